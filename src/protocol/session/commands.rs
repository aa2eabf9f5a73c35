//! `$` statements that the machine has to execute: unlocking, homing, check mode, sleep.
//!
//! Read with Grbl 1.1 `system.c`.

use super::{AfterCommands, LineStage, Links, Progress, Session, Source, dispatch::answer};
use crate::{
    axis::{AXES, LINEAR},
    gcode::LineError,
    machine::Snapshot,
    model::{Levels, State},
    path::Work,
    protocol::{
        dialect::SenderDialect,
        report::{self, Feedback},
    },
};

/// The axes that are homed unless others are named, beside those that home by marks.
const LINEAR_AXES: u8 = (1 << LINEAR) - 1;

impl Session {
    /// Ends the lock of an alarm, once the machine stands still, and compensation in any state.
    pub(super) fn unlock(&mut self, links: &mut Links<'_, '_>) -> Progress {
        if links.machine.state != State::Alarm {
            return self.end_compensation(links.machine);
        }
        if links.machine.failed_self_test {
            return self.refuse(LineError::Locked);
        }
        if !self.is_done(links.machine) {
            return self.await_standstill();
        }
        self.cancel_compensation();
        self.send_work(Work::Unlock, links);
        self.stage = LineStage::Completing(AfterCommands::Message(Feedback::Unlocked));
        Progress::Again
    }

    /// Homes the axes of a mask, 0 for all.
    pub(super) fn home(&mut self, mask: u8, links: &mut Links<'_, '_>) -> Progress {
        if self.interpreter.is_compensating() {
            return self.refuse(LineError::NotWithCompensation);
        }
        if links.machine.failed_self_test {
            return self.refuse(LineError::Locked);
        }
        if !self.is_done(links.machine) {
            return self.await_standstill();
        }
        let is_all = mask == 0;
        let switches = if is_all {
            (1 << AXES) - 1
        } else {
            u16::from(mask)
        };
        let switches = switches & !u16::from(self.settings().homing_marks);
        if links.machine.inputs.has(Levels(switches)) {
            report::feedback(&mut self.reports.message, Feedback::CheckLimits);
            return self.refuse(LineError::LimitsEngaged);
        }
        self.send_work(Work::Home(mask), links);
        self.stage = LineStage::Completing(AfterCommands::Home { mask });
        Progress::Again
    }

    /// Ends homing. A failure has been reported as an alarm, and ends with a reset.
    pub(super) fn end_homing(&mut self, machine: &Snapshot, mask: u8) -> Progress {
        let rules = self.host.rules();
        if machine.state == State::Alarm && rules.answers_when_stopped {
            return self.refuse(LineError::Locked);
        }
        if machine.state == State::Alarm {
            return self.answer_and_reset();
        }
        self.adopt_position(machine);
        let settings = &self.persistence.stored.settings;
        let axes = match mask {
            0 => LINEAR_AXES | settings.homing_marks,
            mask => mask,
        };
        self.interpreter.set_homed(axes, settings);
        if mask != 0 || rules.answers_when_stopped {
            return self.accept();
        }
        self.line.source = Source::Startup {
            number: 0,
            is_homed: true,
        };
        self.stage = LineStage::StartingUp(0);
        Progress::Again
    }

    /// Begins check mode: programs are checked and not executed.
    pub(super) fn begin_check(&mut self, links: &mut Links<'_, '_>) -> Progress {
        self.cancel_compensation();
        self.tool_before_check = Some(self.interpreter.loaded_tool());
        self.send_work(Work::Check, links);
        self.stage = LineStage::Completing(AfterCommands::Message(Feedback::CheckEnabled));
        Progress::Again
    }

    /// Ends check mode, with a reset.
    pub(super) fn end_check(&mut self) -> Progress {
        report::feedback(&mut self.reports.message, Feedback::CheckDisabled);
        self.answer_and_reset()
    }

    /// Switches everything off until a reset. The notice of the machine follows the answer.
    pub(super) fn sleep(&mut self, links: &mut Links<'_, '_>) -> Progress {
        if !self.is_done(links.machine) {
            return self.await_standstill();
        }
        self.cancel_compensation();
        self.send_work(Work::Sleep, links);
        answer(&mut self.reports.message, Ok(()));
        self.stage = LineStage::Asleep;
        Progress::Again
    }
}
