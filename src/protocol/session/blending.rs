//! What `G64` holds back of the program, and when the machine gets it.
//!
//! A line waits for the one after it, as what becomes of it depends on that; but never longer than
//! the machine has something to do. It goes to the machine when anything else than a line comes,
//! when something has to wait for standstill, and, while no line comes, when the machine would soon
//! begin to brake for the end of the motion that it knows of.

use heapless::spsc::Producer;

use super::{Session, Source};
use crate::{
    machine::Snapshot,
    model::{PathControl, State},
    path::{Entry, Work},
    protocol::report,
};

/// More entries than that keep the machine busy, whatever they are.
const FEW: u32 = 8;
/// Time for what is held back to reach the machine, s: what is made in advance, and the line.
const LEAD_S: f32 = 0.03;

impl Session {
    /// How the moves of the line in execution follow each other: jogs keep to their path.
    pub(super) fn path_control(&self) -> PathControl {
        if self.source == Source::Jog {
            PathControl::ExactPath
        } else {
            self.interpreter.modal().path
        }
    }

    /// Forgets what a machine would not execute that is locked, or has ended a motion early.
    pub(super) fn drop_void(&mut self, machine: &Snapshot) {
        if machine.state == State::Alarm || machine.cancelled_motions != self.cancelled_motions {
            self.path.clear();
        }
    }

    /// Sends on what is held back, as far as there is room.
    pub(super) fn release(&mut self, entries: &mut Producer<'_, Entry>) {
        if self.path.has_pending() {
            self.router.flush(&mut self.path);
            self.drain(entries);
        }
    }

    /// Whether everything before the line in execution has been done. What is held back is not, and
    /// is sent on; but where it makes no step, nobody will tell of its end.
    pub(super) fn comes_to_rest(
        &mut self,
        machine: &Snapshot,
        entries: &mut Producer<'_, Entry>,
    ) -> bool {
        self.release(entries);
        self.is_done(machine)
    }

    /// Sends on what is held back, if the machine could use it.
    pub(super) fn release_in_time(
        &mut self,
        machine: &Snapshot,
        entries: &mut Producer<'_, Entry>,
    ) {
        if self.path.has_pending() {
            self.release_if_near(machine, entries);
        }
    }

    /// Apart, as what is ready is: its registers are saved only where something is held back.
    #[inline(never)]
    fn release_if_near(&mut self, machine: &Snapshot, entries: &mut Producer<'_, Entry>) {
        let left = self.entered.wrapping_sub(machine.finished);
        let is_near = left < FEW && self.router.distance_from_mm(&machine.steps) <= self.stop_mm;
        if left == 0 || is_near {
            self.router.flush(&mut self.path);
        }
        self.drain(entries);
    }

    /// Tells how far the program's path was left, if it was.
    pub(super) fn tell_deviation(&mut self) {
        let deviation_mm = self.path.take_deviation_mm();
        if deviation_mm > 0.0 {
            report::path_deviation(&mut self.message, deviation_mm);
        }
    }

    /// Sends what is ready; false when there is no room for all of it.
    #[inline]
    pub(super) fn drain(&mut self, entries: &mut Producer<'_, Entry>) -> bool {
        self.path.front().is_none() || self.drain_ready(entries)
    }

    /// Apart, so that a line under `G61` does not pay for it.
    #[inline(never)]
    fn drain_ready(&mut self, entries: &mut Producer<'_, Entry>) -> bool {
        while let Some(way) = self.path.front() {
            if !entries.ready() {
                return false;
            }
            let mut entry = self.entry();
            self.router.set_exact_stop(false);
            if self.router.route_blended(way, &mut entry.work) {
                if let Work::Move(block) = &entry.work {
                    let speed = block.limit_mm_s.min(block.programmed_mm_s);
                    let braking_s = 0.5 * speed / block.acceleration_mm_s2;
                    self.stop_mm = speed * (braking_s + LEAD_S);
                }
                if entries.enqueue(entry).is_ok() {
                    self.entered = self.entered.wrapping_add(1);
                }
            }
            self.path.dequeue();
        }
        true
    }
}
