//! Decimal numbers, exactly as written: a sign, digits and a point, each optional, no exponent.
//!
//! A number is kept as digits and a decimal point until its unit is known: a coordinate is then
//! rounded once, to one nanometre. Digits beyond the ninth decimal do not count. Read with Grbl 1.1
//! `read_float`, whose single precision decides between equally near steps.
//!
//! # Cost
//! Nearly every number of a program has at most eight digits: a [`SmallDecimal`], which is read and
//! scaled in single words. All other numbers are read once more, by `Scanner::long_decimal`.

use core::iter::Chain;

/// A decimal number: `mantissa / 10^decimals`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Decimal {
    mantissa: i64,
    decimals: u8,
}

/// A number below 10^8, of at most nine digits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SmallDecimal {
    digits: i32,
    decimals: u32,
}

/// The bytes of a text, read with one byte of lookahead.
#[derive(Debug, Clone)]
pub struct Scanner<I> {
    /// The next byte, or [`END`].
    next: u32,
    /// The bytes after the next one.
    following: I,
}

/// Stands for the next byte at the end of the text: as a byte it is no letter, nor part of a number.
const END: u32 = 256;
/// Grbl keeps eight digits: single precision does not have more.
const GRBL_LIMIT: u32 = 100_000_000;
/// Most digits that fit a word.
const WORD_DIGITS: u32 = 9;

/// By the decimals of a number: the factor from its digits to a nanometre, and Grbl's factors to a
/// millimetre, of which the second one comes after rounding.
const SCALES: [(i32, f32, f32); 5] = [
    (1_000_000, 1.0, 1.0),
    (100_000, 0.1, 1.0),
    (10_000, 0.01, 1.0),
    (1_000, 0.01, 0.1),
    (100, 0.01, 0.01),
];

/// Powers of ten up to the most decimals that are kept.
const POWERS: [i32; 10] = [
    1,
    10,
    100,
    1_000,
    10_000,
    100_000,
    1_000_000,
    10_000_000,
    100_000_000,
    1_000_000_000,
];

/// 10^`exponent`; 10^9 above.
fn power(exponent: u8) -> i32 {
    *POWERS.get(usize::from(exponent)).unwrap_or(&1_000_000_000)
}

/// Quotient and remainder by a power of ten, towards zero.
fn divide(value: i64, exponent: u8) -> (i64, i64) {
    let divisor = i64::from(power(exponent));
    // No power in the table is zero.
    let quotient = value.checked_div(divisor).unwrap_or(0);
    (quotient, value.wrapping_sub(quotient.wrapping_mul(divisor)))
}

impl<I: Iterator<Item = u8>> Scanner<I> {
    /// A scanner at the beginning of a text.
    #[inline]
    #[must_use]
    pub fn new(text: I) -> Self {
        let mut scanner = Self {
            next: END,
            following: text,
        };
        scanner.advance();
        scanner
    }

    /// The next byte; 0 at the end.
    #[inline]
    #[must_use]
    pub fn peek(&self) -> u8 {
        self.next as u8
    }

    /// Whether a byte is next.
    #[inline]
    #[must_use]
    pub fn is_at(&self, byte: u8) -> bool {
        self.next == u32::from(byte)
    }

    /// Whether no byte is left.
    #[inline]
    #[must_use]
    pub fn is_at_end(&self) -> bool {
        self.next == END
    }

    /// The bytes after the next one.
    #[inline]
    #[must_use]
    pub fn following(self) -> I {
        self.following
    }

    /// The scanner with more bytes after its own.
    #[must_use]
    pub fn chain<J: Iterator<Item = u8>>(self, more: J) -> Scanner<Chain<I, J>> {
        let is_at_end = self.is_at_end();
        let mut scanner = Scanner {
            next: self.next,
            following: self.following.chain(more),
        };
        if is_at_end {
            scanner.advance();
        }
        scanner
    }

    /// Skips the next byte.
    #[inline]
    pub fn advance(&mut self) {
        self.next = self.following.next().map_or(END, u32::from);
    }

    /// Reads a number; `None` without a digit, and for a number that is not small.
    #[inline]
    #[must_use]
    pub fn small_decimal(&mut self) -> Option<SmallDecimal> {
        let is_negative = self.sign();
        let (mut value, mut length) = self.append_digits(0);
        let mut decimals = 0;
        if self.is_at(b'.') {
            self.advance();
            (value, decimals) = self.append_digits(value);
            length += decimals;
        }
        let is_small = (1..=WORD_DIGITS).contains(&length) && value < GRBL_LIMIT;
        let digits = value.cast_signed();
        is_small.then_some(SmallDecimal {
            // Wrapping, as it is known only afterwards whether the number is small.
            digits: if is_negative {
                digits.wrapping_neg()
            } else {
                digits
            },
            decimals,
        })
    }

