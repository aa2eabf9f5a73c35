//! Lines in the RepRap dialect: numbers and checksums, and what they say in Grbl's words.

use super::{RepRap, bytes::LOST, replies};
use crate::{
    gcode::{
        LineError,
        interpreter::Interpreter,
        reprap::{self, LineModes},
    },
    model::State,
    protocol::{
        ByteReader, FailedCheck, Verdict,
        dialect::{NextStep, SessionContext},
        session::LineStage,
    },
    settings::Settings,
    units::Nm,
};

impl RepRap {
    /// Reads the next line, or goes on with the one that has been begun.
    #[inline(never)]
    pub(super) fn next_step(
        &mut self,
        session: &mut SessionContext<'_>,
        received: &mut ByteReader<'_>,
    ) -> NextStep {
        if let LineStage::ListingInDialect(line) = session.stage {
            return self.list(line, session);
        }
        if session.stage == LineStage::AwaitingStandstill {
            if core::mem::take(&mut self.waits_for_standstill) {
                session.input.clear();
                return self.read_words(session, received);
            }
            return self.execute(session, received);
        }
        if self.is_restart_due {
            return NextStep::Wait;
        }
        let waiting = self.scan.bytes_from(received.oldest());
        let has_line = session.lines.take(received, waiting, |lines, byte| {
            let is_lost = byte == LOST;
            if is_lost {
                lines.raw.lose_rest();
            }
            is_lost
        });
        if has_line {
            return self.check(session, received);
        }
        if self.has_lost_line_end(session) {
            session.lines.raw.clear();
            self.scan.line.clear();
            session.lines.has_ended = true;
            return self.ask_again(FailedCheck::MissingChecksum, session, received);
        }
        NextStep::Wait
    }

    /// Executes a line that has ended, or refuses it.
    fn check(
        &mut self,
        session: &mut SessionContext<'_>,
        received: &mut ByteReader<'_>,
    ) -> NextStep {
        self.command = None;
        let lines = &mut *session.lines;
        let verdict = lines.verdict();
        let is_checked = lines.raw.is_checked();
        let has_lost = session.requests.take_losses_before(received.oldest());
        let is_stale = self
            .stale_before
            .is_some_and(|before| before.wrapping_sub(lines.start).cast_signed() > 0);
        match verdict {
            Verdict::Blank => return NextStep::Skip,
            _ if has_lost && !is_checked => return NextStep::Answer(Err(LineError::BytesLost)),
            // A checksum may be right of what is left: two equal bytes change nothing of it.
            Verdict::Execute(_) | Verdict::SetNumber(_) if has_lost => {
                return self.ask_again(FailedCheck::Checksum, session, received);
            }
            Verdict::Execute(Some(_)) | Verdict::Refuse(_)
                if is_stale && lines.raw.has_number() =>
            {
                return NextStep::Answer(Ok(()));
            }
            Verdict::ReportNumber => {
                lines.write_number(&mut session.reports.message);
                return NextStep::Answer(Ok(()));
            }
            Verdict::SetNumber(number) => {
                lines.set_number(number);
                self.stale_before = None;
                self.reported = 0;
                return NextStep::Answer(Ok(()));
            }
            Verdict::Refuse(failed) => return self.ask_again(failed, session, received),
            Verdict::Execute(Some(number)) => {
                lines.accept_number(number);
                self.stale_before = None;
            }
            Verdict::Execute(None) => {}
        }
        if lines.raw.is_too_long() {
            return NextStep::Answer(Err(LineError::LineOverflow));
        }
        self.read_words(session, received)
    }

    /// Asks for the line after the last accepted one.
    fn ask_again(
        &mut self,
        failed: FailedCheck,
        session: &mut SessionContext<'_>,
        received: &ByteReader<'_>,
    ) -> NextStep {
        self.stale_before = Some(received.written());
        replies::resend(&mut session.reports.message, failed, session.lines.last);
        NextStep::Answer(Ok(()))
    }

    /// Reads the words of a line, and executes them.
    fn read_words(
        &mut self,
        session: &mut SessionContext<'_>,
        received: &ByteReader<'_>,
    ) -> NextStep {
        self.next_extruder = self.extruder;
        let raw = &session.lines.raw;
        if matches!(session.stage, LineStage::Asleep(_)) && !raw.is_restart() {
            replies::asleep(&mut session.reports.message);
            return NextStep::Answer(Ok(()));
        }
        if raw.words().trim_ascii_start().starts_with(b"$") {
            session.lines.copy_words(session.input);
            return NextStep::Execute;
        }
        let settings = session.settings;
        let context = LineModes {
            settings,
            modal: session.interpreter.modal(),
            extruder: self.extruder,
            driven: driven(settings, session.interpreter),
            position: session.interpreter.position(),
            paused_at: self.paused_at,
            is_idle: session.is_done && session.machine.state == State::Idle,
            is_homed: session.interpreter.is_homed(),
        };
        let input = &mut *session.input;
        let meaning = match reprap::read(raw.words(), &context, |text| input.push(text)) {
            Ok(meaning) => meaning,
            Err(LineError::NotIdle) if !session.is_done => {
                self.waits_for_standstill = true;
                return NextStep::AwaitStandstill;
            }
            Err(error) => return NextStep::Answer(Err(error)),
        };
        self.command = meaning.command;
        self.next_extruder = meaning.extruder;
        self.pause_ms = meaning.pause_ms;
        self.moves_motors = meaning.moves_motors;
        self.ends_at_switch = meaning.ends_at_switch;
        if let Some(letter) = meaning.missing_axis
            && self.is_first(u16::from(letter))
        {
            replies::no_axis(&mut session.reports.message, letter);
        }
        self.execute(session, received)
    }

    /// Returns whether something has not been reported to this job: an M code, or a letter.
    pub(super) fn is_first(&mut self, code: u16) -> bool {
        let bit = 1 << (code % 64);
        let is_first = self.reported & bit == 0;
        self.reported |= bit;
        is_first
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
