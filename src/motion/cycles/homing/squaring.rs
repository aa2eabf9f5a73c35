//! Squares axes with two motors, between the homing cycle's approach and its pull-off.
//!
//! ```text
//!            locate, both          square, the lagging one       align, the same          pull-off, both
//!   leading  ------->|\            |                             |                     <--------|
//!   lagging  ---->                 ------------>|\               <--/                  <--------|
//! ```
//!
//! The approach ends where the switch of one motor closes. The other motor goes on alone until its own switch closes,
//! and then to where it is as far behind this switch as the leading motor is behind its own: from there on both are
//! equally far from their switches. Motors are left out of the outputs at rest only. How far a gantry may be skewed is
//! Grbl's rule for axes with two motors.

use super::{Homing, HomingStage, LATENCY_TICKS};
use crate::{
    axis::{AXES, Axes},
    machine::Inputs,
    math,
    model::{GANGED_AXES, StandingMotors},
    stepper::Generator,
};

/// Greatest skew: a part of the travel within bounds, mm, as in Grbl 1.1 (`config.h`,
/// `DUAL_AXIS_HOMING_FAIL_...`).
const SKEW_PART: f32 = 0.05;
const LEAST_SKEW_MM: f32 = 2.5;
const GREATEST_SKEW_MM: f32 = 25.0;

/// Returns how far the second switch of an axis is searched behind the first, mm.
fn greatest_skew_mm(travel_mm: f32) -> f32 {
    math::min(
        math::max(SKEW_PART * travel_mm, LEAST_SKEW_MM),
        GREATEST_SKEW_MM,
    )
}

/// An axis that may have two motors.
#[derive(Debug, Clone, Copy)]
struct Gantry {
    /// Whether it has, each with a switch.
    is_ganged: bool,
    /// Where the switches of both motors closed in this approach, steps.
    switches: [Option<i32>; 2],
    /// Where both motors came to rest after it, steps.
    standstill: i32,
}

impl Gantry {
    const NONE: Self = Self {
        is_ganged: false,
        switches: [None; 2],
        standstill: 0,
    };
}

/// The axes that may have two motors: none in firmware for other boards.
#[derive(Debug)]
pub(super) struct Squaring {
    gantries: [Gantry; GANGED_AXES],
}

impl Squaring {
    pub(super) const fn new() -> Self {
        Self {
            gantries: [Gantry::NONE; GANGED_AXES],
        }
    }

    /// Begins a cycle with the axes that have two motors.
    pub(super) fn begin(&mut self, ganged_axes: u8) {
        for (axis, gantry) in self.gantries.iter_mut().enumerate() {
            gantry.is_ganged = ganged_axes >> axis & 1 != 0;
        }
    }

    /// Begins an approach of both motors.
    pub(super) fn begin_approach(&mut self) {
        for gantry in &mut self.gantries {
            gantry.switches = [None; 2];
        }
    }

    /// Returns the axes with two motors, bit 0 = X.
    pub(super) fn axes(&self) -> u8 {
        self.axes_with(|gantry| gantry.is_ganged)
    }

    /// Returns the axes that have two motors and something else, bit 0 = X.
    fn axes_with(&self, holds: impl Fn(&Gantry) -> bool) -> u8 {
        let mut axes = 0;
        for (axis, gantry) in self.gantries.iter().enumerate() {
            axes |= u8::from(gantry.is_ganged && holds(gantry)) << axis;
        }
        axes
    }

    /// Returns a switch of these axes, by its number, that has closed at a position that is not known yet.
    pub(super) fn latched_switch(&self, axes: u8, inputs: &Inputs) -> Option<usize> {
        let open = |second: usize| {
            self.axes_with(|gantry| gantry.switches.get(second).is_some_and(Option::is_none))
        };
        let (first, second) = (axes & open(0), axes & open(1));
        let mut numbers = 0..GANGED_AXES;
        let found = numbers.find(|axis| first >> axis & 1 != 0 && inputs.is_switch_active(*axis));
        let mut numbers = 0..GANGED_AXES;
        let other =
            numbers.find(|axis| second >> axis & 1 != 0 && inputs.is_switch_active(AXES + *axis));
        found.or(other.map(|axis| AXES + axis))
    }

    /// Takes over the position of a switch, by its number.
    pub(super) fn record(&mut self, switch: usize, steps: i32) {
        let (axis, motor) = match switch.checked_sub(AXES) {
            Some(axis) => (axis, 1),
            None => (switch, 0),
        };
        if let Some(gantry) = self.gantries.get_mut(axis)
            && let Some(place) = gantry.switches.get_mut(motor)
        {
            *place = Some(steps);
        }
    }

