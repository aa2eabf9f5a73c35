//! The steps of an arc in whole steps: in their order, also where an axis reverses within the segment.

use super::{DIRECTION_SETUP_SLOTS, Generator, is_not_before};
use crate::{
    model::timing::{ARC_STEPS_PER_S, MAX_SEGMENT_TICKS, PULSE_LOW_SLOTS, SLOT_TICKS, pulse_slots},
    stepper::{ArcProgress, ArcStep, ArcSteps, AxisMotion, StepArc},
    units::{FineSteps, TICKS_PER_US},
};

/// Bounds the steps of a segment. On the longest one at [`ARC_STEPS_PER_S`] the path has the length of 2.25 steps, and
/// the steps of each axis are the length of one apart.
pub const MAX_ARC_STEPS: usize = 6;
const _: () = assert!(
    ARC_STEPS_PER_S / 2 * (MAX_SEGMENT_TICKS / TICKS_PER_US)
        < (MAX_ARC_STEPS as u32 / 2) * 1_000_000
);
/// Bounds the changes of direction behind the first step in a segment: each axis makes three steps at most.
/// `an_arc_makes_few_steps_and_reverses_seldom_within_a_segment` tests it.
const MAX_REVERSALS: u32 = 4;
/// Bounds the parts of these steps without a reversal.
pub const MAX_ARC_STRETCHES: u32 = MAX_REVERSALS + 1;

/// The arc in whole steps, if there is one.
#[derive(Debug)]
pub(super) struct ArcInSegments {
    /// Where the steps of the segments end on it.
    progress: ArcProgress,
    /// The steps of the arc in the segment that begins next.
    next: Option<ArcSteps>,
    /// Axes that the segment moves by the arc, bit 0 = X.
    axes: u8,
    /// Steps of the segment that have no events yet.
    count: usize,
    steps: [ArcStep; MAX_ARC_STEPS],
}

impl ArcInSegments {
    pub(super) const NONE: Self = Self {
        progress: ArcProgress::NONE,
        next: None,
        axes: 0,
        count: 0,
        steps: [ArcStep::NONE; MAX_ARC_STEPS],
    };

    /// Whether the segment has steps of the arc.
    pub(super) const fn has_steps(&self) -> bool {
        self.count != 0
    }

    /// Discards the steps of the segment.
    pub(super) const fn clear_steps(&mut self) {
        self.count = 0;
    }

    /// Returns a step of the segment.
    fn step(&self, number: usize) -> Option<ArcStep> {
        (number < self.count)
            .then(|| self.steps.get(number).copied())
            .flatten()
    }

    /// Returns the motion of an axis at a position besides the arc: an axis of the arc has none.
    pub(super) fn motion_off_arc(
        &self,
        axis: usize,
        position: FineSteps,
        motion: AxisMotion,
    ) -> AxisMotion {
        if self.axes >> axis & 1 == 0 {
            return motion;
        }
        AxisMotion {
            to: position,
            acceleration: 0.0,
        }
    }
}

impl Generator {
    /// Goes on to the start of an arc in whole steps, at the end of the last segment.
    #[inline(never)]
    pub fn enter_arc(&mut self, arc: &StepArc) {
        self.arc.progress.enter(arc);
    }

    /// Sets which steps of the arc the next segment makes, before it begins: none, if it is of something else.
    pub fn set_arc_steps(&mut self, steps: Option<ArcSteps>) {
        self.arc.next = steps;
    }

    /// Begins the steps of the arc in the segment, behind others in `directions`. Returns the directions at its
    /// beginning.
    #[inline(never)]
    pub(super) fn begin_arc(&mut self, mut directions: u8) -> u8 {
        self.arc.count = 0;
        let Some(segment) = self.arc.next.take() else {
            self.arc.axes = 0;
            return directions;
        };
        let arc = &mut self.arc;
        arc.axes = arc.progress.axes();
        let (mut last, mut known, mut reversals) = (directions, 0, 0);
        for place in &mut arc.steps {
            let Some(step) = arc.progress.take_step(&segment) else {
                break;
            };
            *place = step;
            arc.count += 1;
            let bit = 1 << step.axis;
            let level = u8::from(step.is_negative) << step.axis;
            if known & bit == 0 {
                known |= bit;
                directions = directions & !bit | level;
            } else if last & bit != level {
                reversals += 1;
            }
            last = last & !bit | level;
            if let Some(position) = self.position.0.get_mut(step.axis) {
                *position = after(*position, step.is_negative);
            }
        }
        debug_assert!(!arc.progress.is_due(&segment), "steps are left");
        debug_assert!(reversals <= MAX_REVERSALS, "{reversals} reversals");
        self.max_events += 2 * arc.count as u32 + reversals;
        self.moving_axes |= u32::from(known);
        directions
    }

