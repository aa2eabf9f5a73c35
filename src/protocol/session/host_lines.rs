//! Lines with numbers and checksums, and the lines of the RepRap dialect.
//!
//! A line is taken whole, judged by its number and its checksum ([`RawLine::verdict`](crate::protocol::RawLine)),
//! and then written out in Grbl's words; what Grbl has no words for is an [`HostCommand`]. Every line that is not
//! blank gets exactly one `ok`.

use super::{
    LineStage, Links, Progress, Session,
    host::{Restart, TAKEN},
};
use crate::{
    gcode::{
        LineError, PlainPrefix,
        reprap::{self, HostCommand, Meaning},
    },
    protocol::{ByteReader, Damage, Dialect, Verdict, replies, report},
};

impl Session {
    /// Executes the next line, or, when none has come, sends the moves that `G64` holds back in time.
    #[inline(never)]
    pub(super) fn read_host_line(&mut self, links: &mut Links<'_, '_>) -> Progress {
        if self.is_restarting_host() {
            return Progress::Waiting;
        }
        if self.take_raw(links.received) {
            return self.execute_host_line(links);
        }
        if self.host.dialect == Dialect::RepRap && self.has_lost_line_end() {
            self.host.drop_unfinished();
            self.host.has_ended = true;
            return self.ask_again(Damage::NoChecksum, links);
        }
        self.flush_moves_in_time(links);
        Progress::Waiting
    }

    /// Moves received bytes to the line, up to its end. Returns false when it has not come yet.
    fn take_raw(&mut self, received: &mut ByteReader<'_>) -> bool {
        let host = &mut self.host;
        if core::mem::take(&mut host.has_ended) {
            host.raw.clear();
        }
        let oldest = received.oldest();
        let waiting = if host.dialect == Dialect::RepRap {
            host.scanned_of(oldest)
        } else {
            received.len()
        };
        let [older, newer] = received.waiting();
        let mut taken = 0;
        for byte in older.chain(newer).take(waiting) {
            if host.raw.is_empty() {
                host.start = oldest.wrapping_add(taken);
            }
            taken += 1;
            match byte {
                b'\n' | b'\r' => {
                    host.has_ended = true;
                    break;
                }
                TAKEN => {}
                _ => host.raw.push(byte),
            }
        }
        received.consume(taken);
        host.has_ended
    }

    /// Executes a line that has ended, or refuses it.
    fn execute_host_line(&mut self, links: &mut Links<'_, '_>) -> Progress {
        let host = &mut self.host;
        let verdict = host.raw.verdict(host.last, host.has_begun);
        let is_host = host.dialect == Dialect::RepRap;
        let is_checked = host.raw.is_checked();
        let is_stale = host
            .stale_before
            .is_some_and(|before| before.wrapping_sub(host.start).cast_signed() > 0);
        match verdict {
            Verdict::Blank if is_host => return Progress::Again,
            Verdict::Blank => return self.accept(),
            Verdict::Execute(Some(_)) | Verdict::Refuse(_) if is_stale && host.raw.has_number() => {
                return self.accept();
            }
            Verdict::ReportNumber => {
                replies::line_number(&mut self.reports.message, host.last);
                return self.accept();
            }
            Verdict::SetNumber(number) => {
                host.last = number;
                host.has_begun |= is_checked;
                host.stale_before = None;
                return self.accept();
            }
            // Senders that speak Grbl may number their lines for themselves.
            Verdict::Refuse(Damage::NoChecksum) if !is_host => {}
            Verdict::Refuse(damage) => return self.ask_again(damage, links),
            Verdict::Execute(Some(number)) => {
                host.last = number;
                host.has_begun = true;
                host.stale_before = None;
            }
            Verdict::Execute(None) => {}
        }
        self.line.prefix = PlainPrefix::default();
        if self.host.raw.is_too_long() {
            return self.refuse(LineError::LineOverflow);
        }
        if is_host {
            self.read_reprap(links)
        } else {
            self.take_words();
            self.dispatch(links)
        }
    }

