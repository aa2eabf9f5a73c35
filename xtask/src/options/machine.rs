//! Programs on the virtual machine, on the emulated chip, and on a machine.

use std::{path::PathBuf, str::FromStr, time::Duration};

use super::files::{InputPath, OutputPath};
use crate::BAUD;

/// Run a G-code program on the virtual machine
///
/// The machine is the firmware's own code on a virtual clock, so a program runs as fast as the
/// computer goes and gives the same step edges every time. It is streamed as senders do, to a
/// machine that is unlocked as after homing. The exit status is 1 when a line was refused or an
/// alarm rose.
///
/// With --pty, --tcp or --usbip the same machine runs in real time, for any sender to connect to.
#[derive(Debug, clap::Parser)]
#[command(group = clap::ArgGroup::new("what").required(true).args(["file", "pty", "tcp", "usbip", "session"]))]
pub struct Sim {
    /// The program; `-` is standard input
    pub file: Option<InputPath>,
    /// Change a setting, as '$110=5000'; repeatable
    #[arg(long, value_name = "$N=VALUE")]
    pub set: Vec<String>,
    /// Speak the RepRap dialect: '$780=1', and each line with its number and checksum
    #[arg(long, conflicts_with_all = ["on_target", "session"])]
    pub reprap: bool,
    /// Read settings from a file of $n=value lines
    #[arg(long, value_name = "FILE")]
    pub settings: Option<InputPath>,
    /// Read the tool table from a file of LinuxCNC, in mm: a line like 'T1 P1 Z10.16 D3.048' for each
    /// tool. Tools of the machine that are not in it stay
    #[arg(long, value_name = "FILE", conflicts_with_all = ["on_target", "session"])]
    pub tool_table: Option<InputPath>,
    /// Write every step event: time in ns from the first step, steps of each axis after it
    #[arg(long, value_name = "OUT.csv", conflicts_with_all = ["on_target", "session"])]
    pub trace: Option<OutputPath>,
    /// Write which coils are energised whenever that changes, if motors are driven by phases: time in ns from
    /// power-up, IN1 to IN4 of each axis
    #[arg(
        long,
        value_name = "OUT.csv",
        requires = "file",
        conflicts_with = "on_target"
    )]
    pub coils: Option<OutputPath>,
    /// Draw the tool path, with the holes of canned cycles and the contour of cutter compensation, and
    /// speed and acceleration over time
    #[arg(long, value_name = "OUT.svg", conflicts_with_all = ["on_target", "session"])]
    pub plot: Option<OutputPath>,
    /// Measure how good the motion is: step times, jumps, accelerations and jerks, the distance from
    /// the programmed path, the speed in its corners; --plot then draws jerk and distance as well, and
    /// --json has the figures under the key `quality`
    #[arg(long, requires = "file", conflicts_with = "on_target")]
    pub quality: bool,
    /// Write answers, messages and figures
    #[arg(long, value_name = "OUT.json", conflicts_with = "session")]
    pub json: Option<OutputPath>,
    /// Run the virtual machine on the emulated chip instead of this computer
    #[arg(long, requires = "file")]
    pub on_target: bool,
    /// Serve the machine in real time at a new serial device, until Ctrl-C
    #[arg(long, value_name = "PATH")]
    pub pty: Option<PathBuf>,
    /// Serve the machine in real time at a TCP address such as 127.0.0.1:2323, until Ctrl-C
    #[arg(long, value_name = "ADDR:PORT")]
    pub tcp: Option<String>,
    /// Serve the machine in real time as a USB device to hosts that speak USB/IP, such as Linux, at a TCP address such
    /// as 127.0.0.1:3240, until Ctrl-C
    #[arg(long, value_name = "ADDR:PORT")]
    pub usbip: Option<String>,
    /// Give the machine limit switches at the ends of its travel, in whose middle it stands, and a
    /// probe plate 10 mm above the low end of Z with a block on it, which is an eighth of the travel from the
    /// low ends of X and Y, a quarter wide, and a tenth high
    #[arg(long, conflicts_with_all = ["on_target", "session"])]
    pub switches: bool,
    /// Give X, Y or Z a second motor with a limit switch of its own, so far ahead of the first one: 'Y=3' is a
    /// gantry that is skewed by 3 mm. Homing squares it, and where both motors stand is printed; repeatable
    #[arg(
        long,
        value_name = "AXIS=MM",
        requires = "switches",
        conflicts_with_all = ["on_target", "session", "pty", "tcp", "usbip"]
    )]
    pub second: Vec<SecondMotor>,
    /// Begin the program locked where homing is on ($22=1), as a machine is at power-up
    #[arg(long, requires = "file", conflicts_with = "on_target")]
    pub locked: bool,
    /// Keep what is stored in this file, as the machine's flash does; a new file is a new machine.
    /// Settings that are given beside it are stored there
    #[arg(long, value_name = "FILE", conflicts_with_all = ["on_target", "session"])]
    pub flash: Option<PathBuf>,
    /// Replay recorded exchanges in virtual time
    #[arg(long, value_name = "IN.json", requires = "out", conflicts_with_all = ["set", "settings"])]
    pub session: Option<InputPath>,
    /// Where to write what was received
    #[arg(long, value_name = "OUT.json", requires = "session")]
    pub out: Option<OutputPath>,
}

