//! Phases of motors whose coils the firmware energises itself, in place of a driver with step and direction.
//!
//! A 28BYJ-48 behind a ULN2003 has four coils. A turn of its field has eight phases; from one to the next
//! one coil changes. Full steps pass over the odd phases, in which a single coil is energised:
//!
//! | phase | 0 | 1 | 2 | 3 | 4 | 5 | 6 | 7 |
//! |---|---|---|---|---|---|---|---|---|
//! | IN1 to IN4 | 1100 | 0100 | 0110 | 0010 | 0011 | 0001 | 1001 | 1000 |
//!
//! # Cost
//!
//! For the step interrupt: phases and steps are digits of a word, so that the axes that step are added at once.

use super::StepEvent;
use crate::axis::{AXES, Axes};

/// Coils of a motor.
pub const COILS: usize = 4;
/// Phases of a turn of the field.
pub const PHASES: usize = 8;

/// The coils that are energised in each phase, bit 0 = IN1.
const ENERGISED: [u8; PHASES] = [
    0b0011, 0b0010, 0b0110, 0b0100, 0b1100, 0b1000, 0b1001, 0b0001,
];

/// Bits of a digit: each axis has one.
const DIGIT: u32 = 4;
/// The bits of a phase, in the digits of all axes.
const PHASE_BITS: u32 = in_all(PHASES as u32 - 1);

/// Returns 1 in the digits of some axes, bit 0 = X.
#[inline]
const fn ones_of(axes: u32) -> u32 {
    let (mut digits, mut axis) = (0, 0);
    while axis < AXES as u32 {
        digits |= (axes >> axis & 1) << (DIGIT * axis);
        axis += 1;
    }
    digits
}

/// Returns all bits of the digits of some axes.
#[inline]
const fn digits_of(axes: u32) -> u32 {
    ones_of(axes) * 0xf
}

/// Returns a digit in the place of each axis.
const fn in_all(digit: u32) -> u32 {
    ones_of(u32::MAX) * digit
}

/// The phases of all motors, and how many of them the next step of each passes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Phases {
    phases: u32,
    /// What a step in the direction of each axis adds.
    step: u32,
}

/// How many phases a step in the positive and in the negative direction passes, in the digits of all axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PhaseSteps {
    positive: u32,
    negative: u32,
}

impl PhaseSteps {
    /// Full steps, every direction as it is.
    pub const FULL: Self = Self::new(false, 0);

    /// Returns the steps under the settings `$791`, half steps, and `$3`, axes whose direction is inverted.
    #[must_use]
    pub const fn new(has_half_steps: bool, inverted: u8) -> Self {
        let forwards = if has_half_steps { 1 } else { 2 };
        let (forwards, backwards) = (in_all(forwards), in_all(PHASES as u32 - forwards));
        let inverted = digits_of(inverted as u32);
        Self {
            positive: forwards & !inverted | backwards & inverted,
            negative: backwards & !inverted | forwards & inverted,
        }
    }

    /// Whether a step passes one phase.
    const fn are_half(self) -> bool {
        self.positive & 1 != 0
    }
}

impl Phases {
    /// Returns the phases after power-up: all 0, every direction positive.
    #[must_use]
    pub const fn new(steps: PhaseSteps) -> Self {
        Self {
            phases: 0,
            step: steps.positive,
        }
    }

    /// Returns the phases at rest when the steps change. For full steps an odd phase becomes the next even one: the
    /// motor turns by half a step at most, the position stays.
    #[must_use]
    pub const fn changed(self, from: PhaseSteps, to: PhaseSteps) -> Self {
        // The steps of an axis in its two directions differ in bit 2: 1 and 7, 2 and 6.
        let negative = ((self.step ^ from.positive) >> 2 & in_all(1)) * 0xf;
        let odd = self.phases & in_all(1);
        let by = if to.are_half() { 0 } else { odd };
        Self {
            phases: (self.phases + by) & PHASE_BITS,
            step: to.positive & !negative | to.negative & negative,
        }
    }

