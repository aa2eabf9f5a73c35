//! The machine that is watched: at a serial port, at a TCP address, or virtual.

use std::{
    fs,
    os::{fd::OwnedFd, unix::net::UnixStream},
    path::Path,
    process::{Child, Stdio},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail, ensure};
use common::tools;
use grbl_client::{Link, Machine, MachineAnswers, link::Stopped};
use rustix::{
    fs::{Mode, OFlags},
    process::{Pid, Signal},
};
use simulation::interrupt;
use tempfile::TempDir;

use crate::track::AXES;

/// How long a virtual machine may take to start.
const START: Duration = Duration::from_secs(30);
/// How long an address and a machine may take to answer: a board may start first.
const TIMEOUT: Duration = Duration::from_secs(5);
/// How often it is looked whether it has.
const POLL_INTERVAL: Duration = Duration::from_millis(5);

/// A line to a machine.
pub(crate) struct Source {
    pub(crate) link: Link,
    /// What ends with the line.
    pub(crate) simulator: Option<Simulator>,
}

/// A virtual machine, which ends when it is dropped.
pub(crate) struct Simulator {
    process: Child,
    folder: TempDir,
}

impl Source {
    /// Opens a serial port, or connects to a TCP address.
    pub(crate) fn open(port: Option<&Path>, baud: u32, address: Option<&str>) -> Result<Self> {
        Ok(Self {
            link: Link::open(port, baud, address, TIMEOUT)?,
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
            .env(interrupt::OWNED, "1")
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

/// Waits until a machine answers. Returns it, and its settings and modes where it is at rest: in motion it refuses to
/// tell them.
pub(crate) fn greet(link: Link, stop: &UnixStream) -> Result<(Machine, Vec<String>)> {
    let name = link.name.clone();
    let connected = Machine::connect(link, TIMEOUT, Some(stop));
    let mut machine = connected.map_err(|error| {
        if error.is::<Stopped>() {
            return error;
        }
        error.context(format!("{name} has not answered as Grbl does"))
    })?;
    let is_idle = machine.status.report.state == "Idle";
    let mut lines = Vec::new();
    if is_idle {
        for question in ["$$", "$G"] {
            lines.extend(machine.ask(question, TIMEOUT)?.lines);
        }
    }
    Ok((machine, lines))
}

/// Asks for everything that a job depends on. A machine that moves is asked for nothing: its job is taken for one
/// that has begun at the work zero of now.
pub(crate) fn answers(machine: &mut Machine) -> Result<MachineAnswers> {
    machine.report()?;
    if machine.status.report.state == "Idle" {
        return machine.answers();
    }
    let position = machine.status.machine_position();
    let axes = position.map_or(AXES, |position| position.len().max(AXES));
    let mut zero = machine.status.work_offset().unwrap_or_default().to_vec();
    zero.truncate(AXES);
    zero.resize(axes, 0.0);
    let text: Vec<_> = zero[..AXES].iter().map(|at| format!("{at:.4}")).collect();
    Ok(MachineAnswers {
        parameters: vec![format!("[G54:{}]", text.join(","))],
        position: zero,
        ..MachineAnswers::default()
    })
}

impl Simulator {
    /// Opens its terminal, as soon as there is one.
    fn line(&mut self) -> Result<OwnedFd> {
        let link = self.folder.path().join("machine");
        let start = Instant::now();
        while fs::symlink_metadata(&link).is_err() {
            if self.process.try_wait()?.is_some() {
                let printed = fs::read_to_string(self.folder.path().join("messages"));
                let printed = printed.unwrap_or_default();
                // Whoever shows it says once more that it is one.
                bail!("{}", printed.trim().trim_start_matches("error: "));
            }
            ensure!(start.elapsed() < START, "the simulator does not start");
            thread::sleep(POLL_INTERVAL);
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
