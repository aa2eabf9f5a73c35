//! How many cases random tests try: few, or `LEADSCREW_CASES` times as many.

use proptest::prelude::ProptestConfig;

/// The configuration of a test that tries `cases` cases when it must be quick.
pub(crate) fn cases(cases: u32) -> ProptestConfig {
    let factor = std::env::var("LEADSCREW_CASES").map_or(1, |text| text.parse().unwrap());
    let config = ProptestConfig::default();
    ProptestConfig {
        cases: cases * factor,
        max_local_rejects: config.max_local_rejects.saturating_mul(factor),
        max_global_rejects: config.max_global_rejects.saturating_mul(factor),
        ..config
    }
}
