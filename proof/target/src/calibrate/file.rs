//! `calibration/BOARD.toml`: what was measured on a board.

use std::{collections::BTreeMap, fs, path::PathBuf};

use anyhow::{Context, Result};
use common::cargo;
use firmware::boards::Board;
use serde::Serialize;

use super::compare::Row;

/// What is written above.
const HEAD: &str = "# Measured on a board by `cargo xtask calibrate`, in cycles of its processor.\n\
    # `cargo xtask schedule` raises its table to these.\n\n";

/// A calibration.
#[derive(Debug, PartialEq, Eq, Serialize)]
struct Calibration {
    board: String,
    chip: String,
    /// By class of the table.
    cycles: BTreeMap<String, u64>,
}

/// Writes what was measured.
pub(super) fn write(board: &Board, rows: &[Row]) -> Result<PathBuf> {
    let calibration = Calibration {
        board: board.name.clone(),
        chip: board.part.probe_rs.clone(),
        cycles: rows
            .iter()
            .map(|row| (row.class.clone(), row.measured))
            .collect(),
    };
    let path = cargo::root().join(format!("calibration/{}.toml", board.name));
    let folder = path.parent().unwrap_or(&path);
    fs::create_dir_all(folder)
        .and_then(|()| fs::write(&path, calibration.text()))
        .with_context(|| format!("cannot write {}", path.display()))?;
    Ok(path)
}

impl Calibration {
    fn text(&self) -> String {
        let table = toml::to_string(self).expect("names and numbers are TOML");
        format!("{HEAD}{table}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn calibration() -> Calibration {
        Calibration {
            board: "mill".into(),
            chip: "STM32F405RGTx".into(),
            cycles: [("divide".into(), 12), ("apb1".into(), 14)].into(),
        }
    }

    #[test]
    fn what_is_written_is_what_the_analysis_reads() {
        let text = calibration().text();
        assert!(text.starts_with("# Measured on a board"), "{text}");
        let measured = schedule::Measured::read(&text, "mill").unwrap();
        assert_eq!(measured.cycles, calibration().cycles);
    }
}
