//! Words with short numbers: what nearly every word of a program is.
//!
//! A shorter way to the same values as [`Number`] has, with its grammar, for who can leave all other
//! words to it.

use super::Number;

/// A number of at most eight digits, with four of them behind the point.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SmallDecimal {
    digits: i32,
    decimals: u32,
}

/// By the decimals of a number: what its digits are times for a nanometre, and in Grbl's single
/// precision for a millimetre, in two steps.
const SCALES: [(i32, f32, f32); 5] = [
    (1_000_000, 1.0, 1.0),
    (100_000, 0.1, 1.0),
    (10_000, 0.01, 1.0),
    (1_000, 0.01, 0.1),
    (100, 0.01, 0.01),
];

/// More than eight digits, so that the seven of single precision say which step is nearer: Grbl
/// leaves out the others.
const LONG: i32 = 100_000_000;
/// So many digits fit a word.
const DIGITS: u32 = 9;
/// What is next where no byte is left.
const END: u32 = u32::MAX;

impl SmallDecimal {
    /// The value in millionths, as [`Number::to_millionths`], and as [`Number::to_grbl_f32`]; `None`
    /// with too many decimals.
    #[inline]
    #[must_use]
    pub fn coordinate(self) -> Option<(i64, f32)> {
        let &(nm, first, second) = SCALES.get(self.decimals as usize)?;
        let exact = i64::from(self.digits) * i64::from(nm);
        Some((exact, self.digits as f32 * first * second))
    }

    /// The value if it is whole and not negative.
    #[inline]
    #[must_use]
    pub fn natural(self) -> Option<u32> {
        u32::try_from(self.digits)
            .ok()
            .filter(|_| self.decimals == 0)
    }

    /// The value in single precision, if it is not negative.
    #[must_use]
    pub fn amount(self) -> Option<f32> {
        let number = Number::new(i64::from(self.digits), self.decimals as u8);
        (self.digits >= 0).then(|| number.to_f32())
    }
}

/// The words of a line, as far as they are short.
#[derive(Debug, Clone)]
pub struct PlainWords<I> {
    /// The byte that is next, or [`END`], and those after it.
    next: u32,
    rest: I,
}

impl<I: Iterator<Item = u8>> PlainWords<I> {
    /// The words of the line that begins with these bytes: upper case, without comments, with blanks
    /// between the words at most, and with the end of the line.
    #[inline]
    #[must_use]
    pub fn of(bytes: I) -> Self {
        let mut words = Self {
            next: END,
            rest: bytes,
        };
        words.advance();
        words
    }

    /// Goes on to what is no blank, and tells whether the line ends there.
    #[inline]
    #[must_use]
    pub fn skips_to_end(&mut self) -> bool {
        while self.next == u32::from(b' ') {
            self.advance();
        }
        self.next == u32::from(b'\n') || self.next == u32::from(b'\r')
    }

    /// Whether there are no more bytes, and no end of the line was among them.
    #[inline]
    #[must_use]
    pub fn is_cut_off(&self) -> bool {
        self.next == END
    }

    /// What is behind the byte that is next: the next line, where this one ends.
    #[inline]
    #[must_use]
    pub fn rest(self) -> I {
        self.rest
    }

    /// The letter that is next, or whatever stands there.
    #[inline]
    #[must_use]
    pub fn letter(&self) -> u8 {
        self.next as u8
    }

    /// The number behind that; `None` where there is none, or it is not short.
    #[inline]
    #[must_use]
    pub fn take(&mut self) -> Option<SmallDecimal> {
        self.advance();
        let is_negative = self.next == u32::from(b'-');
        if is_negative || self.next == u32::from(b'+') {
            self.advance();
        }
        let (mut value, mut length) = self.append_digits(0);
        let mut decimals = 0;
        if self.next == u32::from(b'.') {
            self.advance();
            (value, decimals) = self.append_digits(value);
            length += decimals;
        }
        let digits = value.cast_signed();
        let is_short = (1..=DIGITS).contains(&length) && digits < LONG;
        is_short.then_some(SmallDecimal {
            digits: if is_negative { -digits } else { digits },
            decimals,
        })
    }

    /// A value with the digits that come next appended, wrapping, and how many they are.
    #[inline]
    fn append_digits(&mut self, mut value: u32) -> (u32, u32) {
        let mut count = 0;
        loop {
            let digit = self.next.wrapping_sub(u32::from(b'0'));
            if digit > 9 {
                return (value, count);
            }
            value = value.wrapping_mul(10).wrapping_add(digit);
            count += 1;
            self.advance();
        }
    }

    #[inline]
    fn advance(&mut self) {
        self.next = self.rest.next().map_or(END, u32::from);
    }
}
