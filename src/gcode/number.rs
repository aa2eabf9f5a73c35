//! Decimal numbers, exactly as written.
//!
//! A number is kept as digits and a decimal point until its unit is known: a coordinate is then
//! rounded once, to one nanometre. Digits beyond the ninth decimal do not count.

/// A decimal number: `mantissa / 10^decimals`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Number {
    mantissa: i64,
    decimals: u8,
}

/// The number of a `G` or `M` command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Code {
    /// The whole part. Grbl keeps it in eight bits and finds the rest in the fraction.
    pub whole: u8,
    /// The fraction in hundredths, rounded; 100 where the number is no command number at all.
    pub hundredths: u8,
}

impl Code {
    /// Hundredths that no command has.
    const NONE: u8 = 100;

    /// Whether there is no fraction.
    #[must_use]
    pub const fn is_whole(self) -> bool {
        self.hundredths == 0
    }
}

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
    // A power is never zero, which the compiler cannot see in the table.
    let quotient = value.checked_div(divisor).unwrap_or(0);
    (quotient, value.wrapping_sub(quotient.wrapping_mul(divisor)))
}

impl Number {
    /// 0.
    pub const ZERO: Self = Self::new(0, 0);
    /// Decimals that count.
    pub const MAX_DECIMALS: u8 = 9;
    /// What stands for every coordinate that is farther than any machine reaches: a few of them
    /// can be added.
    pub const BEYOND: i64 = 1_000_000_000_000_000_000;
    /// A mantissa that has room for one more digit is below.
    const FULL: u64 = 900_000_000_000_000_000;

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

    /// The number at the beginning of a text and what follows it; `None` without a digit.
    ///
    /// A sign, digits and one decimal point, each optional, but at least one digit. No exponent.
    /// A whole part of more than 18 digits saturates.
    #[inline]
    #[must_use]
    pub fn parse(text: &[u8]) -> Option<(Self, &[u8])> {
        let (is_negative, rest) = match text.split_first() {
            Some((b'-', rest)) => (true, rest),
            Some((b'+', rest)) => (false, rest),
            _ => (false, text),
        };
        // Made of its parts in one place, so that these stay in registers.
        let (mantissa, decimals, rest) =
            if let Some((digits, decimals, rest)) = parse_short(is_negative, rest) {
                (i64::from(digits), decimals, rest)
            } else {
                let (number, rest) = Self::parse_long(is_negative, rest)?;
                (number.mantissa, number.decimals, rest)
            };
        Some((Self { mantissa, decimals }, rest))
    }

