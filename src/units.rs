//! Quantities with their units: nanometres, steps, timer ticks.
//!
//! Positions are integers from the parser on. [`Nm`] holds a coordinate exactly, in millimetre and
//! in inch programs (one inch is 25 400 000 nm); [`StepsPerMm`] converts it to steps without
//! rounding twice.
//!
//! # Cost
//!
//! [`Nm::to_mm`] converts by the FPU up to 2 m. The conversion in software is out of line: the
//! compiler would do it first and choose afterwards.

/// Frequency of the core, MHz: of the class of chips that the feature `clock-96` chooses, or of the others.
pub const CORE_MHZ: u32 = if cfg!(feature = "clock-96") { 96 } else { 168 };
/// Timer ticks in one second: the step timer counts half ticks, which are cycles of the core.
pub const TICKS_PER_SECOND: u32 = CORE_MHZ * 1_000_000 / 2;
/// Timer ticks in one millisecond.
pub const TICKS_PER_MS: u32 = TICKS_PER_SECOND / 1000;
/// Timer ticks in one microsecond.
pub const TICKS_PER_US: u32 = TICKS_PER_SECOND / 1_000_000;

/// Millimetres in one inch.
pub const MM_PER_INCH: f32 = 25.4;

/// A coordinate or a distance along one axis, nm (for a rotary axis: millionths of a degree).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Nm(pub i64);

impl Nm {
    /// Nanometres in one millimetre.
    pub const PER_MM: i64 = 1_000_000;
    /// Nanometres in one inch.
    pub const PER_INCH: i64 = 25_400_000;

    /// Returns the distance in mm. Exact to 1 nm up to 8 m, within a part in 10^7 beyond.
    #[must_use]
    pub fn to_mm(self) -> f32 {
        let nm = match i32::try_from(self.0) {
            Ok(nm) => nm as f32,
            Err(_) => self.to_f32(),
        };
        nm * 1.0e-6
    }

    #[cold]
    fn to_f32(self) -> f32 {
        self.0 as f32
    }

    /// Returns the distance in mm, in double precision: once per block, never per segment.
    #[must_use]
    pub fn to_mm_f64(self) -> f64 {
        self.0 as f64 * 1.0e-6
    }

    /// Returns the nearest coordinate to a distance in mm, in single precision.
    #[must_use]
    pub fn from_mm(mm: f32) -> Self {
        let nm = mm * 1.0e6;
        Self((nm + if nm < 0.0 { -0.5 } else { 0.5 }) as i64)
    }

    /// Returns the nearest coordinate to a distance in mm.
    #[must_use]
    pub fn from_mm_f64(mm: f64) -> Self {
        Self(libm::round(mm * 1.0e6) as i64)
    }
}

/// An angle, millionths of a degree, counter-clockwise: less than a turn in either direction.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MicroDegrees(i32);

impl MicroDegrees {
    /// Millionths of a degree in a quarter turn.
    pub const QUARTER: i32 = 90_000_000;
    /// No angle.
    pub const ZERO: Self = Self(0);

    /// Returns the angle without its whole turns.
    #[must_use]
    pub const fn new(millionths: i64) -> Self {
        Self((millionths % (4 * Self::QUARTER as i64)) as i32)
    }

    /// Returns the angle, millionths of a degree.
    #[must_use]
    pub const fn millionths(self) -> i32 {
        self.0
    }

    /// Returns the sine and the cosine: exact at whole quarter turns.
    #[must_use]
    pub fn sin_cos(self) -> (f64, f64) {
        let quarters = self.0.div_euclid(Self::QUARTER);
        let radians = f64::from(self.0.rem_euclid(Self::QUARTER))
            * (core::f64::consts::FRAC_PI_2 / f64::from(Self::QUARTER));
        let (sin, cos) = libm::sincos(radians);
        match quarters.rem_euclid(4) {
            0 => (sin, cos),
            1 => (cos, -sin),
            2 => (-sin, -cos),
            _ => (-cos, sin),
        }
    }
}

impl core::ops::Add for Nm {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self(self.0.wrapping_add(other.0))
    }
}

impl core::ops::Sub for Nm {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self(self.0.wrapping_sub(other.0))
    }
}

/// Steps of one axis, counted from where the machine was switched on or homed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Steps(pub i32);

/// A position in steps with 32 binary places: the exact point of the path, between two steps.
///
/// The step that is due there is the nearest whole number, [`FineSteps::nearest`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct FineSteps(pub i64);

impl FineSteps {
    /// One step.
    pub const ONE: i64 = 1 << 32;

