//! How the firmware has begun to run.

use crate::{
    model::{Alarm, Bootloaders, ResetCause, SelfTestFault},
    protocol::{
        report::{self, Feedback},
        text::Text,
    },
};

/// What is known since power-up.
#[derive(Debug, Default)]
pub(super) struct PowerUp {
    /// Why the firmware has begun to run.
    pub(super) reset_cause: ResetCause,
    /// What the self-test at power-up has found wrong.
    pub(super) self_test_fault: Option<SelfTestFault>,
    /// The bootloaders to which the board can hand over.
    pub(super) bootloaders: Bootloaders,
    /// The alarm that was reported last.
    pub(super) last_alarm: Option<Alarm>,
}

impl PowerUp {
    /// Writes an alarm, and the reason of one that power-up has caused.
    pub(super) fn write_alarm(&self, text: &mut Text, alarm: Alarm) {
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
    }
}
