//! Lines that cannot be damaged unseen: the number before a line and the checksum behind it.
//!
//! ```text
//! N3 G1 X10*80   ; the number, the words, the exclusive or of all bytes before the asterisk
//! ```
//!
//! [`RawLine`] takes a line byte by byte; [`RawLine::verdict`] decides about the line, from its bytes and the last
//! accepted number alone. Read with the G-code pages of the RepRap wiki.

use core::ops::Range;

/// Length of the longest line, with everything in it, bytes.
pub const RAW_BYTES: usize = 256;

/// The largest number of a line.
pub const MAX_NUMBER: i32 = i32::MAX - 1;

/// The part of a line to which the next byte belongs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum LinePart {
    #[default]
    Words,
    /// Between `(` and `)`.
    Parentheses,
    /// After `;`.
    Semicolon,
    /// Between quotation marks.
    Quotes,
}

/// The last asterisk of a line, and what follows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Checksum {
    /// Number of asterisks.
    asterisks: u8,
    /// Bytes before the last one, and their exclusive or.
    start: usize,
    xor: u8,
    /// The number behind it, its digits, and whether a blank has followed them.
    value: u16,
    digits: u8,
    has_ended: bool,
    is_wrong: bool,
}

impl Checksum {
    /// No asterisk yet.
    const NONE: Self = Self {
        asterisks: 0,
        start: 0,
        xor: 0,
        value: 0,
        digits: 0,
        has_ended: false,
        is_wrong: false,
    };

    /// Takes an asterisk behind `start` bytes.
    const fn begin(&mut self, start: usize, xor: u8) {
        *self = Self {
            asterisks: self.asterisks.saturating_add(1),
            start,
            xor,
            ..Self::NONE
        };
    }

    /// Takes a byte behind the asterisk that is not in a comment.
    const fn push(&mut self, byte: u8) {
        match byte {
            b'0'..=b'9' if !self.has_ended && self.digits < 3 => {
                // A number has no zero in front: a doubled zero is damage.
                self.is_wrong |= self.digits == 1 && self.value == 0;
                self.value = self.value * 10 + (byte - b'0') as u16;
                self.digits += 1;
            }
            b' ' | b'\t' => self.has_ended |= self.digits != 0,
            _ => self.is_wrong = true,
        }
    }

    /// Returns whether a number follows the asterisk.
    const fn is_number(&self) -> bool {
        self.digits != 0 && !self.is_wrong
    }

    /// Returns whether the line is what the sender has sent. A text may have asterisks of its own.
    const fn is_right(&self, is_text: bool) -> bool {
        let is_only = self.asterisks == 1 || is_text;
        is_only && self.is_number() && self.value == self.xor as u16
    }
}

/// What has to become of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing: it is blank, or a comment.
    Blank,
    /// The line is executed; this is its number, if any.
    Execute(Option<i32>),
    /// It only sets the number of the last line.
    SetNumber(i32),
    /// It asks for that number.
    ReportNumber,
    /// It is refused, and asked for again.
    Refuse(FailedCheck),
}

/// The check by which a line is not what the sender has sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FailedCheck {
    /// The checksum is wrong, or the number is none.
    Checksum,
    /// There is a number and no checksum.
    MissingChecksum,
    /// There is a checksum and no number.
    MissingNumber,
    /// The number is not the next one.
    Number,
}

/// A line as it comes.
#[derive(Debug)]
pub struct RawLine<const N: usize = RAW_BYTES> {
    bytes: [u8; N],
    /// Bytes so far, also those for which there was no room.
    length: usize,
    xor: u8,
    region: LinePart,
    /// Of the asterisks among the words, and of all: a text has no comments and no quotes.
    checksum: Checksum,
    text_checksum: Checksum,
    /// Whether anything but blanks and comments has come.
    has_words: bool,
}

