//! Messages to the sender: notices of the machine, status reports, and room for all of them.
//!
//! Notices come before the answer to the line in execution, as in Grbl, which checks for them in
//! each of its waiting loops. Read with Grbl 1.1 `protocol.c` and `report.c`.

use super::{LineStage, Links, Session};
use crate::{
    machine::Snapshot,
    model::{Alarm, Notice, Probing},
    protocol::{
        ByteWriter, replies,
        report::{self, Cadence, Feedback, Status},
        text::Text,
    },
};

/// Notices that one run sends, at most: the capacity of [`crate::model::Notices`].
const MAX_NOTICES: usize = 8;

/// What has been reported, and is to be.
#[derive(Debug, Default)]
pub(super) struct Reports {
    /// A message that still needs room.
    pub(super) message: Text,
    pub(super) cadence: Cadence,
    /// A `?` has not been answered.
    pub(super) is_status_due: bool,
    /// The tool in the spindle has changed, and has not been reported.
    pub(super) is_tool_due: bool,
    /// The report that a compensated move waits is due, or has been sent.
    pub(super) has_reported_wait: bool,
    /// The message that the machine needs a reset has been written.
    pub(super) has_reported_fault: bool,
    /// Number of notices seen, wrapping.
    notices: u32,
    /// [`Snapshot::accessory_changes`] as seen last.
    accessory_changes: u8,
    /// [`Snapshot::coolant_toggles`] as seen last.
    coolant_toggles: u8,
}

impl Reports {
    /// Returns whether a message or a status report waits.
    pub(super) fn is_pending(&self) -> bool {
        self.is_status_due || !self.message.is_empty()
    }

    /// Returns whether there is a notice that has not been sent.
    pub(super) fn has_notices(&self, machine: &Snapshot) -> bool {
        machine.notices.count() != self.notices
    }

    /// Sends the message that waits. Returns false when there is no room.
    pub(super) fn flush(&mut self, sent: &mut ByteWriter<'_>) -> bool {
        let has_room = sent.append(self.message.as_bytes());
        if has_room {
            self.message.clear();
        }
        has_room
    }
}

impl Session {
    /// Returns whether the welcome has been written.
    pub(super) fn is_welcome_sent(&self) -> bool {
        !matches!(
            self.stage,
            LineStage::Starting { .. } | LineStage::ListingDefaults(_) | LineStage::Welcoming
        )
    }

    /// Adopts what has changed at the machine, and makes the next status report show it.
    pub(super) fn observe(&mut self, machine: &Snapshot) {
        let reports = &mut self.reports;
        if reports.accessory_changes != machine.accessory_changes {
            reports.accessory_changes = machine.accessory_changes;
            reports.cadence.overrides_changed();
        }
        if reports.coolant_toggles != machine.coolant_toggles {
            reports.coolant_toggles = machine.coolant_toggles;
            self.interpreter.set_coolant(machine.programmed_coolant);
        }
    }

    /// Sends the message that waits, and all notices. Returns false when there is no room.
    #[inline]
    pub(super) fn send_pending(&mut self, links: &mut Links<'_, '_>) -> bool {
        if self.reports.message.is_empty() {
            self.report_due_message(links.machine);
        }
        self.reports.flush(links.sent)
            && (!self.reports.has_notices(links.machine) || self.send_notices(links))
    }

    /// Sends all notices. Returns false when there is no room.
    ///
    /// Before a welcome these are only alarms, the reason of the lock: an open door comes after it.
    #[inline(never)]
    fn send_notices(&mut self, links: &mut Links<'_, '_>) -> bool {
        for _ in 0..MAX_NOTICES {
            let mut seen = self.reports.notices;
            let Some(notice) = links.machine.notices.next(&mut seen) else {
                break;
            };
            if !self.is_welcome_sent() && !matches!(notice, Notice::Alarm(_)) {
                break;
            }
            self.reports.notices = seen;
            self.write_notice(links.machine, notice);
            if !self.reports.flush(links.sent) {
                return false;
            }
        }
        true
    }