    /// Adds the steps of the arc to the slots behind those of all other axes: each later than the one before.
    #[inline(never)]
    pub(super) fn add_arc_steps(&mut self) {
        let mut free = self.first_slot.cast_signed();
        let mut number = 0;
        // wcet-bound: MAX_ARC_STRETCHES: before each of four reversals, and behind the last
        while let Some(step) = self.arc.step(number) {
            free = self.change_direction(step, free);
            (number, free) = self.add_arc_steps_up_to_reversal(number, free);
        }
        self.arc.count = 0;
        debug_assert!(is_not_before(
            self.base_slot.wrapping_add(free.cast_unsigned()),
            self.base_slot
        ));
    }

    /// Adds the change of direction before a step, if there is one, in the slot `free` or behind it. Returns the
    /// first slot for the step.
    fn change_direction(&mut self, step: ArcStep, free: i32) -> i32 {
        let bit = 1 << step.axis;
        let end = self.pulse_end_slots.get(step.axis);
        let Some(end) = end.filter(|_| (self.directions & bit != 0) != step.is_negative) else {
            return free;
        };
        let pulse_end = end.wrapping_sub(self.base_slot).cast_signed();
        self.directions ^= bit;
        let from = free.max(pulse_end + 1).cast_unsigned();
        let slot =
            (self.slots).add_direction_change(self.base_slot.wrapping_add(from), self.directions);
        slot.wrapping_sub(self.base_slot).cast_signed() + DIRECTION_SETUP_SLOTS.cast_signed()
    }

    /// Adds steps from a number on, in the slot `free` and after it, up to a step with another direction. Returns the
    /// number of this step, and the slot after the last added one.
    fn add_arc_steps_up_to_reversal(&mut self, mut number: usize, mut free: i32) -> (usize, i32) {
        let base = self.base_slot;
        let pulse = pulse_slots(self.pulse_ticks);
        // wcet-bound: MAX_ARC_STEPS, wcet-total: MAX_ARC_STEPS per add_arc_steps: the segment has no more steps of the arc
        while let Some(step) = self.arc.step(number) {
            let bit = 1_u32 << step.axis;
            let is_reversed = (u32::from(self.directions) & bit != 0) != step.is_negative;
            let end = self.pulse_end_slots.get_mut(step.axis);
            let Some(end) = end.filter(|_| !is_reversed) else {
                break;
            };
            let pulse_end = end.wrapping_sub(base).cast_signed();
            let mut earliest = free.max(pulse_end + PULSE_LOW_SLOTS.cast_signed());
            if self.reversing_axes & bit != 0 {
                earliest = earliest.max(self.first_slot_reversing.cast_signed());
            }
            let earliest = earliest.cast_unsigned();
            let time = self.offset_ticks + step.ticks;
            let (mut slot, mut ticks) = (time / SLOT_TICKS, time % SLOT_TICKS);
            if slot < earliest {
                (slot, ticks) = (earliest, 0);
            }
            let at = base.wrapping_add(slot);
            self.slots.add_step(at, bit, ticks);
            *end = at.wrapping_add(pulse);
            self.slots.add_pulse_end(*end, bit);
            self.last_step_slot = self.last_step_slot.max(slot);
            free = slot.cast_signed() + 1;
            number += 1;
        }
        (number, free)
    }

    /// Takes the steps of the arc that will not be made off the position.
    #[inline(never)]
    pub(super) fn withdraw_arc(&mut self) {
        for number in 0..self.arc.steps.len() {
            let Some(step) = self.arc.step(number) else {
                break;
            };
            if let Some(position) = self.position.0.get_mut(step.axis) {
                *position = after(*position, !step.is_negative);
            }
        }
        self.arc.count = 0;
    }
}

/// Returns a position after a step.
const fn after(position: FineSteps, is_negative: bool) -> FineSteps {
    let step = if is_negative {
        -FineSteps::ONE
    } else {
        FineSteps::ONE
    };
    FineSteps(position.0.wrapping_add(step))
}
