//! Gets the senders from their registries, into the folder of build results.

use std::{env, fs, path::PathBuf, process::Command};

use anyhow::{Context, Result, ensure};
use common::{
    cargo,
    install::{self, is_noted, note, quietly},
    ui,
};

/// Oldest Node that cncjs runs with.
const NODE: u32 = 18;

/// The folder with all that is installed, and what the runs leave.
pub(super) fn folder() -> PathBuf {
    cargo::target_dir().join("clients")
}

/// The scripts that drive the senders.
pub(super) fn scripts() -> PathBuf {
    cargo::root().join("tests/clients")
}

/// A Python with the packages of `requirements.txt`.
pub(super) fn python() -> Result<PathBuf> {
    let (home, list) = (folder().join("python"), scripts().join("requirements.txt"));
    install::python(&home, &list, "grbl-streamer, bCNC, Printrun and others")
}

/// The same with Tk, which bCNC's modules import.
pub(super) fn python_with_tk() -> Result<PathBuf> {
    let python = python()?;
    quietly(Command::new(&python).args(["-c", "import tkinter"]))
        .context("Python has no Tk (Debian, Ubuntu: `sudo apt-get install python3-tk`)")?;
    Ok(python)
}

/// The folder of the packages of `package.json`.
pub(super) fn node() -> Result<PathBuf> {
    let version = Command::new("node").arg("--version").output();
    let version = version
        .ok()
        .map(|output| String::from_utf8_lossy(&output.stdout).into_owned());
    let number = version.as_deref().and_then(major);
    ensure!(
        number.is_some_and(|number| number >= NODE) && cargo::is_there("npm"),
        "Node {NODE} with npm is not installed (Debian, Ubuntu: `sudo apt-get install nodejs npm`)"
    );
    let home = folder().join("node");
    let lists = ["package.json", "package-lock.json"];
    let mut wanted = String::new();
    for list in lists {
        wanted += &fs::read_to_string(scripts().join(list))?;
    }
    if is_noted(&home, &wanted) {
        return Ok(home.join("node_modules"));
    }
    ui::status("Installing", "cncjs with npm");
    let _ = fs::remove_dir_all(&home);
    fs::create_dir_all(&home)?;
    for list in lists {
        fs::copy(scripts().join(list), home.join(list))?;
    }
    let mut npm = Command::new("npm");
    npm.args([
        "ci",
        "--omit=dev",
        "--ignore-scripts",
        "--no-audit",
        "--no-fund",
    ]);
    npm.arg("--loglevel=error").current_dir(&home);
    quietly(&mut npm).context("npm cannot install cncjs")?;
    note(&home, &wanted)?;
    Ok(home.join("node_modules"))
}

/// The browser for the page of cncjs.
pub(super) fn browser() -> Result<PathBuf> {
    let path = env::var_os("PATH").unwrap_or_default();
    let names = ["chromium", "google-chrome"];
    let folders = env::split_paths(&path);
    let mut places = folders.flat_map(|folder| names.map(|name| folder.join(name)));
    let found = places.find(|place| cargo::is_there(&place.to_string_lossy()));
    found.context("Chromium is not installed (Debian, Ubuntu: `sudo apt-get install chromium`)")
}

/// The first number of `v20.1.2`.
fn major(version: &str) -> Option<u32> {
    version
        .trim()
        .strip_prefix('v')?
        .split('.')
        .next()?
        .parse()
        .ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_number_of_a_version_is_read() {
        assert_eq!(major("v20.1.2\n"), Some(20));
        assert_eq!(major("20.1.2"), None);
    }
}
