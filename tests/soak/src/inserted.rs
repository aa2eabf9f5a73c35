//! Faults that are inserted into a copy of the sources, one at a time, and who finds them: `cargo xtask soak --faults`,
//! `cargo xtask test --faults` and `cargo xtask rehearse --faults`.

mod by_checks;
mod by_rehearsal;
mod by_soak;
mod page;

use std::{
    fs,
    path::PathBuf,
    process::{Command, ExitStatus},
};

use anyhow::{Context, Result, bail, ensure};
use common::cargo;
use serde::Deserialize;

pub(crate) use self::{
    by_checks::run as by_checks, by_rehearsal::run as by_rehearsal, by_soak::run as by_soak,
};

#[derive(Debug, Deserialize)]
struct Table {
    fault: Vec<Fault>,
}

/// A text of a file, and what replaces it.
#[derive(Debug, Deserialize)]
struct Fault {
    name: String,
    file: String,
    old: String,
    new: String,
    /// The board that is rehearsed, and what its rehearsal must say.
    board: Option<String>,
    message: Option<String>,
}

impl Fault {
    /// The file with the fault.
    fn insert(&self, source: &str) -> Result<String> {
        let places = source.matches(&self.old).count();
        ensure!(
            places == 1,
            "{}: {} has the text {places} times",
            self.name,
            self.file
        );
        Ok(source.replace(&self.old, &self.new))
    }
}

/// Reads a table of faults.
fn faults(table: &str) -> Result<Vec<Fault>> {
    let text = fs::read_to_string(cargo::root().join(table))
        .with_context(|| format!("cannot read {table}"))?;
    let table: Table = toml::from_str(&text).with_context(|| format!("cannot read {table}"))?;
    Ok(table.fault)
}

/// A copy of the sources, with a target folder of its own, in which the next fault is compiled from what the last one
/// has left.
struct Sources {
    folder: PathBuf,
    target: PathBuf,
}

impl Sources {
    fn new() -> Self {
        let target = cargo::root().join("target/inserted");
        let folder = target.join("sources");
        // A copy of before may have files that are no longer in the project.
        let _ = fs::remove_dir_all(&folder);
        Self { folder, target }
    }

    /// Copies what Git does not ignore. An unchanged file keeps its time, so that it is not compiled again. The copy
    /// lies in the project, whose own configuration Cargo reads as well: arguments of the linker would come twice.
    fn restore(&self) -> Result<()> {
        let root = cargo::root();
        let listed = Command::new("git")
            .args(["ls-files", "--cached", "--others", "--exclude-standard"])
            .current_dir(root)
            .output()?;
        ensure!(
            listed.status.success(),
            "the sources are not in a repository of Git"
        );
        let names = String::from_utf8(listed.stdout)?;
        for name in names.lines().filter(|name| !name.starts_with(".cargo/")) {
            let (from, to) = (root.join(name), self.folder.join(name));
            let Ok(contents) = fs::read(&from) else {
                continue;
            };
            if fs::read(&to).is_ok_and(|old| old == contents) {
                continue;
            }
            fs::create_dir_all(to.parent().unwrap_or(&self.folder))?;
            fs::write(to, contents)?;
        }
        Ok(())
    }

    /// Makes the copy that of one fault.
    fn insert(&self, fault: &Fault) -> Result<()> {
        self.restore()?;
        let file = self.folder.join(&fault.file);
        fs::write(&file, fault.insert(&fs::read_to_string(&file)?)?)?;
        Ok(())
    }

    /// A Cargo command in the copy.
    fn cargo(&self, arguments: &[&str]) -> Command {
        let mut command = cargo::cargo(arguments);
        command
            .current_dir(&self.folder)
            .env("CARGO_TARGET_DIR", &self.target);
        command
    }

    /// Compiles the copy: a fault that the compiler finds is none.
    fn build(&self, arguments: &[&str]) -> Result<()> {
        let built = self.cargo(arguments).status()?;
        ensure!(built.success(), "`cargo {}` fails", arguments.join(" "));
        Ok(())
    }
}

/// Whether a tool has found a fault by its exit status. Anything but success and failure is neither: options that do not
/// exist, a panic, a signal.
fn is_found(status: ExitStatus) -> Result<bool> {
    match status.code() {
        Some(0) => Ok(false),
        Some(1) => Ok(true),
        _ => bail!("what looks for faults has failed itself ({status})"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_has_one_place_in_the_sources() {
        for (table, least) in [
            (by_soak::TABLE, 7),
            (by_checks::TABLE, 40),
            (by_rehearsal::TABLE, 17),
        ] {
            let faults = faults(table).unwrap();
            assert!(faults.len() >= least, "{table}");
            for fault in &faults {
                let source = fs::read_to_string(cargo::root().join(&fault.file)).unwrap();
                assert_ne!(fault.insert(&source).unwrap(), source, "{}", fault.name);
                assert!(fault.insert("").is_err(), "{}", fault.name);
            }
        }
    }

    #[cfg(unix)]
    #[test]
    fn only_a_failure_is_a_fault_that_is_found() {
        use std::os::unix::process::ExitStatusExt as _;
        // As `wait` gives them: the status in the second byte, a signal in the first.
        let of = |raw| is_found(ExitStatus::from_raw(raw)).ok();
        assert_eq!(of(0), Some(false));
        assert_eq!(of(1 << 8), Some(true));
        for other in [2 << 8, 101 << 8, 9] {
            assert_eq!(of(other), None);
        }
    }
}
