//! Resets: what they end, the welcome, and the startup lines after it.
//!
//! A line that was begun gets its `ok` before the welcome, as in Grbl, whose waiting loops end with
//! a reset and then answer. Read with Grbl 1.1 `main.c` and `protocol.c`.

use heapless::spsc::Producer;

use super::{LineStage, List, Progress, Session, Source, dispatch::answer};
use crate::{
    machine::Snapshot,
    model::{Alarm, Levels, Probed, State},
    path::Entry,
    protocol::{
        ByteReader,
        report::{self, Cadence, Feedback},
    },
    settings::STARTUP_LINES,
};

impl Session {
    /// Drops everything that the reset makes void.
    pub(super) fn begin_reset(&mut self, epoch: u32) {
        self.reset_count = epoch;
        self.is_answer_owed |= self.is_line_begun();
        self.is_stored_due |= matches!(self.stage, LineStage::Storing(_));
        self.stage = LineStage::Starting;
        self.path.clear();
        self.is_jogging = false;
        self.is_position_known = false;
        self.is_fault_told = false;
    }

    /// Whether a line has been begun and not been answered.
    fn is_line_begun(&self) -> bool {
        match self.stage {
            LineStage::Resting
            | LineStage::Entering(_)
            | LineStage::Completing(_)
            | LineStage::Storing(_)
            | LineStage::Faulting
            | LineStage::Faulted => true,
            LineStage::Starting
            | LineStage::Welcoming
            | LineStage::StartingUp(_)
            | LineStage::Reading
            | LineStage::Listing(..)
            | LineStage::Resetting
            | LineStage::Asleep => false,
        }
    }

    /// Ends what was begun before, as soon as the machine has acted on the reset; false before.
    ///
    /// What is received between the reset and the welcome is lost, as in Grbl.
    pub(super) fn start(&mut self, machine: &Snapshot, received: &mut ByteReader<'_>) -> bool {
        if self.reset_count != 0 {
            // As many as the queue holds, at most.
            for _ in 0..received.capacity() {
                if received.dequeue().is_none() {
                    break;
                }
            }
        }
        if machine.reset_count != self.reset_count {
            return false;
        }
        if machine.reset_in_motion {
            report::alarm(&mut self.message, Alarm::ResetInMotion);
        }
        if core::mem::take(&mut self.is_answer_owed) {
            self.answer_interrupted();
        }
        self.line.clear();
        self.source = Source::Line;
        self.interpreter.reset();
        self.probed = Probed::default();
        self.cadence = Cadence::default();
        self.stage = LineStage::Welcoming;
        if core::mem::take(&mut self.is_first_boot) {
            report::error(&mut self.message, crate::gcode::LineError::StorageRead);
            self.stage = LineStage::Listing(List::FirstSettings, 0);
        }
        true
    }

    /// The answer to the line that a reset has interrupted.
    fn answer_interrupted(&mut self) {
        if self.ends_program() {
            report::feedback(&mut self.message, Feedback::ProgramEnd);
        }
        if let Source::Startup { number, .. } = self.source
            && let Some(line) = self.stored.startup.get(number)
        {
            report::startup(&mut self.message, line);
        }
        answer(&mut self.message, Ok(()));
    }

    /// Welcomes the sender, and says whether the machine is locked.
    pub(super) fn welcome(&mut self, machine: &Snapshot) -> Progress {
        report::welcome(&mut self.message);
        if self.stored.settings.hard_limits && machine.inputs.has(Levels::LIMITS) {
            report::feedback(&mut self.message, Feedback::CheckLimits);
        }
        if machine.state == State::Alarm {
            report::feedback(&mut self.message, Feedback::Locked);
            self.stage = LineStage::Reading;
        } else {
            self.stage = LineStage::StartingUp(0);
        }
        Progress::Again
    }

    /// Begins the first startup line from `first` on that is not empty.
    pub(super) fn start_up(
        &mut self,
        machine: &Snapshot,
        first: usize,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        let is_homed = matches!(self.source, Source::Startup { is_homed: true, .. });
        if !self.is_position_known {
            return Progress::Waiting;
        }
        let next = (first..STARTUP_LINES).find(|&number| {
            self.stored
                .startup
                .get(number)
                .is_some_and(|l| !l.is_empty())
        });
        match next {
            Some(number) if machine.state != State::Alarm => {
                self.source = Source::Startup { number, is_homed };
                self.interpret(machine, entries)
            }
            _ => {
                self.source = Source::Line;
                if is_homed {
                    answer(&mut self.message, Ok(()));
                }
                self.begin_line()
            }
        }
    }
}