    /// Reads a number; `None` without a digit. A whole part of more than 18 digits saturates.
    #[must_use]
    pub fn decimal(&mut self) -> Option<Decimal>
    where
        I: Clone,
    {
        let start = self.clone();
        if let Some(small) = self.small_decimal() {
            return Some(small.into());
        }
        *self = start;
        self.long_decimal()
    }

    /// Reads a number of any length.
    #[inline(never)]
    fn long_decimal(&mut self) -> Option<Decimal> {
        let is_negative = self.sign();
        let (mut mantissa, mut decimals) = (0_u64, 0);
        let mut has_digits = false;
        while let Some(digit) = self.digit() {
            mantissa = if mantissa < Decimal::EXTENSION_LIMIT {
                mantissa * 10 + u64::from(digit)
            } else {
                i64::MAX as u64
            };
            has_digits = true;
        }
        if self.is_at(b'.') {
            self.advance();
            while let Some(digit) = self.digit() {
                if mantissa < Decimal::EXTENSION_LIMIT && decimals < Decimal::MAX_DECIMALS {
                    mantissa = mantissa * 10 + u64::from(digit);
                    decimals += 1;
                }
                has_digits = true;
            }
        }
        let magnitude = mantissa.cast_signed();
        let mantissa = if is_negative { -magnitude } else { magnitude };
        has_digits.then_some(Decimal { mantissa, decimals })
    }

    /// Reads a sign, and returns whether it is a minus.
    #[inline]
    fn sign(&mut self) -> bool {
        let is_negative = self.is_at(b'-');
        if is_negative || self.is_at(b'+') {
            self.advance();
        }
        is_negative
    }

    /// Reads a digit.
    #[inline]
    fn digit(&mut self) -> Option<u32> {
        let digit = self.next.wrapping_sub(u32::from(b'0'));
        let is_digit = digit <= 9;
        if is_digit {
            self.advance();
        }
        is_digit.then_some(digit)
    }

    /// Reads digits, and returns a value with the digits appended, wrapping, and their number.
    #[inline]
    fn append_digits(&mut self, mut value: u32) -> (u32, u32) {
        let mut n = 0;
        while let Some(digit) = self.digit() {
            value = value.wrapping_mul(10).wrapping_add(digit);
            n += 1;
        }
        (value, n)
    }
}

impl SmallDecimal {
    /// The value in millionths, as [`Decimal::to_millionths`], and as [`Decimal::to_grbl_f32`];
    /// `None` with more than four decimals.
    #[inline]
    #[must_use]
    pub fn coordinate(self) -> Option<(i64, f32)> {
        let &(factor, first, second) = SCALES.get(self.decimals as usize)?;
        let exact = i64::from(self.digits) * i64::from(factor);
        Some((exact, self.digits as f32 * first * second))
    }

    /// The value if the number has no decimals and is not negative.
    #[inline]
    #[must_use]
    pub fn natural(self) -> Option<u32> {
        let natural = u32::try_from(self.digits).ok();
        natural.filter(|_| self.decimals == 0)
    }

    /// The value in single precision, as [`Decimal::to_f32`], if the number is not negative.
    #[must_use]
    pub fn non_negative(self) -> Option<f32> {
        (self.digits >= 0).then(|| Decimal::from(self).to_f32())
    }
}

impl From<SmallDecimal> for Decimal {
    fn from(small: SmallDecimal) -> Self {
        Self::new(i64::from(small.digits), small.decimals as u8)
    }
}

impl Decimal {
    /// 0.
    pub const ZERO: Self = Self::new(0, 0);
    /// Decimals that count.
    pub const MAX_DECIMALS: u8 = 9;
    /// The greatest value of a conversion, which stands for every greater one: more than any machine
    /// reaches, in nm, and a few of them can be added.
    pub const CONVERSION_LIMIT: i64 = 1_000_000_000_000_000_000;
    /// A mantissa below this limit can be extended by one more digit.
    const EXTENSION_LIMIT: u64 = 900_000_000_000_000_000;

    /// A number from its digits.
    #[must_use]
    pub const fn new(mantissa: i64, decimals: u8) -> Self {
        Self {
            mantissa,
            decimals: if decimals > Self::MAX_DECIMALS {
                Self::MAX_DECIMALS
            } else {
                decimals
            },
        }
    }

    /// The number at the beginning of a text, and the text after the number; `None` without a digit.
    #[must_use]
    pub fn parse(text: &[u8]) -> Option<(Self, &[u8])> {
        let mut scanner = Scanner::new(text.iter().copied());
        let number = scanner.decimal()?;
        let remaining = scanner.following.len() + usize::from(!scanner.is_at_end());
        Some((number, text.get(text.len() - remaining..)?))
    }

