//! Programs of others beside tests: an environment of Python, filled by pip, in the folder of build results.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use anyhow::{Context, Result, bail, ensure};

use crate::{cargo, ui};

/// The system's Python, for what needs no package.
pub fn plain_python() -> Result<PathBuf> {
    ensure!(
        cargo::is_there("python3"),
        "python3 is not installed (Debian, Ubuntu: `sudo apt-get install python3`)"
    );
    Ok("python3".into())
}

/// A Python in the folder `home` with the packages of a list, which the user is told as `what`.
pub fn python(home: &Path, list: &Path, what: &str) -> Result<PathBuf> {
    let system = plain_python()?;
    let program = home.join("bin/python");
    let wanted = fs::read_to_string(list)?;
    if is_noted(home, &wanted) && cargo::is_there(&program.to_string_lossy()) {
        return Ok(program);
    }
    ui::status("Installing", &format!("{what} with pip"));
    let _ = fs::remove_dir_all(home);
    fs::create_dir_all(home.parent().unwrap_or(home))?;
    quietly(Command::new(system).args(["-m", "venv"]).arg(home)).context(
        "Python cannot make an environment (Debian, Ubuntu: `sudo apt-get install python3-venv`)",
    )?;
    // The list is whole: what it does not name is not used.
    let mut pip = Command::new(&program);
    pip.args([
        "-m",
        "pip",
        "install",
        "--no-deps",
        "--disable-pip-version-check",
    ]);
    quietly(pip.arg("--requirement").arg(list))
        .with_context(|| format!("pip cannot install {what}"))?;
    note(home, &wanted)?;
    Ok(program)
}

/// Whether all that is wanted has been installed.
pub fn is_noted(home: &Path, wanted: &str) -> bool {
    fs::read_to_string(home.join("installed")).is_ok_and(|installed| installed == wanted)
}

/// Notes that all that is wanted has been installed.
pub fn note(home: &Path, wanted: &str) -> Result<()> {
    fs::write(home.join("installed"), wanted).context("cannot take note of the installation")
}

/// Runs a command to its end; what it says is told only when it fails.
pub fn quietly(command: &mut Command) -> Result<()> {
    let output = command.stdin(Stdio::null()).output()?;
    if output.status.success() {
        return Ok(());
    }
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said);
    let last: Vec<_> = said.lines().rev().take(5).collect();
    let last: Vec<_> = last.into_iter().rev().collect();
    bail!("{}", last.join("\n"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_noted_is_installed_until_something_else_is_wanted() {
        let home = tempfile::tempdir().unwrap();
        assert!(!is_noted(home.path(), "unicorn==2"));
        note(home.path(), "unicorn==2").unwrap();
        assert!(is_noted(home.path(), "unicorn==2"));
        assert!(!is_noted(home.path(), "unicorn==3"));
    }

    #[test]
    fn a_command_that_fails_is_told_with_its_last_words() {
        assert!(quietly(Command::new("sh").args(["-c", "echo fine"])).is_ok());
        let mut broken = Command::new("sh");
        broken.args(["-c", "for i in 1 2 3 4 5 6; do echo $i; done; exit 1"]);
        let error = quietly(&mut broken).unwrap_err();
        assert_eq!(error.to_string(), "2\n3\n4\n5\n6");
    }
}
