//! A copy of the project that is changed, built and analysed.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, anyhow, ensure};
use common::cargo;
use firmware::boards::{Board, compile, seal};
use object::{Object, ObjectSegment};
use schedule::{Clock, Input, Report};

/// Entries at the top of the project that are not compiled.
const NOT_COPIED: [&str; 2] = ["target", ".git"];

/// Texts of files by the names of the files.
pub(crate) type Texts = BTreeMap<String, String>;

/// A copy of the project.
pub(crate) struct ProjectCopy<'a> {
    board: &'a Board,
    clock: Clock,
    pub(crate) folder: PathBuf,
    elf: PathBuf,
}

impl<'a> ProjectCopy<'a> {
    /// Copies the project to a place, where its firmware is built and proven.
    pub(crate) fn new(board: &'a Board, place: &Path) -> Result<Self> {
        cargo::need_target()?;
        let folder = place.join("source");
        let _ = fs::remove_dir_all(&folder);
        copy(cargo::root(), &folder)?;
        let new = Self {
            board,
            clock: crate::clock(board)?,
            folder,
            elf: place.join("changed.elf"),
        };
        ensure!(new.build()?, "the firmware cannot be built");
        let mut built_here = compile::read(&new.elf)?;
        seal::seal(&mut built_here)?;
        ensure!(
            flashed(&built_here)? == flashed(&compile::image(board, &[])?)?,
            "the firmware differs from the one built of the same sources in another folder"
        );
        ensure!(
            new.analyse()?.flaws.is_empty(),
            "the firmware is not proven"
        );
        Ok(new)
    }

    pub(crate) fn input(&self) -> Input<'_> {
        Input {
            elf: &self.elf,
            root: &self.folder,
            board: &self.board.name,
            features: &[],
            clock: self.clock,
            axes: cargo::axes(),
            step_rate_hz: None,
            baud: None,
            measured: None,
        }
    }

    pub(crate) fn analyse(&self) -> Result<Report> {
        schedule::analyse(&self.input()).map_err(|error| anyhow!("{error}"))
    }

    /// Has Cargo build the copy; whether it can be.
    pub(crate) fn build(&self) -> Result<bool> {
        let mut command = cargo::cargo(&["build", "--quiet", "--release", "--bin", "leadscrew"]);
        // A folder of its own: nobody is to flash a copy that lies where the firmware does.
        let target = self.elf.with_file_name("build");
        self.board.compile_into(&target, &mut command);
        let output = command.current_dir(&self.folder).output();
        if !output.context("cannot start Cargo")?.status.success() {
            return Ok(false);
        }
        let built = target.join(cargo::TARGET).join("release/leadscrew");
        fs::copy(built, &self.elf)?;
        Ok(true)
    }

    /// The text of a file: the new text, if there is one.
    pub(crate) fn text(&self, texts: &Texts, file: &str) -> Result<String> {
        match texts.get(file) {
            Some(text) => Ok(text.clone()),
            None => read(&self.folder.join(file)),
        }
    }

    /// Has something done with new texts of some files, which are as before afterwards.
    pub(crate) fn with<T>(&self, texts: &Texts, run: impl FnOnce() -> Result<T>) -> Result<T> {
        let mut before = Vec::new();
        for (file, text) in texts {
            let path = self.folder.join(file);
            before.push((read(&path)?, path.clone()));
            fs::write(path, text)?;
        }
        let result = run();
        for (text, path) in before {
            fs::write(path, text)?;
        }
        result
    }

    /// The flashed bytes of the program.
    pub(crate) fn code(&self) -> Result<Vec<u8>> {
        flashed(&compile::read(&self.elf)?)
    }
}

/// The flashed bytes of an ELF file.
fn flashed(elf: &[u8]) -> Result<Vec<u8>> {
    let file = object::File::parse(elf).context("no ELF file")?;
    let mut code = Vec::new();
    for segment in file.segments() {
        code.extend_from_slice(segment.data()?);
    }
    Ok(code)
}

/// Copies a folder of the project.
fn copy(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let (name, path) = (entry.file_name(), entry.path());
        // Cargo reads the settings of all folders above, and those of two would be added up.
        let is_below = name == ".cargo" && to.starts_with(cargo::root());
        let is_left = is_below || NOT_COPIED.iter().any(|not| name == *not);
        if is_left && from == cargo::root() {
            continue;
        }
        if path.is_dir() {
            copy(&path, &to.join(name))?;
        } else {
            fs::copy(&path, to.join(name))?;
        }
    }
    Ok(())
}

fn read(path: &Path) -> Result<String> {
    fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))
}
