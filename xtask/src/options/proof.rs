//! The proof, and what is measured beside it.

use super::files::{InputPath, OutputPath};

/// Prove from the machine code that every task meets its deadline
///
/// Builds the firmware, bounds the execution time of every task from the ELF file, and from that,
/// the priorities and `schedule.toml` its response time. Fails when a deadline can be missed, a
/// panic, recursion, an indirect call or an unbounded loop can be reached from a task with a
/// deadline, interrupts are off for too long anywhere, or the binary is not what the source says.
/// docs/scheduling.md explains the proof.
#[derive(Debug, clap::Args)]
pub struct Schedule {
    /// The board
    #[arg(long, value_name = "NAME", default_value = "netduino-plus-2")]
    pub board: String,
    /// Analyse this program instead of building the firmware
    #[arg(long, value_name = "FILE")]
    pub elf: Option<InputPath>,
    /// Step rate of the table: pulses of all axes together in a second; without it, the required
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(1..))]
    pub step_rate: Option<u32>,
    /// Baud rate of the table; without it, the firmware's
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub baud: Option<u32>,
    /// Write the report to a file, for programs
    #[arg(long, value_name = "OUT")]
    pub json: Option<OutputPath>,
    /// Write the certificate of the proof to a file, for `proof/check.py`
    #[arg(long, value_name = "OUT", conflicts_with_all = ["check", "verdict"])]
    pub certificate: Option<OutputPath>,
    /// Have the certificate of the proof checked by `proof/check.py`
    #[arg(long, conflicts_with_all = ["rate", "check"])]
    pub confirm: bool,
    /// Write the report as a page with pictures
    #[arg(long, value_name = "OUT")]
    pub html: Option<OutputPath>,
    /// Write the report that the documents show
    #[arg(long, conflicts_with_all = ["elf", "step_rate", "baud"])]
    pub write: bool,
    /// Fail when the report that the documents show is out of date
    #[arg(long, conflicts_with_all = ["elf", "step_rate", "baud", "write"])]
    pub check: bool,
    /// Run the firmware under a busy workload in QEMU, and compare with the proof what it executes
    #[arg(long, conflicts_with_all = ["write", "check"])]
    pub replay: bool,
    /// Put faults into copies of the firmware, and tell how many of them the proof finds
    #[arg(
        long,
        value_name = "N",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "60",
        conflicts_with_all = ["elf", "step_rate", "baud", "json", "html", "check", "replay"]
    )]
    pub mutants: Option<usize>,
    /// Where the faults go: which functions are drawn
    #[arg(long, value_name = "N", default_value = "1", requires = "mutants")]
    pub seed: u64,
    /// Take marks for the optimiser out of a copy of the firmware, and tell which of them a proven rate, the size of
    /// the image or the proof needs; of files whose names begin so. With --write, take the others out
    #[arg(
        long,
        value_name = "PREFIX",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "src/",
        conflicts_with_all = ["elf", "step_rate", "baud", "json", "html", "check", "replay", "mutants"]
    )]
    pub marks: Option<String>,
    /// Print the loops of tasks without a deadline that nothing counts, with what ends them, and the bounds that are
    /// believed
    #[arg(long, conflicts_with_all = ["write", "check", "replay", "mutants"])]
    pub loops: bool,
    /// Print the cycles of each class of instructions and accesses, and analyse nothing
    #[arg(long, conflicts_with_all = ["elf", "step_rate", "baud", "write", "check", "replay", "mutants"])]
    pub table: bool,
    /// Print the highest proven step rate and nothing else
    #[arg(long, hide = true, conflicts_with_all = ["table", "write", "check", "replay"])]
    pub rate: bool,
    /// Print the verdict and nothing else
    #[arg(long, hide = true, conflicts_with_all = ["table", "write", "check", "replay", "rate"])]
    pub verdict: bool,
}

/// Follow the firmware under a busy workload
#[derive(Debug, clap::Args)]
pub struct Replay {
    /// The firmware
    pub elf: InputPath,
    /// The board
    #[arg(long)]
    pub board: String,
    /// The step rate that it is proven for
    #[arg(long)]
    pub step_rate: u32,
    /// The baud rate
    #[arg(long)]
    pub baud: u32,
    /// Where to write what was found
    #[arg(long)]
    pub out: OutputPath,
}

