//! The page of `cargo xtask view` in a browser.

use anyhow::{Context, Result};
use common::{cargo, check::Verdict, tools};

use super::browser::{self, run_output};

/// What looks at the page.
const SCRIPT: &str = "view_page.js";

/// Makes the page and the step trace of an example, and has a browser look at the page.
pub(super) fn page() -> Result<Verdict> {
    browser::run_script(SCRIPT, "view-page", |folder, node| {
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
            run_output(&mut command).with_context(|| format!("{} fails", tool.name))?;
        }
        node.arg(page).arg(trace);
        Ok(())
    })
}
