//! `cargo xtask test --clients`: sender programs at the simulator, and some of them at the firmware.
//!
//! A script in `tests/clients` drives each sender and checks its results. A tap between the sender and the machine
//! accounts for the traffic, which must be right to the last byte: see [`grbl`] and [`reprap`].

mod account;
mod browser;
mod damage;
mod flashing;
mod grbl;
mod install;
mod machine;
mod monitor;
mod reprap;
mod tap;
mod usbip;
mod view;
mod web;

use std::{
    fs, mem,
    os::unix::process::CommandExt,
    path::{Path, PathBuf},
    process::{Child, Command, ExitCode, ExitStatus, Stdio},
    sync::Mutex,
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Error, Result, anyhow, bail, ensure};
use common::{
    check::{self, Check, Verdict},
    options::{self, Test, Verb},
    tools, ui,
};
use leadscrew::settings::Settings;
use rustix::process::{Pid, Signal};

use self::{
    account::Account,
    damage::Damage,
    grbl::Grbl,
    machine::{Dialects, Machine, Place},
    monitor::Monitor,
    reprap::RepRap,
    tap::Tap,
};

/// How long nothing may happen on the line: a guard for a sender that is stuck, no measure. Its script
/// finds a machine that is stuck before.
const TIMEOUT: Duration = Duration::from_mins(5);
/// Longest time for one sender's run: a guard against endless loops.
const RUN_TIMEOUT: Duration = Duration::from_mins(30);
/// Longest time for the last answers after the sender has ended.
const LAST_ANSWERS_TIMEOUT: Duration = Duration::from_mins(1);

/// How often it is looked what goes on.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// How many of these must find nothing owed: the last bytes may still be on their connection.
const QUIET_POLLS: u32 = 10;
/// What a script prints.
const SCRIPT_LOG: &str = "script.log";
/// How much of it is told when it fails.
const LAST_LINES: usize = 25;
/// How many of the last lines on the line are told then.
const LAST_PASSED: usize = 12;
/// One thing is installed at a time.
static INSTALLING: Mutex<()> = Mutex::new(());

/// A sender program.
#[derive(Debug, Clone, Copy)]
enum Sender {
    /// A client of our own that keeps exactly 128 bytes in flight.
    Raw,
    /// `cargo xtask send`.
    Ours,
    GrblStreamer,
    /// Gives up when it has had no answer for 30 s.
    PygrblStreamer,
    /// The same, and for 5 s when it switches the tool off.
    Gantrix,
    Bcnc,
    Cncjs,
    /// The page that cncjs serves, in a browser without a window.
    CncjsPage,
    /// The part of Printrun that sends, for RepRap machines.
    Printcore,
    /// A client of our own that keeps the rules by which OctoPrint sends.
    OctoPrintRules,
    /// The control page, in a browser without a window.
    ControlPage(web::PageConnection),
}

