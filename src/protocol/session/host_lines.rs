//! Lines with numbers and checksums, and the lines of the RepRap dialect.
//!
//! A line is taken whole, judged by its number and its checksum ([`RawLine::verdict`](crate::protocol::RawLine)),
//! and then written out in Grbl's words; what Grbl has no words for is a
//! [`HostCommand`](crate::gcode::reprap::HostCommand), which `host_commands` executes. Every line that is not
//! blank gets exactly one `ok`.

use super::{
    LineStage, Links, Progress, Session,
    host_bytes::{LOST, TAKEN},
};
use crate::{
    gcode::{
        LineError, PlainPrefix,
        interpreter::Interpreter,
        reprap::{self, LineModes},
    },
    model::State,
    protocol::{
        ByteReader, FailedCheck, Verdict, replies, report,
        utf8_requests::{LATIN_1_LEAD, is_utf8_request},
    },
    settings::Settings,
    units::Nm,
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
        if self.host.dialect.is_reprap() && self.has_lost_line_end() {
            self.host.drop_unfinished();
            self.host.has_ended = true;
            return self.ask_again(FailedCheck::MissingChecksum, links);
        }
        self.flush_moves_in_time(links);
        Progress::Waiting
    }

    /// Answers the next line of a machine that sleeps, which only `M999` ends.
    #[inline(never)]
    pub(super) fn read_line_asleep(&mut self, links: &mut Links<'_, '_>) -> Progress {
        let progress = self.read_host_line(links);
        if self.stage == LineStage::Reading {
            self.stage = LineStage::Asleep;
        }
        progress
    }

    /// Moves received bytes to the line, up to its end. Returns false when it has not come yet.
    fn take_raw(&mut self, received: &mut ByteReader<'_>) -> bool {
        let host = &mut self.host;
        if core::mem::take(&mut host.has_ended) {
            host.raw.clear();
        }
        let oldest = received.oldest();
        let waiting = if host.dialect.is_reprap() {
            host.scan.bytes_from(oldest)
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
            if core::mem::take(&mut host.is_behind_lead) {
                if is_utf8_request(byte, host.raw.is_empty()) {
                    continue;
                }
                host.raw.push(LATIN_1_LEAD);
            }
            match byte {
                LATIN_1_LEAD if !host.dialect.is_reprap() => host.is_behind_lead = true,
                b'\n' | b'\r' => {
                    host.has_ended = true;
                    break;
                }
                TAKEN => {}
                LOST if host.dialect.is_reprap() => host.raw.lose_rest(),
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
        let is_host = host.dialect.is_reprap();
        let is_checked = host.raw.is_checked();
        let has_lost = links.requests.take_losses_before(links.received.oldest());
        let is_stale = host
            .stale_before
            .is_some_and(|before| before.wrapping_sub(host.start).cast_signed() > 0);
        // In Grbl's words a line can be asked for again only if its sender gives it both.
        let is_unchecked = if is_host {
            !is_checked
        } else {
            !host.raw.has_checksum() || !host.raw.has_number()
        };
        match verdict {
            Verdict::Blank if is_host => return Progress::Again,
            _ if has_lost && is_unchecked && is_host => return self.refuse(LineError::BytesLost),
            _ if has_lost && is_unchecked => {
                return self.refuse_with_hold(LineError::BytesLost, links);
            }
            // A checksum may be right of what is left: two equal bytes change nothing of it.
            Verdict::Execute(_) | Verdict::SetNumber(_) if has_lost => {
                return self.ask_again(FailedCheck::Checksum, links);
            }
            // A comment may be a message.
            Verdict::Blank if !host.raw.is_too_long() => {}
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
                host.begin_job();
                return self.accept();
            }
            // Senders that speak Grbl may number their lines for themselves.
            Verdict::Refuse(FailedCheck::MissingChecksum) if !is_host => {}
            Verdict::Refuse(failed) => return self.ask_again(failed, links),
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
    fn ask_again(&mut self, failed: FailedCheck, links: &Links<'_, '_>) -> Progress {
        let text = &mut self.reports.message;
        let last = self.host.last;
        if self.host.dialect.is_reprap() {
            self.host.stale_before = Some(links.received.written());
            replies::resend(text, failed, last);
            return self.accept();
        }
        replies::resend_message(text, last);
        self.refuse(match failed {
            FailedCheck::Checksum | FailedCheck::MissingChecksum | FailedCheck::MissingNumber => {
                LineError::Checksum
            }
            FailedCheck::Number => LineError::LineNumber,
        })
    }

    /// Makes the words of the line what Grbl's lines are made of.
    fn take_words(&mut self) {
        let mut words = self.host.raw.words().iter().copied();
        // There is no line end in the words.
        let _ = self.line.input.take_from(&mut words);
    }

    /// Reads the words of a line in the RepRap dialect, and executes them.
    pub(super) fn read_reprap(&mut self, links: &mut Links<'_, '_>) -> Progress {
        self.host.next_extruder = self.host.extruder;
        if self.stage == LineStage::Asleep && !self.host.raw.is_restart() {
            replies::asleep(&mut self.reports.message);
            return self.accept();
        }
        if self.host.raw.words().trim_ascii_start().starts_with(b"$") {
            self.take_words();
            return self.dispatch(links);
        }
        let is_done = self.is_done(links.machine);
        let is_idle = is_done && links.machine.state == State::Idle;
        let host = &mut self.host;
        let settings = &self.persistence.stored.settings;
        let context = LineModes {
            settings,
            modal: self.interpreter.modal(),
            extruder: host.extruder,
            driven: driven(settings, &self.interpreter),
            position: self.interpreter.position(),
            paused_at: host.paused_at,
            is_idle,
            is_homed: self.interpreter.is_homed(),
        };
        let input = &mut self.line.input;
        let meaning = match reprap::read(host.raw.words(), &context, |text| input.push(text)) {
            Ok(meaning) => meaning,
            Err(LineError::NotIdle) if !is_done => {
                host.waits_for_standstill = true;
                return self.await_standstill();
            }
            Err(error) => return self.refuse(error),
        };
        host.command = meaning.command;
        host.next_extruder = meaning.extruder;
        host.pause_ms = meaning.pause_ms;
        host.moves_motors = meaning.moves_motors;
        host.ends_at_switch = meaning.ends_at_switch;
        if let Some(letter) = meaning.missing_axis
            && host.is_first(u16::from(letter))
        {
            replies::no_axis(&mut self.reports.message, letter);
        }
        self.dispatch(links)
    }

    /// Writes why a line is refused, and its `ok`.
    pub(super) fn write_refusal(&mut self, error: LineError) {
        let text = &mut self.reports.message;
        let words = self.host.raw.words();
        let is_homing = self.persistence.stored.settings.is_homing_on();
        replies::refusal(text, error, words, self.host.alarm, is_homing);
        report::ok(text);
    }
}

/// Returns the axis that `E` drives, and its work position.
fn driven(settings: &Settings, interpreter: &Interpreter) -> Option<(usize, Nm)> {
    let axis = usize::from(settings.extruder_axis).checked_sub(1)?;
    let position = interpreter.position();
    let offset = interpreter.work_offset(&position);
    let work = position.0.get(axis)?.0 - offset.0.get(axis)?.0;
    Some((axis, Nm(work)))
}
