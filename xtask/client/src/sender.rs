//! The sender's side of Grbl's protocol: character counting, answers, messages.
//!
//! Pure: it says what may be sent and what an answer belongs to; the caller owns the line. Shared
//! by every way to drive a machine. Read with Grbl's `stream.py` and the notes on its interface.

use std::collections::VecDeque;

pub use leadscrew::sim::WINDOW;

pub use crate::Response;

/// A line that was answered.
#[derive(Debug, PartialEq, Eq)]
pub struct Answered {
    /// Its number, from 1.
    pub number: u64,
    /// Its text, as sent.
    pub line: Vec<u8>,
    /// The answer.
    pub response: Response,
}

/// What a received line means.
#[derive(Debug, PartialEq, Eq)]
pub enum Received {
    /// The oldest line in flight was answered.
    Answer(Answered),
    /// An answer to nothing that was sent.
    Surplus(Response),
    /// Everything else.
    Message,
}

/// The lengths of the lines that are not answered, with their line feeds.
#[derive(Debug)]
pub struct InFlight {
    window: usize,
    lengths: VecDeque<usize>,
    bytes: usize,
}

impl Default for InFlight {
    fn default() -> Self {
        Self::new(WINDOW)
    }
}

impl InFlight {
    /// Nothing is in flight to a machine that has room for so many bytes: [`WINDOW`] where it does not tell.
    #[must_use]
    pub fn new(window: usize) -> Self {
        Self {
            window,
            lengths: VecDeque::new(),
            bytes: 0,
        }
    }

    /// Whether the machine's receive buffer has room for a line of this length, whatever has arrived.
    #[must_use]
    pub fn has_room(&self, length: usize) -> bool {
        self.lengths.is_empty() || self.bytes + length <= self.window
    }

    /// Takes note of a line that is sent.
    pub fn send(&mut self, length: usize) {
        self.lengths.push_back(length);
        self.bytes += length;
    }

    /// Takes note of an answer: it belongs to the oldest line.
    pub fn answer(&mut self) {
        self.bytes -= self.lengths.pop_front().unwrap_or_default();
    }

    /// The number of lines.
    #[must_use]
    pub fn len(&self) -> usize {
        self.lengths.len()
    }

    /// Whether every line is answered.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lengths.is_empty()
    }
}

/// The lines between the sender and the machine's answers.
#[derive(Debug, Default)]
pub struct Sender {
    lines: VecDeque<Vec<u8>>,
    in_flight: InFlight,
    sent: u64,
    /// The newest line in flight is one that is sent alone.
    exclusive: bool,
}

impl Sender {
    /// A sender to a machine that has room for so many bytes.
    #[must_use]
    pub fn new(window: usize) -> Self {
        Self {
            in_flight: InFlight::new(window),
            ..Self::default()
        }
    }

    /// Whether a line may be sent now.
    #[must_use]
    pub fn may_send(&self, line: &[u8]) -> bool {
        let may_follow = !self.exclusive && !is_sent_alone(line);
        self.in_flight.has_room(line.len() + 1) && (may_follow || self.is_done())
    }

    /// Takes note of a line that is sent, with its line feed.
    pub fn send(&mut self, line: Vec<u8>) {
        self.in_flight.send(line.len() + 1);
        self.exclusive = is_sent_alone(&line);
        self.lines.push_back(line);
        self.sent += 1;
    }

    /// Sorts a line that was received.
    pub fn receive(&mut self, text: &str) -> Received {
        let Some(response) = Response::parse(text) else {
            return Received::Message;
        };
        let Some(line) = self.lines.pop_front() else {
            return Received::Surplus(response);
        };
        self.in_flight.answer();
        Received::Answer(Answered {
            number: self.answered(),
            line,
            response,
        })
    }

    /// Number of lines sent.
    #[must_use]
    pub fn sent(&self) -> u64 {
        self.sent
    }

    /// Number of lines answered.
    #[must_use]
    pub fn answered(&self) -> u64 {
        self.sent - self.in_flight.len() as u64
    }

    /// Number and text of the oldest line that is not answered.
    #[must_use]
    pub fn oldest(&self) -> Option<(u64, &[u8])> {
        let line = self.lines.front()?;
        Some((self.answered() + 1, line))
    }

    /// Whether every line sent has been answered.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.in_flight.is_empty()
    }
}

/// Whether a line may write to the settings memory, so that bytes sent behind it could be lost on
/// an AVR: senders wait before and after it. `$` lines, `G10`, `G28.1` and `G30.1`.
#[must_use]
pub fn is_sent_alone(line: &[u8]) -> bool {
    let code = code(line);
    code.first() == Some(&b'$')
        || g_numbers(&code).any(|number| [10.0, 28.1, 30.1].contains(&number))
}

/// The beginning of a line, as it may be printed.
#[must_use]
pub fn shown(line: &[u8]) -> String {
    const WIDTH: usize = 60;
    let text = String::from_utf8_lossy(line.trim_ascii());
    let printable = |c: char| if c.is_control() { '·' } else { c };
    let shown: String = text.chars().map(printable).collect();
    if shown.chars().count() > WIDTH {
        shown.chars().take(WIDTH - 1).chain(['…']).collect()
    } else {
        shown
    }
}