impl Sender {
    const ALL: [Self; 13] = [
        Self::Raw,
        Self::Ours,
        Self::GrblStreamer,
        Self::PygrblStreamer,
        Self::Gantrix,
        Self::Bcnc,
        Self::Cncjs,
        Self::CncjsPage,
        Self::Printcore,
        Self::OctoPrintRules,
        Self::ControlPage(web::PageConnection::Served),
        Self::ControlPage(web::PageConnection::Serial),
        Self::ControlPage(web::PageConnection::Socket),
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw client",
            Self::Ours => "cargo xtask send",
            Self::GrblStreamer => "grbl-streamer",
            Self::PygrblStreamer => "pygrbl-streamer",
            Self::Gantrix => "gantrix",
            Self::Bcnc => "bCNC",
            Self::Cncjs => "cncjs",
            Self::CncjsPage => "cncjs' page",
            Self::Printcore => "printcore",
            Self::OctoPrintRules => "OctoPrint's rules",
            Self::ControlPage(connection) => connection.name(),
        }
    }

    /// What is added to the name of its script in that of the folder of a run.
    fn variant(self) -> &'static str {
        match self {
            Self::ControlPage(connection) => connection.word(),
            _ => "",
        }
    }

    /// Whether the sender numbers its lines, and sends damaged lines again.
    fn is_for_reprap(self) -> bool {
        matches!(self, Self::Printcore | Self::OctoPrintRules)
    }

    /// Whether the sender is tried at a place. The simulator has the firmware's code for all that a sender can tell.
    /// Only the serial line and the tasks are the firmware's alone, and are the same for all senders: for them our own
    /// sender, and another for each dialect, are enough, in the emulator or at the virtual board.
    fn is_tried_at(self, place: Place) -> bool {
        match place {
            Place::Simulator => true,
            Place::Firmware => {
                matches!(
                    self,
                    Self::Ours | Self::Printcore | Self::ControlPage(web::PageConnection::Served)
                )
            }
            Place::Board => matches!(self, Self::Raw | Self::Cncjs),
        }
    }

    /// The dialects that the firmware needs for it.
    fn dialects(self) -> Dialects {
        if self.is_for_reprap() {
            Dialects::WithRepRap
        } else {
            Dialects::Grbl
        }
    }

    /// What it needs beside the settings of all.
    fn settings(self) -> Vec<String> {
        let dialect = self.is_for_reprap().then(|| "$780=1".into());
        dialect.into_iter().collect()
    }

    /// The script that drives the sender, and the program that runs the script.
    fn command(self) -> Result<(Command, &'static str)> {
        let (program, script) = match self {
            Self::Raw => (common::install::plain_python()?, "raw.py"),
            Self::GrblStreamer => (install::python()?, "grbl_streamer_jobs.py"),
            Self::PygrblStreamer => (install::python()?, "pygrbl_streamer_jobs.py"),
            Self::Gantrix => (install::python()?, "gantrix_jobs.py"),
            Self::Bcnc => (install::python_with_tk()?, "bcnc_jobs.py"),
            Self::Printcore => (install::python()?, "printcore_jobs.py"),
            Self::OctoPrintRules => (install::python()?, "octoprint_jobs.py"),
            Self::Ours => return Ok((with_our_sender()?, "send_jobs.py")),
            Self::Cncjs => return Ok((with_modules()?, "cncjs_jobs.js")),
            Self::CncjsPage => return Ok((browser_and_modules()?, "cncjs_page_jobs.js")),
            Self::ControlPage(connection) => {
                return Ok((web::with_page(connection)?, "control_jobs.js"));
            }
        };
        Ok((Command::new(program), script))
    }
}

/// Python, with the path of our own sender in its environment.
fn with_our_sender() -> Result<Command> {
    let mut python = Command::new(common::install::plain_python()?);
    python.env("SEND", tools::command(tools::SEND)?.get_program());
    Ok(python)
}

/// Node, which finds the packages of `package.json`.
fn with_modules() -> Result<Command> {
    let mut node = Command::new("node");
    node.env("NODE_PATH", install::node()?);
    Ok(node)
}

/// The same, with a browser in its environment.
fn browser_and_modules() -> Result<Command> {
    let browser = install::browser()?;
    let mut node = with_modules()?;
    node.env("CHROMIUM", browser);
    Ok(node)
}

/// What lies between a sender and its machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wire {
    Good,
    /// It damages lines.
    Bad,
    /// `cargo xtask monitor` passes everything on.
    Monitored,
}

impl Wire {
    /// What is added to the name of a check, and to that of its folder.
    fn name(self) -> &'static str {
        match self {
            Self::Good => "",
            Self::Bad => " on a bad line",
            Self::Monitored => " with a monitor",
        }
    }
}

/// From which lines are damaged.
const SEED: u64 = 7;

/// The checks that `--short` leaves out: they take long, and find what is seldom broken.
const LONG: [&str; 7] = [
    "the served control page at the firmware",
    "the control page by a serial port at the simulator",
    "the control page by a WebSocket at the simulator",
    "a key held while the control page goes",
    "axe-core at the control page",
    "a long job of a hidden control page",
    "the first picture of long jobs",
];

/// Checks at the same time: senders wait most of it.
const PARALLEL_CHECKS: usize = 4;

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::Test(Test {
            only,
            list,
            clients: true,
            short,
            ..
        }) => {
            let mut checks: Vec<_> = all().collect();
            if short {
                checks.retain(|check| !LONG.contains(&&*check.name));
                ui::status("Left out", &LONG.join(", "));
            }
            check::run(checks, only.as_deref(), list, PARALLEL_CHECKS)
        }
        other => other.refuse(),
    })
}

