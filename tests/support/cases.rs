//! How many cases random tests try: few, or `LEADSCREW_CASES` times as many.

#![allow(dead_code, reason = "each test uses a part of it")]

use proptest::prelude::ProptestConfig;

/// How many times as many cases are tried as when it must be quick.
pub(crate) fn factor() -> u32 {
    std::env::var("LEADSCREW_CASES").map_or(1, |text| text.parse().unwrap())
}

/// The configuration of a test that tries `cases` cases when it must be quick.
pub(crate) fn cases(cases: u32) -> ProptestConfig {
    let factor = factor();
    let config = ProptestConfig::default();
    ProptestConfig {
        cases: cases * factor,
        max_local_rejects: config.max_local_rejects.saturating_mul(factor),
        max_global_rejects: config.max_global_rejects.saturating_mul(factor),
        ..config
    }
}