    /// Returns the steps in single precision.
    #[must_use]
    pub fn to_f32(self) -> f32 {
        let magnitude = self.0.unsigned_abs();
        let parts = magnitude as u32 as f32 * (1.0 / Self::ONE as f32);
        let steps = (magnitude >> 32) as u32 as f32 + parts;
        if self.0 < 0 { -steps } else { steps }
    }

    /// Returns the position at a distance of less than 2048 steps.
    #[must_use]
    pub fn moved_by(self, steps: f32) -> Self {
        let parts = (steps * (1 << 20) as f32) as i32;
        Self(self.0.wrapping_add(i64::from(parts) << 12))
    }

    /// Returns the position so many steps before.
    #[must_use]
    pub const fn minus_steps(self, steps: i32) -> Self {
        Self(self.0.wrapping_sub((steps as i64) << 32))
    }

    /// Returns the nearest whole step, halves upwards.
    #[must_use]
    pub const fn nearest(self) -> Steps {
        Steps((self.0.wrapping_add(Self::ONE / 2) >> 32) as i32)
    }
}

/// The resolution of one axis: millionths of a step per mm.
///
/// `$100=250` is 250 000 000. At most [`StepsPerMm::MAX`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepsPerMm {
    millionths: u64,
    /// Steps per nm, times 2^64: dividing by a million is a multiplication then.
    per_nm: u64,
}

impl StepsPerMm {
    /// The finest resolution that can be set: 100 000 steps/mm.
    pub const MAX: u64 = 100_000_000_000;
    /// Farthest coordinate of any resolution, nm: below 2^53, which double precision holds exactly.
    const FARTHEST_NM: u64 = 9_000_000_000_000_000;
    /// Micro-steps-per-mm times nm that make one step.
    const ONE_STEP: i64 = 1_000_000_000_000;

    /// Returns the resolution of millionths of a step per mm; `None` for zero and above
    /// [`Self::MAX`].
    #[must_use]
    pub const fn from_millionths(millionths: u64) -> Option<Self> {
        if millionths == 0 || millionths > Self::MAX {
            return None;
        }
        let per_nm = ((millionths as u128) << 64) / Self::ONE_STEP as u128;
        Some(Self {
            millionths,
            per_nm: per_nm as u64,
        })
    }

    /// Returns the resolution in millionths of a step per mm.
    #[must_use]
    pub const fn millionths(self) -> u64 {
        self.millionths
    }

    /// Returns the resolution in steps per mm.
    #[must_use]
    pub fn to_f32(self) -> f32 {
        self.millionths as f32 * 1.0e-6
    }

    /// Returns the farthest coordinate whose step count an axis can hold, nm: one quarter of the
    /// range of a step counter, so that no difference of two positions overflows.
    #[must_use]
    pub const fn farthest(self) -> Nm {
        let steps = (i32::MAX / 4) as u64;
        let nm = match (steps * 1_000_000).checked_div(self.millionths) {
            Some(mm) => mm.saturating_mul(1_000_000),
            None => 0,
        };
        // Where the resolution is coarse, the limit is what double precision holds exactly.
        Nm(if nm > Self::FARTHEST_NM {
            Self::FARTHEST_NM.cast_signed()
        } else {
            nm.cast_signed()
        })
    }

    /// Returns the whole steps at a coordinate, `round(nm × steps/mm)` with halves away from zero,
    /// and the exact point in between.
    ///
    /// The coordinate must not be beyond [`Self::farthest`]. The nearest step of the fine position
    /// is always the whole number returned with it.
    #[must_use]
    pub fn steps_at(self, position: Nm) -> (Steps, FineSteps) {
        self.split(position, || true)
    }

    /// Returns the same as [`Self::steps_at`], but rounds a coordinate exactly half-way between two
    /// steps as Grbl does, from its single-precision value in mm. Both steps are equally near.
    #[must_use]
    pub fn steps_as_grbl(self, position: Nm, single_mm: f32) -> (Steps, FineSteps) {
        self.split(position, || {
            let steps = (single_mm * self.to_f32()).abs();
            steps - steps as u32 as f32 >= 0.5
        })
    }

