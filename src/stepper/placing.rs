//! How the steps of an axis get into the slots of a segment.

use crate::model::timing::SLOT_TICKS;

use super::{
    slots::{SLOTS, Slots},
    step_times::{AxisSteps, TIME_FRACTION_BITS},
};

/// Where the slot begins in a time with [`EVEN_BITS`] binary places; the ticks in it are below. Above
/// are as many bits as tell slots apart.
const SLOT_SHIFT: u32 = TIME_FRACTION_BITS + SLOT_TICKS.ilog2();
const _: () = assert!(SLOTS == 1 << (32 - SLOT_SHIFT));

/// Where the steps of an axis are put. Slots are counted from the one that the segment begins in.
pub(super) struct Placing {
    /// The slot that the segment begins in, and how many ticks after that slot.
    pub(super) base: u32,
    pub(super) offset: u32,
    /// The axis, and the axes that need not make way for it.
    pub(super) mask: u32,
    pub(super) stop: u32,
    /// From a step to the end of its pulse, and from there to the next step at least.
    pub(super) pulse: u32,
    pub(super) low: u32,
    /// The first slot in which the next step may be, and that of the last step.
    pub(super) earliest: u32,
    pub(super) slot: u32,
}

impl Placing {
    /// Puts steps at an even pace, later where they have to be.
    #[inline(never)]
    pub(super) fn put_evenly(&mut self, slots: &mut Slots, steps: &AxisSteps) {
        self.put(slots, steps, AxisSteps::advance_periodic);
    }

    /// Puts steps at an even pace, each where it is: see [`AxisSteps::is_apart`]. The first one may
    /// be there.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "two loops come of this, too")]
    fn put_apart(
        &mut self,
        slots: &mut Slots,
        steps: &AxisSteps,
        make_way: impl Fn(&mut Slots, u32),
    ) {
        // The slot and the ticks in it are in one word, which wraps as slots do.
        let begin = (self.offset << TIME_FRACTION_BITS).wrapping_add(self.base << SLOT_SHIFT);
        let period = steps.period_fixed;
        let mut fine = begin.wrapping_add(steps.time_fixed);
        let end = fine.wrapping_add(period.wrapping_mul(steps.remaining));
        let (mask, pulse) = (self.mask, self.pulse);
        let mut put = |fine: u32| {
            let slot = fine >> SLOT_SHIFT;
            slots.add_step(slot, mask, fine >> TIME_FRACTION_BITS);
            make_way(slots, fine);
            slots.add_pulse_end(slot + pulse, mask);
        };
        // wcet-bound: segment_steps, wcet-total: segment_steps
        while fine != end {
            put(fine);
            fine = fine.wrapping_add(period);
        }
        let last = end.wrapping_sub(period) >> SLOT_SHIFT;
        self.slot = last.wrapping_sub(self.base) % SLOTS;
        self.earliest = self.slot + self.pulse + self.low;
    }

    /// Puts the steps of an axis that nothing makes way for.
    #[inline(never)]
    pub(super) fn put_behind(&mut self, slots: &mut Slots, steps: &AxisSteps) {
        self.put_apart(slots, steps, |_, _| ());
    }

    /// Puts the steps of the axis that what happens to others makes way for.
    #[inline(never)]
    pub(super) fn put_ahead(&mut self, slots: &mut Slots, steps: &AxisSteps) {
        let stop = self.stop;
        self.put_apart(slots, steps, |slots, fine| {
            let slot = fine >> SLOT_SHIFT;
            if slots.is_occupied(slot.wrapping_sub(1)) {
                slots.move_neighbours_earlier_out_of_line(
                    slot,
                    stop,
                    (fine >> TIME_FRACTION_BITS) % SLOT_TICKS,
                );
            }
        });
    }

    /// Puts steps whose times have to be solved for.
    #[inline(never)]
    pub(super) fn put_exactly(&mut self, slots: &mut Slots, steps: &AxisSteps) {
        self.put(slots, steps, AxisSteps::advance_solved);
    }

    /// Two loops come of this, each so short that it stays in the instruction cache beside the
    /// tasks that interrupt it most.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "see above")]
    fn put(&mut self, slots: &mut Slots, steps: &AxisSteps, advance: impl Fn(&mut AxisSteps)) {
        let mut left = *steps;
        let (mut slot, mut earliest) = (0, self.earliest);
        // wcet-bound: segment_steps, wcet-total: segment_steps
        while left.remaining != 0 {
            let time = self.offset + left.next_ticks;
            slot = time / SLOT_TICKS;
            let mut ticks = time % SLOT_TICKS;
            if slot < earliest {
                (slot, ticks) = (earliest, 0);
            }
            let at = self.base.wrapping_add(slot);
            slots.add_step(at, self.mask, ticks);
            slots.move_neighbours_earlier(at, self.stop, ticks);
            slots.add_pulse_end(at.wrapping_add(self.pulse), self.mask);
            earliest = slot + self.pulse + self.low;
            advance(&mut left);
        }
        (self.slot, self.earliest) = (slot, earliest);
    }
}
