//! The step rate that the committed report proves: for what runs without an image.

use std::{fs, sync::OnceLock};

use anyhow::{Context, Result, ensure};
use common::{BAUD, cargo};
use leadscrew::{axis::AXES, settings::StepRate};
use serde_json::Value;

/// The report of the analysis, made by `cargo xtask schedule --write`.
pub const REPORT: &str = "docs/schedule.json";

/// What the firmware of the emulated board is proven for, in whole thousands. A report is of one
/// number of axes; with others nothing is proven.
pub fn committed() -> StepRate {
    static COMMITTED: OnceLock<StepRate> = OnceLock::new();
    let read = || -> Result<u32> { of_report(&fs::read_to_string(cargo::root().join(REPORT))?) };
    *COMMITTED.get_or_init(|| read().map_or(StepRate::Unproven, StepRate::of_image))
}

/// The rate in a report, if it is one of as many axes.
fn of_report(text: &str) -> Result<u32> {
    let report: Value = serde_json::from_str(text)?;
    ensure!(report["axes"] == AXES, "it is of another number of axes");
    let rate = report["proven_step_rate_hz"][BAUD.to_string()].as_u64();
    Ok(common::whole_thousands(
        rate.context("it has no rate")? as u32
    ))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_report_gives_the_rate_of_its_axes_in_thousands() {
        let report = |axes: usize| {
            let rates = json!({"115200": 187_654, "1000000": 130_000});
            json!({"axes": axes, "proven_step_rate_hz": rates}).to_string()
        };
        assert_eq!(of_report(&report(AXES)).unwrap(), 187_000);
        assert!(of_report(&report(AXES + 1)).is_err());
        assert!(of_report("{}").is_err());
    }
}
