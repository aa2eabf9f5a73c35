//! Tests.

use super::files::{InputPath, OutputPath};

/// Let anything happen to the virtual machine, and look whether it does what it must
///
/// Lines of all codes, realtime bytes, contacts, damaged bytes, breaks, settings that are stored, and losses of
/// power come at random times. Every pulse has its width and its distance, no axis is faster than it may be or
/// leaves its travel, spindle, laser and coolant are on where they may and off where they must, a break holds what
/// runs, each line is answered once and in known words, each `?` in time, a sender always knows the work offset, the
/// machine is where it believes to be, and what was stored before power was lost is there afterwards.
#[derive(Debug, clap::Args)]
pub struct Soak {
    /// The seed of the first history; each one after it has the next
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    pub seed: u64,
    /// How long, s
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    pub seconds: u64,
    /// Instead, until the machines have run for so many hours
    #[arg(long, value_name = "HOURS", conflicts_with = "seconds")]
    pub machine_hours: Option<f64>,
    /// Instead, a number of histories
    #[arg(long, value_name = "COUNT", conflicts_with_all = ["seconds", "machine_hours"])]
    pub histories: Option<u64>,
    /// Instead, a day of work of one machine, in which nothing is refused
    #[arg(long, conflicts_with_all = ["seconds", "machine_hours", "histories"])]
    pub day: bool,
    /// Insert the faults of `tests/soak_faults.toml` into copies of the sources, and look whether each is found
    #[arg(long, conflicts_with_all = ["machine_hours", "histories", "day"])]
    pub faults: bool,
}

/// Give the library inputs that nobody sends, and look whether any makes it panic
///
/// Each target begins with the inputs of its corpus (tests/soak/corpus), and goes on with what becomes of them
/// when bits, bytes, numbers and pieces are changed.
#[derive(Debug, clap::Args)]
pub struct Fuzz {
    /// The target: bytes, lines, statements, hosts, sessions or flash; every one without a name
    pub target: Option<String>,
    /// How many inputs each target gets
    #[arg(long, value_name = "COUNT", default_value_t = 20_000)]
    pub inputs: u64,
    /// The seed of what is changed
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    pub seed: u64,
}

/// Replay what Grbl was recorded to do, and compare
///
/// Without DIR, short programs of tests/conformance/ are replayed, with what Grbl answers to each line.
/// DIR holds recordings: programs that were executed (golden/CATEGORY/NAME.grbl.json), programs in
/// check mode line by line (golden/CATEGORY/NAME.check.csv), single lines
/// (suites/) and sessions with times (suites/). Answers,
/// messages, reports, positions, modes, outputs and times are compared. Deliberate deviations are
/// named and counted; any other difference is printed and makes the exit status 1.
#[derive(Debug, clap::Args)]
pub struct Conformance {
    /// The recorded data; without it, the answers of Grbl in tests/conformance/
    pub dir: Option<InputPath>,
    /// Only this category: a folder of golden/, 'check', `error_cases` or 'transcripts', or a file of
    /// tests/conformance/; repeatable
    #[arg(long, value_name = "NAME")]
    pub category: Vec<String>,
    /// Write every comparison as JSON
    #[arg(long, value_name = "OUT")]
    pub json: Option<OutputPath>,
    /// Print every difference, also those that are by design
    #[arg(long)]
    pub all: bool,
    /// Print docs/conformance.md
    #[arg(long, hide = true)]
    pub document: bool,
}

/// Check something for `cargo xtask test`
#[derive(Debug, clap::Args)]
pub struct Check {
    /// What is checked
    pub what: Subject,
}

/// What can be checked.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum Subject {
    /// That the program of `calibrate` runs.
    Calibration,
    /// That `bring-up` passes as far as QEMU goes.
    BringUp,
    /// That records of activations are right.
    Records,
    /// That programs do the same on the chip's processor as here.
    Chip,
    /// That they do the same in the firmware.
    Firmware,
}

/// Test what needs no hardware
///
/// What a change breaks most often, in a few minutes: formatting, unit tests, host tests, documents, the answers of Grbl,
/// the firmware's proof and the room that it leaves in the flash, and the firmware over its serial line in QEMU, which is
/// skipped without QEMU. Goes on after a failure and lists what failed. Asks rustup for what rustup can give.
#[derive(Debug, clap::Args)]
pub struct Test {
    /// Only the checks whose names contain this, also those of --rest; a whole name is that check alone
    #[arg(value_name = "NAME")]
    pub only: Option<String>,
    /// Everything: what is quick and what --rest tests
    #[arg(long)]
    pub all: bool,
    /// Only what is not quick: lints, every case of the random tests, the tools, other numbers of axes, other boards and
    /// their proofs, virtual boards, tests on the emulated processor, random histories and inputs, sender programs
    #[arg(long, conflicts_with = "all")]
    pub rest: bool,
    /// List the checks and do nothing
    #[arg(long)]
    pub list: bool,
    /// Only the sender programs, at the simulator, at the firmware in QEMU and at a virtual board, and the pages in a
    /// browser: gets senders with pip and npm, and skips what Python, Node or Chromium is missing for
    #[arg(long, conflicts_with_all = ["all", "rest"])]
    pub clients: bool,
    /// With --clients: without what takes long there
    #[arg(long, requires = "clients", hide = true)]
    pub short: bool,
    /// Instead, insert the faults of `tests/faults.toml` into a copy of the sources, or those whose name contains this,
    /// and look which check finds each
    #[arg(long, value_name = "FAULT", num_args = 0..=1, default_missing_value = "", conflicts_with_all = ["only", "all", "rest", "list", "clients"])]
    pub faults: Option<String>,
    /// Add what was found to docs/faults.md, in which it then looks for no fault again that is not named
    #[arg(long, requires = "faults")]
    pub write: bool,
}
