//! Code of so many repetitions, and twice as many, on the cycle counter.

/// The processor's cycle counter.
pub(crate) const COUNTER: u32 = 0xe000_1004;
/// Repetitions in the shorter of two codes.
pub(crate) const REPETITIONS: u32 = 32;
/// Number of measurements of a pair of codes.
const RUNS: u32 = 8;

/// Cycles of some repetitions: the least and the most of several runs.
pub(crate) struct Sample {
    pub(crate) repetitions: u32,
    pub(crate) least: u32,
    pub(crate) most: u32,
}

impl Sample {
    /// Measures how much longer one code takes than the other, which has so many repetitions less.
    pub(crate) fn of(repetitions: u32, short: impl Fn() -> u32, long: impl Fn() -> u32) -> Self {
        let mut sample = Self {
            repetitions,
            least: u32::MAX,
            most: 0,
        };
        for _ in 0..RUNS {
            // The first time fills the cache.
            let _ = short();
            let shorter = short();
            let _ = long();
            let cycles = long().saturating_sub(shorter);
            sample.least = sample.least.min(cycles);
            sample.most = sample.most.max(cycles);
        }
        sample
    }
}

/// A function that repeats instructions and returns the cycles that they take. `before` and `after`
/// are around what is timed.
macro_rules! repeated {
    ($count:literal, $before:literal, $body:literal, $after:literal, $($operands:tt)*) => {
        || -> u32 {
            let (start, end): (u32, u32);
            // SAFETY: the operands say what the instructions read and write; what they store to is
            // the caller's.
            unsafe {
                core::arch::asm!(
                    concat!(
                        $before, "\ndsb\nisb\nldr {start}, [{counter}]\n.rept ", $count, "\n",
                        $body, "\n.endr\nldr {end}, [{counter}]\n", $after
                    ),
                    start = out(reg) start,
                    end = out(reg) end,
                    counter = in(reg) crate::cycles::COUNTER,
                    $($operands)*
                );
            }
            end.wrapping_sub(start)
        }
    };
}

/// Measures instructions; those of one repetition may count as several.
macro_rules! sample {
    ($each:literal, $body:literal, $($operands:tt)*) => {
        crate::cycles::Sample::of(
            crate::cycles::REPETITIONS * $each,
            crate::cycles::repeated!(32, "", $body, "", $($operands)*),
            crate::cycles::repeated!(64, "", $body, "", $($operands)*),
        )
    };
}

/// Measures a floating-point instruction on `s0` = 1.3, `s1` = 0.7, `s2` = 1.1, which the compiler
/// does not let an operand name. An address is in `p`.
macro_rules! float_sample {
    ($body:literal) => {
        crate::cycles::Sample::of(
            crate::cycles::REPETITIONS,
            crate::cycles::float_repeated!(32, $body),
            crate::cycles::float_repeated!(64, $body),
        )
    };
}

/// The same as `repeated`, on floating-point registers.
macro_rules! float_repeated {
    ($count:literal, $body:literal) => {
        crate::cycles::repeated!(
            $count,
            "vpush {{s0, s1, s2, s3}}\nvmov s0, {x}\nvmov s1, {y}\nvmov s2, {z}",
            $body,
            "vpop {{s0, s1, s2, s3}}\n/* {p} */",
            x = in(reg) 1.3_f32.to_bits(),
            y = in(reg) 0.7_f32.to_bits(),
            z = in(reg) 1.1_f32.to_bits(),
            p = in(reg) &raw const crate::cycles::WORD,
        )
    };
}

/// The word that floating-point registers are loaded from.
pub(crate) static WORD: f32 = 1.5;

pub(crate) use {float_repeated, float_sample, repeated, sample};
