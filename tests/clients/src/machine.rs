//! The machines that senders are tried at: the simulator in real time, and the firmware under QEMU.

use std::{
    fs,
    os::fd::OwnedFd,
    path::{Path, PathBuf},
    process::{Child, Stdio},
    sync::{Mutex, PoisonError},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail, ensure};
use common::{cargo, tools};
use firmware::boards::Board;
use leadscrew::settings::{Settings, StepRate};
use rustix::{
    fs::{Mode, OFlags},
    process::{Pid, Signal},
};
use simulation::{machine::SwitchPositions, settings};
use target::emulator::Emulator;

/// How long a machine may take to start.
const START_TIMEOUT: Duration = Duration::from_mins(3);

/// Where a sender's machine runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// `cargo xtask sim --pty`.
    Simulator,
    /// The firmware, on the emulated board.
    Firmware,
}

impl Place {
    /// The name in file names and arguments.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Simulator => "sim",
            Self::Firmware => "qemu",
        }
    }
}

/// The dialects that a firmware has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Dialects {
    /// Grbl's alone.
    Grbl,
    /// That of hosts of 3D printers, too.
    WithRepRap,
}

/// A running machine.
pub(super) enum Machine {
    Simulator { process: Child },
    Firmware { emulator: Box<Emulator> },
}

impl Machine {
    /// Starts a machine with the settings of a file and with overrides. Also returns its serial line and its settings.
    pub(super) fn start(
        place: Place,
        dialects: Dialects,
        folder: &Path,
        file: &Path,
        overrides: &[String],
    ) -> Result<(Self, OwnedFd, Settings)> {
        match place {
            Place::Simulator => {
                let loaded = settings::load(Some(file), overrides)?;
                let (machine, line) = simulator(folder, file, overrides)?;
                Ok((machine, line, loaded.settings))
            }
            Place::Firmware => firmware(dialects, file, overrides),
        }
    }

    /// Steps of each axis that the pins have made; the simulator does not tell.
    pub(super) fn steps(&mut self) -> Result<Option<Vec<i32>>> {
        match self {
            Self::Simulator { .. } => Ok(None),
            Self::Firmware { emulator } => Ok(Some(emulator.pins()?.steps)),
        }
    }

    /// Fails when the machine has ended by itself.
    pub(super) fn check(&mut self) -> Result<()> {
        if let Self::Simulator { process } = self
            && let Some(status) = process.try_wait()?
        {
            bail!("the simulator has ended ({status})");
        }
        Ok(())
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        if let Self::Simulator { process } = self {
            // As Ctrl-C would: it takes its link away.
            if let Some(id) = Pid::from_raw(process.id().cast_signed()) {
                let _ = rustix::process::kill_process(id, Signal::TERM);
            }
            let _ = process.wait();
        }
    }
}

fn simulator(folder: &Path, settings: &Path, overrides: &[String]) -> Result<(Machine, OwnedFd)> {
    let link: PathBuf = folder.join("machine");
    let messages = fs::File::create(folder.join("machine.log"))?;
    let mut process = tools::command(tools::SIM)?
        .args(["--switches", "--pty"])
        .arg(&link)
        .arg("--settings")
        .arg(settings)
        .args(overrides.iter().flat_map(|setting| ["--set", setting]))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(messages)
        .spawn()
        .context("cannot start the simulator")?;
    let start = Instant::now();
    while fs::symlink_metadata(&link).is_err() {
        if let Some(status) = process.try_wait()? {
            bail!("the simulator has ended ({status})");
        }
        ensure!(
            start.elapsed() < START_TIMEOUT,
            "the simulator does not start"
        );
        thread::sleep(Duration::from_millis(5));
    }
    let machine = Machine::Simulator { process };
    let line = rustix::fs::open(&link, OFlags::RDWR | OFlags::NOCTTY, Mode::empty());
    Ok((
        machine,
        line.context("cannot open the simulator's terminal")?,
    ))
}

/// The firmware with these dialects, which is built once for all senders.
fn built(board: &Board, dialects: Dialects) -> Result<PathBuf> {
    static BUILT: Mutex<[Option<PathBuf>; 2]> = Mutex::new([None, None]);
    let mut built = BUILT.lock().unwrap_or_else(PoisonError::into_inner);
    let place = &mut built[usize::from(dialects == Dialects::WithRepRap)];
    if let Some(elf) = place {
        return Ok(elf.clone());
    }
    let elf = match dialects {
        Dialects::Grbl => firmware::firmware(board)?,
        Dialects::WithRepRap => firmware::for_hosts(board)?,
    };
    Ok(place.insert(elf).clone())
}

fn firmware(
    dialects: Dialects,
    file: &Path,
    overrides: &[String],
) -> Result<(Machine, OwnedFd, Settings)> {
    cargo::need_qemu()?;
    let (board, machine) = firmware::boards::emulated()?;
    let elf = built(&board, dialects)?;
    let step_rate = firmware::image::read(&elf).map(StepRate::of_image)?;
    let loaded = settings::load_for(step_rate, Some(file), overrides)?;
    let mut emulator = Emulator::start(&elf, &machine)?;
    emulator.wait_for_welcome(START_TIMEOUT)?;
    for statement in &loaded.statements {
        emulator.set(statement, START_TIMEOUT)?;
    }
    emulator.mount(&SwitchPositions::of(&loaded.settings))?;
    let line = emulator.line()?;
    let emulator = Box::new(emulator);
    Ok((Machine::Firmware { emulator }, line, loaded.settings))
}
