//! Arithmetic that is the same, bit for bit, on the host and on the target.
//!
//! Single-precision addition, multiplication and division are exact to the last bit everywhere
//! (IEEE 754) and Rust never fuses them; everything else is built from them here, or in integers.
//! Double precision is that of `libm`, at most once per block and never per segment.
//!
//! # Cost
//!
//! `no_std` has no safe name for the FPU's square root, so [`sqrt`] takes 15 multiplications.
//! [`sqrt_inlined`] is for the loops of `prepare`: a call costs as much as the root. [`min`] and
//! [`max`] are one comparison each, as NaN is not considered.

use core::f32::consts::FRAC_PI_2;

/// Returns the smaller of two numbers, neither of which is NaN.
#[inline]
#[must_use]
pub fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns the greater of two numbers, neither of which is NaN.
#[inline]
#[must_use]
pub fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Returns the scalar product of two vectors.
#[inline]
#[must_use]
pub fn dot<const N: usize>(a: &[f32; N], b: &[f32; N]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns the square root; 0 for zero and below. Relative error below 3·10⁻⁷.
///
/// The inverse root is found by three Newton steps from the first guess of Lomont 2003.
#[must_use]
pub fn sqrt(x: f32) -> f32 {
    sqrt_inlined(x)
}

/// Returns the square root as [`sqrt`] does.
#[inline(always)]
#[expect(clippy::inline_always, reason = "a call costs as much as the root")]
#[must_use]
pub fn sqrt_inlined(x: f32) -> f32 {
    if x <= f32::MIN_POSITIVE {
        return 0.0;
    }
    let half = 0.5 * x;
    let mut y = f32::from_bits(0x5f37_5a86 - (x.to_bits() >> 1));
    y *= 1.5 - half * y * y;
    y *= 1.5 - half * y * y;
    y *= 1.5 - half * y * y;
    x * y
}

/// Returns half the square root of twice a number; nearly 0 for zero. Relative error below 8·10⁻⁷.
/// The sign is ignored: rounding may leave one on zero.
///
/// Two Newton steps, with a first guess and constants that balance the error instead of converging
/// from below (Walczyk, Moroz and Cieśliński 2019).
#[inline]
#[must_use]
pub fn half_root_of_twice(half: f32) -> f32 {
    let half = half.abs();
    let mut y = f32::from_bits(0x5ef7_6908 - (half.to_bits() >> 1));
    y *= 1.500_878_9 - half * y * y;
    y *= 1.500_000_6 - half * y * y;
    half * y
}

/// Returns the sine of an angle from 0 to π/2 rad. Error below 3·10⁻⁷ of the result.
///
/// Taylor's series to the 11th power.
#[must_use]
pub fn sin(angle: f32) -> f32 {
    let x2 = angle * angle;
    let p = 2.755_731_9e-6 - x2 * 2.505_210_8e-8;
    let p = 1.984_127e-4 - x2 * p;
    let p = 8.333_333e-3 - x2 * p;
    let p = 1.666_666_7e-1 - x2 * p;
    angle * (1.0 - x2 * p)
}

/// Returns the arc sine of 0 to 1, rad. Error below 1.5·10⁻⁶ of the result.
#[must_use]
pub fn asin(x: f32) -> f32 {
    if x < 0.5 {
        asin_small(x)
    } else {
        FRAC_PI_2 - 2.0 * asin_small(sqrt(0.5 * (1.0 - x)))
    }
}

/// The 19th-power term of the arc sine, raised to stand for all that follow it at x = 0.5.
const ASIN_TAIL: f32 = 0.013_178_16;

/// Returns the arc sine of 0 to 0.5 by its Taylor series.
fn asin_small(x: f32) -> f32 {
    let x2 = x * x;
    let p = 0.011_551_8 + x2 * ASIN_TAIL;
    let p = 0.013_964_844 + x2 * p;
    let p = 0.017_352_765 + x2 * p;
    let p = 0.022_372_16 + x2 * p;
    let p = 0.030_381_944 + x2 * p;
    let p = 0.044_642_86 + x2 * p;
    let p = 0.075 + x2 * p;
    let p = 0.166_666_67 + x2 * p;
    x + x * x2 * p
}

/// 2³⁰, the 1 of [`cos_sin`].
pub const ONE_Q30: i32 = 1 << 30;

/// Returns the cosine and sine of a phase, 2³² to the turn, times 2³⁰. Error below 4 units.
#[must_use]
pub fn cos_sin(phase: u32) -> (i32, i32) {
    // The nearest quarter turn, and the angle from it: -1/8 to 1/8 of a turn.
    let quarter = phase.wrapping_add(1 << 29) >> 30;
    let remainder = phase.wrapping_sub(quarter << 30).cast_signed();
    // Times 2π/2³², to rad times 2³⁰: times π/2.
    let angle = mul_q30(remainder, 1_686_629_713);
    let x2 = mul_q30(angle, angle);
    let p = 2_959 - mul_q30(x2, 27);
    let p = 213_044 - mul_q30(x2, p);
    let p = 8_947_849 - mul_q30(x2, p);
    let p = 178_956_971 - mul_q30(x2, p);
    let sin = angle - mul_q30(mul_q30(angle, x2), p);
    let p = 26_631 - mul_q30(x2, 296);
    let p = 1_491_308 - mul_q30(x2, p);
    let p = 44_739_243 - mul_q30(x2, p);
    let p = 536_870_912 - mul_q30(x2, p);
    let cos = ONE_Q30 - mul_q30(x2, p);
    match quarter & 3 {
        0 => (cos, sin),
        1 => (-sin, cos),
        2 => (-cos, -sin),
        _ => (sin, -cos),
    }
}

/// Returns the product of two numbers times 2³⁰, rounded to nearest.
fn mul_q30(a: i32, b: i32) -> i32 {
    ((i64::from(a) * i64::from(b) + (1 << 29)) >> 30) as i32
}

/// Returns `value × factor / 2³⁰`, rounded down; the result must fit.
#[must_use]
pub fn scale_q30(value: i64, factor: i32) -> i64 {
    let low = u64::from(value as u32);
    let high = value >> 32;
    let factor = i64::from(factor);
    ((high * factor) << 2).wrapping_add((low.cast_signed() * factor) >> 30)
}

/// 2³¹, the whole of a block in [`scale_q31`].
pub const WHOLE_Q31: u32 = 1 << 31;

/// Returns `value × part / 2³¹`, rounded down; the result must fit.
#[must_use]
pub fn scale_q31(value: i64, part: u32) -> i64 {
    let low = u64::from(value as u32);
    let high = value >> 32;
    ((high * i64::from(part)) << 1).wrapping_add(((low * u64::from(part)) >> 31).cast_signed())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_are_as_right_as_they_say() {
        let mut x = 1.0e-12_f32;
        while x < 1.0e12 {
            let exact = f64::from(x).sqrt();
            assert!((f64::from(sqrt(x)) - exact).abs() <= 3.0e-7 * exact, "{x}");
            let short = 2.0 * f64::from(half_root_of_twice(0.5 * x));
            assert!((short - exact).abs() <= 8.0e-7 * exact, "{x}");
            x *= 1.003;
        }
        assert_eq!([sqrt(0.0), sqrt(-1.0)], [0.0; 2]);
        assert_eq!(half_root_of_twice(0.0), 0.0);
        assert_eq!(half_root_of_twice(-2.0).abs(), half_root_of_twice(2.0));
    }

    #[test]
    fn sin_and_asin_are_right_and_inverse() {
        for k in 0..=10_000 {
            let x = k as f32 / 10_000.0;
            let exact = f64::from(x).asin();
            assert!(
                (f64::from(asin(x)) - exact).abs() <= 1.5e-6 * exact,
                "asin {x}"
            );
            let angle = x * FRAC_PI_2;
            let exact = f64::from(angle).sin();
            assert!(
                (f64::from(sin(angle)) - exact).abs() <= 3.0e-7 * exact,
                "sin {angle}"
            );
        }
    }

    #[test]
    fn cos_sin_are_right_to_four_units() {
        for k in 0..1_000_000_u32 {
            let phase = k.wrapping_mul(2_654_435_761);
            let angle = f64::from(phase) / 4_294_967_296.0 * std::f64::consts::TAU;
            let (cos, sin) = cos_sin(phase);
            assert!(
                (f64::from(cos) - angle.cos() * 1_073_741_824.0).abs() < 4.0,
                "{phase}"
            );
            assert!(
                (f64::from(sin) - angle.sin() * 1_073_741_824.0).abs() < 4.0,
                "{phase}"
            );
        }
    }

    #[test]
    fn quarter_turns_are_exact() {
        assert_eq!(cos_sin(0), (ONE_Q30, 0));
        assert_eq!(cos_sin(1 << 30), (0, ONE_Q30));
        assert_eq!(cos_sin(2 << 30), (-ONE_Q30, 0));
        assert_eq!(cos_sin(3 << 30), (0, -ONE_Q30));
    }

    #[test]
    fn scaling_agrees_with_128_bits() {
        for value in [
            0,
            1,
            -1,
            123_456_789_012_345,
            -9_876_543_210_987,
            i64::from(u32::MAX),
        ] {
            for factor in [0, 1, -1, ONE_Q30, -ONE_Q30, 759_250_125] {
                let exact = (i128::from(value) * i128::from(factor)) >> 30;
                assert_eq!(i128::from(scale_q30(value, factor)), exact);
            }
            for part in [0, 1, 77, WHOLE_Q31 / 3, WHOLE_Q31] {
                let exact = (i128::from(value) * i128::from(part)) >> 31;
                assert_eq!(i128::from(scale_q31(value, part)), exact);
            }
        }
    }
}
