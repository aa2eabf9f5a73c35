//! Which cases tests try that have many: some of them and always the same, unless `LEADSCREW_CASES` is set. With 1,
//! all that a test names; with more, that many times as many random ones, and others with another `LEADSCREW_SEED`.

#![allow(dead_code, reason = "each test uses a part of it")]

use proptest::{prelude::ProptestConfig, test_runner::RngSeed};

/// What part of many cases is tried when it must be quick.
const PART: u32 = 8;
/// As many random cases are tried even then.
const LEAST: u32 = 4;

/// How many times as many cases are tried as are named; `None` if it must be quick.
fn factor() -> Option<u32> {
    let text = std::env::var("LEADSCREW_CASES").ok()?;
    Some(text.parse().unwrap())
}

/// The seed of the cases, fixed by default: a test fails, or passes, for everybody and each time.
fn seed() -> u64 {
    std::env::var("LEADSCREW_SEED").map_or(1, |text| text.parse().unwrap())
}

/// The configuration of a test that tries `cases` random cases.
pub(crate) fn cases(cases: u32) -> ProptestConfig {
    let config = ProptestConfig::default();
    let times = factor().unwrap_or(1);
    ProptestConfig {
        cases: factor().map_or_else(|| cases.min(LEAST.max(cases / PART)), |times| cases * times),
        max_local_rejects: config.max_local_rejects.saturating_mul(times),
        max_global_rejects: config.max_global_rejects.saturating_mul(times),
        rng_seed: RngSeed::Fixed(seed()),
        ..config
    }
}

/// The rounds of a random history that has `rounds` of them.
pub(crate) fn rounds(rounds: u32) -> u64 {
    u64::from(factor().map_or_else(|| rounds.div_ceil(PART), |times| rounds * times))
}

/// Of all cases that there are, each `nth` when it must be quick, for `step_by`.
pub(crate) fn each(nth: usize) -> usize {
    if factor().is_some() { 1 } else { nth }
}