/// Run a G-code program on the virtual machine on the emulated chip
///
/// What `sim --on-target` hands on to.
#[derive(Debug, clap::Args)]
pub struct SimOnTarget {
    /// The program
    pub file: InputPath,
    /// Change a setting, as '$110=5000'; repeatable
    #[arg(long, value_name = "$N=VALUE")]
    pub set: Vec<String>,
    /// Write answers, messages and figures
    #[arg(long, value_name = "OUT.json")]
    pub json: Option<OutputPath>,
}

/// Run a G-code program on the firmware itself, on the emulated board
///
/// Builds the firmware, boots it under QEMU, streams the program over its serial line as senders
/// do, and reads what the pins did. Answers, final steps and steps per axis are those of `sim`. How
/// far the firmware could look ahead depends on when the bytes arrive, so the event hash and the
/// motion time may differ. The exit status is 1 when a line was refused or an alarm rose.
#[derive(Debug, clap::Args)]
pub struct Qemu {
    /// The program
    pub file: InputPath,
    /// Change a setting before, as '$110=5000'; repeatable
    #[arg(long, value_name = "$N=VALUE")]
    pub set: Vec<String>,
    /// Read settings from a file of $n=value lines
    #[arg(long, value_name = "FILE")]
    pub settings: Option<InputPath>,
    /// Write answers, messages and figures
    #[arg(long, value_name = "OUT.json")]
    pub json: Option<OutputPath>,
    /// Run this firmware instead of building it
    #[arg(long, value_name = "FILE")]
    pub elf: Option<InputPath>,
}

/// The line to a machine.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("where").required(true).args(["port", "tcp"]))]
pub struct Connection {
    /// The serial port of the machine, such as /dev/ttyACM0
    #[arg(long, value_name = "DEVICE")]
    pub port: Option<InputPath>,
    /// The TCP address of the machine, such as 127.0.0.1:2323
    #[arg(long, value_name = "ADDR:PORT")]
    pub tcp: Option<String>,
    /// The baud rate of the serial port
    #[arg(long, value_name = "BAUD", default_value_t = BAUD, requires = "port")]
    pub baud: u32,
    /// How long to wait for an answer, s
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = seconds)]
    pub timeout: Duration,
}