    /// Asks for the line after the last accepted one.
    fn ask_again(&mut self, damage: Damage, links: &Links<'_, '_>) -> Progress {
        let text = &mut self.reports.message;
        let last = self.host.last;
        if self.host.dialect == Dialect::RepRap {
            self.host.stale_before = Some(links.received.written());
            replies::resend(text, damage, last);
            return self.accept();
        }
        replies::resend_message(text, last);
        self.refuse(match damage {
            Damage::Mismatch | Damage::NoChecksum | Damage::NoNumber => LineError::Checksum,
            Damage::Number => LineError::LineNumber,
        })
    }

    /// Makes the words of the line what Grbl's lines are made of.
    fn take_words(&mut self) {
        let mut words = self.host.raw.words().iter().copied();
        // There is no line end in the words.
        let _ = self.line.input.take_from(&mut words);
    }

    /// Reads the words of a line in the RepRap dialect, and executes them.
    fn read_reprap(&mut self, links: &mut Links<'_, '_>) -> Progress {
        let words = self.host.raw.words();
        if words.trim_ascii_start().starts_with(b"$") {
            self.take_words();
            return self.dispatch(links);
        }
        let input = &mut self.line.input;
        match reprap::read(words, |text| input.push(text)) {
            Ok(Meaning::Words) => {}
            Ok(Meaning::HostCommand(act)) => self.host.command = Some(act),
            Err(error) => return self.refuse(error),
        }
        self.dispatch(links)
    }

    /// Writes why a line is refused, and its `ok`.
    pub(super) fn write_refusal(&mut self, error: LineError) {
        let text = &mut self.reports.message;
        let words = self.host.raw.words();
        replies::refusal(text, error, words, self.host.alarm);
        report::ok(text);
    }

    /// Writes the next line of the answer to `M115`, and its `ok` after the last.
    pub(super) fn list_firmware(&mut self, line: usize) -> Progress {
        let settings = &self.persistence.stored.settings;
        if !replies::firmware(&mut self.reports.message, line, settings) {
            return self.accept();
        }
        self.stage = LineStage::ListingFirmware(line + 1);
        Progress::Again
    }

    /// Does what Grbl has no words for.
    #[inline(never)]
    pub(super) fn execute_host_command(
        &mut self,
        command: HostCommand,
        links: &mut Links<'_, '_>,
    ) -> Progress {
        let machine = links.machine;
        let text = &mut self.reports.message;
        match command {
            HostCommand::Nothing => {}
            HostCommand::Temperature => {
                replies::temperature(text);
                return self.begin_line();
            }
            HostCommand::Position { is_now } => {
                let settings = &self.persistence.stored.settings;
                let position = if is_now {
                    report::machine_position(machine, settings)
                } else {
                    self.interpreter.position()
                };
                let offset = self.interpreter.work_offset(&position);
                let work = position.zip(offset, |position, offset| position - offset);
                replies::position(text, &work, crate::units::Nm(0), &machine.steps);
            }
            HostCommand::Firmware => return self.list_firmware(0),
            HostCommand::Echo => {
                let words = self.host.raw.words().trim_ascii();
                replies::echo(text, words.get(4..).unwrap_or_default());
            }
            HostCommand::Files => {
                text.word("Begin file list").end();
                text.word("End file list").end();
            }
            HostCommand::Standstill => {
                if !self.is_done(machine) || machine.state.is_suspended() {
                    return self.await_standstill();
                }
            }
            HostCommand::Kill => {
                self.host.restart(Restart::Killing);
                self.stage = LineStage::Resetting;
                return Progress::Again;
            }
            HostCommand::Restart => {
                self.host.restart(Restart::Unlocking);
                return self.answer_and_reset();
            }
            HostCommand::NotPresent(code) => replies::not_present(text, code),
            HostCommand::InvalidTool(tool) => replies::invalid_tool(text, tool),
            HostCommand::BusyInterval(seconds) => self.host.busy_interval_s = seconds,
        }
        self.accept()
    }
}
