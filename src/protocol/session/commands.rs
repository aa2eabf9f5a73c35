//! `$` statements that the machine has to carry out: unlocking, homing, check mode, sleep.
//!
//! Read with Grbl 1.1 `system.c`.

use heapless::spsc::Producer;

use super::{After, LineStage, Progress, Session, Source, dispatch::answer};
use crate::{
    axis::AXES,
    gcode::LineError,
    machine::Snapshot,
    model::{Levels, State},
    path::{Entry, Work},
    protocol::report::{self, Feedback},
};

impl Session {
    /// Takes the lock of an alarm off, once the machine has come to rest.
    pub(super) fn unlock(
        &mut self,
        machine: &Snapshot,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        if machine.state != State::Alarm {
            return self.accept();
        }
        if !self.is_done(machine) {
            return self.rest();
        }
        self.send_entry(Work::Unlock, entries);
        self.stage = LineStage::Completing(After::Tell(Feedback::Unlocked));
        Progress::Again
    }

    /// Homes the axes of a mask, 0 for all.
    pub(super) fn home(
        &mut self,
        machine: &Snapshot,
        mask: u8,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        if !self.is_done(machine) {
            return self.rest();
        }
        let is_all = mask == 0;
        let switches = if is_all {
            (1 << AXES) - 1
        } else {
            u16::from(mask)
        };
        if machine.inputs.has(Levels(switches)) {
            report::feedback(&mut self.message, Feedback::CheckLimits);
            return self.refuse(LineError::LimitsEngaged);
        }
        self.send_entry(Work::Home(mask), entries);
        self.stage = LineStage::Completing(After::Home { is_all });
        Progress::Again
    }

    /// What homing has come to. A failure has been told; it ends with a reset.
    pub(super) fn end_homing(&mut self, machine: &Snapshot, is_all: bool) -> Progress {
        if machine.state == State::Alarm {
            answer(&mut self.message, Ok(()));
            self.stage = LineStage::Resetting;
            return Progress::Again;
        }
        self.take_position(machine);
        if !is_all {
            return self.accept();
        }
        self.source = Source::Startup {
            number: 0,
            is_homed: true,
        };
        self.stage = LineStage::StartingUp(0);
        Progress::Again
    }

    /// From here on programs are checked and not executed.
    pub(super) fn begin_check(&mut self, entries: &mut Producer<'_, Entry>) -> Progress {
        self.send_entry(Work::Check, entries);
        self.stage = LineStage::Completing(After::Tell(Feedback::CheckEnabled));
        Progress::Again
    }

    /// Check mode ends with a reset.
    pub(super) fn end_check(&mut self) -> Progress {
        report::feedback(&mut self.message, Feedback::CheckDisabled);
        answer(&mut self.message, Ok(()));
        self.stage = LineStage::Resetting;
        Progress::Again
    }

    /// Everything off until a reset. The machine says so after the answer.
    pub(super) fn sleep(
        &mut self,
        machine: &Snapshot,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        if !self.is_done(machine) {
            return self.rest();
        }
        self.send_entry(Work::Sleep, entries);
        answer(&mut self.message, Ok(()));
        self.stage = LineStage::Asleep;
        Progress::Again
    }
}
