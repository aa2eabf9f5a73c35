//! Files that options name, told apart by what becomes of them.

use std::{
    ffi::OsString,
    fs::{self, Metadata},
    ops::Deref,
    os::unix::fs::MetadataExt as _,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use clap::ArgMatches;

/// Something that is read: a file, a folder, a serial port; `-` is standard input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputPath(PathBuf);

/// A file that is written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputPath(PathBuf);

impl InputPath {
    /// Whether it is `-`.
    pub fn is_standard_input(&self) -> bool {
        *self.0 == *Path::new("-")
    }
}

impl From<OsString> for InputPath {
    fn from(path: OsString) -> Self {
        Self(path.into())
    }
}

impl From<OsString> for OutputPath {
    fn from(path: OsString) -> Self {
        Self(path.into())
    }
}

impl Deref for InputPath {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

impl Deref for OutputPath {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

impl AsRef<Path> for InputPath {
    fn as_ref(&self) -> &Path {
        &self.0
    }
}

impl AsRef<Path> for OutputPath {
    fn as_ref(&self) -> &Path {
        &self.0
    }
}

/// Makes sure that everything a command reads is there, but what it waits for, and that it writes over nothing of that.
///
/// # Errors
///
/// The same sentence for whatever cannot be opened: a program, settings, a port.
pub(super) fn check(matches: &ArgMatches, waits_for: Option<&str>) -> Result<()> {
    let ids = || matches.ids().map(clap::Id::as_str);
    let read = ids().filter(|id| Some(*id) != waits_for);
    let read = read.filter_map(|id| matches.try_get_many::<InputPath>(id).ok().flatten());
    let written = ids().filter_map(|id| matches.try_get_many::<OutputPath>(id).ok().flatten());
    let written = written
        .flatten()
        .filter_map(|path| fs::metadata(&**path).ok());
    let written: Vec<_> = written.map(|file| identity(&file)).collect();
    for path in read.flatten().filter(|path| !path.is_standard_input()) {
        let file = fs::metadata(&**path);
        let file = file.with_context(|| format!("cannot open {}", path.display()))?;
        ensure!(
            !file.is_file() || !written.contains(&identity(&file)),
            "{} would be written over: it is what is read",
            path.display()
        );
    }
    Ok(())
}

/// What a file is, under whatever name.
fn identity(file: &Metadata) -> (u64, u64) {
    (file.dev(), file.ino())
}
