//! `cargo xtask flash`, whatever it writes by: which file a board takes, and the image in it.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, bail, ensure};
use common::options::Flash;
use formats::read::{self, OwnedPart};

use crate::{
    boards::{self, Board, compile, layout},
    release::{self, FlashMethod},
    released::Released,
};

/// An image that may be written to a board: it lies where the board's file wants a program, and nowhere else.
#[derive(Debug)]
pub struct Image {
    parts: Vec<OwnedPart>,
    start: u32,
}

impl Image {
    /// Reads a file for DFU, and compares its image with the board's memory.
    pub fn read_dfu(board: &Board, file: &Path) -> Result<Self> {
        let bytes = fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
        Self::of_dfu(board, &bytes).with_context(|| format!("{} is not written", file.display()))
    }

    /// The same of the contents of a file.
    pub fn of_dfu(board: &Board, bytes: &[u8]) -> Result<Self> {
        let file = read::dfuse(bytes)?;
        ensure!(
            file.name == board.title,
            "it is for a board {}, and not for {}",
            file.name,
            board.title
        );
        Self::of_parts(board, file.parts)
    }

    /// The image of parts in any order.
    pub fn of_parts(board: &Board, mut parts: Vec<OwnedPart>) -> Result<Self> {
        parts.retain(|(_, bytes)| !bytes.is_empty());
        parts.sort_by_key(|(start, _)| *start);
        let borrowed: Vec<_> = parts.iter().map(|(at, bytes)| (*at, &bytes[..])).collect();
        layout::check_parts(board, &borrowed)?;
        let start = board.chosen_memory().flash_start;
        Ok(Self { parts, start })
    }

    /// Its parts, in the order of their addresses.
    pub fn parts(&self) -> &[OwnedPart] {
        &self.parts
    }

    /// Where its vectors are.
    pub fn start(&self) -> u32 {
        self.start
    }

    /// The number of its bytes.
    pub fn bytes(&self) -> usize {
        self.parts.iter().map(|(_, bytes)| bytes.len()).sum()
    }
}

/// Returns the method of a board that is of a kind.
pub fn by(board: &Board, kind: &str) -> Result<FlashMethod> {
    let mut methods = release::flashing(board).into_iter();
    let method = methods.find(|method| method.kind == kind);
    method.with_context(|| {
        format!(
            "{} is not flashed by {kind}: docs/boards/{}.md has how it is",
            board.title, board.name
        )
    })
}

/// How a board is written whose firmware is not whole: without it, `$DFU` leads nowhere.
pub fn again(board: &Board) -> String {
    match &release::flashing(board)[..] {
        [first, ..] if !board.has_dfu => format!("write it by {}, `{}`", first.kind, first.file),
        _ => "put it into DFU mode again, and repeat the command".into(),
    }
}

/// What is flashed.
pub struct FirmwareSource {
    /// The board.
    pub board: Board,
    released: Option<Released>,
    is_unproven: bool,
}

impl FirmwareSource {
    /// What the options of the command choose: the board that is named, or the only one of a release.
    pub fn by(options: &Flash) -> Result<Self> {
        let released = options.from.as_deref().map(Released::open).transpose()?;
        let name = match (&options.board, &released) {
            (Some(name), _) => name,
            (None, Some(released)) => released.only_board()?,
            (None, None) => bail!("no board is named"),
        };
        Ok(Self {
            board: boards::named(name)?,
            released,
            is_unproven: options.unproven,
        })
    }

    /// Makes sure that a file of a release may be written, before anything else is looked at.
    pub fn check(&self, method: &FlashMethod) -> Result<()> {
        if let Some(released) = &self.released {
            released.file(&self.board, method)?;
        }
        Ok(())
    }

    /// The file for a method: that of the release, or of a firmware that is built, and proven unless it is asked for
    /// without.
    pub fn file(&self, method: &FlashMethod) -> Result<PathBuf> {
        if let Some(released) = &self.released {
            return released.file(&self.board, method);
        }
        let mut files = release::write(&self.board, &self.elf()?)?.into_iter();
        let file = files.find(|(it, _)| it.kind == method.kind);
        Ok(file.context("the board has lost its file")?.1)
    }

    /// The same as an ELF file.
    pub fn elf(&self) -> Result<PathBuf> {
        match &self.released {
            Some(released) => released.elf(&self.board),
            None if self.is_unproven => compile::firmware(&self.board),
            None => crate::proven(&self.board),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_firmware_is_written_again_by_what_needs_none() {
        for (name, words) in [
            ("blackpill-f411", "put it into DFU mode again"),
            ("btt-skr-2", "write it by SD card, `firmware.bin`"),
            ("flexi-hal", "write it by UF2, `leadscrew.uf2`"),
        ] {
            let text = again(&boards::named(name).unwrap());
            assert!(text.starts_with(words), "{name}: {text}");
        }
    }
}
