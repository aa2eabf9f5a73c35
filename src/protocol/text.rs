//! Numbers and words written into a message of bounded length.
//!
//! A message is written completely before its first byte is sent.
//!
//! # Cost
//! No `core::fmt`, no float formatting and no division: digits are found by subtraction. What writes bytes is never
//! inlined: messages are written at hundreds of places.

use heapless::Vec;

use crate::{
    axis::{AXES, Axes},
    settings::Settings,
    units::{MicroDegrees, Nm},
};

/// Bytes of the longest message: a status report with every field and large coordinates, and the
/// version with the longest text that a user can store.
pub const MESSAGE_BYTES: usize = 80 + 32 * AXES;

/// Digits of the largest coordinate, 2⁶³ nm, in µm.
const MAX_DIGITS: usize = 16;
/// The value of each digit when the last counts 1, 1000 nm or 1/10 000 inch in nm.
const ONES: [u64; MAX_DIGITS] = digit_values(1);
const MICROMETRES: [u64; MAX_DIGITS] = digit_values(1_000);
const TENTHS_OF_MIL: [u64; MAX_DIGITS] = digit_values(2_540);

/// Returns `unit` times the powers of ten, the largest first.
const fn digit_values(unit: u64) -> [u64; MAX_DIGITS] {
    let mut values = [unit; MAX_DIGITS];
    let mut index = MAX_DIGITS - 1;
    while index > 0 {
        values[index - 1] = values[index] * 10;
        index -= 1;
    }
    values
}

/// The unit of lengths and speeds in reports, `$13`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReportUnit {
    /// mm with 3 decimals, mm/min with none.
    Millimetre,
    /// Inches with 4 decimals, inches/min with 1.
    Inch,
}

impl ReportUnit {
    /// Returns the unit that the settings ask for.
    #[must_use]
    pub const fn of(settings: &Settings) -> Self {
        if settings.report_inches {
            Self::Inch
        } else {
            Self::Millimetre
        }
    }
}

/// A message of at most [`MESSAGE_BYTES`]; bytes beyond are dropped.
#[derive(Debug, Clone, Default)]
pub struct Text {
    bytes: Vec<u8, MESSAGE_BYTES>,
}

impl Text {
    /// An empty message.
    #[must_use]
    pub const fn new() -> Self {
        Self { bytes: Vec::new() }
    }

    /// Returns what has been written.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Returns whether nothing has been written.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Empties the message.
    pub fn clear(&mut self) {
        self.bytes.clear();
    }

    /// Writes one character.
    #[inline(never)]
    pub fn byte(&mut self, byte: u8) -> &mut Self {
        let _ = self.bytes.push(byte);
        self
    }

    /// Writes a word.
    #[inline(never)]
    pub fn word(&mut self, word: &str) -> &mut Self {
        for &byte in word.as_bytes() {
            self.byte(byte);
        }
        self
    }

