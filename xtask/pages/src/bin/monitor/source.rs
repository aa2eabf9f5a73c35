//! The machine that is watched: at a serial port, at a TCP address, or virtual.

use std::{
    fs,
    os::fd::{AsFd, BorrowedFd, OwnedFd},
    path::Path,
    process::{Child, Stdio},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail, ensure};
use common::tools;
use rustix::{
    fs::{Mode, OFlags},
    io::Errno,
    process::{Pid, Signal},
};
use tempfile::TempDir;

/// How long a virtual machine may take to start, and an address to answer.
const START: Duration = Duration::from_secs(30);
const CONNECT: Duration = Duration::from_secs(5);
/// How often it is looked whether it has.
const GLANCE: Duration = Duration::from_millis(5);

/// A line to a machine, which never makes this program wait.
pub(crate) struct Source {
    line: OwnedFd,
    /// The port or the address, as the user has named it.
    pub(crate) name: String,
    /// What may be wrong where nothing answers.
    pub(crate) hint: String,
    /// What ends with the line.
    simulator: Option<Simulator>,
}

/// A virtual machine, which ends with this program.
struct Simulator {
    process: Child,
    folder: TempDir,
}

impl Source {
    /// Opens a serial port, which no other program may have open.
    pub(crate) fn serial(path: &Path, baud: u32) -> Result<Self> {
        let port = grbl_client::port::serial(path, baud)?;
        Self::new(
            &port,
            path.display().to_string(),
            grbl_client::port::serial_hint(baud),
        )
    }

    /// Connects to a TCP address.
    pub(crate) fn tcp(address: &str) -> Result<Self> {
        let stream = grbl_client::port::tcp(address, CONNECT)?;
        Self::new(&stream, address.into(), grbl_client::port::TCP_HINT.into())
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
        let mut source = Self::new(&line, "the simulator".into(), "has it ended?".into())?;
        source.simulator = Some(simulator);
        Ok(source)
    }

    fn new(line: &impl AsFd, name: String, hint: String) -> Result<Self> {
        let own = || {
            // The lock of a port is that of its description, which both share.
            let line = line.as_fd().try_clone_to_owned()?;
            let flags = rustix::fs::fcntl_getfl(&line)?;
            rustix::fs::fcntl_setfl(&line, flags | OFlags::NONBLOCK)?;
            std::io::Result::Ok(line)
        };
        Ok(Self {
            line: own().with_context(|| format!("cannot use {name}"))?,
            name,
            hint,
            simulator: None,
        })
    }

    /// The line, to wait for.
    pub(crate) fn line(&self) -> BorrowedFd<'_> {
        self.line.as_fd()
    }

    /// Reads what has come.
    pub(crate) fn read(&self, chunk: &mut [u8]) -> Result<usize> {
        match rustix::io::read(&self.line, chunk) {
            Ok(0) => bail!("{} has gone: the connection has ended", self.name),
            Ok(length) => Ok(length),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(error) => Err(error).with_context(|| format!("{} has gone", self.name)),
        }
    }

    /// Writes what there is room for, and takes it away.
    pub(crate) fn write(&self, waiting: &mut Vec<u8>) -> Result<()> {
        match rustix::io::write(&self.line, waiting) {
            Ok(length) => drop(waiting.drain(..length)),
            Err(Errno::AGAIN | Errno::INTR) => {}
            Err(error) => return Err(error).with_context(|| format!("{} has gone", self.name)),
        }
        Ok(())
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