/// Count what the firmware costs on the emulated chip, in instructions and modelled cycles
///
/// Streams five workloads to the firmware under QEMU: one axis at 100 kHz, three axes at 100, 73
/// and 51 kHz, short G1 lines, lines of 10 steps as in a raster, and lines that re-plan 100 blocks each.
/// `docs/benchmarks.md` says what is counted, and how far to trust it.
#[derive(Debug, clap::Args)]
pub struct Bench {
    /// Write the figures to a file
    #[arg(long, value_name = "FILE")]
    pub json: Option<OutputPath>,
    /// Write the figures that docs/benchmarks.md shows
    #[arg(long, conflicts_with = "elf")]
    pub write: bool,
    /// Print no figures, and fail when docs/benchmarks.md shows others
    #[arg(long, conflicts_with_all = ["elf", "json", "profile", "write"])]
    pub check: bool,
    /// Show where the cycles go: by task, function and source line
    #[arg(long)]
    pub profile: bool,
    /// Count another program instead: one that ends by semihosting
    #[arg(long, value_name = "FILE", conflicts_with = "json")]
    pub elf: Option<InputPath>,
    /// Arguments of that program
    #[arg(requires = "elf")]
    pub arguments: Vec<String>,
}

/// Measure how long tasks wait and take, beside the bounds that are proven
///
/// Without --board, on the emulated board, whose time base is its own: see docs/latency.md. On a
/// board, through a debug probe. The exit status is 1 when a maximum is above its bound.
#[derive(Debug, clap::Args)]
pub struct Latency {
    /// The program that is executed meanwhile; without it, one that keeps every task busy
    pub file: Option<InputPath>,
    /// The board to measure
    #[arg(long, value_name = "NAME", conflicts_with = "qemu")]
    pub board: Option<String>,
    /// Measure on the emulated board: the default
    #[arg(long)]
    pub qemu: bool,
    /// How long to measure, repeating the program; without it, a FILE is executed once
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub seconds: Option<u64>,
    /// The board's serial port, to send the program to; without it, you send one
    #[arg(long, value_name = "DEVICE", requires = "board")]
    pub port: Option<InputPath>,
    /// The probe, as `VID:PID` or `VID:PID:SERIAL`, where there is more than one
    #[arg(long, value_name = "PROBE", requires = "board")]
    pub probe: Option<String>,
    /// Change a setting before, as '$110=5000'; repeatable
    #[arg(long, value_name = "$N=VALUE")]
    pub set: Vec<String>,
    /// Print JSON instead of tables
    #[arg(long)]
    pub json: bool,
    /// Draw the histograms
    #[arg(long, value_name = "OUT.svg")]
    pub plot: Option<OutputPath>,
}

/// Measure on a board what the timing analysis takes for granted
///
/// Writes a program to the board that runs each class of the analysis' cycle table on the
/// processor's cycle counter: instructions, buses, flash, exceptions. Prints what was measured beside
/// the table, and writes `calibration/BOARD.toml`: `cargo xtask schedule` and `build` raise the
/// table to it, and name it. The firmware must be written again afterwards. docs/calibration.md
/// tells more.
#[derive(Debug, clap::Args)]
pub struct Calibrate {
    /// The board
    #[arg(long, value_name = "NAME")]
    pub board: String,
    /// The probe, as `VID:PID` or `VID:PID:SERIAL`, where there is more than one
    #[arg(long, value_name = "PROBE")]
    pub probe: Option<String>,
    /// Only see whether the program runs, under QEMU, which has no cycle counter
    #[arg(long, conflicts_with = "probe")]
    pub qemu: bool,
}

/// Look whether a board is what the firmware counts on
///
/// Writes a program to the board that says which chip it is, times the step timer, exchanges bytes over
/// the serial port that `--port` names, and makes faults, each of which resets the chip. Take every wire
/// off the board that could switch or move something: spindle, coolant and laser are switched on, for up to
/// 0.3 s if a fault is not noticed. While bytes come over the serial port, it erases and programs the last
/// sector of the flash that holds no settings. Writes a report, `bring-up/BOARD-NUMBER.json`, and a page beside it. The firmware must be
/// written again afterwards. docs/bring-up.md tells more.
#[derive(Debug, clap::Args)]
pub struct BringUp {
    /// The board
    #[arg(long, value_name = "NAME", required_unless_present = "verify")]
    pub board: Option<String>,
    /// The probe, as `VID:PID` or `VID:PID:SERIAL`, where there is more than one
    #[arg(long, value_name = "PROBE")]
    pub probe: Option<String>,
    /// The serial port of the board; without it, what needs it stays open
    #[arg(long, value_name = "DEVICE")]
    pub port: Option<InputPath>,
    /// What the emulator can show, under QEMU; the report is in `target/bring-up`
    #[arg(long, conflicts_with_all = ["probe", "port"])]
    pub qemu: bool,
    /// What a virtual board can show; the report is in `target/bring-up`
    #[arg(long = "virtual", conflicts_with_all = ["probe", "port", "qemu"])]
    pub virtual_board: bool,
    /// Instead, see whether a report is as it was written
    #[arg(long, value_name = "REPORT.json", conflicts_with_all = ["board", "probe", "port", "qemu", "virtual_board"])]
    pub verify: Option<InputPath>,
}