    fn split(self, position: Nm, is_away: impl FnOnce() -> bool) -> (Steps, FineSteps) {
        const HALF: i64 = StepsPerMm::ONE_STEP / 2;
        let magnitude = position.0.unsigned_abs();
        // Rounded down, and up to one too small; the product may wrap, the remainder does not.
        let mut whole = high_word(magnitude, self.per_nm).cast_signed();
        let product = magnitude.wrapping_mul(self.millionths).cast_signed();
        let mut remainder = product.wrapping_sub(whole.wrapping_mul(Self::ONE_STEP));
        if remainder > HALF || (remainder == HALF && is_away()) {
            whole += 1;
            remainder -= Self::ONE_STEP;
        }
        // The remainder / 10^12 of a step to 32 binary places is × 2^66 / 10^12 / 2^34; below 2 ×
        // 10^12, it fits a word without its last ten bits.
        let fraction = (i64::from((remainder >> 10) as i32) * 73_786_976) >> 24;
        let (whole, fraction) = if position.0 < 0 {
            (-whole, -fraction)
        } else {
            (whole, fraction)
        };
        let fraction = fraction.clamp(-(FineSteps::ONE / 2), FineSteps::ONE / 2 - 1);
        (
            Steps(whole as i32),
            FineSteps((whole << 32).wrapping_add(fraction)),
        )
    }

    /// Returns the coordinate of a whole step, to the nearest nm.
    #[must_use]
    pub fn position_of(self, steps: Steps) -> Nm {
        let scaled = i64::from(steps.0) as f64 * (1.0e12 / self.millionths as f64);
        Nm(libm::round(scaled) as i64)
    }
}

/// Returns the upper half of a product.
const fn high_word(a: u64, b: u64) -> u64 {
    let (a_low, a_high) = (a & 0xffff_ffff, a >> 32);
    let (b_low, b_high) = (b & 0xffff_ffff, b >> 32);
    let middle = a_high * b_low + ((a_low * b_low) >> 32);
    let other = a_low * b_high + (middle & 0xffff_ffff);
    a_high * b_high + (middle >> 32) + (other >> 32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resolution(steps_per_mm: u64) -> StepsPerMm {
        StepsPerMm::from_millionths(steps_per_mm * 1_000_000).unwrap()
    }

    #[test]
    fn halves_round_away_from_zero() {
        for (nm, steps) in [
            (2_000, 1),
            (-2_000, -1),
            (1_999, 0),
            (6_000, 2),
            (-6_000, -2),
        ] {
            let (whole, fine) = resolution(250).steps_at(Nm(nm));
            assert_eq!(whole, Steps(steps), "{nm} nm");
            assert_eq!(fine.nearest(), whole, "{nm} nm");
        }
    }

    #[test]
    fn fine_steps_are_the_same_in_single_precision_to_its_last_digit() {
        for steps in [0.0, 0.25, -0.25, 1_000.125, -1_000.125, 2_000_000.0, -2.0e9] {
            let fine = FineSteps((f64::from(steps) * FineSteps::ONE as f64) as i64);
            assert_eq!(fine.to_f32(), steps);
        }
        for steps in [0.25, -0.25, 2_047.5, -2_047.5] {
            assert_eq!(FineSteps(0).moved_by(steps).to_f32(), steps);
        }
    }

    #[test]
    fn halves_round_as_grbls_single_precision_does() {
        for (nm, single_mm, steps) in [
            (57_674_000, 57.673_996, 14_418),
            (57_674_000, 57.674, 14_419),
            (-57_674_000, -57.673_996, -14_418),
            (57_675_000, 0.0, 14_419),
        ] {
            let (whole, fine) = resolution(250).steps_as_grbl(Nm(nm), single_mm);
            assert_eq!(whole, Steps(steps), "{single_mm}");
            assert_eq!(fine.nearest(), whole, "{single_mm}");
        }
    }

    #[test]
    fn steps_at_agrees_with_exact_arithmetic_far_from_the_origin() {
        for millionths in [1, 80_000_000, 157_480_315, 99_999_999_999] {
            let resolution = StepsPerMm::from_millionths(millionths).unwrap();
            let far = resolution.farthest().0;
            for k in 0..1000_i64 {
                let nm = far / 1000 * k - 7 * k;
                for nm in [nm, -nm] {
                    let product = i128::from(nm) * i128::from(millionths);
                    let half = 500_000_000_000 * product.signum();
                    let exact = (product + half) / 1_000_000_000_000;
                    let (whole, fine) = resolution.steps_at(Nm(nm));
                    assert_eq!(i128::from(whole.0), exact, "{nm} nm at {millionths}");
                    let exact_fine = (product << 32) / 1_000_000_000_000;
                    assert!((i128::from(fine.0) - exact_fine).abs() <= 64);
                }
            }
        }
    }

    #[test]
    fn a_step_has_a_coordinate_that_has_that_step() {
        for millionths in [333_333, 80_000_000, 250_000_000, 157_480_315] {
            let resolution = StepsPerMm::from_millionths(millionths).unwrap();
            for steps in (-100_000..100_000).step_by(997) {
                let nm = resolution.position_of(Steps(steps));
                assert_eq!(resolution.steps_at(nm).0, Steps(steps));
            }
        }
    }
}
