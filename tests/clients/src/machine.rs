//! The machines that senders are tried at: the simulator in real time, the firmware under QEMU, and that of a virtual board.

use std::{
    fs,
    io::{BufRead as _, BufReader, Read as _, Write as _},
    net::TcpStream,
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
    /// The image of a board, as it is flashed, on its virtual chip.
    Board,
}

impl Place {
    /// The name in file names and arguments.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Simulator => "sim",
            Self::Firmware => "qemu",
            Self::Board => "board",
        }
    }

    /// The file of its settings.
    pub(super) fn settings(self) -> &'static str {
        match self {
            Self::Simulator | Self::Board => "sim.settings",
            Self::Firmware => "qemu.settings",
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
    Board { process: Child },
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
            Place::Board => board(file, overrides),
        }
    }

    /// Steps of each axis that the pins have made; simulator and virtual board do not tell.
    pub(super) fn steps(&mut self) -> Result<Option<Vec<i32>>> {
        match self {
            Self::Simulator { .. } | Self::Board { .. } => Ok(None),
            Self::Firmware { emulator } => Ok(Some(emulator.pins()?.steps)),
        }
    }

    /// Fails when the machine has ended by itself.
    pub(super) fn check(&mut self) -> Result<()> {
        if let Self::Simulator { process } | Self::Board { process } = self
            && let Some(status) = process.try_wait()?
        {
            bail!("the machine has ended ({status})");
        }
        Ok(())
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        if let Self::Simulator { process } | Self::Board { process } = self {
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

/// The board whose image senders are tried at.
pub(super) const BOARD: &str = "btt-skr-2";

fn board(file: &Path, overrides: &[String]) -> Result<(Machine, OwnedFd, Settings)> {
    let loaded = settings::load(Some(file), overrides)?;
    let board = firmware::boards::named(BOARD)?;
    let switches: Vec<_> = loaded
        .statements
        .iter()
        .map(|it| format!("${it}"))
        .collect();
    let mut command = firmware::rehearsal::served(&board, "--tcp", "127.0.0.1:0")?;
    command.args(["--switches", &switches.join(",")]);
    let command = command.stdin(Stdio::null()).stdout(Stdio::piped());
    let mut process = command.spawn().context("cannot start the virtual board")?;
    let output = process.stdout.take().context("it has no output")?;
    let machine = Machine::Board { process };
    let mut served = String::new();
    BufReader::new(output).read_line(&mut served)?;
    let (_, address) = served
        .trim_end()
        .rsplit_once(' ')
        .context("it is not served")?;
    let mut line = TcpStream::connect(address)?;
    line.set_read_timeout(Some(START_TIMEOUT))?;
    wait_for(&mut line, "Grbl ")?;
    for statement in &loaded.statements {
        line.write_all(format!("${statement}\n").as_bytes())?;
        wait_for(&mut line, "ok")?;
    }
    line.set_read_timeout(None)?;
    Ok((machine, line.into(), loaded.settings))
}

/// Reads up to the end of a line that begins with a text.
fn wait_for(line: &mut TcpStream, beginning: &str) -> Result<()> {
    let (mut received, mut byte) = (Vec::new(), [0]);
    loop {
        line.read_exact(&mut byte)
            .with_context(|| format!("{beginning:?} does not come"))?;
        if byte != *b"\n" {
            received.extend(byte);
            continue;
        }
        let text = String::from_utf8_lossy(&received);
        if text.starts_with(beginning) {
            return Ok(());
        }
        // A new board has no settings, as Grbl has it.
        let is_refused = text.starts_with("error:") && text.trim_end() != "error:7";
        ensure!(!is_refused, "the board answers {text}");
        received.clear();
    }
}
