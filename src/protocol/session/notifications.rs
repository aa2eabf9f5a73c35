//! What the sender is told without having asked: notices of the machine.
//!
//! Notices come before whatever the line in execution is answered, as in Grbl, which looks for them
//! in each of its waiting loops. Read with Grbl 1.1 `protocol.c` and `report.c`.

use super::Session;
use crate::{
    machine::Snapshot,
    model::{Alarm, Notice},
    protocol::{
        ByteWriter,
        report::{self, Feedback},
    },
};

/// Notices that are told in one run: as many as are kept.
const NOTICES: usize = 8;

/// What has been seen of the machine.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Seen {
    /// Notices, wrapping.
    notices: u32,
    news: u8,
    coolant_toggles: u8,
    /// A probing move has ended since it was asked for.
    pub(super) is_probed: bool,
}

impl Session {
    /// Takes over what has changed at the machine, and makes the next status report show it.
    pub(super) fn look_at(&mut self, machine: &Snapshot) {
        let seen = &mut self.seen;
        if seen.news != machine.accessory_changes {
            seen.news = machine.accessory_changes;
            self.cadence.overrides_changed();
        }
        if seen.coolant_toggles != machine.coolant_toggles {
            seen.coolant_toggles = machine.coolant_toggles;
            self.interpreter.set_coolant(machine.coolant_asked);
        }
    }

    /// Whether there is something that the sender has not been told.
    pub(super) fn has_notices(&self, machine: &Snapshot) -> bool {
        machine.notices.count() != self.seen.notices
    }

    /// Tells everything that there is to tell; false when there is no room for it.
    ///
    /// Before a welcome that is only why the machine was locked: an open door comes after it.
    #[inline]
    pub(super) fn tell_notices(&mut self, machine: &Snapshot, sent: &mut ByteWriter<'_>) -> bool {
        !self.has_notices(machine) || self.tell_all(machine, sent)
    }

    #[inline(never)]
    fn tell_all(&mut self, machine: &Snapshot, sent: &mut ByteWriter<'_>) -> bool {
        for _ in 0..NOTICES {
            let mut seen = self.seen.notices;
            let Some(notice) = machine.notices.next(&mut seen) else {
                break;
            };
            if !self.is_welcome_told() && !matches!(notice, Notice::Alarm(_)) {
                break;
            }
            self.seen.notices = seen;
            self.tell_notice(machine, notice);
            if !self.flush(sent) {
                return false;
            }
        }
        true
    }

    fn tell_notice(&mut self, machine: &Snapshot, notice: Notice) {
        let is_miss = !machine.probed.success && self.is_alarmed_by_a_miss();
        let text = &mut self.message;
        match notice {
            // Told with the welcome.
            Notice::Alarm(Alarm::ResetInMotion) => {}
            Notice::Alarm(alarm) => {
                report::alarm(text, alarm);
                if machine.is_critical {
                    report::feedback(text, Feedback::ResetNeeded);
                    self.is_fault_told = true;
                }
            }
            Notice::CheckDoor => report::feedback(text, Feedback::CheckDoor),
            Notice::RestoringSpindle => report::feedback(text, Feedback::RestoringSpindle),
            Notice::Sleeping => report::feedback(text, Feedback::Sleeping),
            Notice::Probed => {
                // A miss that is an alarm leaves the position of the last contact, as in Grbl.
                self.probed.success = machine.probed.success;
                if !is_miss {
                    self.probed.steps = machine.probed.steps;
                }
                self.seen.is_probed = true;
                report::probed(text, &self.probed, &self.stored.settings);
            }
        }
    }

    /// The machine stopped dead in motion. No line is answered any more, as in Grbl; only a reset
    /// ends this. Grbl's alarm 3 says what it means for the sender: the position may be lost.
    pub(super) fn tell_fault(&mut self, machine: &Snapshot) {
        if machine.has_underrun && !self.is_fault_told {
            report::alarm(&mut self.message, Alarm::ResetInMotion);
            report::feedback(&mut self.message, Feedback::ResetNeeded);
            self.is_fault_told = true;
        }
    }
}
