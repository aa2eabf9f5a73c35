//! Tables of boards within documents: each stands between two comments.

use std::{collections::BTreeMap, fmt::Write as _};

use anyhow::{Context, Result};
use board_data::Board;
use common::{cargo, document, text::separated};
use firmware::boards::rates;

/// A table that is made, and the document that it stands in.
pub(crate) struct Table {
    /// The document, from the project's root.
    pub(crate) path: &'static str,
    /// The name in the comments.
    name: &'static str,
    make: fn(&[Board]) -> Result<String>,
}

/// Every table.
pub(crate) const TABLES: [Table; 2] = [
    Table {
        path: "README.md",
        name: "boards",
        make: choice,
    },
    Table {
        path: "docs/boards.md",
        name: "rates",
        make: step_rates,
    },
];

impl Table {
    /// Returns the document with the table as it has to be.
    pub(crate) fn document(&self) -> Result<String> {
        let table = (self.make)(&Board::all(cargo::root())?)?;
        replaced(&document::read(self.path)?, self.name, &table)
            .with_context(|| format!("{} has no place for the table {}", self.path, self.name))
    }
}

/// Returns a document with a table between the comments of its name.
fn replaced(document: &str, name: &str, table: &str) -> Option<String> {
    let begin = format!("<!-- {name}: made by `cargo xtask docs` -->\n");
    let end = format!("<!-- end of {name} -->\n");
    document::with_part(document, &begin, &end, &format!("\n{table}\n"))
}

/// The boards in a row for each maker and place of the sender. The maker is the first word of a board's name.
fn choice(boards: &[Board]) -> Result<String> {
    let mut rows: BTreeMap<(&str, String), Vec<String>> = BTreeMap::new();
    for board in boards {
        let (title, name) = (&board.title, &board.name);
        let (maker, model) = title.split_once(' ').unwrap_or((title, title));
        let row = rows.entry((maker, board.sender())).or_default();
        row.push(format!("[{model}](docs/boards/{name}.md) `{name}`"));
    }
    let mut text = String::from("| maker | board, `--board` | the sender at |\n|---|---|---|\n");
    for ((maker, sender), boards) in rows {
        writeln!(text, "| {maker} | {} | {sender} |", boards.join("<br>"))?;
    }
    Ok(text)
}

/// The step rates that are proven for each board.
fn step_rates(boards: &[Board]) -> Result<String> {
    let rates = rates::read()?;
    let mut text = String::from(
        "| board | `--board` | 3 axes | 4 axes | 5 axes | 6 axes |\n|---|---|---|---|---|---|\n",
    );
    for board in boards {
        let name = &board.name;
        write!(text, "| [{}](boards/{name}.md) | `{name}` |", board.title)?;
        let of_board = rates.get(&board.name).map_or(&[][..], Vec::as_slice);
        for axes in 3..=6 {
            let rate = match of_board.get(axes - 3) {
                _ if axes > board.most_axes() => "no pins".into(),
                None => "not computed".into(),
                Some(&rate) => separated(rate.into()),
            };
            write!(text, " {rate} |")?;
        }
        text.push('\n');
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boards_of_a_maker_share_a_row() {
        let text = choice(&Board::all(cargo::root()).unwrap()).unwrap();
        let mut rows = text.lines().filter(|row| row.starts_with("| FYSETC |"));
        let row = rows.next().unwrap();
        for name in ["`fysetc-s6-2`", "`fysetc-spider`", "| USB |"] {
            assert!(row.contains(name), "{row}");
        }
        assert_eq!(rows.next(), None);
        assert!(text.contains("| Flexi-HAL | [Flexi-HAL]("), "{text}");
    }

    #[test]
    fn a_table_stands_between_its_comments() {
        let document = "a\n<!-- t: made by `cargo xtask docs` -->\n\nold\n\n<!-- end of t -->\nb\n";
        let new = replaced(document, "t", "new\n").unwrap();
        assert_eq!(new, document.replace("old", "new"));
        assert_eq!(replaced(document, "u", "new\n"), None);
    }
}
