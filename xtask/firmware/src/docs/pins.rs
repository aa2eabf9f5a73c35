//! `docs/pins.md`: the pins of each board, from its file.

use std::fmt::Write as _;

use anyhow::Result;
use firmware::boards::{Board, pins};

/// Returns the document.
pub(crate) fn table() -> Result<String> {
    let boards = firmware::boards::all()?;
    let mut text = String::from(
        "# Pins\n\nMade of the files in `boards/` by `cargo xtask docs`. [Boards](boards.md) says how to write such a \
         file, [Wiring](wiring.md) what to connect. \"Low\" is an output that is active low, \"high\" an input that is active high. *Slow*: the input shares \
         its interrupt line with another one and is looked at twice a millisecond, instead of at once. Sources: one that ends in \"only\" is the only one that was found for it.\n\n\
         | board | `--board` | chip | crystal | axes |\n|---|---|---|---|---|\n",
    );
    for board in &boards {
        let axes = match board.most_axes() {
            3 => "3".into(),
            most => format!("3 to {most}"),
        };
        let kind = if board.is_crystal_bypassed {
            " (a clock signal)"
        } else {
            ""
        };
        writeln!(
            text,
            "| {} | `{}` | STM32{} | {} MHz{kind} | {axes} |",
            board.title, board.name, board.part_name, board.crystal_mhz
        )?;
    }
    for board in &boards {
        section(&mut text, board)?;
    }
    Ok(text)
}

/// Writes what is told of a board, and its pins.
fn section(text: &mut String, board: &Board) -> Result<()> {
    writeln!(text, "\n## {}\n", board.title)?;
    if !board.about.is_empty() {
        writeln!(
            text,
            "{}{}.\n",
            board.about[..1].to_uppercase(),
            &board.about[1..]
        )?;
    }
    for source in &board.sources {
        writeln!(text, "* {source}")?;
    }
    if !board.sources.is_empty() {
        writeln!(text)?;
    }
    text.push_str(&pins::table(board)?);
    Ok(())
}
