//! Backlash, `$160`…: how far a motor turns before its axis follows.
//!
//! ```text
//!   motor = axis + lead     0 ≤ lead ≤ backlash: none of it after a negative move, all of it after a positive one
//! ```
//!
//! Before an axis moves in another direction, its motor takes up the backlash, in a move of its own. The generator's
//! position is the axes' position: motor travel without the axes is taken off, segment by segment. Before homing, an
//! axis counts as moved last as by its pull-off, as in grblHAL.

use super::{Activity, Motion};
use crate::{
    axis::{AXES, Axes, Z},
    machine::Event,
    model::{State, timing::MAX_SEGMENT_TICKS},
    motion::{
        cycles::{
            cycle_move::{CycleLimits, CycleMove},
            parking::ZBacklash,
        },
        executor::Goal,
    },
    path::TakeUp,
    settings::Settings,
    stepper::{Generator, Segment},
};

/// The backlash of each axis, and where in it the motors are.
#[derive(Debug)]
pub(super) struct Backlash {
    /// Backlash of each axis, steps.
    steps: Axes<i32>,
    /// How far the motor of each axis is ahead in the positive direction, steps.
    lead: Axes<i32>,
    /// Axes whose pull-off is positive, bit 0 = X.
    positive_pull_off: u8,
    /// Position of the generator that has been followed, steps.
    followed: Axes<i32>,
}

impl Backlash {
    pub(super) const fn new() -> Self {
        Self {
            steps: Axes([0; AXES]),
            lead: Axes([0; AXES]),
            positive_pull_off: 0,
            followed: Axes([0; AXES]),
        }
    }

    /// Takes over the settings, at a standstill: the direction in which an axis has moved last stays.
    pub(super) fn configure(&mut self, settings: &Settings) {
        self.positive_pull_off = settings.homing_direction;
        for axis in 0..AXES {
            let before = self.steps[axis];
            self.steps[axis] = settings.backlash_steps(axis);
            if before == 0 {
                self.pull_off(axis);
            } else if self.lead[axis] >= before {
                self.lead[axis] = self.steps[axis];
            } else {
                self.lead[axis] = self.lead[axis].min(self.steps[axis]);
            }
        }
    }

    /// An axis has moved last as by the pull-off of homing.
    fn pull_off(&mut self, axis: usize) {
        let is_positive = self.positive_pull_off >> axis & 1 != 0;
        self.lead[axis] = if is_positive { self.steps[axis] } else { 0 };
    }

    /// These axes have been homed, bit 0 = X.
    pub(super) fn home(&mut self, axes: u8) {
        for axis in 0..AXES {
            if axes >> axis & 1 != 0 {
                self.pull_off(axis);
            }
        }
    }

    /// Returns where the motor of Z is in its backlash.
    pub(super) fn of_z(&self) -> ZBacklash {
        ZBacklash {
            steps: self.steps[Z],
            lead: self.lead[Z],
        }
    }

    /// Begins to follow the motors from where they are.
    pub(super) fn begin(&mut self, generator: &Generator) {
        self.followed = generator.steps();
    }

    /// Takes what the motors have moved without their axes off the position and off where the move of them begins.
    #[inline(never)]
    pub(super) fn follow(&mut self, generator: &mut Generator, of_motors: &mut CycleMove) {
        let motors = generator.steps();
        for axis in 0..AXES {
            let moved = motors[axis].wrapping_sub(self.followed[axis]);
            let lead = self.lead[axis].saturating_add(moved);
            let lead = lead.min(self.steps[axis]).max(0);
            let alone = lead.wrapping_sub(self.lead[axis]);
            self.lead[axis] = lead;
            self.followed[axis] = motors[axis].wrapping_sub(alone);
            generator.move_back(axis, alone);
            of_motors.move_back(axis, alone);
        }
    }
}

/// The move of motors that take up backlash.
#[derive(Debug)]
pub(super) struct TakeUpMove {
    limits: CycleLimits,
    of_motors: CycleMove,
    /// A jog follows.
    pub(super) is_jog: bool,
}

impl TakeUpMove {
    pub(super) const fn new() -> Self {
        Self {
            limits: CycleLimits::NONE,
            of_motors: CycleMove::new(),
            is_jog: false,
        }
    }

    /// Takes over the settings.
    pub(super) fn configure(&mut self, settings: &Settings) {
        self.limits.configure(settings);
    }
}

impl Motion {
    /// Whether backlash is taken up.
    #[inline]
    pub(super) const fn takes_up_backlash(&self) -> bool {
        matches!(self.activity, Activity::TakeUp)
    }

    /// Begins to take up the backlash of axes that are about to move. The plan is empty, and its last segment made.
    #[inline(never)]
    pub(super) fn begin_take_up(&mut self, take_up: TakeUp) {
        let mut delta = Axes([0; AXES]);
        for axis in 0..AXES {
            let (backlash, lead) = (self.backlash.steps[axis], self.backlash.lead[axis]);
            let ahead = if take_up.positive >> axis & 1 != 0 {
                backlash
            } else if take_up.negative >> axis & 1 != 0 {
                0
            } else {
                lead
            };
            delta[axis] = i64::from(ahead.wrapping_sub(lead)) << 32;
        }
        (self.take_up.of_motors).begin(delta, f32::MAX, &self.take_up.limits);
        if self.take_up.of_motors.is_active() && self.control.state != State::Alarm {
            self.take_up.is_jog = take_up.is_jog;
            self.backlash.begin(&self.generator);
            self.activity = Activity::TakeUp;
            self.go_on_taking_up();
        } else {
            self.finish_entries(1);
        }
    }

    /// Leaves the idle state for the move, where it is not held.
    pub(super) fn go_on_taking_up(&mut self) {
        self.delays.disables_drivers = false;
        let is_jog = self.take_up.is_jog;
        let event = if is_jog { Event::Jog } else { Event::Move };
        self.control = self.control.after(event).0;
    }

    /// Makes the next segment of taking up backlash: a laser is dark, as nothing is to be burnt.
    #[inline(never)]
    pub(super) fn take_up_segment(&mut self) -> bool {
        let of_motors = &mut self.take_up.of_motors;
        self.backlash.follow(&mut self.generator, of_motors);
        let goal = if self.executes() {
            Goal::Run
        } else {
            Goal::Stop
        };
        let position = self.generator.position();
        if !self.take_up.of_motors.is_active() {
            // The run that ends a move makes none of the segments of the next. With a short one this is as long as two.
            self.segment = Segment::standstill(MAX_SEGMENT_TICKS, position);
            self.activity = Activity::Path;
            self.finish_entries(1);
            // The move behind it is what leaves a contact.
            self.left_contact_in = self.left_contact_in.map(|entries| entries.wrapping_add(1));
        } else if !(self.take_up.of_motors).next(position, goal, &mut self.segment) {
            return false;
        }
        self.segment.power = self.dark_power();
        self.enable_drivers();
        true
    }

    /// Whether there is a segment of taking up backlash.
    pub(super) fn has_take_up_segment(&self) -> bool {
        self.executes() || self.take_up.of_motors.is_moving()
    }
}
