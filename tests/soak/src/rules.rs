//! Rules for the motion of a machine, checked at each change of its pins.

use std::collections::VecDeque;

use leadscrew::{
    axis::{AXES, Axes},
    sim::{Edge, Simulator},
    units::{TICKS_PER_MS, TICKS_PER_US},
};

use crate::{pulses::Pulses, setup::STEPS_PER_MM};

/// The window over which speeds are measured, and the same in ticks.
const WINDOW_MS: usize = 80;
const WINDOW_TICKS: u64 = TICKS_PER_MS as u64 * WINDOW_MS as u64;
/// The greatest speed of any setup and of what its programs set, mm/min.
const FASTEST_MM_MIN: i32 = 6000;
/// Steps in a window at that speed, and one more that lies at its border.
const STEPS_IN_WINDOW: usize = (FASTEST_MM_MIN * STEPS_PER_MM) as usize * WINDOW_MS / 60_000 + 2;

/// The pins up to now.
pub(crate) struct MotionRules {
    pulses: Pulses,
    /// Steps of each motor since power-up.
    steps: Axes<i32>,
    /// The newest steps of each motor, as many as fit a window at the greatest speed.
    newest: [VecDeque<u64>; AXES],
}

impl MotionRules {
    pub(crate) fn new(simulator: &Simulator) -> Self {
        let pulse_us = simulator.session().settings().step_pulse_us;
        Self {
            pulses: Pulses::new(u64::from(pulse_us) * u64::from(TICKS_PER_US)),
            steps: Axes::all(0),
            newest: Default::default(),
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
            if newest.len() > STEPS_IN_WINDOW
                && let Some(first) = newest.pop_front()
            {
                let ticks = edge.ticks - first;
                assert!(
                    ticks >= WINDOW_TICKS,
                    "motor {axis} is too fast: {STEPS_IN_WINDOW} steps in {ticks} ticks"
                );
            }
        }
    }

    /// Panics if a pulse has no end.
    pub(crate) fn check_end(&self) {
        self.pulses.check_end();
    }
}