/// Every sender at its machines, and the pages.
fn all() -> impl Iterator<Item = Check> {
    let places = [
        (Place::Simulator, "simulator"),
        (Place::Firmware, "firmware"),
        (Place::Board, "virtual board"),
    ];
    let senders = places.into_iter().flat_map(|(place, at)| {
        let tried = Sender::ALL.into_iter();
        let tried = tried.filter(move |sender| sender.is_tried_at(place));
        let wires = tried.flat_map(move |sender| {
            let is_monitored = matches!(sender, Sender::Cncjs) && place == Place::Simulator;
            // The line's damage is the same at both.
            let has_bad = sender.is_for_reprap() && place == Place::Simulator;
            let bad = has_bad.then_some((sender, Wire::Bad));
            let monitored = is_monitored.then_some((sender, Wire::Monitored));
            [(sender, Wire::Good)]
                .into_iter()
                .chain(bad)
                .chain(monitored)
        });
        wires.map(move |(sender, wire)| {
            let name = format!("{} at the {at}{}", sender.name(), wire.name());
            Check::new(name, move || drive(sender, place, wire))
        })
    });
    senders.chain([
        Check::new("USB/IP host at the simulator", usbip::simulator),
        Check::new("USB/IP host at the virtual board", usbip::board),
        Check::new("the monitor's page", monitor::page),
        Check::new("the live page of a job", monitor::live_page),
        Check::new("the memory of the monitor's page", monitor::memory),
        Check::new("the page of a job", view::page),
        Check::new("jobs as WebAssembly", web::jobs),
        Check::new("the page that runs jobs", web::page),
        Check::new("the control page", web::control),
        Check::new("a key held while the control page goes", web::loss),
        Check::new("axe-core at the control page", web::axe),
        Check::new("a long job of a hidden control page", web::long_job),
        Check::new("the first picture of long jobs", web::first_picture),
        Check::new("the page that installs a release", flashing::page),
    ])
}

/// Drives one sender at one machine.
fn drive(sender: Sender, place: Place, wire: Wire) -> Result<Verdict> {
    let installing = INSTALLING.lock();
    let command = sender.command();
    drop(installing);
    let (mut command, script) = match command {
        Ok(found) => found,
        Err(reason) => return Ok(Verdict::Skipped(format!("{reason:#}"))),
    };
    let mut run = Run::start(Path::new(script), sender, place, wire)?;
    let mut port = run.folder.join("port");
    let mut monitor = None;
    if wire == Wire::Monitored {
        let (started, link) = Monitor::between(&port, &run.folder)?;
        (port, monitor) = (link, Some(started));
    }
    command.arg(install::scripts().join(script));
    command.arg(port).arg(place.name());
    let ended = run.sender(command);
    let ended = ended.map_err(|error| run.with_last_passed(&error));
    monitor.map_or(Ok(()), Monitor::end)?;
    let account = run.end()?;
    let end = ended.with_context(|| format!("see {}", run.folder.display()))?;
    ensure!(
        account.faults().is_empty(),
        "{}\n(see {})",
        account.faults().join("\n"),
        run.folder.join("wire.log").display()
    );
    run.check_end(&*account, end.as_deref())?;
    Ok(Verdict::Counted(account.summary()))
}

/// One sender at one machine.
struct Run {
    /// The folder of the log of the traffic and of the script's output.
    folder: PathBuf,
    settings: Settings,
    machine: Machine,
    tap: Tap,
    /// Steps that the pins had made more than was reported, after homing.
    offset: Option<Vec<i32>>,
}

