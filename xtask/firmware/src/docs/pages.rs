//! `docs/boards/NAME.md`: the page of each board, from its file.

use std::fmt::Write as _;

use anyhow::Result;
use common::{BAUD, text::separated};
use firmware::{
    boards::{self, Board, pins, rates},
    release,
};

/// Returns each page with its path from the project's root.
pub(crate) fn all() -> Result<Vec<(String, String)>> {
    let rates = rates::read()?;
    let pages = boards::all()?.into_iter().map(|board| {
        let of_board = rates.get(&board.name).map_or(&[][..], Vec::as_slice);
        let path = format!("docs/boards/{}.md", board.name);
        (path, page(&board, of_board))
    });
    Ok(pages.collect())
}

/// Returns the page of a board with its proven step rates.
fn page(board: &Board, rates: &[u32]) -> String {
    let name = &board.name;
    let mut text = format!(
        "# {}\n\n{}Made of `boards/{name}.toml` by `cargo xtask docs`. **{}**: measure before you connect.\n\n{}",
        board.title,
        about(board),
        release::UNTRIED,
        summary(board, rates)
    );
    let [motors, connectors, inside] = pins::tables(board);
    let _ = write!(
        text,
        "\n## Connectors\n\n\
         Labels are what is printed beside pins or sockets, as far as a source shows it. \"Low\" is an output that is active \
         low, \"high\" an input that is active high. *Slow*: the input shares its interrupt line with another one and is looked \
         at twice a millisecond, instead of at once. Other axes, other pins: the last column says with how many.\n\n\
         {connectors}\n## Motors\n\n{motors}",
    );
    if !inside.is_empty() {
        let _ = write!(text, "\n## On the board\n\n{inside}");
    }
    text += &settings(board);
    text += &flashing(board);
    if !board.sources.is_empty() {
        text += "\n## Sources\n\nOne that ends in \"only\" is the only one that was found.\n\n";
        for source in &board.sources {
            let _ = writeln!(text, "* {source}");
        }
    }
    text
}

/// What else a user wants to know, as a sentence of its own.
fn about(board: &Board) -> String {
    let mut letters = board.about.chars();
    letters.next().map_or_else(String::new, |first| {
        format!("{}{}.\n\n", first.to_uppercase(), letters.as_str())
    })
}

/// The facts in a table.
fn summary(board: &Board, rates: &[u32]) -> String {
    let clock = if board.is_crystal_bypassed {
        "clock signal"
    } else {
        "crystal"
    };
    let sender = if board.has_usb() {
        "USB, with any baud rate".into()
    } else {
        format!("{}, {} baud", board.sender(), separated(BAUD.into()))
    };
    let rate = |axes: usize| match rates.get(axes - 3) {
        None => "not computed".into(),
        Some(0) => "none".into(),
        Some(&rate) => format!("{} steps/s", separated(rate.into())),
    };
    let rates = pins::grouped(board, rate).into_iter();
    let rates: Vec<_> = rates
        .map(|(rate, axes)| format!("{rate} ({axes} axes)"))
        .collect();
    format!(
        "| | |\n|---|---|\n\
         | `--board` | `{}` |\n| chip | STM32{}, {} MHz |\n| {clock} | {} MHz |\n\
         | sender | {sender} ([the name of the port](../platforms.md)) |\n\
         | proven step rate of all axes together | {} |\n",
        board.name,
        board.part_name,
        board.chip.clocks.core_mhz,
        board.crystal_mhz,
        rates.join(", ")
    )
}

/// Where the settings are, and whether they outlive a new firmware.
fn settings(board: &Board) -> String {
    let by_axes = |axes| {
        let memory = board.memory(axes);
        let Some([first, second]) = memory.journal else {
            return "the EEPROM | there".into();
        };
        // A file for a bootloader is flat: it covers what lies within the program.
        let fate = match (memory.code_start, &board.bootloader_file) {
            (None, _) => "there",
            (Some(_), None) => "there; a `.bin` file would erase them",
            (Some(_), Some(_)) => "**gone** by SD card, else there",
        };
        format!(
            "flash, sectors {} and {} | {fate}",
            first.sector, second.sector
        )
    };
    let mut text = String::from(
        "\n## Settings\n\n| axes | settings are in | after an update |\n|---|---|---|\n",
    );
    for (row, axes) in pins::grouped(board, by_axes) {
        let _ = writeln!(text, "| {axes} | {row} |");
    }
    text + "\nSave them before each [update](../update.md).\n"
}

/// How the firmware comes onto the board.
fn flashing(board: &Board) -> String {
    let mut text = format!(
        "\n## Write the firmware\n\n\
         Take one of these files of `{0}/3-axes`, or of more axes, in a release or in what `cargo xtask release --board {0} \
         --out DIR` makes:\n",
        board.name
    );
    for method in release::flashing(board) {
        let _ = write!(
            text,
            "\n* **{}**, `{}`: {}",
            method.kind,
            method.file,
            method.steps.join(" ")
        );
    }
    text + "\n\nOr [build one of the sources](../boards.md#put-the-firmware-on-the-board), where it also stands what to look for \
            on some boards. Then [First cut](../first-cut.md#3-the-board-alone) leads from the greeting over `$$` to a part.\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_says_what_an_update_leaves() {
        let gone = "| 5 | flash, sectors 3 and 4 | **gone** by SD card, else there |";
        for (name, row) in [
            ("fysetc-spider", "| 3, 4 | the EEPROM | there |"),
            ("fysetc-spider", gone),
            ("btt-octopus-1.1-f446", gone),
            (
                "btt-octopus-1.1-f429",
                "| 5 | flash, sectors 10 and 11 | there |",
            ),
            (
                "nucleo-f446re",
                "sectors 1 and 2 | there; a `.bin` file would erase them |",
            ),
        ] {
            let page = page(&boards::named(name).unwrap(), &[]);
            assert!(page.contains(row), "{name}: {row}\n{page}");
        }
    }
}
