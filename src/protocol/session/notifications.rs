//! Messages to the sender: notices of the machine, status reports, and room for all of them.
//!
//! Notices come before the answer to the line in execution, as in Grbl, which checks for them in
//! each of its waiting loops. Read with Grbl 1.1 `protocol.c` and `report.c`.

use super::{Ports, Session};
use crate::{
    machine::Snapshot,
    model::{Alarm, Notice, Probing},
    protocol::{
        dialect::{SenderDialect, SenderMessage},
        report::{self, Feedback},
    },
};

/// Notices that one run sends, at most: the capacity of [`crate::model::Notices`].
const MAX_NOTICES: usize = 8;

impl Session {
    /// Sends the message that waits, and all notices. Returns false when there is no room.
    pub(super) fn send_pending(&mut self, ports: &mut Ports<'_, '_>) -> bool {
        if self.reports.message.is_empty() {
            let text = &mut self.reports.message;
            self.operator_messages.write_due(ports.machine, text);
        }
        self.reports.flush(ports.sent)
            && (!self.reports.has_notices(ports.machine) || self.send_notices(ports))
    }

    /// Sends all notices. Returns false when there is no room.
    ///
    /// Before a welcome these are only alarms, the reason of the lock: an open door comes after it.
    fn send_notices(&mut self, ports: &mut Ports<'_, '_>) -> bool {
        for _ in 0..MAX_NOTICES {
            let mut seen = self.reports.notices;
            let Some(notice) = ports.machine.notices.next(&mut seen) else {
                break;
            };
            if !self.stage.is_welcome_sent() && !matches!(notice, Notice::Alarm(_)) {
                break;
            }
            self.reports.notices = seen;
            self.write_notice(ports.machine, notice);
            if !self.reports.flush(ports.sent) {
                return false;
            }
        }
        true
    }

    fn write_notice(&mut self, machine: &Snapshot, notice: Notice) {
        let text = &mut self.reports.message;
        match notice {
            // Sent with the welcome.
            Notice::Alarm(Alarm::ResetInMotion) => {}
            Notice::Alarm(alarm) => {
                if !alarm.keeps_position() {
                    self.line.interpreter.forget_home();
                }
                let is_of_probing = matches!(alarm, Alarm::ProbeState | Alarm::ProbeContact);
                if is_of_probing && self.persistence.stored.settings.probing_alarm_switches_off {
                    self.line.interpreter.switch_off();
                }
                self.power_up.last_alarm = Some(alarm);
                if self.write_alarm(alarm) && machine.is_critical {
                    report::feedback(&mut self.reports.message, Feedback::ResetNeeded);
                    self.reports.has_reported_fault = true;
                }
            }
            #[cfg(arc_machine)]
            Notice::CycleStart => {
                let is_free = self.stage == super::LineStage::Reading && self.path.is_done(machine);
                if is_free && self.persistence.stored.settings.runs_stored_program {
                    self.stored_program.start();
                }
            }
            Notice::CheckDoor => report::feedback(text, Feedback::CheckDoor),
            Notice::RestoringSpindle => report::feedback(text, Feedback::RestoringSpindle),
            Notice::SpindleDelay => report::feedback(text, Feedback::SpindleDelay),
            Notice::Sleeping => report::feedback(text, Feedback::Sleeping),
            Notice::Standstill if self.cutter_path.is_waiting() => {
                report::feedback(text, Feedback::CompensationWaits);
            }
            Notice::Standstill => {}
            Notice::Probed if self.line.checked.probing() == Some(Probing::LimitSwitch) => {
                self.probing.has_ended = true;
            }
            Notice::Probed => {
                self.probing.has_ended = true;
                self.report_probed(machine.probed);
            }
        }
    }

    /// Writes an alarm. Returns false where a host of 3D printers has its own words for it.
    pub(super) fn write_alarm(&mut self, alarm: Alarm) -> bool {
        let (text, settings) = (&mut self.reports.message, &self.persistence.stored.settings);
        let is_own = !self.host.write(text, SenderMessage::Alarm(alarm), settings);
        if is_own {
            self.power_up.write_alarm(text, alarm);
        }
        is_own
    }

    /// Reports a fault that only a reset ends. Returns false where no line is answered any more, as in
    /// Grbl; a host of 3D printers gets its answers.
    ///
    /// When the step events ran out in motion, this is Grbl's alarm 3: the position may be lost.
    pub(super) fn report_fault(&mut self, ports: &mut Ports<'_, '_>) -> bool {
        if ports.machine.has_underrun && !self.reports.has_reported_fault {
            let text = &mut self.reports.message;
            let alarm = Alarm::ResetInMotion;
            let settings = &self.persistence.stored.settings;
            if !self.host.write(text, SenderMessage::Alarm(alarm), settings) {
                report::alarm(text, alarm);
                report::feedback(text, Feedback::ResetNeeded);
            }
            self.reports.has_reported_fault = true;
            self.line.interpreter.forget_home();
        }
        self.reports.flush(ports.sent) && self.host.rules().answers_when_stopped
    }
}
