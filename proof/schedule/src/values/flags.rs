//! The condition flags, as far as they are known.

use super::Value;

/// Negative, zero, carry, overflow; `None`: not known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Flags {
    negative: Option<bool>,
    zero: Option<bool>,
    carry: Option<bool>,
    overflow: Option<bool>,
}

impl Flags {
    /// After `left - right`.
    pub(crate) fn compare(left: Value, right: Value) -> Self {
        match (left, right) {
            (Value::Constant(left), Value::Constant(right)) => {
                let (difference, borrows) = left.overflowing_sub(right);
                let (_, overflows) = left.cast_signed().overflowing_sub(right.cast_signed());
                Self {
                    negative: Some(difference.cast_signed() < 0),
                    zero: Some(difference == 0),
                    carry: Some(!borrows),
                    overflow: Some(overflows),
                }
            }
            (
                Value::From { base, offset, .. },
                Value::From {
                    base: other,
                    offset: other_offset,
                    ..
                },
            ) if base == other => Self {
                zero: Some(offset == other_offset),
                ..Self::default()
            },
            _ => Self::default(),
        }
    }

    /// After `left + distance`, or a subtraction of its negative: which of them is not known.
    pub(crate) fn add(left: Value, distance: i32) -> Self {
        let Value::Constant(left) = left else {
            return Self::default();
        };
        let right = distance.cast_unsigned();
        let (sum, carries) = left.overflowing_add(right);
        let (_, overflows) = left.cast_signed().overflowing_add(distance);
        // Where the two differ.
        let is_same = distance != 0 && distance != i32::MIN;
        Self {
            negative: Some(sum.cast_signed() < 0),
            zero: Some(sum == 0),
            carry: is_same.then_some(carries),
            overflow: is_same.then_some(overflows),
        }
    }

    /// After an operation with this result, of which no more is known.
    pub(crate) fn result(value: Value) -> Self {
        let value = value.constant();
        Self {
            negative: value.map(|value| value.cast_signed() < 0),
            zero: value.map(|value| value == 0),
            ..Self::default()
        }
    }

    /// The join of both values.
    pub(crate) fn join(self, other: Self) -> Self {
        let join = |left, right| if left == right { left } else { None };
        Self {
            negative: join(self.negative, other.negative),
            zero: join(self.zero, other.zero),
            carry: join(self.carry, other.carry),
            overflow: join(self.overflow, other.overflow),
        }
    }

    /// Whether a condition holds, as it is encoded (DDI 0403E, table A7-1).
    pub(crate) fn holds(self, condition: u8) -> Option<bool> {
        let positive = match condition >> 1 {
            0 => self.zero,
            1 => self.carry,
            2 => self.negative,
            3 => self.overflow,
            // Unsigned higher.
            4 => self.unless_zero(self.carry),
            5 => self.is_not_less(),
            6 => self.unless_zero(self.is_not_less()),
            _ => return Some(true),
        };
        positive.map(|positive| positive == (condition & 1 == 0))
    }

    /// Whether a condition holds, and the result is not zero.
    const fn unless_zero(self, condition: Option<bool>) -> Option<bool> {
        match (condition, self.zero) {
            (Some(false), _) | (_, Some(true)) => Some(false),
            (Some(true), Some(false)) => Some(true),
            _ => None,
        }
    }

    fn is_not_less(self) -> Option<bool> {
        Some(self.negative? == self.overflow?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comparisons_decide_what_the_manual_says() {
        let values = [0, 1, 5, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff_u32];
        for left in values {
            for right in values {
                let flags = Flags::compare(Value::Constant(left), Value::Constant(right));
                let signed = (left.cast_signed(), right.cast_signed());
                let expected = [left == right, left != right, left >= right, left < right];
                for (condition, expected) in expected.into_iter().enumerate() {
                    assert_eq!(flags.holds(condition as u8), Some(expected));
                }
                let expected = [
                    left > right,
                    left <= right,
                    signed.0 >= signed.1,
                    signed.0 < signed.1,
                    signed.0 > signed.1,
                    signed.0 <= signed.1,
                    true,
                ];
                for (condition, expected) in expected.into_iter().enumerate() {
                    assert_eq!(flags.holds(condition as u8 + 8), Some(expected));
                }
            }
        }
    }

    #[test]
    fn an_addition_of_zero_leaves_the_carry_open() {
        let flags = Flags::add(Value::Constant(3), 0);
        assert_eq!(flags.holds(0), Some(false));
        assert_eq!(flags.holds(2), None);
        let flags = Flags::add(Value::Constant(1), -1);
        assert_eq!((flags.holds(0), flags.holds(2)), (Some(true), Some(true)));
    }
}
