//! A script that looks at a page in a browser, with a folder of its own.

use std::{
    fs,
    path::PathBuf,
    process::{Command, Stdio},
};

use anyhow::{Context, Result, ensure};
use common::check::Verdict;

use super::{INSTALLING, browser_and_modules, install};

/// What a script shows at its end.
const END: &str = "at 0,0,0";

/// Runs a script in an empty folder of a name; what it needs is made there, and its arguments are added, by `prepare`.
/// Skipped with the reason where there is no browser.
pub(super) fn run_script(
    script: &str,
    folder: &str,
    prepare: impl FnOnce(&PathBuf, &mut Command) -> Result<()>,
) -> Result<Verdict> {
    let installing = INSTALLING.lock();
    let node = browser_and_modules();
    drop(installing);
    let mut node = match node {
        Ok(node) => node,
        Err(reason) => return Ok(Verdict::Skipped(format!("{reason:#}"))),
    };
    let folder = install::folder().join(folder);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder)?;
    node.arg(install::scripts().join(script))
        .current_dir(&folder);
    prepare(&folder, &mut node)?;
    let run_output = run_output(&mut node).with_context(|| format!("see {}", folder.display()))?;
    ensure!(
        run_output.trim().ends_with(END),
        "the script comes to no end: {run_output}"
    );
    Ok(Verdict::Passed)
}

/// Runs a command, and returns what it prints.
pub(super) fn run_output(command: &mut Command) -> Result<String> {
    let output = command
        .stdin(Stdio::null())
        .output()
        .context("cannot start it")?;
    let failed = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{failed}");
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}