    /// Any number.
    #[inline(never)]
    fn parse_long(is_negative: bool, text: &[u8]) -> Option<(Self, &[u8])> {
        let mut rest = text;
        let mut mantissa = 0_u64;
        let mut has_digits = false;
        while let Some((digit, tail)) = split_digit(rest) {
            mantissa = if mantissa < Self::FULL {
                mantissa * 10 + u64::from(digit)
            } else {
                i64::MAX as u64
            };
            has_digits = true;
            rest = tail;
        }
        let mut decimals = 0;
        if let Some((b'.', fraction)) = rest.split_first() {
            rest = fraction;
            while let Some((digit, tail)) = split_digit(rest) {
                if mantissa < Self::FULL && decimals < Self::MAX_DECIMALS {
                    mantissa = mantissa * 10 + u64::from(digit);
                    decimals += 1;
                }
                has_digits = true;
                rest = tail;
            }
        }
        let magnitude = mantissa.cast_signed();
        let mantissa = if is_negative { -magnitude } else { magnitude };
        has_digits.then_some((Self { mantissa, decimals }, rest))
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

    /// The value in millionths (of a mm: nm), rounded half away from zero, within ±[`Self::BEYOND`].
    #[inline]
    #[must_use]
    pub fn to_millionths(self) -> i64 {
        self.scaled(1, 6)
    }

    /// The value of inches in nm, rounded half away from zero, within ±[`Self::BEYOND`].
    #[must_use]
    pub fn inches_to_nm(self) -> i64 {
        // 25 400 000 nm, with the power of ten apart.
        self.scaled(254, 5)
    }

    /// The value in thousandths, rounded half away from zero, within ±[`Self::BEYOND`].
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
                .clamp(-Self::BEYOND, Self::BEYOND)
        }
    }

    /// The digits times `factor` / 10^`excess`.
    #[inline(never)]
    fn scaled_down(self, factor: i32, excess: u8) -> i64 {
        let factor = i64::from(factor);
        let (whole, rest) = divide(self.mantissa, excess);
        let half = i64::from(power(excess)) / 2;
        let half = if self.mantissa < 0 { -half } else { half };
        whole
            .saturating_mul(factor)
            .saturating_add(divide(rest * factor + half, excess).0)
            .clamp(-Self::BEYOND, Self::BEYOND)
    }

    /// The value in single precision: exact for up to seven digits.
    #[must_use]
    pub fn to_f32(self) -> f32 {
        self.mantissa as f32 / power(self.decimals) as f32
    }

    /// The value as Grbl 1.1 computes it in single precision: eight digits at most, scaled down by
    /// hundredths and a tenth. It decides only between equally near steps.
    #[inline]
    #[must_use]
    pub fn to_grbl_f32(self) -> f32 {
        if let Ok(digits) = i32::try_from(self.mantissa)
            && digits.unsigned_abs() < 100_000_000
            && self.decimals <= 4
        {
            // As below, for what nearly all coordinates are.
            let value = digits as f32;
            return match self.decimals {
                0 => value,
                1 => value * 0.1,
                2 => value * 0.01,
                3 => value * 0.01 * 0.1,
                _ => value * 0.01 * 0.01,
            };
        }
        self.long_to_grbl_f32()
    }

    #[inline(never)]
    fn long_to_grbl_f32(self) -> f32 {
        let (mut digits, mut decimals) = (self.mantissa.unsigned_abs(), self.decimals);
        while digits >= 100_000_000 && decimals > 0 {
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

    /// Whether the value has no fraction.
    #[must_use]
    pub fn is_whole(self) -> bool {
        self.decimals == 0 || divide(self.mantissa, self.decimals).1 == 0
    }

    /// The value as the number of a command, in the single precision of Grbl: it decides whether half
    /// a hundredth counts.
    #[must_use]
    pub fn code(self) -> Code {
        if self.decimals == 0 {
            return Code {
                whole: self.mantissa as u8,
                hundredths: if u8::try_from(self.mantissa).is_ok() {
                    0
                } else {
                    Code::NONE
                },
            };
        }
        let value = self.to_grbl_f32();
        let whole = value as i32;
        let hundredths = 100.0 * (value - whole as f32);
        let is_code = u8::try_from(whole).is_ok() && hundredths >= 0.0;
        let below = hundredths as u8;
        let rounds_up = hundredths - f32::from(below) >= 0.5;
        Code {
            whole: whole as u8,
            hundredths: if is_code {
                below + u8::from(rounds_up)
            } else {
                Code::NONE
            },
        }
    }
}

/// The digits and the decimals of a number of at most nine digits, which fit a word, and what follows.
#[inline]
fn parse_short(is_negative: bool, text: &[u8]) -> Option<(i32, u8, &[u8])> {
    let (mut value, before) = append_digits(0, text);
    let mut rest = text.get(before..)?;
    let mut decimals = 0;
    if let Some((b'.', fraction)) = rest.split_first() {
        (value, decimals) = append_digits(value, fraction);
        rest = fraction.get(decimals..)?;
    }
    if !(1..=9).contains(&(before + decimals)) {
        return None;
    }
    let value = value.cast_signed();
    let value = if is_negative { -value } else { value };
    Some((value, decimals as u8, rest))
}

/// A value with the digits at the beginning of a text appended, wrapping, and how many they are.
#[inline]
fn append_digits(value: u32, text: &[u8]) -> (u32, usize) {
    let (mut value, mut count) = (value, 0);
    for &byte in text {
        let digit = u32::from(byte).wrapping_sub(u32::from(b'0'));
        if digit > 9 {
            break;
        }
        value = value.wrapping_mul(10).wrapping_add(digit);
        count += 1;
    }
    (value, count)
}

/// The value of the digit at the beginning of a text, and the rest.
fn split_digit(text: &[u8]) -> Option<(u8, &[u8])> {
    let (byte, rest) = text.split_first()?;
    let digit = byte.wrapping_sub(b'0');
    (digit < 10).then_some((digit, rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parsed(text: &str) -> Option<Number> {
        Number::parse(text.as_bytes()).map(|(number, _)| number)
    }

    fn number(text: &str) -> Number {
        parsed(text).unwrap()
    }

    #[test]
    fn a_number_needs_a_digit() {
        for text in ["", "+", "-", ".", "-.", "--1", "+-1", "E1", "X"] {
            assert_eq!(parsed(text), None, "{text}");
        }
        for text in ["1", "-1", "+1", "1.", ".1", "-.1", "001"] {
            assert!(parsed(text).is_some(), "{text}");
        }
    }

    #[test]
    fn single_precision_is_grbls() {
        // As recorded: 57.6740 mm at 250 steps/mm ends at step 14418, not 14419.
        assert!(number("57.6740").to_grbl_f32() * 250.0 < 14_418.5);
        assert_eq!(number("85.7860").to_grbl_f32(), 857_860.0_f32 * 0.01 * 0.01);
        assert_eq!(number("-0.5").to_grbl_f32(), -5.0_f32 * 0.1);
        assert_eq!(number("12").to_grbl_f32(), 12.0);
    }

    #[test]
    fn a_number_ends_where_its_grammar_ends() {
        for (text, rest) in [("1.2.3", ".3"), ("1-2", "-2"), ("1E1", "E1"), ("5Y", "Y")] {
            assert_eq!(Number::parse(text.as_bytes()).unwrap().1, rest.as_bytes());
        }
    }

    #[test]
    fn coordinates_round_half_away_from_zero_at_one_nanometre() {
        for (text, nm) in [
            ("0.0000005", 1),
            ("-0.0000005", -1),
            ("0.00000049999999999999", 0),
            ("12.3456789", 12_345_679),
            ("8000000.000001", 8_000_000_000_001),
            ("1.0000000000000000000000000000000000001", 1_000_000),
        ] {
            assert_eq!(number(text).to_millionths(), nm, "{text}");
        }
        for (text, nm) in [
            ("1", 25_400_000),
            ("0.00001", 254),
            ("0.000001", 25),
            ("-0.0000015", -38),
            ("39370.07874015748", 1_000_000_000_000),
        ] {
            assert_eq!(number(text).inches_to_nm(), nm, "{text}");
        }
    }

    #[test]
    fn numbers_that_do_not_fit_saturate() {
        for text in [
            "99999999999999999999",
            "9999999999999999999.5",
            "1000000000000000000000000000000000",
            "9000000000000000000",
        ] {
            assert_eq!(number(text).to_millionths(), Number::BEYOND, "{text}");
            assert_eq!(number(text).inches_to_nm(), Number::BEYOND, "{text}");
            assert!(number(text).trunc() > 1_000_000_000_000, "{text}");
            assert!(number(text).to_f32() > 1.0e17, "{text}");
        }
    }

    #[test]
    fn codes_wrap_as_in_grbl() {
        for (text, whole, hundredths) in [
            ("38.2", 38, 20),
            ("38.25", 38, 25),
            ("1.999", 1, 100),
            ("0.004", 0, 0),
            ("21.0", 21, 0),
            ("256", 0, 100),
            ("257", 1, 100),
            ("-1", 255, 100),
            ("-0.5", 0, 100),
            ("-0", 0, 0),
            ("3.005", 3, 0),
            ("0.005", 0, 1),
            ("17.005", 17, 1),
            ("1.005", 1, 0),
            ("28.095", 28, 9),
            ("38.195", 38, 19),
            ("43.105", 43, 10),
            ("3.006", 3, 1),
            ("1.99999999", 2, 0),
        ] {
            let code = number(text).code();
            assert_eq!((code.whole, code.hundredths), (whole, hundredths), "{text}");
        }
    }

    proptest! {
        #[test]
        fn printing_and_parsing_give_the_same_number(
            mantissa in -900_000_000_000_000_000..900_000_000_000_000_000_i64,
            decimals in 0..=Number::MAX_DECIMALS,
        ) {
            let divisor = i64::from(power(decimals));
            let width = usize::from(decimals);
            let sign = if mantissa < 0 { "-" } else { "" };
            let whole = (mantissa / divisor).abs();
            let fraction = (mantissa % divisor).abs();
            let text = if decimals == 0 {
                std::format!("{sign}{whole}")
            } else {
                std::format!("{sign}{whole}.{fraction:0width$}")
            };
            prop_assert_eq!(number(&text), Number::new(mantissa, decimals));
        }

        #[test]
        fn scaling_agrees_with_wide_arithmetic(
            mantissa in -900_000_000_000_000_000..900_000_000_000_000_000_i64,
            decimals in 0..=Number::MAX_DECIMALS,
        ) {
            let exact = |factor: i128| {
                let product = i128::from(mantissa) * factor;
                let divisor = i128::from(power(decimals));
                let rounded = (product + divisor / 2 * product.signum()) / divisor;
                let limit = i128::from(Number::BEYOND);
                rounded.clamp(-limit, limit) as i64
            };
            let number = Number::new(mantissa, decimals);
            prop_assert_eq!(number.to_millionths(), exact(1_000_000));
            prop_assert_eq!(number.inches_to_nm(), exact(25_400_000));
        }
    }
}
