//! Rules for the motion of a machine, checked at each change of its pins.

use std::collections::VecDeque;

use leadscrew::{
    axis::{AXES, Axes},
    sim::{Edge, Simulator},
    units::{TICKS_PER_MS, TICKS_PER_US},
};

use crate::{pulses::Pulses, setup::Setup};

/// The window over which speeds are measured, and the same in ticks.
const WINDOW_MS: usize = 80;
const WINDOW_TICKS: u64 = TICKS_PER_MS as u64 * WINDOW_MS as u64;
/// The greatest speed of any setup and of what its programs set, mm/min.
const FASTEST_MM_MIN: i32 = 6000;

/// The pins up to now.
pub(crate) struct MotionRules {
    pulses: Pulses,
    /// Steps of each motor since power-up.
    steps: Axes<i32>,
    /// The newest steps of each motor, as many as fit a window at the greatest speed.
    newest: [VecDeque<u64>; AXES],
    /// Number of these steps, including a step at the border of the window.
    steps_in_window: [usize; AXES],
}

impl MotionRules {
    pub(crate) fn new(simulator: &Simulator, setup: Setup) -> Self {
        let steps_in_window = Axes::from_fn(|axis| {
            (FASTEST_MM_MIN * setup.resolution(axis)) as usize * WINDOW_MS / 60_000 + 2
        });
        let pulse_us = simulator.session().settings().step_pulse_us;
        Self {
            pulses: Pulses::new(u64::from(pulse_us) * u64::from(TICKS_PER_US)),
            steps: Axes::all(0),
            newest: Default::default(),
            steps_in_window: steps_in_window.0,
        }
    }

    /// Steps of each motor since power-up.
    pub(crate) fn steps(&self) -> &Axes<i32> {
        &self.steps
    }

    /// Panics if the next edge breaks a rule; `counted` are the pulses that the motors see.
    pub(crate) fn check(&mut self, edge: &Edge, counted: u32) {
        self.pulses.check(edge);
        for (axis, newest) in self.newest.iter_mut().enumerate() {
            if edge.raise >> axis & 1 == 0 {
                continue;
            }
            let is_negative = edge.directions >> axis & 1 != 0;
            if counted >> axis & 1 != 0 {
                self.steps[axis] += if is_negative { -1 } else { 1 };
            }
            newest.push_back(edge.ticks);
            let steps = self.steps_in_window[axis];
            if newest.len() > steps
                && let Some(first) = newest.pop_front()
            {
                let ticks = edge.ticks - first;
                assert!(
                    ticks >= WINDOW_TICKS,
                    "motor {axis} is too fast: {steps} steps in {ticks} ticks"
                );
            }
        }
    }

    /// Panics if a pulse has no end.
    pub(crate) fn check_end(&self) {
        self.pulses.check_end();
    }
}