impl<const N: usize> RawLine<N> {
    /// An empty line.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            bytes: [0; N],
            length: 0,
            xor: 0,
            region: LinePart::Words,
            checksum: Checksum::NONE,
            text_checksum: Checksum::NONE,
            has_words: false,
        }
    }

    /// Begins a new line.
    pub fn clear(&mut self) {
        self.length = 0;
        self.xor = 0;
        self.region = LinePart::Words;
        self.checksum = Checksum::NONE;
        self.text_checksum = Checksum::NONE;
        self.has_words = false;
    }

    /// Returns whether nothing has come yet.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Returns whether bytes of the line were dropped.
    #[must_use]
    pub const fn is_too_long(&self) -> bool {
        self.length > N
    }

    /// Makes the line one of which bytes were dropped.
    pub fn lose_rest(&mut self) {
        self.length = self.length.max(N).saturating_add(1);
    }

    /// Takes the next byte, which does not end the line.
    pub fn push(&mut self, byte: u8) {
        if let Some(place) = self.bytes.get_mut(self.length) {
            *place = byte;
        }
        let is_blank = matches!(byte, b' ' | b'\t');
        if byte == b'*' {
            self.text_checksum.begin(self.length, self.xor);
        } else if self.text_checksum.asterisks != 0 {
            self.text_checksum.push(byte);
        }
        match (self.region, byte) {
            (LinePart::Words, b';') => self.region = LinePart::Semicolon,
            (LinePart::Words, b'(') => {
                self.region = LinePart::Parentheses;
                self.checksum.is_wrong |= self.checksum.asterisks != 0;
            }
            (LinePart::Words, b'*') => {
                self.checksum.begin(self.length, self.xor);
                self.has_words = true;
            }
            (LinePart::Words, _) => {
                if byte == b'"' {
                    self.region = LinePart::Quotes;
                }
                if self.checksum.asterisks != 0 {
                    self.checksum.push(byte);
                }
                self.has_words |= !is_blank;
            }
            (LinePart::Parentheses, b')') | (LinePart::Quotes, b'"') => {
                self.region = LinePart::Words;
            }
            (LinePart::Parentheses | LinePart::Semicolon | LinePart::Quotes, _) => {}
        }
        self.xor ^= byte;
        self.length = self.length.saturating_add(1);
    }

    /// Returns whether a line that has not ended is one with a number or a checksum.
    #[must_use]
    pub fn is_checked(&self) -> bool {
        let (number, _) = self.number();
        number.is_some() || self.checksum.asterisks != 0
    }

    /// Returns whether the line has a checksum, right or wrong.
    #[must_use]
    pub fn has_checksum(&self) -> bool {
        self.chosen_checksum().is_some()
    }

    /// Returns whether the line begins with an `N`.
    #[must_use]
    pub fn has_number(&self) -> bool {
        self.number().0.is_some()
    }

    /// Returns the line without its number and its checksum.
    #[must_use]
    pub fn words(&self) -> &[u8] {
        self.bytes.get(self.range()).unwrap_or_default()
    }

    /// Returns whether the rest of a line with a number is a text, in which comments and quotes mean
    /// nothing.
    fn is_text(&self) -> bool {
        let (number, start) = self.number();
        let line = self.received().get(start..).unwrap_or_default();
        number.is_some() && (has_code(line, b"M117").is_some() || has_code(line, b"M118").is_some())
    }

    fn received(&self) -> &[u8] {
        self.bytes
            .get(..self.length)
            .unwrap_or(self.bytes.as_slice())
    }

    fn range(&self) -> Range<usize> {
        let (_, start) = self.number();
        let checksum = self.chosen_checksum();
        let end = checksum.map_or(self.length, |checksum| checksum.start);
        let end = end.min(N);
        start.min(end)..end
    }

    /// Returns the checksum, `None` without.
    fn chosen_checksum(&self) -> Option<&Checksum> {
        let checksum = if self.is_text() {
            &self.text_checksum
        } else {
            &self.checksum
        };
        (checksum.asterisks != 0).then_some(checksum)
    }

    /// Returns the number at the beginning, `None` without an `N`, and where the words begin.
    fn number(&self) -> (Option<Result<i32, NotANumber>>, usize) {
        let line = self.received();
        let blanks = line.iter().take_while(|byte| is_blank(**byte)).count();
        match line.get(blanks..) {
            Some([b'N' | b'n', tail @ ..]) => match read_number(tail) {
                Some((number, used)) => (Some(Ok(number)), blanks + 1 + used),
                None => (Some(Err(NotANumber)), blanks + 1),
            },
            _ => (None, 0),
        }
    }

    /// Says what has to become of a line that has ended. `last` is the number of the last accepted line. `has_begun`
    /// tells whether the lines of the sender have checksums: a part of a line may then come without its number, and
    /// with the asterisk in an apparent comment or text.
    #[must_use]
    pub fn verdict(&self, last: i32, has_begun: bool) -> Verdict {
        let (number, _) = self.number();
        let checksum = self.chosen_checksum();
        let has_checksum = checksum.is_some();
        let is_right = checksum.is_some_and(|it| it.is_right(self.is_text()));
        if !self.has_words {
            return Verdict::Blank;
        }
        if has_checksum && !is_right && number.is_some() {
            return Verdict::Refuse(FailedCheck::Checksum);
        }
        let number = match number {
            Some(Err(NotANumber)) => return Verdict::Refuse(FailedCheck::Checksum),
            Some(Ok(_)) if !has_checksum => return Verdict::Refuse(FailedCheck::MissingChecksum),
            Some(Ok(number)) => Some(number),
            None => None,
        };
        if let Some(tail) = has_code(self.words(), b"M110") {
            return match (set_number(tail), number) {
                (Some(Ok(set)), _) if !has_checksum || is_right => Verdict::SetNumber(set),
                (Some(_), _) => Verdict::Refuse(FailedCheck::Checksum),
                (None, Some(number)) => Verdict::SetNumber(number),
                (None, None) if has_checksum => Verdict::Refuse(FailedCheck::MissingNumber),
                (None, None) => Verdict::ReportNumber,
            };
        }
        match number {
            Some(number) if number == next_number(last) => Verdict::Execute(Some(number)),
            Some(_) => Verdict::Refuse(FailedCheck::Number),
            None if has_checksum || has_begun && self.is_part() => {
                Verdict::Refuse(FailedCheck::MissingNumber)
            }
            None => Verdict::Execute(None),
        }
    }

    /// Whether the line may be the end of a line in which a byte has become a line end: it ends with a checksum, or is
    /// a checksum without its asterisk.
    fn is_part(&self) -> bool {
        let line = self.received().trim_ascii();
        let is_number = (1..=3).contains(&line.len()) && line.iter().all(u8::is_ascii_digit);
        is_number || self.text_checksum.is_number()
    }

    /// Returns whether the line is `M999`.
    #[must_use]
    pub fn is_restart(&self) -> bool {
        has_code(self.words(), b"M999").is_some()
    }

    /// Returns whether the line is the command of an emergency, with its checksum right where there is
    /// one; the number does not matter.
    #[must_use]
    pub fn emergency(&self) -> Option<Emergency> {
        let (number, _) = self.number();
        let has_checksum = self.checksum.asterisks != 0;
        let is_whole = match number {
            Some(Ok(_)) => has_checksum && self.checksum.is_right(false),
            Some(Err(NotANumber)) => false,
            None => !has_checksum,
        };
        if !is_whole || self.is_too_long() {
            return None;
        }
        [
            (&b"M112"[..], Emergency::Kill),
            (b"M108", Emergency::GoOn),
            (b"M24", Emergency::GoOn),
            (b"M410", Emergency::Stop),
        ]
        .into_iter()
        .find_map(|(code, emergency)| has_code(self.words(), code).map(|_| emergency))
    }
}

