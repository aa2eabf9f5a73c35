//! `cargo xtask soak --faults`: faults of the firmware, inserted into a copy of the sources, which a soak of a minute
//! has to find.

use std::{
    fs,
    path::Path,
    process::{Command, ExitCode, Stdio},
    time::Instant,
};

use anyhow::{Context, Result, ensure};
use common::{cargo, ui};
use serde::Deserialize;

/// The table of faults.
const TABLE: &str = "tests/soak_faults.toml";

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

fn faults(root: &Path) -> Result<Vec<Fault>> {
    let text =
        fs::read_to_string(root.join(TABLE)).with_context(|| format!("cannot read {TABLE}"))?;
    Ok(toml::from_str::<Table>(&text)?.fault)
}

/// Looks for each fault.
pub(crate) fn run(seed: u64, seconds: u64) -> Result<ExitCode> {
    let root = cargo::root();
    let copy = root.join("target/inserted/sources");
    let mut missed = Vec::new();
    for fault in faults(root)? {
        copy_sources(root, &copy)?;
        let file = copy.join(&fault.file);
        fs::write(&file, fault.insert(&fs::read_to_string(&file)?)?)?;
        let mut build = cargo::cargo(&["build", "--profile", "checked", "-p", "soak"]);
        build
            .current_dir(&copy)
            .env("CARGO_TARGET_DIR", root.join("target/inserted"));
        let built = build.status()?;
        ensure!(built.success(), "{}: does not compile", fault.name);
        let start = Instant::now();
        let soak = Command::new(root.join("target/inserted/checked/soak"))
            .args([
                "--seed",
                &seed.to_string(),
                "--seconds",
                &seconds.to_string(),
            ])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()?;
        let elapsed = start.elapsed().as_secs_f32();
        if soak.success() {
            ui::status("Missed", &fault.name);
            missed.push(fault.name);
        } else {
            ui::status("Found", &format!("{}, in {elapsed:.1} s", fault.name));
        }
    }
    ensure!(missed.is_empty(), "not found: {}", missed.join(", "));
    Ok(ExitCode::SUCCESS)
}

/// Copies what Git knows of. A file that is the same keeps its time, so that it is not compiled again.
fn copy_sources(root: &Path, copy: &Path) -> Result<()> {
    let listed = Command::new("git")
        .arg("ls-files")
        .current_dir(root)
        .output()?;
    ensure!(
        listed.status.success(),
        "the sources are not in a repository of Git"
    );
    for name in String::from_utf8(listed.stdout)?.lines() {
        let (from, to) = (root.join(name), copy.join(name));
        let Ok(contents) = fs::read(&from) else {
            continue;
        };
        if fs::read(&to).is_ok_and(|old| old == contents) {
            continue;
        }
        fs::create_dir_all(to.parent().unwrap_or(copy))?;
        fs::write(to, contents)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_has_one_place_in_the_sources() {
        let root = cargo::root();
        let faults = faults(root).unwrap();
        assert!(faults.len() >= 7, "{faults:?}");
        for fault in &faults {
            let source = fs::read_to_string(root.join(&fault.file)).unwrap();
            assert_ne!(fault.insert(&source).unwrap(), source, "{}", fault.name);
            assert!(fault.insert("").is_err(), "{}", fault.name);
        }
    }
}
