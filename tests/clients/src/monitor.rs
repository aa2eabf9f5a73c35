//! `cargo xtask monitor` between a sender and the machine, and its page in a browser.

use std::{
    io::{BufRead as _, BufReader, Read as _},
    path::{Path, PathBuf},
    process::{Child, ChildStderr, Command, Stdio},
};

use anyhow::{Context, Result, bail, ensure};
use common::{cargo, check::Verdict, tools};
use rustix::process::{Pid, Signal};

use super::browser;

/// What looks at the page of a path, and at that of a job.
const PATH_SCRIPT: &str = "monitor_page.js";
const JOB_SCRIPT: &str = "live_page.js";
/// What sends the page as much as ten minutes have.
const MEMORY_SCRIPT: &str = "monitor_memory.js";

/// A monitor that runs.
pub(super) struct Monitor {
    process: Child,
    messages: BufReader<ChildStderr>,
}

impl Monitor {
    /// Starts it, and waits until its page is there.
    fn start(command: &mut Command) -> Result<Self> {
        let mut process = command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .context("cannot start the monitor")?;
        let messages = process.stderr.take().context("the monitor is mute")?;
        let mut messages = BufReader::new(messages);
        let mut printed = String::new();
        while !printed.contains("http://") {
            if messages.read_line(&mut printed)? == 0 {
                bail!("the monitor has ended: {}", printed.trim());
            }
        }
        Ok(Self { process, messages })
    }

    /// Puts a monitor between a port and a new port; returns the path of the new port.
    pub(super) fn between(port: &Path, folder: &Path) -> Result<(Self, PathBuf)> {
        let link = folder.join("link");
        let mut command = tools::command(tools::MONITOR)?;
        command.arg("--port").arg(port).arg("--link").arg(&link);
        Ok((Self::start(&mut command)?, link))
    }

    /// Ends the monitor, and checks that it has had no error until then.
    pub(super) fn end(mut self) -> Result<()> {
        self.interrupt();
        let mut printed = String::new();
        self.messages.read_to_string(&mut printed)?;
        let status = self.process.wait()?;
        ensure!(status.success(), "the monitor: {}", printed.trim());
        Ok(())
    }

    fn interrupt(&self) {
        if let Some(id) = Pid::from_raw(self.process.id().cast_signed()) {
            let _ = rustix::process::kill_process(id, Signal::TERM);
        }
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        // It has a number of its own until it is waited for.
        if self.process.try_wait().is_ok_and(|ended| ended.is_none()) {
            self.interrupt();
            let _ = self.process.wait();
        }
    }
}

/// Looks at the page in the middle of a path and at its end.
pub(super) fn page() -> Result<Verdict> {
    check_page(PATH_SCRIPT, "pico")
}

/// Looks at the page of a job in several sizes, in its middle and at its end.
pub(super) fn live_page() -> Result<Verdict> {
    check_page(JOB_SCRIPT, "plate")
}

/// Has a script start the monitor and the simulator, and look at the page while an example is sent.
fn check_page(script: &str, example: &str) -> Result<Verdict> {
    let examples = cargo::root().join("examples");
    let settings = if example == "pico" { "pico" } else { "mill" };
    browser::run_script(script, &format!("monitor-{example}"), |_, node| {
        for tool in [tools::MONITOR, tools::SIM] {
            node.arg(tools::command(tool)?.get_program());
        }
        node.arg(examples.join(format!("{example}.nc")))
            .arg(examples.join(format!("{settings}.settings")));
        Ok(())
    })
}

/// Sends a page what ten minutes have, and looks at its memory.
pub(super) fn memory() -> Result<Verdict> {
    browser::run_script(MEMORY_SCRIPT, "monitor-memory", |_, node| {
        node.arg(tools::command(tools::MONITOR)?.get_program());
        Ok(())
    })
}