/// Send a G-code program to a machine
///
/// The machine is a board at a serial port, or the simulator. The job is run on the virtual machine first,
/// with the machine's own settings and offsets: a job that would be refused or end in an alarm is not begun,
/// and the time that is left is known. How far the job is, is kept in FILE.resume until it is done. The exit
/// status is 1 when the job does not come to its end, or a line was refused.
///
/// Keys: h hold, r resume, q stop, t type lines (in a change of the tool), + - 0 feed, f m l rapids, s S spindle, c coolant; Ctrl-C holds, and stops
/// a job that is held. Where standard input is at its end, nobody can press a key: a program pause or a
/// change of the tool then ends the job.
#[derive(Debug, clap::Args)]
pub struct Send {
    /// The program
    pub file: InputPath,
    /// Where the machine is.
    #[command(flatten)]
    pub connection: Connection,
    /// Home the machine first
    #[arg(long)]
    pub home: bool,
    /// Continue the job that was interrupted, where it is certain that all before has been carried out
    #[arg(long, conflicts_with = "from")]
    pub resume: bool,
    /// Continue at a line, counted from 1, or at one before it where that is within a contour or a cycle
    #[arg(long, value_name = "LINE", value_parser = clap::value_parser!(u64).range(1..))]
    pub from: Option<u64>,
    /// Wait for the machine where it has gone or is not there yet, and continue a job that has begun
    #[arg(long)]
    pub wait: bool,
    /// The machine is where it says, with the right tool: do not ask before a job is continued
    #[arg(long)]
    pub confirmed: bool,
    /// Send a program of which lines are refused
    #[arg(long)]
    pub despite_refusals: bool,
    /// How long the spindle gets before the tool goes down where a job is continued, s
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = seconds)]
    pub spin_up: Duration,
    /// The highest feed at which it goes down, mm/min
    #[arg(long, value_name = "MM_MIN", default_value_t = 200.0, value_parser = feed)]
    pub plunge: f32,
}

/// Save the settings of a machine, compare them with a file, or load them
///
/// The machine is a board at a serial port, or the simulator. A file is any list of settings as a machine
/// has printed it. --load sends only what differs, one setting at a time, and reads all of it back. The
/// exit status is 1 when something differs (--diff) or is refused.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("what").required(true).args(["load", "save", "diff"]))]
pub struct Settings {
    /// Where the machine is.
    #[command(flatten)]
    pub connection: Connection,
    /// Change the machine's settings to those in a file
    #[arg(long, value_name = "FILE")]
    pub load: Option<InputPath>,
    /// Write the machine's settings to a file
    #[arg(long, value_name = "FILE")]
    pub save: Option<OutputPath>,
    /// List where a file and the machine differ
    #[arg(long, value_name = "FILE")]
    pub diff: Option<InputPath>,
}

/// A second motor of an axis, with a switch of its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SecondMotor {
    /// Its axis, 0 = X, 1 = Y, 2 = Z.
    pub axis: usize,
    /// How far it is ahead of the first one at power-up, mm.
    pub ahead_mm: f64,
}

impl FromStr for SecondMotor {
    type Err = String;

    /// Reads `Y=3`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (letter, ahead) = text.split_once('=').unwrap_or((text, "0"));
        let axis = ["X", "Y", "Z"]
            .iter()
            .position(|of| of.eq_ignore_ascii_case(letter));
        let axis = axis.ok_or("X, Y or Z may have a second motor")?;
        let ahead_mm = ahead.parse().ok().filter(|mm: &f64| mm.is_finite());
        let ahead_mm = ahead_mm.ok_or_else(|| format!("{ahead} is no number of mm"))?;
        Ok(Self { axis, ahead_mm })
    }
}

/// Reads a time that can be waited for.
fn seconds(text: &str) -> Result<Duration, String> {
    match text.parse() {
        Ok(seconds) if (0.1..=600.0).contains(&seconds) => Ok(Duration::from_secs_f64(seconds)),
        _ => Err("0.1 to 600 seconds are possible".into()),
    }
}

/// Reads a feed.
fn feed(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(feed) if (1.0..=100_000.0).contains(&feed) => Ok(feed),
        _ => Err("1 to 100000 mm/min are possible".into()),
    }
}
