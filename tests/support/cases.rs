//! Which cases random tests try: few and always the same, or `LEADSCREW_CASES` times as many, and others with
//! another `LEADSCREW_SEED`.

#![allow(dead_code, reason = "each test uses a part of it")]

use proptest::{prelude::ProptestConfig, test_runner::RngSeed};

/// How many times as many cases are tried as when it must be quick.
pub(crate) fn factor() -> u32 {
    std::env::var("LEADSCREW_CASES").map_or(1, |text| text.parse().unwrap())
}

/// What the cases are drawn with: a test that fails fails again, and one that passes for somebody passes for all.
fn seed() -> u64 {
    std::env::var("LEADSCREW_SEED").map_or(1, |text| text.parse().unwrap())
}

/// The configuration of a test that tries `cases` cases when it must be quick.
pub(crate) fn cases(cases: u32) -> ProptestConfig {
    let factor = factor();
    let config = ProptestConfig::default();
    ProptestConfig {
        cases: cases * factor,
        max_local_rejects: config.max_local_rejects.saturating_mul(factor),
        max_global_rejects: config.max_global_rejects.saturating_mul(factor),
        rng_seed: RngSeed::Fixed(seed()),
        ..config
    }
}
