//! Boards, their firmware, and documents.

use std::path::PathBuf;

use super::files::InputPath;

/// Build the firmware
///
/// Leaves `target/firmware/BOARD.elf`, with the step rate in it for which its timing is proven, and
/// fails when it cannot be proven. Asks rustup for the compiler's target when it is missing.
#[derive(Debug, clap::Args)]
pub struct Build {
    /// A board's name, or the path of a file; netduino-plus-2 without it
    #[arg(long, value_name = "BOARD")]
    pub board: Option<String>,
    /// Every board of the project
    #[arg(long, conflicts_with = "board")]
    pub all: bool,
    /// Prove nothing: the firmware then keeps to 30 000 steps per second
    #[arg(long)]
    pub unproven: bool,
}

/// Build the firmware and show how much flash and RAM it takes
///
/// Flash is what the program may use: neither a bootloader's nor that of the settings. RAM is what is taken statically;
/// the rest is the stack's.
#[derive(Debug, clap::Args)]
pub struct Size {
    /// A board's name, or the path of a file; netduino-plus-2 without it
    #[arg(long, value_name = "BOARD")]
    pub board: Option<String>,
    /// Every board of the project
    #[arg(long, conflicts_with = "board")]
    pub all: bool,
}

/// Check the file of a board, make one of a printer's configuration, or run a virtual board for a sender
#[derive(Debug, clap::Subcommand)]
#[allow(missing_docs, reason = "the options of each say what it does")]
pub enum Board {
    Check(BoardCheck),
    Import(BoardImport),
    Run(BoardRun),
}

/// Run the firmware of a board on its virtual chip, for a sender to connect to
///
/// The image that is flashed runs on models of the chip's registers, in real time, until Ctrl-C. Each run begins with a
/// new board: what is stored is gone with it.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("line").required(true).args(["tcp", "usbip"]))]
pub struct BoardRun {
    /// The board
    #[arg(value_name = "BOARD")]
    pub board: String,
    /// Where the sender connects, on this computer: `127.0.0.1:2323`
    #[arg(long, value_name = "ADDR:PORT")]
    pub tcp: Option<String>,
    /// Serve the board as the USB device that it is, to hosts that speak USB/IP, on this computer: `127.0.0.1:3240`
    #[arg(long, value_name = "ADDR:PORT")]
    pub usbip: Option<String>,
    /// Give the machine limit switches at the ends of a travel of 200 mm, in whose middle it stands, and a probe plate
    /// 10 mm above the low end of Z
    #[arg(long)]
    pub switches: bool,
    /// At the end, compare the steps at the pins with a file that `sim --trace` has written; the exit status is 1 when
    /// they differ
    #[arg(long, value_name = "STEPS.csv")]
    pub against: Option<InputPath>,
}

/// Test the firmware of a board on its virtual chip: all that can be tried without the board
///
/// The image that is flashed runs on models of the chip's registers, from power-up and from states in which bootloaders
/// leave the chip. Tested are registers, pins, settings, power cuts, wrong crystals, faults in motion, and programs, whose
/// step edges must be those of the simulator. The first time, the models are compiled, which takes some minutes.
#[derive(Debug, clap::Args)]
pub struct Rehearse {
    /// A board's name, or the path of a file
    #[arg(long, value_name = "BOARD", required_unless_present_any = ["all", "faults"])]
    pub board: Option<String>,
    /// Every board of the project with each number of axes
    #[arg(long, conflicts_with = "board")]
    pub all: bool,
    /// Without the programs, with one state of bootloaders and one power cut
    #[arg(long)]
    pub short: bool,
    /// Only that the firmware starts and moves, from each file that the board's loaders take
    #[arg(long, conflicts_with = "short")]
    pub start: bool,
    /// Show every line from the firmware, with the board's time in ms and where X is in steps
    #[arg(long, conflicts_with = "all")]
    pub lines: bool,
    /// Instead, insert the faults of `tests/virtual_board/faults.toml` into a copy of the sources, or those whose name contains
    /// this, and look whether the rehearsal names each
    #[arg(long, value_name = "FAULT", num_args = 0..=1, default_missing_value = "", conflicts_with_all = ["board", "all", "short", "start", "lines"])]
    pub faults: Option<String>,
    /// Take the files of a release, as `cargo xtask release` makes it
    #[arg(long, value_name = "RELEASE", conflicts_with_all = ["all", "faults"])]
    pub from: Option<PathBuf>,
    /// Where Cargo builds the firmware
    #[arg(long, hide = true, conflicts_with = "all")]
    pub into: Option<PathBuf>,
}