impl<const N: usize> Default for RawLine<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// A command that does not wait for the lines before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Emergency {
    /// `M112`: the machine stops and is locked.
    Kill,
    /// `M108`, `M24`: what waits for the user goes on.
    GoOn,
    /// `M410`: the machine stops, and goes on with the lines that follow.
    Stop,
}

/// An `N` without a number, or with one out of range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct NotANumber;

/// Returns the number that comes after a line's.
#[must_use]
pub(super) const fn next_number(last: i32) -> i32 {
    last.saturating_add(1)
}

const fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t')
}

/// Reads a whole number of a line, and the number of its bytes. It ends before anything that is no part
/// of a number.
fn read_number(text: &[u8]) -> Option<(i32, usize)> {
    let is_negative = text.first() == Some(&b'-');
    let digits = text.get(usize::from(is_negative)..).unwrap_or_default();
    let n = digits
        .iter()
        .take_while(|byte| byte.is_ascii_digit())
        .count();
    if n == 0 || n > 10 || matches!(digits.get(n), Some(b'.' | b'-' | b'+')) {
        return None;
    }
    let mut value = 0_i64;
    for digit in digits.iter().take(n) {
        value = value * 10 + i64::from(digit - b'0');
    }
    let value = if is_negative { -value } else { value };
    let number = i32::try_from(value).ok()?;
    (-1..=MAX_NUMBER)
        .contains(&number)
        .then_some((number, usize::from(is_negative) + n))
}

