//! `cargo xtask sim --usbip` and a USB host in pure Python: a job makes the steps that it makes without USB.

use std::{
    fs,
    io::{BufRead as _, BufReader, Read as _},
    path::Path,
    process::{Child, ChildStderr, Command, Stdio},
};

use anyhow::{Context, Result, bail, ensure};
use common::{cargo, check::Verdict, tools};
use rustix::process::{Pid, Signal};
use serde_json::Value;

use super::{INSTALLING, browser::run_output, install};

/// The host, and its job.
const SCRIPT: &str = "usbip_host.py";
const JOB: &str = "examples/plate.nc";
/// So fast that the job takes no longer than its feeds want.
const SETTINGS: [&str; 6] = [
    "$110=6000",
    "$111=6000",
    "$112=6000",
    "$120=500",
    "$121=500",
    "$122=500",
];
/// The dwell before the first motion: the look-ahead is full when it begins, however busy this computer is.
const DWELL: &str = "G4 P1\n";
/// What is compared: `docs/json.md`.
const FIGURES: [&str; 6] = [
    "lines",
    "responses",
    "final",
    "steps_axis",
    "events",
    "event_hash",
];

/// The simulator, until it is interrupted.
struct Server {
    process: Child,
    messages: BufReader<ChildStderr>,
    port: String,
}

impl Server {
    fn start(figures: &Path) -> Result<Self> {
        let mut command = simulator(figures)?;
        let mut process = command
            .args(["--usbip", "127.0.0.1:0"])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .context("cannot start the simulator")?;
        let messages = process.stderr.take().context("the simulator is mute")?;
        let mut server = Self {
            process,
            messages: BufReader::new(messages),
            port: String::new(),
        };
        let mut printed = String::new();
        while server.port.is_empty() {
            if server.messages.read_line(&mut printed)? == 0 {
                bail!("the simulator has ended: {}", printed.trim());
            }
            let address = printed.split_once("usbip://127.0.0.1:");
            let port = address.and_then(|(_, rest)| rest.split_whitespace().next());
            server.port = port.unwrap_or_default().into();
        }
        Ok(server)
    }

    /// Ends the simulator as Ctrl-C does. Returns its messages since it began to serve.
    fn end(mut self) -> Result<String> {
        self.interrupt();
        let mut printed = String::new();
        self.messages.read_to_string(&mut printed)?;
        let status = self.process.wait()?;
        ensure!(status.success(), "the simulator: {}", printed.trim());
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

/// The simulator with the settings of both runs, which writes its figures.
fn simulator(figures: &Path) -> Result<Command> {
    let mut command = tools::command(tools::SIM)?;
    command.args(SETTINGS.iter().flat_map(|setting| ["--set", setting]));
    command.arg("--json").arg(figures);
    Ok(command)
}

fn read(figures: &Path) -> Result<Value> {
    let text = fs::read_to_string(figures)?;
    serde_json::from_str(&text).with_context(|| format!("{} is no JSON", figures.display()))
}

/// The host streams the job, and attaches the device once more.
pub(super) fn host() -> Result<Verdict> {
    let installing = INSTALLING.lock();
    let python = install::python();
    drop(installing);
    let python = match python {
        Ok(python) => python,
        Err(reason) => return Ok(Verdict::Skipped(format!("{reason:#}"))),
    };
    let folder = install::folder().join("usbip-host");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder)?;
    let [job, with, without] = ["job.nc", "usb.json", "file.json"].map(|name| folder.join(name));
    let lines = fs::read_to_string(cargo::root().join(JOB))?;
    fs::write(&job, format!("{DWELL}{lines}"))?;
    let server = Server::start(&with)?;
    let mut script = Command::new(python);
    script.arg(install::scripts().join(SCRIPT));
    let printed = run_output(script.arg(&server.port).arg(&job))?;
    let messages = server.end()?;
    ensure!(!messages.contains("warning"), "{messages}");
    run_output(simulator(&without)?.arg(&job))?;
    let (with, without) = (read(&with)?, read(&without)?);
    for figure in FIGURES {
        ensure!(
            without[figure] == with[figure] && !with[figure].is_null(),
            "{figure}: {} by USB, {} without (see {})",
            with[figure],
            without[figure],
            folder.display()
        );
    }
    let hash = with["event_hash"].as_str().unwrap_or_default();
    let events = &with["events"];
    Ok(Verdict::Counted(format!(
        "{}, {events} step events, hash {hash} as without USB",
        printed.trim()
    )))
}