/// Check the file of a board
///
/// Tells what a build would make of it, with a table of its pins, or prints the error of a wrong file with its
/// line, and ends with status 1.
#[derive(Debug, clap::Args)]
pub struct BoardCheck {
    /// A board's name, or the path of a file
    #[arg(value_name = "BOARD", required_unless_present = "all")]
    pub board: Option<String>,
    /// Every board of the project: also builds each firmware with three axes and more, and looks what of the flash is
    /// left free
    #[arg(long, conflicts_with = "board")]
    pub all: bool,
    /// The same of one board; and prove the step rate at 115 200 baud
    #[arg(long)]
    pub prove: bool,
}

/// Make a board's file of a printer's configuration in Klipper's syntax
///
/// Prints it: `cargo xtask board import printer.cfg > boards/mine.toml`. What the configuration does not tell
/// stands there as comments: chip, crystal, bootloader, the sender's pins, spindle, buttons.
#[derive(Debug, clap::Args)]
pub struct BoardImport {
    /// The configuration, which may include others
    #[arg(value_name = "PRINTER.CFG")]
    pub printer: InputPath,
}

/// Write the documents and tables that are made from the code: G-codes, settings, errors, pins, boards
#[derive(Debug, clap::Args)]
pub struct Docs {
    /// Write nothing; fail when a document is out of date
    #[arg(long)]
    pub check: bool,
}

/// Build the firmware and write it to the board with a debug probe or by DFU, or copy it to the drive from which the board
/// takes it
///
/// An ST-Link, a J-Link or a CMSIS-DAP probe will do: a Nucleo board has one built in. The first
/// time, the tools for boards are compiled anew, with probe-rs in them. --to and --dfu need none of that.
#[derive(Debug, clap::Args)]
pub struct Flash {
    /// The board; without it, the only one of the release
    #[arg(long, value_name = "NAME", required_unless_present = "from")]
    pub board: Option<String>,
    /// Build nothing: take the file of a release, in whose folder `SHA256SUMS` is
    #[arg(long, value_name = "RELEASE", conflicts_with = "unproven")]
    pub from: Option<InputPath>,
    /// The probe, as `VID:PID` or `VID:PID:SERIAL`, where there is more than one
    #[arg(long, value_name = "PROBE")]
    pub probe: Option<String>,
    /// Copy the file instead that the board takes: to an SD card, to the drive of a UF2 bootloader or of a Nucleo
    #[arg(long, value_name = "DIR", conflicts_with = "probe")]
    pub to: Option<PathBuf>,
    /// Write it over USB by the bootloader in the chip's ROM: waits for the board in DFU mode before anything is built
    #[arg(long, conflicts_with_all = ["probe", "to"])]
    pub dfu: bool,
    /// Write it although nothing is proven: it then keeps to 30 000 steps per second
    #[arg(long)]
    pub unproven: bool,
}

/// Run an ELF file on the emulated board and print its log
///
/// Cargo's runner for the target: `cargo test --target thumbv7em-none-eabihf --test 'target_*'`
/// ends up here. The exit status is the program's own.
#[derive(Debug, clap::Args)]
pub struct Run {
    /// The program
    pub elf: InputPath,
    /// Its arguments, which it reads by semihosting
    pub arguments: Vec<String>,
}

/// Make a release: the firmware of every board with each number of axes, proven, in all files that its owners need
///
/// For each image: ELF, Intel HEX, a flat file, the file for the bootloader's SD card, UF2 and DFU files where the board takes
/// them, and the certificate of its proof. Beside them an index, SHA-256 sums, and the licences of all that is in an image.
/// Takes about an hour.
#[derive(Debug, clap::Args)]
pub struct Release {
    /// The folder, which must be empty
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// One board only
    #[arg(long, value_name = "BOARD")]
    pub board: Option<String>,
    /// One number of axes only
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(3..=6))]
    pub with_axes: Option<u8>,
    /// Write the rates that are proven into docs/rates.toml, of which `cargo xtask docs` makes tables
    #[arg(long, conflicts_with = "with_axes")]
    pub write: bool,
}

/// Make an image of a release
#[derive(Debug, clap::Args)]
pub struct ReleaseImage {
    /// The board
    #[arg(long)]
    pub board: String,
    /// The folder of the release
    #[arg(long)]
    pub out: PathBuf,
    /// Where Cargo builds it
    #[arg(long)]
    pub into: Option<PathBuf>,
}

/// Build the firmware of a board, and measure how much flash it leaves free
#[derive(Debug, clap::Args)]
pub struct Room {
    /// The board
    pub board: String,
    /// Where Cargo builds it
    #[arg(long)]
    pub into: Option<PathBuf>,
}