impl Run {
    fn start(script: &Path, sender: Sender, place: Place, wire: Wire) -> Result<Self> {
        let stem = script.file_stem().unwrap_or_default().to_string_lossy();
        let name = format!("{stem} {}{}{}", place.name(), wire.name(), sender.variant());
        let folder = install::folder().join(name.replace(' ', "-"));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder)?;
        let file = install::scripts().join(place.settings());
        let dialects = sender.dialects();
        let (machine, line, settings) =
            Machine::start(place, dialects, &folder, &file, &sender.settings())?;
        let is_damaged = wire == Wire::Bad;
        let account: Box<dyn Account> = if sender.is_for_reprap() {
            Box::new(RepRap::new(is_damaged))
        } else {
            Box::<Grbl>::default()
        };
        let damage = is_damaged.then(|| Damage::new(SEED));
        let tap = Tap::open(&folder.join("port"), line, account, damage)?;
        Ok(Self {
            folder,
            settings,
            machine,
            tap,
            offset: None,
        })
    }

    /// Runs a script to its end, and gives the last line that it prints.
    fn sender(&mut self, mut command: Command) -> Result<Option<String>> {
        let home = self.folder.join("home");
        fs::create_dir_all(&home)?;
        let output = fs::File::create(self.folder.join(SCRIPT_LOG))?;
        let mut child = command
            // What senders keep of their users' settings stays here.
            .env("HOME", &home)
            .current_dir(&self.folder)
            .stdin(Stdio::null())
            .stdout(output.try_clone()?)
            .stderr(output)
            .process_group(0)
            .spawn()
            .context("cannot start the script")?;
        let status = self.wait(&mut child);
        // A server that the sender has started ends with the sender.
        if let Some(group) = Pid::from_raw(child.id().cast_signed()) {
            let _ = rustix::process::kill_process_group(group, Signal::KILL);
        }
        let _ = child.wait();
        let script_output = self.script_output();
        let status = status.with_context(|| script_output.clone())?;
        if !status.success() {
            let lines: Vec<_> = script_output.lines().collect();
            let last = lines.len().saturating_sub(LAST_LINES);
            bail!("{}", lines[last..].join("\n"));
        }
        Ok(script_output.lines().last().map(Into::into))
    }

    fn script_output(&self) -> String {
        let script_output = fs::read(self.folder.join(SCRIPT_LOG)).unwrap_or_default();
        String::from_utf8_lossy(&script_output).into_owned()
    }

    /// Adds to an error what passed on the line before it.
    fn with_last_passed(&self, error: &Error) -> Error {
        let last = self.tap.seen().last(LAST_PASSED).join("\n");
        anyhow!("{error:#}\nThe last lines on the line:\n{last}")
    }

    fn wait(&mut self, child: &mut Child) -> Result<ExitStatus> {
        let start = Instant::now();
        let (mut progress, mut went_on) = (String::new(), start);
        loop {
            if let Some(status) = child.try_wait()? {
                return Ok(status);
            }
            self.machine.check()?;
            if self.offset.is_none() && self.script_output().lines().any(|line| line == "homed") {
                self.measure()?;
            }
            let now = self.tap.seen().account.progress();
            if now != progress {
                (progress, went_on) = (now, Instant::now());
            }
            ensure!(
                went_on.elapsed() < TIMEOUT,
                "nothing goes on between sender and machine: {progress}"
            );
            ensure!(
                start.elapsed() < RUN_TIMEOUT,
                "the sender does not come to an end: {progress}"
            );
            thread::sleep(POLL_INTERVAL);
        }
    }

    /// Compares the pins with what is reported, while the script waits for it.
    fn measure(&mut self) -> Result<()> {
        let reported = self.steps(&self.reported()?);
        let made = self.machine.steps()?.unwrap_or_else(|| reported.clone());
        let offset = made
            .iter()
            .zip(&reported)
            .map(|(made, reported_mm)| made - reported_mm);
        self.offset = Some(offset.collect());
        fs::write(self.folder.join("measured"), "").context("cannot tell the script to go on")
    }

    fn reported(&self) -> Result<Vec<f64>> {
        let seen = self.tap.seen();
        seen.account.position().context("no report was seen")
    }

    /// A position in mm as steps.
    fn steps(&self, position_mm: &[f64]) -> Vec<i32> {
        let scales = self.settings.steps_per_mm.0.iter();
        let scaled = scales.zip(position_mm);
        let steps =
            scaled.map(|(scale, displacement)| scale.millionths() as f64 * 1e-6 * displacement);
        steps.map(|steps| steps.round() as i32).collect()
    }

    /// Closes the line when nothing is owed any more, and keeps what passed.
    fn end(&mut self) -> Result<Box<dyn Account>> {
        let start = Instant::now();
        let mut quiet = 0;
        while quiet < QUIET_POLLS && start.elapsed() < LAST_ANSWERS_TIMEOUT {
            thread::sleep(POLL_INTERVAL);
            let is_quiet = self.tap.seen().account.is_quiet();
            quiet = if is_quiet { quiet + 1 } else { 0 };
        }
        self.tap.close()?;
        let mut seen = self.tap.seen();
        seen.account.close();
        seen.write_log(&self.folder.join("wire.log"))?;
        let nothing: Box<dyn Account> = Box::<Grbl>::default();
        Ok(mem::replace(&mut seen.account, nothing))
    }

    /// Checks that the machine is where the script says.
    fn check_end(&mut self, account: &dyn Account, script_output: Option<&str>) -> Result<()> {
        let place = script_output.and_then(|line| line.strip_prefix("at "));
        let place = place.context("the script does not say where the machine is to be")?;
        let wanted: Result<Vec<f64>, _> = place.split(',').map(str::parse).collect();
        let wanted = wanted.context("the script does not say where the machine is to be")?;
        let reported = account.position().context("no report was seen")?;
        ensure!(
            reported == wanted,
            "the machine is at {reported:?} instead of {wanted:?}"
        );
        if let (Some(made), Some(offset)) = (self.machine.steps()?, &self.offset) {
            let reported_mm = self.steps(&wanted);
            let expected: Vec<_> = reported_mm
                .iter()
                .zip(offset)
                .map(|(reported_mm, more)| reported_mm + more)
                .collect();
            ensure!(
                made == expected,
                "the pins have made {made:?} steps instead of {expected:?}"
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_short_leaves_out_is_there() {
        let names: Vec<_> = all().map(|check| check.name).collect();
        for long in LONG {
            assert!(names.iter().any(|name| name == long), "{long}: {names:?}");
        }
    }
}
