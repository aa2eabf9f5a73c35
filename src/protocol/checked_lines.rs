//! Lines with numbers and checksums, as they are received: what all dialects do with them alike.
//!
//! A line is taken whole, then judged by its number and its checksum ([`RawLine::verdict`]). Only a line that gives
//! both can be asked for again.

use super::{
    ByteReader, FailedCheck, Line, RawLine, Text, Verdict,
    checked::next_number,
    dialect::NextStep,
    utf8_requests::{LATIN_1_LEAD, is_utf8_request},
};

use crate::{gcode::LineError, model::Requests};

/// The placeholder of a received byte that has been acted on, or belongs to a dropped line.
pub(super) const TAKEN: u8 = 0;

/// The line being received, and the last one that was accepted.
#[derive(Debug)]
pub(super) struct CheckedLines {
    /// The line as received, and whether it has ended.
    pub(super) raw: RawLine,
    pub(super) has_ended: bool,
    /// Behind the first byte of what may be a realtime byte in UTF-8.
    follows_lead: bool,
    /// Number of the line's first byte.
    pub(super) start: usize,
    /// Number of the last accepted line.
    pub(super) last: i32,
    /// Whether there has been a good line with a checksum.
    pub(super) has_begun: bool,
}

impl CheckedLines {
    /// No line yet.
    pub(super) fn new() -> Self {
        Self {
            raw: RawLine::new(),
            has_ended: false,
            follows_lead: false,
            start: 0,
            last: 0,
            has_begun: false,
        }
    }

    /// Forgets what has been received and numbered.
    pub(super) fn reset(&mut self) {
        self.raw.clear();
        self.has_ended = false;
        self.last = 0;
        self.has_begun = false;
    }

    /// Returns whether no line has begun.
    pub(super) fn is_empty(&self) -> bool {
        self.has_ended || self.raw.is_empty()
    }

    /// Moves received bytes to the line, `waiting` at most, up to its end, but for those that `is_special` has dealt
    /// with. Returns false when the end has not come yet.
    pub(super) fn take(
        &mut self,
        received: &mut ByteReader<'_>,
        waiting: usize,
        is_special: impl Fn(&mut Self, u8) -> bool,
    ) -> bool {
        if core::mem::take(&mut self.has_ended) {
            self.raw.clear();
        }
        let oldest = received.oldest();
        let [older, newer] = received.waiting();
        let mut taken = 0;
        for byte in older.chain(newer).take(waiting) {
            if self.raw.is_empty() {
                self.start = oldest.wrapping_add(taken);
            }
            taken += 1;
            if core::mem::take(&mut self.follows_lead) {
                if is_utf8_request(byte, self.raw.is_empty()) {
                    continue;
                }
                self.raw.push(LATIN_1_LEAD);
            }
            match byte {
                b'\n' | b'\r' => {
                    self.has_ended = true;
                    break;
                }
                TAKEN => {}
                _ if is_special(self, byte) => {}
                _ => self.raw.push(byte),
            }
        }
        received.consume(taken);
        self.has_ended
    }

    /// Takes a line in Grbl's words: realtime bytes in UTF-8 are no part of it.
    pub(super) fn take_grbl(&mut self, received: &mut ByteReader<'_>) -> bool {
        self.take(received, received.len(), |lines, byte| {
            lines.follows_lead = byte == LATIN_1_LEAD;
            lines.follows_lead
        })
    }

    /// Reads the next line, in Grbl's words, which may have a number and a checksum.
    #[inline(never)]
    pub(super) fn read_grbl(
        &mut self,
        received: &mut ByteReader<'_>,
        requests: &Requests,
        line: &mut Line,
        text: &mut Text,
    ) -> NextStep {
        if !self.take_grbl(received) {
            return NextStep::Wait;
        }
        let has_lost = requests.take_losses_before(received.oldest());
        // A line can be asked for again only if its sender gives it both.
        let is_unchecked = !self.raw.has_checksum() || !self.raw.has_number();
        match self.verdict() {
            _ if has_lost && is_unchecked => return NextStep::RefuseLost,
            // A checksum may be right of what is left: two equal bytes change nothing of it.
            Verdict::Execute(_) | Verdict::SetNumber(_) if has_lost => {
                return self.ask_again(LineError::Checksum, text);
            }
            Verdict::Blank if self.raw.is_too_long() => return NextStep::Answer(Ok(())),
            Verdict::ReportNumber => {
                self.write_number(text);
                return NextStep::Answer(Ok(()));
            }
            Verdict::SetNumber(number) => {
                self.set_number(number);
                return NextStep::Answer(Ok(()));
            }
            Verdict::Refuse(FailedCheck::Checksum | FailedCheck::MissingNumber) => {
                return self.ask_again(LineError::Checksum, text);
            }
            Verdict::Refuse(FailedCheck::Number) => {
                return self.ask_again(LineError::LineNumber, text);
            }
            Verdict::Execute(Some(number)) => self.accept_number(number),
            // A comment may be a message, and senders that speak Grbl may number their lines for themselves.
            Verdict::Blank
            | Verdict::Refuse(FailedCheck::MissingChecksum)
            | Verdict::Execute(None) => {}
        }
        if self.raw.is_too_long() {
            return NextStep::Answer(Err(LineError::LineOverflow));
        }
        self.copy_words(line);
        NextStep::Execute
    }

    /// Asks for the line after the last accepted one, in Grbl's words, and refuses this one.
    fn ask_again(&self, error: LineError, text: &mut Text) -> NextStep {
        text.word("[MSG:Resend: ");
        text.integer(next_number(self.last)).word("]").end();
        NextStep::Answer(Err(error))
    }

    /// Appends the words of the line to one that is made of Grbl's words.
    pub(super) fn copy_words(&self, line: &mut Line) {
        let mut words = self.raw.words().iter().copied();
        // There is no line end in the words.
        let _ = line.take_from(&mut words);
    }

    /// Returns what has to become of the line.
    pub(super) fn verdict(&self) -> Verdict {
        self.raw.verdict(self.last, self.has_begun)
    }

    /// Takes the number of a line for the last one.
    pub(super) fn accept_number(&mut self, number: i32) {
        self.last = number;
        self.has_begun = true;
    }

    /// Takes the number that `M110` sets for the last one.
    pub(super) fn set_number(&mut self, number: i32) {
        self.last = number;
        self.has_begun |= self.raw.is_checked();
    }

    /// `echo:Line number: 7`.
    pub(super) fn write_number(&self, text: &mut Text) {
        text.word("echo:Line number: ");
        text.integer(self.last).end();
    }
}
