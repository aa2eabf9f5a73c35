//! The plugin's report, see `proof/cost/src/report.rs`.

use std::{fs, path::Path};

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

/// Everything counted in one run.
#[derive(Deserialize)]
pub(super) struct Report {
    /// Name and calibration of the cycle table.
    pub(super) model: String,
    /// Modelled cycles of everything.
    pub(super) cycles: u64,
    /// The first is what runs outside exception handlers.
    pub(super) tasks: Vec<Task>,
    /// Task, address, executions and cycles of every instruction.
    pub(super) sites: Vec<(usize, u64, u64, u64)>,
    pub(super) functions: Vec<Function>,
    unexplained: u64,
    unknown: Vec<String>,
}

/// One exception handler, entry and exit included, preemption excluded.
#[derive(Deserialize, Clone, Default)]
pub(super) struct Task {
    /// The handler's name, or `thread`.
    pub(super) name: String,
    pub(super) activations: u64,
    pub(super) instructions: u64,
    pub(super) cycles: u64,
    pub(super) min_cycles: u64,
    pub(super) max_instructions: u64,
    pub(super) max_cycles: u64,
    pub(super) peripheral_reads: u64,
    pub(super) peripheral_writes: u64,
    /// Number of activations by their cycles.
    pub(super) histogram: Vec<(u64, u64)>,
}

/// A function as the linker sees it.
#[derive(Deserialize)]
pub(super) struct Function {
    pub(super) name: String,
    pub(super) calls: u64,
    /// Of its calls, callees included.
    pub(super) calls_instructions: u64,
    pub(super) calls_cycles: u64,
}

impl Task {
    /// Cycles that all but one of `share` activations do not exceed.
    pub(super) fn all_but_one_in(&self, share: u64) -> u64 {
        let mut above = self.activations / share;
        let mut rows = self.histogram.iter().rev();
        let row = rows.find(|(_, count)| {
            let is_reached = *count > above;
            above = above.saturating_sub(*count);
            is_reached
        });
        row.map_or(0, |&(cycles, _)| cycles)
    }
}

impl Report {
    /// Reads a report, and fails when it cannot be trusted.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = fs::read_to_string(path)
            .with_context(|| format!("the plugin left no report in {}", path.display()))?;
        Self::parse(&text)
    }

    fn parse(text: &str) -> Result<Self> {
        let report: Self = serde_json::from_str(text).context("damaged report")?;
        ensure!(
            report.unknown.is_empty(),
            "instructions that the decoder does not know were executed:\n{}",
            report.unknown.join("\n")
        );
        ensure!(
            report.unexplained == 0,
            "{} jumps that no rule explains: costs would be charged to the wrong task",
            report.unexplained
        );
        Ok(report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn task(histogram: &[(u64, u64)]) -> Task {
        Task {
            name: "SysTick".into(),
            activations: histogram.iter().map(|(_, count)| count).sum(),
            histogram: histogram.to_vec(),
            ..Task::default()
        }
    }

    #[test]
    fn a_report_that_cannot_be_trusted_is_refused() {
        let report = |unexplained: u64, unknown: &str| {
            Report::parse(&format!(
                r#"{{"model": "", "cycles": 0, "tasks": [], "sites": [], "functions": [],
                    "unexplained": {unexplained}, "unknown": [{unknown}]}}"#
            ))
        };
        assert!(report(0, "").is_ok());
        assert!(report(1, "").is_err());
        let error = report(0, r#""08000000: de00 0000""#).err().unwrap();
        assert!(error.to_string().contains("08000000: de00"));
        assert!(Report::parse("{").is_err());
    }

    #[test]
    fn a_thousandth_may_exceed_the_quantile() {
        assert_eq!(task(&[(80, 1998), (90, 2)]).all_but_one_in(1000), 80);
        assert_eq!(task(&[(80, 1997), (90, 3)]).all_but_one_in(1000), 90);
        assert_eq!(task(&[(80, 5)]).all_but_one_in(1000), 80);
        assert_eq!(task(&[]).all_but_one_in(1000), 0);
    }
}