    /// Takes over the position of an axis at which an approach begins, for switches that are closed there.
    pub(super) fn record_closed(&mut self, axis: usize, steps: i32, inputs: &Inputs) {
        if self.gantries.get(axis).is_some() {
            for switch in [axis, AXES + axis] {
                if inputs.is_switch_active(switch) {
                    self.record(switch, steps);
                }
            }
        }
    }

    /// Returns those of some axes whose motors are not equally far from their switches, bit 0 = X.
    fn skewed_axes(&self, axes: u8) -> u8 {
        axes & self.axes_with(|gantry| gantry.switches[0] != gantry.switches[1])
    }

    /// Returns those of some axes of which one motor has not come to its switch, bit 0 = X.
    fn lagging_axes(&self, axes: u8) -> u8 {
        axes & self.axes_with(|gantry| gantry.switches.contains(&None))
    }

    /// Takes over where both motors have come to rest, and returns the leading motors of these axes, whose switches
    /// are known.
    fn begin_squaring(
        &mut self,
        axes: u8,
        switches: &Axes<i32>,
        standstill: &Axes<i32>,
    ) -> StandingMotors {
        let mut leading = StandingMotors::NONE;
        let places = switches.iter().zip(standstill);
        for (axis, (gantry, (switch, steps))) in self.gantries.iter_mut().zip(places).enumerate() {
            gantry.standstill = *steps;
            let bit = 1 << axis & axes;
            if gantry.switches[0] == Some(*switch) {
                leading.first |= bit;
            } else {
                leading.second |= bit;
            }
        }
        leading
    }

    /// Returns where the lagging motor of an axis is as far behind its switch as the leading one, which stands at
    /// rest behind its own at `switch`; `None` for an axis without a lagging motor.
    fn aligned(&self, axis: usize, switch: i32) -> Option<i32> {
        let gantry = self.gantries.get(axis).filter(|gantry| gantry.is_ganged)?;
        let [Some(first), Some(second)] = gantry.switches else {
            return None;
        };
        let lagging = if first == switch { second } else { first };
        Some(lagging.wrapping_add(gantry.standstill.wrapping_sub(switch)))
    }

    /// Sets the position of these axes back to that of their leading motors.
    fn restore(&self, axes: u8, steps: &mut Axes<i32>) {
        for (axis, (gantry, steps)) in self.gantries.iter().zip(steps.iter_mut()).enumerate() {
            if axes >> axis & 1 != 0 {
                *steps = gantry.standstill;
            }
        }
    }
}

impl Homing {
    /// The axes have been located: gantries that are not square become so.
    pub(super) fn end_approach(&mut self, inputs: &Inputs, generator: &Generator) {
        let skewed = self.squaring.skewed_axes(self.current_axes);
        if skewed == 0 {
            self.enter(HomingStage::PullOff, inputs, generator);
            return;
        }
        let standstill = generator.steps();
        let leading = (self.squaring).begin_squaring(skewed, &self.switches, &standstill);
        if inputs.order_standing(leading) {
            let next = if self.squaring.lagging_axes(self.current_axes) == 0 {
                HomingStage::Align
            } else {
                HomingStage::Square
            };
            self.enter(next, inputs, generator);
        }
    }

    /// The gantries are square: both motors of each go on together.
    pub(super) fn end_squaring(&mut self, inputs: &Inputs, generator: &mut Generator) {
        if inputs.order_standing(StandingMotors::NONE) {
            let mut steps = generator.steps();
            let skewed = self.squaring.skewed_axes(self.current_axes);
            self.squaring.restore(skewed, &mut steps);
            generator.set_steps(steps);
            self.enter(HomingStage::PullOff, inputs, generator);
        }
    }

    /// Returns whether every motor moves with its axis again, at the end of a cycle that has been stopped.
    pub(super) fn do_motors_follow(&self, inputs: &Inputs) -> bool {
        let all_move =
            inputs.standing() == StandingMotors::NONE && inputs.standing_order().is_none();
        all_move
            || self.standstill_ticks >= LATENCY_TICKS && inputs.order_standing(StandingMotors::NONE)
    }

    /// Returns where the lagging motor of an axis goes in this stage, steps.
    pub(super) fn squaring_target(&self, axis: usize) -> Option<i32> {
        let switch = self.switches[axis];
        if self.stage == HomingStage::Align {
            return self.squaring.aligned(axis, switch);
        }
        let is_lagging = self.squaring.lagging_axes(self.current_axes) >> axis & 1 != 0;
        let skew_mm = greatest_skew_mm(self.parameters.travel_mm[axis]);
        let steps = self.parameters.towards_switch(axis, skew_mm);
        is_lagging.then(|| switch.saturating_add(steps))
    }
}
