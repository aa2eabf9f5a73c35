//! How the steps of an axis get into the slots of a segment.

use super::{
    axis_steps::AxisSteps,
    slots::{SLOT_TICKS, Slots},
};

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
    /// Puts steps at an even pace.
    #[inline(never)]
    pub(super) fn put_evenly(&mut self, slots: &mut Slots, steps: &AxisSteps) {
        self.put(slots, steps, AxisSteps::advance_evenly);
    }

    /// Puts steps whose times have to be solved for.
    #[inline(never)]
    pub(super) fn put_exactly(&mut self, slots: &mut Slots, steps: &AxisSteps) {
        self.put(slots, steps, AxisSteps::advance_exactly);
    }

    /// Two loops come of this, each so short that it stays in the instruction cache beside the
    /// tasks that interrupt it most.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "see above")]
    fn put(&mut self, slots: &mut Slots, steps: &AxisSteps, advance: impl Fn(&mut AxisSteps)) {
        let mut left = *steps;
        let (mut slot, mut earliest) = (0, self.earliest);
        // wcet-bound: segment_steps, wcet-total: segment_steps
        while left.left != 0 {
            let time = self.offset + left.next;
            slot = time / SLOT_TICKS;
            let mut ticks = time % SLOT_TICKS;
            if slot < earliest {
                (slot, ticks) = (earliest, 0);
            }
            let at = self.base.wrapping_add(slot);
            slots.step(at, self.mask, ticks);
            slots.make_way(at, self.stop, ticks);
            slots.end(at.wrapping_add(self.pulse), self.mask);
            earliest = slot + self.pulse + self.low;
            advance(&mut left);
        }
        (self.slot, self.earliest) = (slot, earliest);
    }
}
