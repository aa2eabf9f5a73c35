//! `cargo xtask flash --to`: the firmware for what writes it from a drive: a bootloader, or the programmer on the board.

use std::{
    fs::{self, File},
    io::Write as _,
    path::Path,
};

use anyhow::{Context, Result, bail, ensure};

use crate::{
    boards::Board,
    release::{self, FlashMethod},
};

/// Methods whose file is copied, each with a file by which its drive is known.
const DRIVES: [(&str, Option<&str>); 3] = [
    ("drive", Some("DETAILS.TXT")),
    ("SD card", None),
    ("UF2", Some("INFO_UF2.TXT")),
];

/// Returns the method of a board by which a folder takes the firmware, before anything is compiled.
pub fn method(board: &Board, folder: &Path) -> Result<FlashMethod> {
    let methods = release::flashing(board).into_iter();
    let mut by_drive = methods.filter_map(|method| {
        let known = DRIVES.iter().find(|(kind, _)| *kind == method.kind)?;
        Some((method, known.1))
    });
    let Some((method, mark)) = by_drive.next() else {
        bail!(
            "{} takes no file from a drive: docs/boards/{}.md has how it is flashed",
            board.title,
            board.name
        );
    };
    let name = folder.display();
    ensure!(
        folder.is_dir(),
        "{name} is no folder: connect the {} first",
        if method.kind == "SD card" {
            "card"
        } else {
            "drive"
        }
    );
    if let Some(mark) = mark {
        ensure!(
            folder.join(mark).is_file(),
            "{name} is not the drive of a {}: it has no {mark}",
            board.title
        );
    }
    Ok(method)
}

/// Copies a file into a folder, under its name, and returns when the drive has it.
pub fn copy(file: &Path, folder: &Path) -> Result<()> {
    let bytes = fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    let to = folder.join(file.file_name().context("the file has no name")?);
    let written = File::create(&to).and_then(|mut copy| {
        copy.write_all(&bytes)?;
        copy.sync_all()
    });
    written.with_context(|| format!("cannot write {}", to.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_not_the_boards_drive_is_refused_before_anything_is_built() {
        let folder = tempfile::tempdir().unwrap();
        let refusal = |name: &str, folder: &Path| {
            let board = crate::boards::named(name).unwrap();
            method(&board, folder).unwrap_err().to_string()
        };
        for (name, words) in [
            ("nucleo-f446re", "it has no DETAILS.TXT"),
            ("flexi-hal", "it has no INFO_UF2.TXT"),
            ("blackpill-f411", "takes no file from a drive"),
        ] {
            let error = refusal(name, folder.path());
            assert!(error.contains(words), "{error}");
        }
        let missing = folder.path().join("card");
        let error = refusal("btt-skr-2", &missing);
        assert!(
            error.ends_with("is no folder: connect the card first"),
            "{error}"
        );
    }

    #[test]
    fn the_file_of_the_board_is_copied_under_its_name() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("DETAILS.TXT"), "").unwrap();
        for (name, file) in [
            ("nucleo-f446re", "leadscrew.hex"),
            ("btt-skr-2", "firmware.bin"),
        ] {
            let board = crate::boards::named(name).unwrap();
            let method = method(&board, folder.path()).unwrap();
            assert_eq!(method.file, file);
            let built = tempfile::tempdir().unwrap();
            let built = built.path().join(&method.file);
            fs::write(&built, name).unwrap();
            copy(&built, folder.path()).unwrap();
            assert_eq!(fs::read(folder.path().join(file)).unwrap(), name.as_bytes());
            assert!(copy(&built, &folder.path().join("no")).is_err());
        }
    }
}
