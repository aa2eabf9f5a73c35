//! Resets: what they end, the welcome, and the startup lines after it.
//!
//! A line that was begun gets its `ok` before the welcome, as in Grbl, whose waiting loops end with
//! a reset and then answer. Read with Grbl 1.1 `main.c` and `protocol.c`.

use super::{LineStage, Ports, Progress, Session, Source, dispatch::answer, line_break::LineBreak};
use crate::{
    gcode::LineError,
    machine::Snapshot,
    model::{Alarm, Levels, Probed, State},
    protocol::{
        dialect::{Restart, SenderDialect, SenderMessage},
        listing,
        report::{self, Cadence, Feedback},
    },
    settings::STARTUP_LINES,
};

impl Session {
    /// Drops everything that a new reset cancels, if one has come.
    pub(super) fn begin_reset(&mut self, reset_count: u32) {
        if reset_count == self.path.sync.reset_count {
            return;
        }
        self.path.sync.reset_count = reset_count;
        self.operator_messages.clear();
        if matches!(self.stage, LineStage::Storing(_)) {
            self.persistence.defer();
        }
        let is_own = false;
        // A line of the stored program has no answer.
        #[cfg(arc_machine)]
        let is_own = is_own | self.stored_program.stop();
        if !matches!(self.stage, LineStage::Starting { .. }) {
            self.stage = LineStage::Starting {
                is_first_boot: false,
                owes_answer: self.stage.is_line_begun() && !is_own || self.tool_change.is_manual(),
            };
        }
        self.tool_change.end_manual(&mut self.line);
        self.path.blender.clear();
        self.cutter_path.compensator.clear();
        self.path.sync.is_jogging = false;
        self.path.sync.is_position_known = false;
        self.line_break = LineBreak::None;
        self.path.sync.follows_refused = false;
        self.reports.has_reported_fault = false;
    }

    /// Ends what was begun before a reset. Returns false until the machine has acted on the reset.
    ///
    /// What is received between the reset and the welcome is lost, as in Grbl.
    pub(super) fn start(&mut self, ports: &mut Ports<'_, '_>) -> bool {
        let LineStage::Starting {
            is_first_boot,
            owes_answer,
        } = self.stage
        else {
            return true;
        };
        if self.path.sync.reset_count != 0 && !self.host.rules().keeps_lines {
            drop_received(ports);
        }
        if ports.machine.reset_count != self.path.sync.reset_count {
            return false;
        }
        match self.host.restart(&mut self.lines) {
            Restart::Grbl => {}
            Restart::Anew {
                feed_mm_min,
                is_welcomed,
                has_limits,
            } => {
                if ports.machine.reset_in_motion {
                    self.line.interpreter.forget_home();
                }
                self.restart();
                self.line.interpreter.set_default_feed(feed_mm_min);
                if has_limits {
                    self.persistence.restore();
                }
                self.stage = if is_welcomed {
                    LineStage::Welcoming
                } else {
                    LineStage::Reading
                };
                return true;
            }
            Restart::GoesOn => {
                self.line.interpreter.switch_off();
                if owes_answer {
                    report::ok(&mut self.reports.message);
                }
                self.begin_line();
                return true;
            }
        }
        if ports.machine.reset_in_motion {
            self.line.interpreter.forget_home();
            self.power_up.last_alarm = Some(Alarm::ResetInMotion);
            report::alarm(&mut self.reports.message, Alarm::ResetInMotion);
        }
        if owes_answer {
            self.answer_interrupted();
        }
        self.restart();
        self.stage = if is_first_boot {
            report::error(&mut self.reports.message, LineError::StorageRead);
            LineStage::ListingDefaults(0)
        } else {
            LineStage::Welcoming
        };
        true
    }

    /// Goes back to the modes of power-up.
    pub(super) fn restart(&mut self) {
        self.line.input.clear();
        self.line.source = Source::Line;
        self.line.interpreter.reset();
        if let Some(tool) = self.tool_before_check.take() {
            self.line.interpreter.set_loaded_tool(tool);
        }
        self.probing.reported = Probed::default();
        self.reports.cadence = Cadence::default();
    }

