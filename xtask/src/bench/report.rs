//! The plugin's report, see `xtask/cost/src/report.rs`.

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
#[derive(Deserialize, Clone)]
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

impl Report {
    /// Reads a report, and fails when it cannot be trusted.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = fs::read_to_string(path)
            .with_context(|| format!("the plugin left no report in {}", path.display()))?;
        let report: Self = serde_json::from_str(&text).context("damaged report")?;
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