    /// Returns the phases after an event: at the beginning of a pulse the motor steps, at its end nothing happens.
    #[inline]
    #[must_use]
    pub const fn after(mut self, event: StepEvent, steps: PhaseSteps) -> Self {
        if let Some(negative) = event.directions() {
            let negative = digits_of(negative as u32);
            self.step = steps.positive & !negative | steps.negative & negative;
        } else {
            let stepping = digits_of(event.raise());
            self.phases = (self.phases + (self.step & stepping)) & PHASE_BITS;
        }
        self
    }

    /// Returns the phase of an axis, below [`PHASES`].
    #[inline]
    #[must_use]
    pub const fn phase(self, axis: usize) -> usize {
        (self.phases >> (DIGIT * axis as u32)) as usize % PHASES
    }

    /// Returns the coils that are energised, bit 0 = IN1, for each axis.
    #[must_use]
    pub fn coils(self) -> Axes<u8> {
        Axes::from_fn(|axis| coils(self.phase(axis)))
    }
}

/// The phases of the motors, and the phases after the event that is set up: an event that is given up turns no motor.
#[derive(Debug)]
pub struct PhaseDrive {
    phases: Phases,
    next: Phases,
    steps: PhaseSteps,
}

impl PhaseDrive {
    /// Returns the drive after power-up: full steps, directions as they are.
    #[must_use]
    pub const fn new() -> Self {
        let steps = PhaseSteps::FULL;
        Self {
            phases: Phases::new(steps),
            next: Phases::new(steps),
            steps,
        }
    }

    /// Sets up an event, and returns the phases after it.
    #[inline]
    pub const fn set_up(&mut self, event: StepEvent) -> Phases {
        self.next = self.phases.after(event, self.steps);
        self.next
    }

    /// The event that is set up is output.
    #[inline]
    pub const fn output(&mut self) {
        self.phases = self.next;
    }

    /// The event that is set up will not be output.
    #[inline]
    pub const fn give_up(&mut self) {
        self.next = self.phases;
    }

    /// Returns the phases that are output.
    #[must_use]
    pub const fn phases(&self) -> Phases {
        self.phases
    }

    /// Takes over what steps do. At rest only.
    pub fn configure(&mut self, steps: PhaseSteps) {
        self.phases = self.phases.changed(self.steps, steps);
        self.next = self.phases;
        self.steps = steps;
    }
}

impl Default for PhaseDrive {
    fn default() -> Self {
        Self::new()
    }
}