/// A line in upper case without blanks and comments.
#[must_use]
pub fn code(line: &[u8]) -> Vec<u8> {
    let mut code = Vec::new();
    let mut in_comment = false;
    for byte in line {
        match byte {
            b';' if !in_comment => break,
            b'(' => in_comment = true,
            b')' => in_comment = false,
            _ if in_comment || *byte <= b' ' => {}
            _ => code.push(byte.to_ascii_uppercase()),
        }
    }
    code
}

/// The numbers of the `G` words in [`code`].
pub fn g_numbers(code: &[u8]) -> impl Iterator<Item = f64> {
    code.split(|byte| *byte == b'G').skip(1).filter_map(|word| {
        let end = word
            .iter()
            .position(|byte| !byte.is_ascii_digit() && *byte != b'.');
        let digits = &word[..end.unwrap_or(word.len())];
        str::from_utf8(digits).ok()?.parse().ok()
    })
}

/// What is sent for a byte that must not be: no word has it.
pub const REFUSED: u8 = 0x7f;

/// A line of a program as it is sent: without what the machine would take for realtime commands (`?`, `!`, `~`, 0x18,
/// bytes from 0x80 on that are no text in UTF-8).
///
/// In a comment they are left out. Elsewhere that would join what they separate (`X1?5` is not X15), so that something is
/// sent in their place that is refused.
#[must_use]
pub fn sendable(line: &[u8]) -> Vec<u8> {
    let mut sent = Vec::with_capacity(line.len());
    let (mut in_parentheses, mut in_rest) = (false, false);
    for chunk in line.utf8_chunks() {
        for character in chunk.valid().chars() {
            let is_code = !in_parentheses && !in_rest;
            match character {
                '(' if is_code => in_parentheses = true,
                ')' if !in_rest => in_parentheses = false,
                ';' if is_code => in_rest = true,
                _ => {}
            }
            let is_first = sent.is_empty();
            match character {
                '\u{a0}' if is_first => sent.push(b' '),
                '?' | '!' | '~' | '\x18' | '\u{80}'..='\u{9f}' if is_code => sent.push(REFUSED),
                '\u{a1}'..='\u{a3}' if is_code && is_first => sent.push(REFUSED),
                '?' | '!' | '~' | '\x18' | '\u{80}'..='\u{9f}' => {}
                _ => sent.extend(character.encode_utf8(&mut [0; 4]).bytes()),
            }
        }
        if !chunk.invalid().is_empty() && !in_parentheses && !in_rest {
            sent.push(REFUSED);
        }
    }
    sent
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sender_with(lines: &[&[u8]]) -> Sender {
        let mut sender = Sender::default();
        for line in lines {
            assert!(sender.may_send(line));
            sender.send(line.to_vec());
        }
        sender
    }

    #[test]
    fn never_more_than_127_bytes_are_in_flight() {
        let mut sender = sender_with(&[&[b'X'; 59], &[b'Y'; 59]]);
        assert!(sender.may_send(b"G0X100"));
        assert!(!sender.may_send(b"G0X1000"));
        assert!(matches!(sender.receive("ok"), Received::Answer(_)));
        assert!(sender.may_send(b"G0X1000"));
    }

    #[test]
    fn a_machine_that_tells_of_more_room_gets_more() {
        let mut sender = Sender::new(1023);
        sender.send(vec![b'X'; 1000]);
        assert!(sender.may_send(&[b'Y'; 21]));
        assert!(!sender.may_send(&[b'Y'; 22]));
    }

    #[test]
    fn a_line_longer_than_the_window_waits_until_nothing_is_in_flight() {
        let mut sender = sender_with(&[b"G0"]);
        assert!(!sender.may_send(&[b'('; 10_000]));
        sender.receive("ok");
        assert!(sender.may_send(&[b'('; 10_000]));
    }

    #[test]
    fn answers_belong_to_lines_in_order() {
        let mut sender = sender_with(&[b"G0", b"G999"]);
        let answer = |number, line: &[u8], response| {
            Received::Answer(Answered {
                number,
                line: line.to_vec(),
                response,
            })
        };
        assert_eq!(sender.receive("ok"), answer(1, b"G0", Response::Ok));
        assert_eq!(sender.receive("[MSG:hello]"), Received::Message);
        let refused = answer(2, b"G999", Response::Error(20));
        assert_eq!(sender.receive("error:20"), refused);
        assert_eq!(sender.receive("ok"), Received::Surplus(Response::Ok));
        assert!(sender.is_done());
    }

    #[test]
    fn lines_that_write_settings_are_sent_alone() {
        for line in [
            "$$",
            "  $H",
            "g10 L2 P1 X0",
            "G90 G28.1",
            "N5G30.1",
            "G 10 L20",
        ] {
            assert!(is_sent_alone(line.as_bytes()), "{line}");
        }
        for line in ["", "G28", "G30 X0", "G1 X10", "G100", "M10", "G1.0"] {
            assert!(!is_sent_alone(line.as_bytes()), "{line}");
        }
        let mut sender = sender_with(&[b"G0"]);
        assert!(!sender.may_send(b"G10L2P1"));
        sender.receive("ok");
        sender.send(b"G10L2P1".to_vec());
        assert!(!sender.may_send(b"G0"));
        sender.receive("ok");
        assert!(sender.may_send(b"G0"));
    }
}
