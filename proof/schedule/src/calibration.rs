//! `calibration/BOARD.toml`: what `cargo xtask calibrate` has measured on a board.

use std::{collections::BTreeMap, fs, io::ErrorKind, path::Path};

use serde::Deserialize;

/// The measurements of a board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Measured {
    /// The file that says so, from the project's root.
    pub file: String,
    /// Cycles, by class of the table.
    pub cycles: BTreeMap<String, u64>,
}

/// The file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Calibration {
    board: String,
    #[serde(rename = "chip")]
    _chip: String,
    cycles: BTreeMap<String, u64>,
}

impl Measured {
    /// What was measured on a board of the project in a folder, if anything was.
    ///
    /// # Errors
    ///
    /// The file is there and cannot be read, or is another board's.
    pub fn on(board: &str, root: &Path) -> Result<Option<Self>, String> {
        let file = file(board);
        match fs::read_to_string(root.join(&file)) {
            Ok(text) => Self::read(&text, board).map(Some),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(format!("cannot read {file}: {error}")),
        }
    }

    /// Reads a file.
    ///
    /// # Errors
    ///
    /// The file has another form, or is another board's.
    pub fn read(text: &str, board: &str) -> Result<Self, String> {
        let file = file(board);
        let calibration: Calibration =
            toml::from_str(text).map_err(|error| format!("{file}: {error}"))?;
        let other = &calibration.board;
        if other != board {
            return Err(format!("{file} is of the board {other}"));
        }
        Ok(Self {
            file,
            cycles: calibration.cycles,
        })
    }
}

/// Where a board's file is, from the project's root.
fn file(board: &str) -> String {
    format!("calibration/{board}.toml")
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "board = \"mill\"\nchip = \"STM32F405RGTx\"\n[cycles]\napb1 = 14\n";

    #[test]
    fn the_file_of_a_board_is_read() {
        let measured = Measured::read(TEXT, "mill").unwrap();
        assert_eq!(measured.file, "calibration/mill.toml");
        assert_eq!(measured.cycles, [("apb1".into(), 14)].into());
    }

    #[test]
    fn the_file_of_another_board_is_refused() {
        let error = Measured::read(TEXT, "lathe").unwrap_err();
        assert_eq!(error, "calibration/lathe.toml is of the board mill");
        assert!(Measured::read("cycles = 3", "mill").is_err());
        assert!(Measured::read(&format!("{TEXT}[more]\n"), "mill").is_err());
    }

    #[test]
    fn a_board_that_nobody_has_measured_has_no_calibration() {
        let nobody = Measured::on("board-of-nobody", Path::new("."));
        assert!(nobody.unwrap().is_none());
    }
}
