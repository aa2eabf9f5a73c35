//! The boards of `boards/`, and the firmware of each.

pub mod compile;
pub mod image;
pub mod layout;
pub mod pins;
pub mod rates;
pub mod seal;

use std::{fmt::Write as _, ops::Deref, path::Path, process::Command};

use anyhow::{Context, Result, bail};
pub use board_data::FlashSector;
use board_data::{DEFAULT, MemoryLayout};
use common::{cargo, ui};

/// `DEV_ID` of F42x, which may have twice the flash, in two banks.
const OF_TWO_BANKS: u16 = 0x419;

/// A board the firmware can be built for.
#[derive(Debug, Clone)]
pub struct Board {
    data: board_data::Board,
    /// Whether the firmware is for QEMU instead of the board.
    is_in_qemu: bool,
}

impl Deref for Board {
    type Target = board_data::Board;

    fn deref(&self) -> &Self::Target {
        &self.data
    }
}

impl From<board_data::Board> for Board {
    fn from(data: board_data::Board) -> Self {
        Self {
            data,
            is_in_qemu: false,
        }
    }
}

impl Board {
    /// What other tools are told of the board with `--board`: its file, for it may lie anywhere.
    pub fn argument(&self) -> String {
        self.file.to_string_lossy().into_owned()
    }

    /// The numbers of axes that the board can have, or one of them.
    pub fn numbers_of_axes(&self, only: Option<u8>) -> impl Iterator<Item = u8> + use<> {
        let most = self.most_axes();
        let numbers = (3..).take_while(move |axes| usize::from(*axes) <= most);
        numbers.filter(move |axes| only.is_none_or(|it| it == *axes))
    }

    /// Where program and settings are with as many axes as were asked for.
    pub fn chosen_memory(&self) -> MemoryLayout {
        self.memory(cargo::axes().into())
    }

    /// The sizes of the sectors of the flash, KiB, as the chip's own bootloader may describe it: that of the part, that of
    /// the chip's larger parts, on which the image runs as well, and two banks of it where the image also runs on F42x.
    pub fn flashes_kib(&self) -> Vec<Vec<u32>> {
        let sectors = &self.chip.sectors_kib;
        let ends_kib = sectors.iter().scan(0, |end_kib, kib| {
            *end_kib += kib;
            Some(*end_kib)
        });
        let parts = (1..).zip(ends_kib);
        let parts = parts.filter(|(_, end_kib)| {
            let is_part = self
                .chip
                .parts
                .values()
                .any(|part| part.flash_kib == *end_kib);
            is_part && *end_kib >= self.part.flash_kib
        });
        let of_parts = parts.map(|(count, _)| sectors[..count].to_vec());
        let may_be_twice = self.chip.dev_ids.contains(&OF_TWO_BANKS);
        let twice = may_be_twice.then(|| sectors.repeat(2));
        of_parts.chain(twice).collect()
    }

    /// Makes a Cargo command compile for the board.
    pub fn compile<'a>(&self, command: &'a mut Command) -> &'a mut Command {
        self.compile_into(&cargo::target_dir(), command)
    }

    /// The same into another folder than that of the project.
    pub fn compile_into<'a>(&self, target: &Path, command: &'a mut Command) -> &'a mut Command {
        let mut features = self.features(cargo::axes().into());
        if self.is_in_qemu {
            features.push("qemu".into());
        }
        cargo::compile_for(command, &self.argument(), &features.join(","), target);
        command
    }
}

impl Board {
    /// The board as it is in QEMU: its firmware has `src/board/qemu/` in place of the chip. Boards whose motors are
    /// driven by phases have none, nor have those whose settings are in an EEPROM.
    pub fn in_emulator(mut self) -> Result<Self> {
        if self.has_phases() {
            bail!(
                "the emulator records steps and directions: {} has phases instead",
                self.name
            );
        }
        let wiring = self.wiring(cargo::axes().into());
        if wiring.is_some_and(|wiring| wiring.eeprom.is_some()) {
            bail!(
                "the emulator has no EEPROM: {} has its settings in one",
                self.name
            );
        }
        self.is_in_qemu = true;
        Ok(self)
    }
}

/// Every board.
pub fn all() -> Result<Vec<Board>> {
    let boards = board_data::Board::all(cargo::root())?;
    Ok(boards.into_iter().map(Board::from).collect())
}

/// The board of a name, or of a file: a path that ends in `.toml`.
pub fn named(name: &str) -> Result<Board> {
    let file = board_data::Board::path(name, cargo::root());
    if file.is_file() {
        return Ok(board_data::Board::read(&file, cargo::root())?.into());
    }
    let mut known = String::new();
    for board in &all()? {
        write!(known, "\n  {}", board.name)?;
    }
    bail!("there is no board {name:?}; the boards are{known}")
}

/// The boards that the options of a command choose: a named board, every board, or the default board, whose name is
/// printed.
pub fn chosen(name: Option<&str>, are_all: bool) -> Result<Vec<Board>> {
    if are_all {
        return all();
    }
    let name = name.unwrap_or_else(|| {
        ui::status(
            "Board",
            &format!("{DEFAULT}: `--board NAME` takes another one, `--all` every one"),
        );
        DEFAULT
    });
    Ok(vec![named(name)?])
}

/// The board that QEMU emulates, in QEMU, and its machine.
pub fn emulated() -> Result<(Board, String)> {
    let (board, machine) = all()?
        .into_iter()
        .find_map(|board| board.qemu.clone().map(|machine| (board, machine)))
        .context("no board names a QEMU machine")?;
    Ok((board.in_emulator()?, machine))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_emulator_is_for_boards_with_steps_and_settings_in_flash() {
        let in_emulator = |name: &str| named(name).unwrap().in_emulator();
        assert!(in_emulator("nucleo-f446re").is_ok());
        for (name, words) in [
            ("nucleo-f446re-uln2003", "has phases instead"),
            ("flexi-hal", "the emulator has no EEPROM"),
            ("fysetc-s6-2", "the emulator has no EEPROM"),
        ] {
            let error = in_emulator(name).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn without_a_name_one_board_is_chosen_and_all_when_they_are_asked_for() {
        let names = |boards: Vec<Board>| -> Vec<String> {
            boards.iter().map(|board| board.name.clone()).collect()
        };
        assert_eq!(names(chosen(None, false).unwrap()), [DEFAULT]);
        let one = Some("nucleo-f446re");
        assert_eq!(names(chosen(one, false).unwrap()), ["nucleo-f446re"]);
        let all = names(chosen(None, true).unwrap());
        assert!(
            all.len() > 2 && all.contains(&DEFAULT.to_owned()),
            "{all:?}"
        );
        assert!(chosen(Some("no-such-board"), false).is_err());
    }
}