    fn write_notice(&mut self, machine: &Snapshot, notice: Notice) {
        let is_miss = !machine.probed.success && self.is_alarmed_by_a_miss();
        let text = &mut self.reports.message;
        match notice {
            // Sent with the welcome.
            Notice::Alarm(Alarm::ResetInMotion) => {}
            Notice::Alarm(alarm) => {
                if !alarm.keeps_position() {
                    self.interpreter.forget_home();
                }
                self.host.alarm = Some(alarm);
                let is_of_probing = matches!(alarm, Alarm::ProbeState | Alarm::ProbeContact);
                if is_of_probing && self.persistence.stored.settings.probing_alarm_switches_off {
                    self.interpreter.switch_off();
                }
                if self.host.dialect.is_reprap() {
                    replies::stopped(text, alarm);
                    return;
                }
                if alarm == Alarm::Restarted {
                    // The reset may have cut a line off.
                    text.end();
                }
                report::alarm(text, alarm);
                match alarm {
                    Alarm::SelfTest => {
                        if let Some(fault) = self.self_test_fault {
                            report::self_test_fault(text, fault);
                        }
                    }
                    Alarm::Restarted => report::restarted(text, self.reset_cause),
                    Alarm::UnexpectedContact => report::feedback(text, Feedback::UnexpectedContact),
                    _ => {}
                }
                if machine.is_critical {
                    report::feedback(text, Feedback::ResetNeeded);
                    self.reports.has_reported_fault = true;
                }
            }
            #[cfg(arc_machine)]
            Notice::CycleStart => self.start_stored_program(machine),
            Notice::CheckDoor => report::feedback(text, Feedback::CheckDoor),
            Notice::RestoringSpindle => report::feedback(text, Feedback::RestoringSpindle),
            Notice::SpindleDelay => report::feedback(text, Feedback::SpindleDelay),
            Notice::Sleeping => report::feedback(text, Feedback::Sleeping),
            Notice::Standstill if self.compensator.is_waiting() => {
                report::feedback(text, Feedback::CompensationWaits);
            }
            Notice::Standstill => {}
            Notice::Probed if self.line.checked.probing() == Some(Probing::LimitSwitch) => {
                self.probing.has_ended = true;
            }
            Notice::Probed => {
                let probing = &mut self.probing;
                // A miss that is an alarm leaves the position of the last contact, as in Grbl.
                probing.reported.success = machine.probed.success;
                if !is_miss {
                    probing.reported.steps = machine.probed.steps;
                }
                probing.has_ended = true;
                report::probed(text, &probing.reported, &self.persistence.stored.settings);
            }
        }
    }

    /// Sends a status report that is due. Returns false when there is no room.
    pub(super) fn answer_status(&mut self, links: &mut Links<'_, '_>) -> bool {
        if !self.reports.is_status_due || !self.is_welcome_sent() {
            return true;
        }
        let received_free = links.received.capacity() - links.received.len();
        self.send_status(links.machine, received_free, links.sent)
    }

    /// Sends a status report. Returns false when there is no room.
    pub(super) fn send_status(
        &mut self,
        machine: &Snapshot,
        received_free: usize,
        sent: &mut ByteWriter<'_>,
    ) -> bool {
        // A report counts only once it has been sent.
        let mut cadence = self.reports.cadence;
        let mut text = Text::new();
        let position = report::machine_position(machine, &self.persistence.stored.settings);
        let status = Status {
            machine,
            settings: &self.persistence.stored.settings,
            work_offset: self.interpreter.work_offset(&position),
            depends_on_place: self.interpreter.is_rotated(),
            received_free,
            extra: cadence.next(machine.state),
            new_tool: (self.reports.is_tool_due).then_some(self.interpreter.loaded_tool()),
        };
        report::status(&mut text, &status);
        let has_room = sent.append(text.as_bytes());
        if has_room {
            self.reports.cadence = cadence;
            self.reports.is_status_due = false;
            self.reports.is_tool_due = false;
        }
        has_room
    }

    /// Reports a fault that only a reset ends. Returns false where no line is answered any more, as in
    /// Grbl; a host of 3D printers gets its answers.
    ///
    /// When the step events ran out in motion, this is Grbl's alarm 3: the position may be lost.
    pub(super) fn report_fault(&mut self, links: &mut Links<'_, '_>) -> bool {
        let is_host = self.host.dialect.is_reprap();
        if links.machine.has_underrun && !self.reports.has_reported_fault {
            let text = &mut self.reports.message;
            self.host.alarm = Some(Alarm::ResetInMotion);
            if is_host {
                replies::stopped(text, Alarm::ResetInMotion);
            } else {
                report::alarm(text, Alarm::ResetInMotion);
                report::feedback(text, Feedback::ResetNeeded);
            }
            self.reports.has_reported_fault = true;
            self.interpreter.forget_home();
        }
        self.reports.flush(links.sent) && is_host
    }
}
