//! `calibration/BOARD.toml`: what was measured on a board.

use std::{collections::BTreeMap, fs, io::ErrorKind, path::PathBuf};

use anyhow::{Context, Result, ensure};
use schedule::Measured;
use serde::{Deserialize, Serialize};

use super::compare::Row;
use crate::{boards::Board, cargo};

/// What is written above.
const HEAD: &str = "# Measured on a board by `cargo xtask calibrate`, in cycles of its processor.\n\
    # `cargo xtask schedule` raises its table to these.\n\n";

/// A calibration.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Calibration {
    board: String,
    chip: String,
    /// By class of the table.
    cycles: BTreeMap<String, u64>,
}

/// Where a board's file is, from the project's root.
fn name(board: &str) -> String {
    format!("calibration/{board}.toml")
}

/// Writes what was measured.
pub(super) fn write(board: &Board, rows: &[Row]) -> Result<PathBuf> {
    let calibration = Calibration {
        board: board.name.clone(),
        chip: board.chip.clone(),
        cycles: rows
            .iter()
            .map(|row| (row.class.clone(), row.measured))
            .collect(),
    };
    let path = cargo::root().join(name(&board.name));
    let folder = path.parent().unwrap_or(&path);
    fs::create_dir_all(folder)
        .and_then(|()| fs::write(&path, calibration.text()))
        .with_context(|| format!("cannot write {}", path.display()))?;
    Ok(path)
}

/// What was measured on a board, if anything was.
pub(crate) fn measured(board: &str) -> Result<Option<Measured>> {
    let file = name(board);
    match fs::read_to_string(cargo::root().join(&file)) {
        Ok(text) => read(&text, board, file).map(Some),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error).with_context(|| format!("cannot read {file}")),
    }
}

fn read(text: &str, board: &str, file: String) -> Result<Measured> {
    let calibration: Calibration = toml::from_str(text).with_context(|| file.clone())?;
    let other = &calibration.board;
    ensure!(other == board, "{file} is of the board {other}");
    Ok(Measured {
        file,
        cycles: calibration.cycles,
    })
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
    fn what_is_written_is_read() {
        let text = calibration().text();
        assert!(text.starts_with("# Measured on a board"), "{text}");
        assert!(
            text.contains("[cycles]\napb1 = 14\ndivide = 12\n"),
            "{text}"
        );
        let measured = read(&text, "mill", name("mill")).unwrap();
        assert_eq!(measured.file, "calibration/mill.toml");
        assert_eq!(measured.cycles, calibration().cycles);
    }

    #[test]
    fn the_file_of_another_board_is_refused() {
        let text = calibration().text();
        let error = read(&text, "lathe", name("lathe")).unwrap_err().to_string();
        assert_eq!(error, "calibration/lathe.toml is of the board mill");
        assert!(read("cycles = 3", "mill", name("mill")).is_err());
        let more = format!("{text}magic = true\n[more]\n");
        assert!(read(&more, "mill", name("mill")).is_err());
    }

    #[test]
    fn a_board_that_nobody_has_measured_has_no_calibration() {
        assert!(measured("board-of-nobody").unwrap().is_none());
    }
}
