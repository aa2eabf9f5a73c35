//! The page of `cargo xtask view` in a browser.

use std::fs;

use anyhow::{Context, Result};
use common::{cargo, check::Verdict, tools};

use super::browser::{self, run_output};

/// What looks at the page.
const SCRIPT: &str = "view_page.js";

/// Makes the page, the step trace and the figures of an example, and has a browser look at the page. The example gets
/// two tools, and a work zero from which it goes 10 mm beyond the travel.
pub(super) fn page() -> Result<Verdict> {
    browser::run_script(SCRIPT, "view-page", |folder, node| {
        let examples = cargo::root().join("examples");
        let files = ["page.html", "trace.csv", "figures.json", "plate.nc"];
        let [page, trace, figures, job] = files.map(|name| folder.join(name));
        let program = fs::read_to_string(examples.join("plate.nc"))?
            .replace("G54\n", "G10 L2 P1 X-50 Y-45 Z-10\nG54\nT1 M6\n")
            .replace("(bore", "T2 M6\nM3 S9000\n(bore");
        fs::write(&job, program)?;
        for (tool, arguments) in [
            (tools::VIEW, &["--output".as_ref(), page.as_os_str()][..]),
            (
                tools::SIM,
                &[
                    "--trace".as_ref(),
                    trace.as_os_str(),
                    "--quality".as_ref(),
                    "--json".as_ref(),
                    figures.as_os_str(),
                ],
            ),
        ] {
            let mut command = tools::command(tool)?;
            command.arg(&job).arg("--settings");
            command.arg(examples.join("mill.settings")).args(arguments);
            run_output(&mut command).with_context(|| format!("{} fails", tool.name))?;
        }
        node.arg(page).arg(trace).arg(figures);
        Ok(())
    })
}