/// Returns the coils that are energised in a phase, bit 0 = IN1.
#[must_use]
pub const fn coils(phase: usize) -> u8 {
    ENERGISED[phase % PHASES]
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::{string::String, vec::Vec};

    use super::*;

    const X: u32 = 1;
    const FULL: PhaseSteps = PhaseSteps::FULL;
    const HALF: PhaseSteps = PhaseSteps::new(true, 0);
    const FORWARDS: StepEvent = StepEvent::set_directions(9, 0);
    const BACKWARDS: StepEvent = StepEvent::set_directions(9, X as u8);

    /// The pattern of X as people write it: IN1 first.
    fn pattern(phases: Phases) -> String {
        let coils = phases.coils()[0];
        (0..COILS)
            .map(|coil| if coils >> coil & 1 != 0 { '1' } else { '0' })
            .collect()
    }

    /// Steps X, and returns the patterns.
    fn play(phases: &mut Phases, by: PhaseSteps, steps: usize) -> Vec<String> {
        let step = |_| {
            *phases = phases.after(StepEvent::new(9, X, 0), by);
            let standing = phases.after(StepEvent::new(9, 0, X), by);
            assert_eq!(standing, *phases, "the end of a pulse");
            pattern(*phases)
        };
        (0..steps).map(step).collect()
    }

    #[test]
    fn nine_full_steps_and_one_back_pass_the_patterns_of_the_motor() {
        let mut phases = Phases::new(FULL);
        assert_eq!(pattern(phases), "1100");
        let patterns = [
            "0110", "0011", "1001", "1100", "0110", "0011", "1001", "1100", "0110",
        ];
        assert_eq!(play(&mut phases, FULL, 9), patterns);
        assert_eq!(phases.phase(0), 2 * 9 % 8);
        phases = phases.after(BACKWARDS, FULL);
        assert_eq!(play(&mut phases, FULL, 1), ["1100"]);
    }

    #[test]
    fn half_steps_change_one_coil_and_full_steps_two_at_most() {
        for (steps, per_turn, most) in [(FULL, 2048, 2), (HALF, 4096, 1)] {
            for direction in [FORWARDS, BACKWARDS] {
                let start = Phases::new(steps).after(direction, steps);
                let mut phases = start;
                for _ in 0..per_turn {
                    let before = phases.coils()[0];
                    play(&mut phases, steps, 1);
                    let after = phases.coils()[0];
                    assert!((before ^ after).count_ones() <= most);
                    assert!(matches!(after.count_ones(), 1 | 2));
                }
                assert_eq!(phases, start, "a turn of the shaft");
            }
        }
    }

    #[test]
    fn inverted_directions_reverse_the_order() {
        for half in [false, true] {
            let [plain, inverted] = [0, X as u8].map(|axes| PhaseSteps::new(half, axes));
            let mut forwards = Phases::new(plain);
            let mut reversed = Phases::new(inverted).after(BACKWARDS, inverted);
            assert_eq!(
                play(&mut forwards, plain, 20),
                play(&mut reversed, inverted, 20)
            );
            let again = reversed.changed(inverted, plain).after(FORWARDS, plain);
            assert_eq!(again, forwards);
        }
    }

    #[test]
    fn a_change_of_the_settings_keeps_phase_and_direction() {
        let mut phases = Phases::new(HALF).after(BACKWARDS, HALF);
        play(&mut phases, HALF, 3);
        assert_eq!(pattern(phases), "0001");
        let mut full = phases.changed(HALF, FULL);
        assert_eq!(pattern(full), "1001", "the next even phase");
        assert_eq!(play(&mut full, FULL, 1), ["0011"], "and still backwards");
        assert_eq!(phases.changed(HALF, HALF), phases);
        let mut odd = phases.after(FORWARDS, HALF);
        play(&mut odd, HALF, 2);
        assert_eq!((odd.phase(0), odd.changed(HALF, FULL).phase(0)), (7, 0));
    }

    #[test]
    fn an_event_that_is_given_up_turns_no_motor() {
        let step = StepEvent::new(9, X, 0);
        let mut drive = PhaseDrive::new();
        drive.set_up(step);
        drive.output();
        let before = drive.phases();
        drive.set_up(BACKWARDS);
        drive.give_up();
        drive.set_up(step);
        drive.give_up();
        drive.output();
        assert_eq!(drive.phases(), before);
        assert_eq!(drive.set_up(step), before.after(step, FULL));
    }

    #[test]
    fn each_axis_steps_by_itself() {
        let all = (1 << AXES) - 1;
        let mut phases = Phases::new(FULL);
        for raise in 0..=all {
            for directions in [0, all as u8, 0b101_0101 & all as u8] {
                let before = phases;
                phases = phases
                    .after(StepEvent::set_directions(1, directions), FULL)
                    .after(StepEvent::new(1, raise, 0), FULL);
                for axis in 0..AXES {
                    let is_stepping = raise >> axis & 1 != 0;
                    let by = if directions >> axis & 1 == 0 { 2 } else { 6 };
                    let step = if is_stepping { by } else { 0 };
                    assert_eq!(phases.phase(axis), (before.phase(axis) + step) % PHASES);
                }
            }
        }
    }
}
