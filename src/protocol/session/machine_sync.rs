//! What the session knows of the machine: entries sent and done, resets acted on, the position.

use heapless::spsc::Producer;

use super::queued_duration::QueuedDuration;
use crate::{
    machine::Snapshot,
    path::{Entry, Work},
};

/// How far the session and the machine are in step: the interpreter runs ahead of the motion.
#[derive(Debug, Default)]
pub(super) struct MachineSync {
    /// Number of entries sent so far, wrapping.
    pub(super) entered: u32,
    /// The reset that the session has acted on.
    pub(super) reset_count: u32,
    /// Number of motions that ended before their target, as far as the position is known.
    pub(super) cancelled_motions: u32,
    /// Whether the interpreter knows the position of the machine.
    pub(super) is_position_known: bool,
    /// Whether the entries that are not done are jogs.
    pub(super) is_jogging: bool,
    /// `prepare` has to run: a reset or another request was made here.
    pub(super) has_release_request: bool,
    /// The next line of the program follows a refused one, and the machine is held before it: `$796`.
    pub(super) follows_refused: bool,
    /// Distance before the end of the last blended move at which the machine must know more, mm.
    pub(super) handover_mm: f32,
    /// A command waits until what has been sent lasts no longer than `$797`.
    pub(super) waits_for_time: bool,
    /// How long what has been sent lasts.
    duration: QueuedDuration,
}

impl MachineSync {
    /// Returns whether every entry has been done.
    pub(super) fn has_finished(&self, machine: &Snapshot) -> bool {
        machine.finished == self.entered
    }

    /// Returns whether the machine has ended a motion early, and the position is not yet known again.
    pub(super) fn is_cancelled(&self, machine: &Snapshot) -> bool {
        machine.cancelled_motions != self.cancelled_motions
    }

    /// Returns the number by which `prepare` knows an entry made before a reset or a cancelled motion.
    pub(super) fn cancellation_count(&self) -> u32 {
        self.reset_count.wrapping_add(self.cancelled_motions)
    }

    /// Sends work; `end_ms` is the duration of all moves so far, its own included. The caller has made sure of room;
    /// after standstill the queue is empty.
    pub(super) fn send(&mut self, work: Work, end_ms: u32, entries: &mut Producer<'_, Entry>) {
        let is_speed = matches!(work, Work::Speed(_));
        let cancellation_count = self.cancellation_count();
        let entry = Entry {
            cancellation_count,
            work,
        };
        match entries.enqueue(entry) {
            Ok(()) if is_speed => self.count_speed(),
            Ok(()) => self.count_entry(end_ms),
            Err(_) => {}
        }
    }

    /// Counts a sent entry; `end_ms` is the duration of all moves so far, its own included.
    pub(super) fn count_entry(&mut self, end_ms: u32) {
        self.entered = self.entered.wrapping_add(1);
        self.duration.add(end_ms);
    }

    /// Counts a sent speed of the spindle: its entry is done before the moves ahead of it.
    pub(super) fn count_speed(&mut self) {
        self.entered = self.entered.wrapping_add(1);
    }

    /// Returns whether the work behind that in execution lasts longer than a limit.
    pub(super) fn lasts_longer_than(&self, limit_ms: u32, machine: &Snapshot) -> bool {
        let unfinished = self.entered.wrapping_sub(machine.finished);
        unfinished > 1 && self.duration.of_newest_ms(unfinished - 1) > limit_ms
    }
}