    /// Writes bytes as they are.
    #[inline(never)]
    pub fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        for &byte in bytes {
            self.byte(byte);
        }
        self
    }

    /// Writes a word in ASCII: `µ` as `u`, `²` and `³` as `^2` and `^3`.
    pub fn plain(&mut self, word: &str) -> &mut Self {
        for letter in word.chars() {
            match letter {
                'µ' => self.byte(b'u'),
                '²' => self.word("^2"),
                '³' => self.word("^3"),
                _ if letter.is_ascii() => self.byte(letter as u8),
                _ => self.byte(b'?'),
            };
        }
        self
    }

    /// Ends the line.
    pub fn end(&mut self) -> &mut Self {
        self.byte(b'\r').byte(b'\n')
    }

    /// Writes a whole number.
    #[inline(never)]
    pub fn natural(&mut self, value: u32) -> &mut Self {
        self.digits(u64::from(value), &ONES, 0)
    }

    /// Writes a whole number, negative ones with their sign.
    pub fn integer(&mut self, value: i32) -> &mut Self {
        if value < 0 {
            self.byte(b'-');
        }
        self.natural(value.unsigned_abs())
    }

    /// Writes a coordinate: 3 decimals in mm, 4 in inches, halves away from zero.
    pub fn coordinate(&mut self, value: Nm, unit: ReportUnit) -> &mut Self {
        let nm = value.0.unsigned_abs();
        if value.0 < 0 {
            self.byte(b'-');
        }
        match unit {
            ReportUnit::Millimetre => self.digits(nm.saturating_add(500), &MICROMETRES, 3),
            ReportUnit::Inch => self.digits(nm.saturating_add(1270), &TENTHS_OF_MIL, 4),
        }
    }

    /// Writes a length in mm exactly, without zeros at its end: `10.16`.
    pub fn length(&mut self, value: Nm) -> &mut Self {
        if value.0 < 0 {
            self.byte(b'-');
        }
        self.digits(value.0.unsigned_abs(), &ONES, 6);
        for _ in 0..6 {
            if self.bytes.last() == Some(&b'0') {
                self.bytes.pop();
            }
        }
        if self.bytes.last() == Some(&b'.') {
            self.bytes.pop();
        }
        self
    }

    /// Writes one coordinate for each axis, separated by commas.
    pub fn coordinates(&mut self, values: &Axes<Nm>, unit: ReportUnit) -> &mut Self {
        for (axis, &value) in values.iter().enumerate() {
            if axis > 0 {
                self.byte(b',');
            }
            self.coordinate(value, unit);
        }
        self
    }

    /// Writes an angle in degrees with two decimals, halves away from zero.
    pub fn degrees(&mut self, angle: MicroDegrees) -> &mut Self {
        let millionths = angle.millionths();
        if millionths < 0 {
            self.byte(b'-');
        }
        let hundredths = (millionths.unsigned_abs() + 5_000) / 10_000;
        self.natural(hundredths / 100).byte(b'.');
        if hundredths % 100 < 10 {
            self.byte(b'0');
        }
        self.natural(hundredths % 100)
    }

    /// Writes a speed in mm/min or, with one decimal, in inches/min.
    pub fn rate(&mut self, mm_min: f32, unit: ReportUnit) -> &mut Self {
        match unit {
            ReportUnit::Millimetre => self.number(mm_min, 0),
            ReportUnit::Inch => self.number(mm_min * (1.0 / 25.4), 1),
        }
    }

    /// Writes a number with 0, 1 or 3 decimals, halves away from zero. Its magnitude must be
    /// below 2³².
    pub fn number(&mut self, value: f32, decimals: usize) -> &mut Self {
        if value < 0.0 {
            self.byte(b'-');
        }
        let magnitude = value.abs();
        let scale: u32 = match decimals {
            0 => 1,
            1 => 10,
            _ => 1000,
        };
        // The whole part and the fraction are exact, so only the last decimal is rounded.
        let whole = magnitude as u32;
        let fraction = ((magnitude - whole as f32) * scale as f32 + 0.5) as u32;
        let scaled = u64::from(whole) * u64::from(scale) + u64::from(fraction);
        self.digits(scaled, &ONES, decimals)
    }

    /// Writes millionths with 3 decimals, halves upwards.
    pub fn millionths(&mut self, value: u64) -> &mut Self {
        self.digits(value.saturating_add(500), &MICROMETRES, 3)
    }

    /// Writes a value as a multiple of the last digit's, rounded down, with a point before the last
    /// `decimals` digits.
    #[inline(never)]
    fn digits(&mut self, value: u64, values: &[u64; MAX_DIGITS], decimals: usize) -> &mut Self {
        let mut remainder = value;
        let mut is_significant = false;
        for (digit_value, index) in values.iter().zip((0..MAX_DIGITS).rev()) {
            let mut digit = b'0';
            for _ in 0..9 {
                if remainder < *digit_value {
                    break;
                }
                remainder -= digit_value;
                digit += 1;
            }
            is_significant |= digit != b'0' || index <= decimals;
            if decimals > 0 && index + 1 == decimals {
                self.byte(b'.');
            }
            if is_significant {
                self.byte(digit);
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use std::{format, string::String};

    use proptest::prelude::*;

    use super::*;

    fn written(write: impl FnOnce(&mut Text) -> &mut Text) -> String {
        let mut text = Text::new();
        write(&mut text);
        String::from_utf8(text.as_bytes().to_vec()).unwrap()
    }

    #[test]
    fn coordinates_are_written_as_grbl_writes_them() {
        for (nm, mm, inch) in [
            (0, "0.000", "0.0000"),
            (5_437_500, "5.438", "0.2141"),
            (-5_000_000, "-5.000", "-0.1969"),
            (10_000_000, "10.000", "0.3937"),
            (-499, "-0.000", "-0.0000"),
            (500, "0.001", "0.0000"),
            (25_400_000, "25.400", "1.0000"),
            (1_234_567_890_123, "1234567.890", "48605.0350"),
            (i64::MIN, "-9223372036854.776", "-363124883340.7392"),
        ] {
            assert_eq!(
                written(|t| t.coordinate(Nm(nm), ReportUnit::Millimetre)),
                mm,
                "{nm} nm"
            );
            assert_eq!(
                written(|t| t.coordinate(Nm(nm), ReportUnit::Inch)),
                inch,
                "{nm} nm"
            );
        }
    }

    #[test]
    fn lengths_are_written_exactly() {
        for (nm, mm) in [
            (0, "0"),
            (10_160_000, "10.16"),
            (-1, "-0.000001"),
            (-500_000_000, "-500"),
            (9_007_199_254_740_992, "9007199254.740992"),
        ] {
            assert_eq!(written(|t| t.length(Nm(nm))), mm);
        }
    }

    #[test]
    fn speeds_round_halves_up() {
        for (rate, mm, inch) in [
            (0.0, "0", "0.0"),
            (499.5, "500", "19.7"),
            (1000.0, "1000", "39.4"),
            (254.0, "254", "10.0"),
        ] {
            assert_eq!(written(|t| t.rate(rate, ReportUnit::Millimetre)), mm);
            assert_eq!(written(|t| t.rate(rate, ReportUnit::Inch)), inch);
        }
    }

    #[test]
    fn a_full_message_drops_more_bytes() {
        let mut text = Text::new();
        for _ in 0..MESSAGE_BYTES {
            text.word("ab");
        }
        assert_eq!(text.as_bytes().len(), MESSAGE_BYTES);
    }

    proptest! {
        #![proptest_config(crate::cases(64))]

        #[test]
        fn whole_numbers_are_written_in_full(value: u32) {
            prop_assert_eq!(written(|t| t.natural(value)), format!("{value}"));
        }

        #[test]
        fn a_coordinate_is_the_nearest_micrometre(nm in -9_000_000_000_000_i64..9_000_000_000_000) {
            let text = written(|t| t.coordinate(Nm(nm), ReportUnit::Millimetre));
            let micrometres: i64 = text.replace('.', "").parse().unwrap();
            prop_assert!((micrometres * 1000 - nm).abs() <= 500, "{nm} nm gives {text}");
        }

        #[test]
        fn a_setting_is_the_nearest_thousandth(thousandths in 0_u32..8_000_000) {
            let value = (f64::from(thousandths) / 1000.0) as f32;
            let expected = format!("{}.{:03}", thousandths / 1000, thousandths % 1000);
            prop_assert_eq!(written(|t| t.number(value, 3)), expected);
        }
    }
}