    /// Answers the line that a reset has interrupted.
    fn answer_interrupted(&mut self) {
        if self.line.ends_program() {
            report::feedback(&mut self.reports.message, Feedback::ProgramEnd);
        }
        if let Source::Startup { number, .. } = self.line.source
            && let Some(line) = self.persistence.stored.startup.get(number)
        {
            report::startup(&mut self.reports.message, line);
        }
        answer(&mut self.reports.message, Ok(()));
    }

    /// Writes the next line of the defaults, before the first welcome.
    pub(super) fn list_defaults(&mut self, line: usize) -> Progress {
        let settings = &self.persistence.stored.settings;
        self.stage = if listing::setting(&mut self.reports.message, settings, line) {
            LineStage::ListingDefaults(line + 1)
        } else {
            LineStage::Welcoming
        };
        Progress::Again
    }

    /// Greets a sender that has come while the machine runs, and says why it is locked.
    pub(super) fn greet_again(&mut self, machine: &Snapshot) {
        if machine.state == State::Alarm
            && let Some(alarm) = self.power_up.last_alarm
        {
            self.write_alarm(alarm);
        }
        self.greet();
        self.report_lock(machine);
    }

    /// Writes the first line for a new sender.
    fn greet(&mut self) {
        let text = &mut self.reports.message;
        let settings = &self.persistence.stored.settings;
        if !self.host.write(text, SenderMessage::Welcome, settings) {
            report::welcome(text);
        }
    }

    /// Welcomes the sender, and reports whether the machine is locked.
    pub(super) fn welcome(&mut self, machine: &Snapshot) -> Progress {
        self.greet();
        let text = &mut self.reports.message;
        let settings = &self.persistence.stored.settings;
        let damaged = self.persistence.damaged;
        let tools = self.line.interpreter.tools();
        let damage = SenderMessage::Damage(damaged, tools);
        if !damaged.is_empty() && !self.host.write(text, damage, settings) {
            listing::damage(text, damaged, tools);
        }
        if settings.hard_limits && machine.inputs.has(Levels::LIMITS) {
            report::feedback(text, Feedback::CheckLimits);
        }
        self.stage = if self.report_lock(machine) {
            LineStage::Reading
        } else {
            LineStage::StartingUp(0)
        };
        Progress::Again
    }

    /// Writes that the machine is locked, if it is. Returns whether it is.
    fn report_lock(&mut self, machine: &Snapshot) -> bool {
        let (text, settings) = (&mut self.reports.message, &self.persistence.stored.settings);
        let is_locked = machine.state == State::Alarm;
        if is_locked && !self.host.write(text, SenderMessage::Locked, settings) {
            report::feedback(text, Feedback::Locked);
        }
        is_locked
    }

    /// Begins the first startup line from `first` on that is not empty.
    pub(super) fn start_up(&mut self, first: usize, ports: &mut Ports<'_, '_>) -> Progress {
        let is_homed = matches!(self.line.source, Source::Startup { is_homed: true, .. });
        if !self.path.sync.is_position_known {
            return Progress::Waiting;
        }
        let lines = &self.persistence.stored.startup;
        let next = (first..STARTUP_LINES)
            .find(|&number| lines.get(number).is_some_and(|line| !line.is_empty()));
        match next {
            Some(number) if ports.machine.state != State::Alarm => {
                self.line.source = Source::Startup { number, is_homed };
                self.interpret(ports)
            }
            Some(_) | None => {
                self.line.source = Source::Line;
                if is_homed {
                    answer(&mut self.reports.message, Ok(()));
                }
                self.begin_line()
            }
        }
    }
}

/// Drops the received bytes, and the count of lost bytes among them.
fn drop_received(ports: &mut Ports<'_, '_>) {
    // No more than the capacity of the queue.
    for _ in 0..ports.received.capacity() {
        if ports.received.dequeue().is_none() {
            break;
        }
    }
    let next = ports.received.oldest().wrapping_add(1);
    let _ = ports.requests.take_losses_before(next);
}
