//! Machines served by USB/IP and a USB host in pure Python: a job makes the same steps as without USB.

use std::{
    fs,
    io::{BufRead as _, BufReader, PipeReader, Read as _, pipe},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
};

use anyhow::{Context, Result, bail, ensure};
use common::{cargo, check::Verdict, tools};
use rustix::process::{Pid, Signal};
use serde_json::Value;

use super::{INSTALLING, browser::run_output, install, machine::BOARD};

/// The host, and its job.
const SCRIPT: &str = "usbip_host.py";
const JOB: &str = "examples/plate.nc";
/// Settings so fast that the job takes no longer than its feeds want, and a dwell before the first motion, by whose
/// end the look-ahead is full, however busy this computer is.
const BEFORE: &str = "$110=6000\n$111=6000\n$112=6000\n$120=500\n$121=500\n$122=500\nG4P1\n";
/// What is compared: `docs/json.md`.
const FIGURES: [&str; 6] = [
    "lines",
    "responses",
    "final",
    "steps_axis",
    "events",
    "event_hash",
];
/// What the device is named that the simulator serves.
const SIMULATOR: &str = "Leadscrew simulator";

/// What serves the device, until it is interrupted.
struct Server {
    process: Child,
    messages: BufReader<PipeReader>,
    port: String,
}

impl Server {
    fn start(mut command: Command) -> Result<Self> {
        let (messages, end) = pipe()?;
        let process = command
            .stdin(Stdio::null())
            .stdout(end.try_clone()?)
            .stderr(end)
            .spawn()
            .context("cannot start what serves the device")?;
        // It has the other end of the pipe.
        drop(command);
        let mut server = Self {
            process,
            messages: BufReader::new(messages),
            port: String::new(),
        };
        let mut printed = String::new();
        while server.port.is_empty() {
            if server.messages.read_line(&mut printed)? == 0 {
                bail!("it has ended: {}", printed.trim());
            }
            let address = printed.split_once("usbip://127.0.0.1:");
            let port = address.and_then(|(_, rest)| rest.split_whitespace().next());
            server.port = port.unwrap_or_default().into();
        }
        Ok(server)
    }

    /// Ends it as Ctrl-C does. Returns its messages since it began to serve.
    fn end(mut self) -> Result<String> {
        self.interrupt();
        let mut printed = String::new();
        self.messages.read_to_string(&mut printed)?;
        let status = self.process.wait()?;
        ensure!(status.success(), "the device: {}", printed.trim());
        Ok(printed)
    }

    fn interrupt(&self) {
        if let Some(id) = Pid::from_raw(self.process.id().cast_signed()) {
            let _ = rustix::process::kill_process(id, Signal::TERM);
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // It has a number of its own until it is waited for.
        if self.process.try_wait().is_ok_and(|ended| ended.is_none()) {
            self.interrupt();
            let _ = self.process.wait();
        }
    }
}

/// A host, and the files of its run.
struct Host {
    python: PathBuf,
    folder: PathBuf,
    job: PathBuf,
}

impl Host {
    /// # Errors
    /// Why there is none.
    fn new(at: &str) -> Result<Result<Self, Verdict>> {
        let installing = INSTALLING.lock();
        let python = install::python();
        drop(installing);
        let python = match python {
            Ok(python) => python,
            Err(reason) => return Ok(Err(Verdict::Skipped(format!("{reason:#}")))),
        };
        let folder = install::folder().join(format!("usbip-host-{at}"));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder)?;
        let job = folder.join("job.nc");
        let lines = fs::read_to_string(cargo::root().join(JOB))?;
        fs::write(&job, format!("{BEFORE}{lines}"))?;
        Ok(Ok(Self {
            python,
            folder,
            job,
        }))
    }

    /// Streams the job to a device of a name, and attaches the device once more. Returns what host and server say.
    fn stream(&self, command: Command, name: &str) -> Result<[String; 2]> {
        let server = Server::start(command)?;
        let mut script = Command::new(&self.python);
        script.arg(install::scripts().join(SCRIPT));
        let answers = run_output(script.arg(&server.port).arg(&self.job).arg(name))?;
        Ok([answers.trim().into(), server.end()?])
    }
}

fn read(figures: &Path) -> Result<Value> {
    let text = fs::read_to_string(figures)?;
    serde_json::from_str(&text).with_context(|| format!("{} is no JSON", figures.display()))
}

/// The host at the simulator.
pub(super) fn simulator() -> Result<Verdict> {
    let host = match Host::new("sim")? {
        Ok(host) => host,
        Err(verdict) => return Ok(verdict),
    };
    let [with, without] = ["usb.json", "file.json"].map(|name| host.folder.join(name));
    let mut command = tools::command(tools::SIM)?;
    command
        .args(["--usbip", "127.0.0.1:0", "--json"])
        .arg(&with);
    let [lines, messages] = host.stream(command, SIMULATOR)?;
    ensure!(!messages.contains("warning"), "{messages}");
    let mut command = tools::command(tools::SIM)?;
    run_output(command.arg(&host.job).arg("--json").arg(&without))?;
    let (with, without) = (read(&with)?, read(&without)?);
    for figure in FIGURES {
        ensure!(
            without[figure] == with[figure] && !with[figure].is_null(),
            "{figure}: {} by USB, {} without (see {})",
            with[figure],
            without[figure],
            host.folder.display()
        );
    }
    let hash = with["event_hash"].as_str().unwrap_or_default();
    let events = &with["events"];
    Ok(Verdict::Counted(format!(
        "{lines}, {events} step events, hash {hash} as without USB"
    )))
}

/// The host at the image of a board, as it is flashed, on its virtual chip.
pub(super) fn board() -> Result<Verdict> {
    let host = match Host::new("board")? {
        Ok(host) => host,
        Err(verdict) => return Ok(verdict),
    };
    let events = host.folder.join("events.csv");
    let board = firmware::boards::named(BOARD)?;
    let mut command = firmware::rehearsal::served(&board, "--usbip", "127.0.0.1:0")?;
    command.arg("--against").arg(&events);
    let mut trace = tools::command(tools::SIM)?;
    run_output(trace.arg(&host.job).arg("--trace").arg(&events))?;
    let [lines, messages] = host.stream(command, &board.title)?;
    let steps = messages.trim().lines().last().unwrap_or_default();
    Ok(Verdict::Counted(format!("{lines}, {steps}")))
}
