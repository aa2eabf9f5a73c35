//! The checker of certificates, `proof/check.py`: Python, with two packages that pip installs.

use std::{path::Path, process::Command};

use anyhow::{Context as _, Result};
use common::{cargo, install};

/// The answer of the checker to a certificate of a program: the last line that the checker prints, as an error where
/// the certificate is refused.
///
/// # Errors
///
/// Where there is no Python, or the packages cannot be installed: [`install::Unavailable`].
pub fn confirm(elf: &Path, certificate: &Path) -> Result<Result<String, String>> {
    let home = cargo::target_dir().join("checker/python");
    let list = cargo::root().join("proof/check-requirements.txt");
    let python = install::python(&home, &list, "capstone and pyelftools")?;
    let mut command = Command::new(python);
    command.arg(cargo::root().join("proof/check.py"));
    let output = command.arg(elf).arg(certificate).output();
    let output = output.context("Python does not start")?;
    let text = if output.status.success() {
        &output.stdout
    } else {
        // A fault of the checker itself has another place, and confirms nothing.
        &[&output.stderr[..], &output.stdout].concat()
    };
    let text = String::from_utf8_lossy(text);
    let last = text.lines().last().unwrap_or_default().to_owned();
    Ok(if output.status.success() {
        Ok(last)
    } else {
        Err(last)
    })
}