/// Returns the words after a code, if the words begin with this code and not with a longer one.
fn has_code<'a>(words: &'a [u8], code: &[u8]) -> Option<&'a [u8]> {
    let words = words.trim_ascii_start();
    let (start, tail) = words.split_at_checked(code.len())?;
    let is_longer = matches!(tail.first(), Some(b'0'..=b'9' | b'.'));
    (start.eq_ignore_ascii_case(code) && !is_longer).then_some(tail)
}

/// Reads the `N` of an `M110`, `None` without.
fn set_number(tail: &[u8]) -> Option<Result<i32, NotANumber>> {
    match tail.trim_ascii() {
        [b'N' | b'n', number @ ..] => {
            let read = read_number(number).filter(|(_, used)| *used == number.len());
            Some(read.map(|(number, _)| number).ok_or(NotANumber))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(text: &[u8]) -> RawLine {
        let mut line = RawLine::new();
        for byte in text {
            line.push(*byte);
        }
        line
    }

    #[test]
    fn a_line_is_judged_by_its_checksum_then_by_its_number() {
        use FailedCheck::{Checksum, MissingChecksum, MissingNumber, Number};
        use Verdict::{Blank, Execute, Refuse, ReportNumber, SetNumber};
        for (text, verdict) in [
            ("N3 T0*57", Execute(Some(3))),
            ("n3 T0*57", Refuse(Checksum)),
            ("N3 T0*57 ", Execute(Some(3))),
            ("N3 T0*57 ;comment*1", Execute(Some(3))),
            ("N3 T0*58", Refuse(Checksum)),
            ("N3 T0*057", Refuse(Checksum)),
            ("N3 T0*257", Refuse(Checksum)),
            ("N3 T0*00057", Refuse(Checksum)),
            ("N3 T0*", Refuse(Checksum)),
            ("N3 T0*5 7", Refuse(Checksum)),
            ("N3 T0*57*57", Refuse(Checksum)),
            ("N3 T0*57*17", Refuse(Checksum)),
            ("N3 T0", Refuse(MissingChecksum)),
            ("N3 T0;*57", Refuse(MissingChecksum)),
            ("N3 T0\"*57", Refuse(MissingChecksum)),
            ("N3.0 T0*57", Refuse(Checksum)),
            ("N T0*57", Refuse(Checksum)),
            ("N99999999999 T0*57", Refuse(Checksum)),
            ("T0*57", Refuse(MissingNumber)),
            ("57", Refuse(MissingNumber)),
            ("T0", Execute(None)),
            ("", Blank),
            (" \t", Blank),
            ("; N3 T0*57", Blank),
            ("(T0)", Blank),
            ("N4 T0*62", Refuse(Number)),
            ("N0 M110 N0*125", SetNumber(0)),
            ("N-1 M110 N-1*125", SetNumber(-1)),
            ("N0 M110*35", SetNumber(0)),
            ("M110 N7", SetNumber(7)),
            ("m110n7", SetNumber(7)),
            ("M110", ReportNumber),
            ("M1100", Execute(None)),
            ("N3 M117 a;b*12", Refuse(Checksum)),
            ("N3 M117 a*b*46", Execute(Some(3))),
            ("N3 M118 **34", Execute(Some(3))),
            (r#"N3 m117 "a*b*7"*19"#, Execute(Some(3))),
            ("N3 M117 2*3*4 (6*4)*59", Execute(Some(3))),
            ("N3 M117 a*b*47", Refuse(Checksum)),
            ("N3 M117 a*b", Refuse(Checksum)),
        ] {
            assert_eq!(line(text.as_bytes()).verdict(2, true), verdict, "{text}");
        }
    }

    #[test]
    fn an_emergency_is_a_whole_line_whose_checksum_is_right() {
        for (text, emergency) in [
            ("M112", Some(Emergency::Kill)),
            (" m112 ", Some(Emergency::Kill)),
            ("M112;now", Some(Emergency::Kill)),
            ("M108", Some(Emergency::GoOn)),
            ("M24", Some(Emergency::GoOn)),
            ("M240", None),
            ("M410", Some(Emergency::Stop)),
            ("N7 M112*38", Some(Emergency::Kill)),
            ("N7 M112*35", None),
            ("N7 M112", None),
            ("M112*36", None),
            ("M1120", None),
            ("M112.5", None),
            ("G1 M112", None),
        ] {
            assert_eq!(line(text.as_bytes()).emergency(), emergency, "{text}");
        }
    }
}
