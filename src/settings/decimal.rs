//! Decimal numbers in `$` statements: a sign, digits, a point; no exponent.

/// A decimal number to 6 places, cut off at ±9.2·10¹².
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Decimal {
    millionths: i64,
    /// Below zero, be it by less than a millionth.
    is_negative: bool,
}

impl Decimal {
    /// Whether the number is below 0.
    #[must_use]
    pub(super) const fn is_negative(self) -> bool {
        self.is_negative
    }

    /// The number without its fraction.
    #[must_use]
    pub(super) const fn whole(self) -> i64 {
        self.millionths / 1_000_000
    }

    /// The number in millionths.
    #[must_use]
    pub(super) const fn millionths(self) -> i64 {
        self.millionths
    }
}

/// Reads the number at the beginning of a text; gives it and what follows. `None` without a digit.
#[must_use]
pub(super) fn read(text: &[u8]) -> Option<(Decimal, &[u8])> {
    let (minus, mut rest) = match text.split_first() {
        Some((b'-', rest)) => (true, rest),
        Some((b'+', rest)) => (false, rest),
        _ => (false, text),
    };
    let mut magnitude = 0_i64;
    let mut is_zero = true;
    let mut digits = 0_usize;
    // What one digit after the point is worth, in millionths; `None` before the point.
    let mut place: Option<i64> = None;
    while let Some((&byte, after)) = rest.split_first() {
        match (byte, place) {
            (b'0'..=b'9', _) => {
                let digit = i64::from(byte - b'0');
                digits += 1;
                is_zero &= digit == 0;
                if let Some(worth) = place {
                    magnitude = magnitude.saturating_add(digit * worth);
                    place = Some(worth / 10);
                } else {
                    magnitude = magnitude
                        .saturating_mul(10)
                        .saturating_add(digit * 1_000_000);
                }
            }
            (b'.', None) => place = Some(100_000),
            _ => break,
        }
        rest = after;
    }
    let decimal = Decimal {
        millionths: if minus { -magnitude } else { magnitude },
        is_negative: minus && !is_zero,
    };
    (digits > 0).then_some((decimal, rest))
}

#[cfg(test)]
mod tests {
    use std::borrow::ToOwned;

    use super::*;

    #[test]
    fn numbers_are_read_up_to_what_is_none() {
        for (text, millionths, rest) in [
            ("3", 3_000_000, ""),
            ("+5.", 5_000_000, ""),
            (".25", 250_000, ""),
            ("-0.5X", -500_000, "X"),
            ("1.2.3", 1_200_000, ".3"),
            ("250.0000019", 250_000_001, ""),
            ("1-2", 1_000_000, "-2"),
        ] {
            let (decimal, left) = read(text.as_bytes()).unwrap();
            assert_eq!(decimal.millionths, millionths, "{text}");
            assert_eq!(left, rest.as_bytes(), "{text}");
        }
        for text in ["", "-", ".", "+.", "=1", "A1", "+-5"] {
            assert!(read(text.as_bytes()).is_none(), "{text}");
        }
    }

    #[test]
    fn a_number_too_large_is_cut_off() {
        let digits = std::string::String::from("9").repeat(250);
        let (decimal, _) = read(digits.as_bytes()).unwrap();
        assert_eq!(decimal.millionths, i64::MAX);
        let (decimal, _) = read(("-".to_owned() + &digits).as_bytes()).unwrap();
        assert!(decimal.is_negative() && decimal.whole() < 0);
    }

    #[test]
    fn less_than_a_millionth_below_zero_is_negative() {
        assert!(read(b"-0.00000001").unwrap().0.is_negative());
        assert!(!read(b"-0.0").unwrap().0.is_negative());
    }
}
