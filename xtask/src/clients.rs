//! `cargo xtask test --clients`: sender programs at the simulator and at the firmware.
//!
//! Each sender is driven by a script in `tests/clients`, which says what it does and checks what the
//! sender makes of it. Between the sender and the machine sits a tap, and whatever the script checks,
//! the account of what passed must be right to the last byte: see [`account`].

mod account;
mod install;
mod machine;
mod tap;

use std::{
    fs,
    os::unix::process::CommandExt,
    path::Path,
    process::{Child, Command, ExitStatus, Stdio},
    sync::Mutex,
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail, ensure};
use rustix::process::{Pid, Signal};

use self::{
    account::{Account, Counts},
    machine::{Machine, Place},
    tap::Tap,
};
use crate::{settings, test::Verdict};

/// Longest time for one sender's run: a guard, no measure.
const PATIENCE: Duration = Duration::from_secs(150);
/// Longest time for the last answers after the sender has ended.
const REST: Duration = Duration::from_secs(5);

/// One thing is installed at a time.
static INSTALLING: Mutex<()> = Mutex::new(());

/// A sender program.
#[derive(Debug, Clone, Copy)]
enum Sender {
    /// A client of our own that keeps exactly 128 bytes in flight.
    Raw,
    GrblStreamer,
    Bcnc,
    Cncjs,
}

impl Sender {
    const ALL: [Self; 4] = [Self::Raw, Self::GrblStreamer, Self::Bcnc, Self::Cncjs];

    fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw client",
            Self::GrblStreamer => "grbl-streamer",
            Self::Bcnc => "bCNC",
            Self::Cncjs => "cncjs",
        }
    }

    /// The script that drives it, and the program that runs the script.
    fn command(self) -> Result<(Command, &'static str)> {
        let (program, script) = match self {
            Self::Raw => (install::plain_python()?, "raw.py"),
            Self::GrblStreamer => (install::python()?, "grbl_streamer_jobs.py"),
            Self::Bcnc => (install::python_with_tk()?, "bcnc_jobs.py"),
            Self::Cncjs => {
                let mut node = Command::new("node");
                node.env("NODE_PATH", install::node()?);
                return Ok((node, "cncjs_jobs.js"));
            }
        };
        Ok((Command::new(program), script))
    }
}

/// Every sender at every machine: names and what to run.
pub(crate) fn all() -> impl Iterator<Item = (String, impl Fn() -> Result<Verdict> + Send)> {
    let places = [
        (Place::Simulator, "simulator"),
        (Place::Firmware, "firmware"),
    ];
    places.into_iter().flat_map(|(place, at)| {
        Sender::ALL.map(|sender| {
            let name = format!("{} at the {at}", sender.name());
            (name, move || drive(sender, place))
        })
    })
}

/// Drives one sender at one machine.
fn drive(sender: Sender, place: Place) -> Result<Verdict> {
    let installing = INSTALLING.lock();
    let command = sender.command();
    drop(installing);
    let (mut command, script) = match command {
        Ok(found) => found,
        Err(reason) => return Ok(Verdict::Skipped(format!("{reason:#}"))),
    };
    let stem = Path::new(script)
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy();
    let folder = install::folder().join(format!("{stem}-{}", place.name()));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder)?;
    let settings = install::scripts().join(format!("{}.settings", place.name()));
    let (mut machine, line) = Machine::start(place, &folder, &settings)?;
    let port = folder.join("port");
    let mut tap = Tap::open(&port, line)?;
    command
        .arg(install::scripts().join(script))
        .arg(&port)
        .arg(place.name());
    let ended = run(command, &folder, &mut machine);
    // The machine may have bytes on the line still.
    let start = Instant::now();
    while !tap.seen().account.is_quiet() && start.elapsed() < REST {
        thread::sleep(Duration::from_millis(20));
    }
    let steps = machine.steps()?;
    tap.close()?;
    drop(machine);
    let mut seen = tap.seen();
    seen.account.close();
    seen.write_log(&folder.join("wire.log"))?;
    let end = ended?;
    verdict(
        &seen.account,
        end.as_deref(),
        steps.as_deref(),
        &folder,
        &settings,
    )
}

/// Runs a script to its end, and gives the last line that it prints: where the machine must be.
fn run(mut command: Command, folder: &Path, machine: &mut Machine) -> Result<Option<String>> {
    let home = folder.join("home");
    fs::create_dir_all(&home)?;
    let said = folder.join("script.log");
    let output = fs::File::create(&said)?;
    let mut child = command
        // What senders keep of their users' settings stays here.
        .env("HOME", &home)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(output.try_clone()?)
        .stderr(output)
        .process_group(0)
        .spawn()
        .context("cannot start the script")?;
    let status = wait(&mut child, machine);
    // A server that it has started goes with it.
    if let Some(group) = Pid::from_raw(child.id().cast_signed()) {
        let _ = rustix::process::kill_process_group(group, Signal::KILL);
    }
    let _ = child.wait();
    let text = fs::read_to_string(&said).unwrap_or_default();
    let status = status.with_context(|| text.clone())?;
    if !status.success() {
        let last: Vec<_> = text.lines().rev().take(15).collect();
        let last: Vec<_> = last.into_iter().rev().collect();
        bail!("{}\n(see {})", last.join("\n"), folder.display());
    }
    Ok(text.lines().last().map(Into::into))
}

fn wait(child: &mut Child, machine: &mut Machine) -> Result<ExitStatus> {
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        machine.check()?;
        ensure!(
            start.elapsed() < PATIENCE,
            "the sender does not come to an end"
        );
        thread::sleep(Duration::from_millis(20));
    }
}

/// What is to be said of a run whose script is content.
fn verdict(
    account: &Account,
    end: Option<&str>,
    steps: Option<&[i32]>,
    folder: &Path,
    settings: &Path,
) -> Result<Verdict> {
    ensure!(
        account.faults.is_empty(),
        "{}\n(see {})",
        account.faults.join("\n"),
        folder.join("wire.log").display()
    );
    let end = end.and_then(|line| line.strip_prefix("at "));
    let end = end.context("the script does not say where the machine is to be")?;
    let wanted: Result<Vec<f64>, _> = end.split(',').map(str::parse).collect();
    let wanted = wanted.context("the script does not say where the machine is to be")?;
    let reported = account.position().context("no report was seen")?;
    ensure!(
        reported == wanted,
        "the machine is at {reported:?} instead of {wanted:?}"
    );
    if let Some(steps) = steps {
        let scale = settings::load(Some(settings), &[])?.settings.steps_per_mm;
        let scale = scale.0.iter().map(|scale| scale.millionths() as f64 * 1e-6);
        let made: Vec<f64> = steps
            .iter()
            .zip(scale)
            .map(|(steps, scale)| f64::from(*steps) / scale)
            .collect();
        ensure!(
            made == wanted,
            "the pins have gone to {made:?} instead of {wanted:?}"
        );
    }
    Ok(Verdict::Counted(summary(&account.counts)))
}

fn summary(counts: &Counts) -> String {
    format!(
        "{} lines, {} answers, {} voided by {} resets, {} `?`, {} reports, {} other realtime bytes, \
         at most {} bytes in flight",
        counts.lines,
        counts.answers,
        counts.voided,
        counts.resets,
        counts.queries,
        counts.reports,
        counts.realtime,
        counts.most_in_flight
    )
}
