//! The machine that is watched: at a serial port, at a TCP address, or virtual.

use std::{
    fs,
    os::fd::OwnedFd,
    path::Path,
    process::{Child, Stdio},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail, ensure};
use common::tools;
use grbl_client::Link;
use rustix::{
    fs::{Mode, OFlags},
    process::{Pid, Signal},
};
use tempfile::TempDir;

/// How long a virtual machine may take to start, and an address to answer.
const START: Duration = Duration::from_secs(30);
const CONNECT: Duration = Duration::from_secs(5);
/// How often it is looked whether it has.
const GLANCE: Duration = Duration::from_millis(5);

/// A line to a machine.
pub(crate) struct Source {
    pub(crate) link: Link,
    /// What ends with the line.
    #[expect(dead_code, reason = "it is ended when it is dropped")]
    simulator: Option<Simulator>,
}

/// A virtual machine, which ends with this program.
struct Simulator {
    process: Child,
    folder: TempDir,
}

impl Source {
    /// Opens a serial port, or connects to a TCP address.
    pub(crate) fn open(port: Option<&Path>, baud: u32, address: Option<&str>) -> Result<Self> {
        Ok(Self {
            link: Link::open(port, baud, address, CONNECT)?,
            simulator: None,
        })
    }

    /// Starts the simulator with settings, in real time.
    pub(crate) fn simulated(settings: Option<&Path>, set: &[String]) -> Result<Self> {
        let folder = tempfile::tempdir().context("there is no room for a terminal")?;
        let mut command = tools::command(tools::SIM)?;
        command.arg("--pty").arg(folder.path().join("machine"));
        if let Some(settings) = settings {
            command.arg("--settings").arg(settings);
        }
        let process = command
            .args(set.iter().flat_map(|setting| ["--set", setting]))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(fs::File::create(folder.path().join("messages"))?)
            .spawn()
            .context("cannot start the simulator")?;
        let mut simulator = Simulator { process, folder };
        let line = simulator.line()?;
        Ok(Self {
            link: Link::over(&line, "the simulator".into(), "has it ended?".into())?,
            simulator: Some(simulator),
        })
    }
}

impl Simulator {
    /// Opens its terminal, as soon as there is one.
    fn line(&mut self) -> Result<OwnedFd> {
        let link = self.folder.path().join("machine");
        let start = Instant::now();
        while fs::symlink_metadata(&link).is_err() {
            if self.process.try_wait()?.is_some() {
                let said = fs::read_to_string(self.folder.path().join("messages"));
                let said = said.unwrap_or_default();
                // Whoever shows it says once more that it is one.
                bail!("{}", said.trim().trim_start_matches("error: "));
            }
            ensure!(start.elapsed() < START, "the simulator does not start");
            thread::sleep(GLANCE);
        }
        let line = rustix::fs::open(&link, OFlags::RDWR | OFlags::NOCTTY, Mode::empty());
        line.context("cannot open the simulator's terminal")
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        // As Ctrl-C would: it takes its link away.
        if let Some(id) = Pid::from_raw(self.process.id().cast_signed()) {
            let _ = rustix::process::kill_process(id, Signal::TERM);
        }
        let _ = self.process.wait();
    }
}