    /// Whether the value is 0.
    #[must_use]
    pub const fn is_zero(self) -> bool {
        self.mantissa == 0
    }

    /// Whether the value is below 0.
    #[must_use]
    pub const fn is_negative(self) -> bool {
        self.mantissa < 0
    }

    /// The value in millionths (of a mm: nm), rounded half away from zero, within ±[`Self::CONVERSION_LIMIT`].
    #[inline]
    #[must_use]
    pub fn to_millionths(self) -> i64 {
        self.scaled(1, 6)
    }

    /// The value as rounded by `to_whole`, but 1 where a value above 0 would become 0: a short time is not left out.
    #[must_use]
    pub fn at_least_one(self, to_whole: fn(Self) -> i64) -> i64 {
        let whole = to_whole(self);
        if whole == 0 && self.mantissa > 0 {
            1
        } else {
            whole
        }
    }

    /// The value of inches in nm, rounded half away from zero, within ±[`Self::CONVERSION_LIMIT`].
    #[must_use]
    pub fn inches_to_nm(self) -> i64 {
        // 25 400 000 nm, the power of ten separately.
        self.scaled(254, 5)
    }

    /// The value in thousandths, rounded half away from zero, within ±[`Self::CONVERSION_LIMIT`].
    #[must_use]
    pub fn to_thousandths(self) -> i64 {
        self.scaled(1, 3)
    }

    /// The value times `factor` × 10^`exponent`.
    #[inline]
    fn scaled(self, factor: i32, exponent: u8) -> i64 {
        if self.decimals > exponent {
            return self.scaled_down(factor, self.decimals - exponent);
        }
        let scale = factor * power(exponent - self.decimals);
        if let Ok(mantissa) = i32::try_from(self.mantissa) {
            i64::from(mantissa) * i64::from(scale)
        } else {
            self.mantissa
                .saturating_mul(i64::from(scale))
                .clamp(-Self::CONVERSION_LIMIT, Self::CONVERSION_LIMIT)
        }
    }

    /// The digits times `factor` / 10^`excess`.
    #[inline(never)]
    fn scaled_down(self, factor: i32, excess: u8) -> i64 {
        let factor = i64::from(factor);
        let (whole, remainder) = divide(self.mantissa, excess);
        let half = i64::from(power(excess)) / 2;
        let half = if self.mantissa < 0 { -half } else { half };
        whole
            .saturating_mul(factor)
            .saturating_add(divide(remainder * factor + half, excess).0)
            .clamp(-Self::CONVERSION_LIMIT, Self::CONVERSION_LIMIT)
    }

    /// The value in single precision: exact for up to seven digits.
    #[must_use]
    pub fn to_f32(self) -> f32 {
        self.mantissa as f32 / power(self.decimals) as f32
    }

    /// The value in double precision: exact to its sixteenth digit.
    #[must_use]
    pub fn to_f64(self) -> f64 {
        self.mantissa as f64 / f64::from(power(self.decimals))
    }

    /// The value as Grbl 1.1 computes it in single precision: eight digits at most, scaled down by
    /// hundredths and a tenth. It decides only between equally near steps.
    #[must_use]
    pub fn to_grbl_f32(self) -> f32 {
        let (mut digits, mut decimals) = (self.mantissa.unsigned_abs(), self.decimals);
        while digits >= u64::from(GRBL_LIMIT) && decimals > 0 {
            digits /= 10;
            decimals -= 1;
        }
        let Ok(digits) = u32::try_from(digits) else {
            return self.to_f32();
        };
        let mut value = digits as f32;
        while decimals >= 2 {
            value *= 0.01;
            decimals -= 2;
        }
        if decimals == 1 {
            value *= 0.1;
        }
        if self.is_negative() { -value } else { value }
    }

    /// The value without its fraction.
    #[must_use]
    pub fn trunc(self) -> i64 {
        if self.decimals == 0 {
            self.mantissa
        } else {
            divide(self.mantissa, self.decimals).0
        }
    }

    /// The value in hundredths; `None` where that is no whole number.
    #[must_use]
    pub fn hundredths(self) -> Option<i64> {
        match self.decimals.checked_sub(2) {
            Some(excess) => {
                let (whole, remainder) = divide(self.mantissa, excess);
                (remainder == 0).then_some(whole)
            }
            None => Some(self.scaled(1, 2)),
        }
    }

    /// Whether the value has no fraction.
    #[must_use]
    pub fn is_whole(self) -> bool {
        self.decimals == 0 || divide(self.mantissa, self.decimals).1 == 0
    }
}

#[cfg(test)]
mod tests;
