//! The step rates that are proven for the boards of the project: `docs/rates.toml`.

use std::{collections::BTreeMap, fmt::Write as _, fs};

use anyhow::{Context, Result, ensure};
use common::cargo;

use super::Board;
use crate::release::Index;

/// The file, from the project's root.
const FILE: &str = "docs/rates.toml";
/// What it begins with.
const HEAD: &str = "\
# Step rates of all axes together, steps/s, at which every deadline is met, over USB or at 115 200 baud: with three axes
# and more. Written by `cargo xtask release --out DIR --write`.
";

/// Rates by the name of the board: with three axes, four and so on.
pub type Rates = BTreeMap<String, Vec<u32>>;

/// Reads the file.
pub fn read() -> Result<Rates> {
    let path = cargo::root().join(FILE);
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {FILE}"))?;
    toml::from_str(&text).with_context(|| format!("{FILE} cannot be understood"))
}

/// Writes the rates of a release into the file: the boards are of the project.
pub fn write(boards: &[Board], index: &Index) -> Result<()> {
    let mut rates = read()?;
    for (board, entry) in boards.iter().zip(&index.boards) {
        let own = board_data::Board::path(&board.name, cargo::root());
        ensure!(
            board.file == own,
            "{FILE} has the boards of the project: {} is none of them",
            board.file.display()
        );
        let of_board = entry.images.iter().map(|image| image.step_rate_hz);
        rates.insert(board.name.clone(), of_board.collect());
    }
    fs::write(cargo::root().join(FILE), text(&rates))
        .with_context(|| format!("cannot write {FILE}"))
}

/// The contents of the file.
fn text(rates: &Rates) -> String {
    let mut text = HEAD.to_owned();
    for (board, rates) in rates {
        let _ = writeln!(text, "{board:?} = {rates:?}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let rates = Rates::from([
            ("a-1.2".to_owned(), vec![200_000, 150_000]),
            ("b".to_owned(), Vec::new()),
        ]);
        assert_eq!(toml::from_str::<Rates>(&text(&rates)).unwrap(), rates);
    }

    #[test]
    fn the_file_is_as_it_would_be_written() {
        let path = cargo::root().join(FILE);
        let found = fs::read_to_string(path).unwrap();
        assert_eq!(found, text(&read().unwrap()));
    }
}
