//! The page of `cargo xtask view` in a browser.

use std::{
    fs,
    process::{Command, Stdio},
};

use anyhow::{Context, Result, ensure};
use common::{cargo, check::Verdict, tools};

use super::{INSTALLING, browser_and_modules, install};

/// What looks at the page, and shows at its end.
const SCRIPT: &str = "view_page.js";
const END: &str = "at 0,0,0";

/// Makes the page and the step trace of an example, and has a browser look at the page.
pub(super) fn page() -> Result<Verdict> {
    let installing = INSTALLING.lock();
    let node = browser_and_modules();
    drop(installing);
    let mut node = match node {
        Ok(node) => node,
        Err(reason) => return Ok(Verdict::Skipped(format!("{reason:#}"))),
    };
    let folder = install::folder().join("view-page");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder)?;
    let examples = cargo::root().join("examples");
    let [page, trace] = ["page.html", "trace.csv"].map(|name| folder.join(name));
    for (tool, option, file) in [
        (tools::VIEW, "--output", &page),
        (tools::SIM, "--trace", &trace),
    ] {
        let mut command = tools::command(tool)?;
        command.arg(examples.join("plate.nc")).arg("--settings");
        command
            .arg(examples.join("mill.settings"))
            .arg(option)
            .arg(file);
        said(&mut command).with_context(|| format!("{} fails", tool.name))?;
    }
    node.arg(install::scripts().join(SCRIPT))
        .arg(page)
        .arg(trace);
    let said =
        said(node.current_dir(&folder)).with_context(|| format!("see {}", folder.display()))?;
    ensure!(
        said.trim().ends_with(END),
        "the script comes to no end: {said}"
    );
    Ok(Verdict::Passed)
}

/// Runs a command, and returns what it prints.
pub(super) fn said(command: &mut Command) -> Result<String> {
    let output = command.stdin(Stdio::null()).output()?;
    let failed = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{failed}");
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}
