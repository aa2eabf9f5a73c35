//! Fingerprints of arithmetic: the host and the target must agree bit for bit.

use leadscrew::{
    math,
    units::{Nm, Steps, StepsPerMm},
};

/// The operation, its function, and the FNV-1a hash of all results.
type Fingerprint = (&'static str, fn() -> u64, u64);

/// All of them.
pub(crate) const FINGERPRINTS: [Fingerprint; 4] = [
    ("single precision", single_precision, 0x1ac1_5682_c9ee_0ffc),
    ("fixed point", fixed_point, 0x47b4_6c7d_b0c8_8bd6),
    ("double precision", double_precision, 0xb7fe_fa13_ab62_70ff),
    ("positions", positions, 0x83d1_3f71_4721_f760),
];

/// FNV-1a over words.
struct Hash(u64);

impl Hash {
    const fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    fn add(&mut self, word: u64) {
        self.0 = (self.0 ^ word).wrapping_mul(0x0100_0000_01b3);
    }
}

fn single_precision() -> u64 {
    let mut hash = Hash::new();
    let mut x = 1.0e-9_f32;
    while x < 1.0e9 {
        hash.add(math::sqrt(x).to_bits().into());
        hash.add((1.0 / x).to_bits().into());
        hash.add((x * 0.1 + 3.0).to_bits().into());
        x *= 1.01;
    }
    for k in 0..=2_000_u16 {
        let x = f32::from(k) / 2_000.0;
        hash.add(math::sin(x).to_bits().into());
        hash.add(math::asin(x).to_bits().into());
    }
    hash.0
}

fn fixed_point() -> u64 {
    let mut hash = Hash::new();
    for k in 0..4_000_u32 {
        let phase = k.wrapping_mul(2_654_435_761);
        let (cos, sin) = math::cos_sin(phase);
        let value = i64::from(k) * 123_456_789_123 - 7_000_000_000;
        hash.add(cos as u64);
        hash.add(sin as u64);
        hash.add(math::scale_q30(value, cos) as u64);
        hash.add(math::scale_q31(value, phase >> 1) as u64);
    }
    hash.0
}

fn double_precision() -> u64 {
    let mut hash = Hash::new();
    for k in 1..=400_i32 {
        let x = f64::from(k) * 0.037 - 7.0;
        let y = f64::from(k * k % 97) - 48.0;
        for result in [
            libm::atan2(y, x),
            libm::hypot(x, y),
            libm::sqrt(x * x + y),
            libm::round(x * 1.0e6),
            libm::sin(x),
            libm::cos(y),
            x / (y + 0.5),
        ] {
            // A root of a negative number: the sign of NaN is nobody's business.
            hash.add(if result.is_nan() { 0 } else { result.to_bits() });
        }
    }
    hash.0
}

fn positions() -> u64 {
    let mut hash = Hash::new();
    for millionths in [1, 80_000_000, 157_480_315, 99_999_999_999] {
        let Some(resolution) = StepsPerMm::from_millionths(millionths) else {
            continue;
        };
        let far = resolution.farthest().0;
        for k in 0..200 {
            let (steps, fine) = resolution.steps_at(Nm(far / 200 * k - 7 * k * k));
            hash.add(steps.0 as u64);
            hash.add(fine.0 as u64);
            hash.add(resolution.position_of(Steps(k as i32 * 997)).0 as u64);
        }
    }
    hash.0
}
