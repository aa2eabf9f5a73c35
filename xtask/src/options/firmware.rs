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

/// Check the file of a board, or make one of a printer's configuration
#[derive(Debug, clap::Subcommand)]
#[allow(missing_docs, reason = "the options of each say what it does")]
pub enum Board {
    Check(BoardCheck),
    Import(BoardImport),
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
    /// Every board of the project: also builds each firmware with three axes and more, looks what of the flash is left
    /// free, and starts it on a model of its chip, where pip can get the processor for that
    #[arg(long, conflicts_with = "board")]
    pub all: bool,
    /// The same of one board; and prove the step rate at 115 200 baud
    #[arg(long)]
    pub prove: bool,
    /// Write the rates that are proven into docs/rates.toml, of which `cargo xtask docs` makes tables
    #[arg(long, requires = "prove")]
    pub write: bool,
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

/// Build the firmware and write it to the board with a debug probe
///
/// An ST-Link, a J-Link or a CMSIS-DAP probe will do: a Nucleo board has one built in. The first
/// time, the tools for boards are compiled anew, with probe-rs in them.
#[derive(Debug, clap::Args)]
pub struct Flash {
    /// The board
    #[arg(long, value_name = "NAME")]
    pub board: String,
    /// The probe, as `VID:PID` or `VID:PID:SERIAL`, where there is more than one
    #[arg(long, value_name = "PROBE")]
    pub probe: Option<String>,
    /// Write it although nothing is proven: it then keeps to 30 000 steps per second
    #[arg(long)]
    pub unproven: bool,
}

/// Run an ELF file on the emulated board and print its log
///
/// Cargo's runner for the target: `cargo run --target thumbv7em-none-eabihf --example target_machine`
/// ends up here. The exit status is the program's own.
#[derive(Debug, clap::Args)]
pub struct Run {
    /// The program
    pub elf: InputPath,
    /// Its arguments, which it reads by semihosting
    pub arguments: Vec<String>,
}

/// Build the firmware of a board, look what it leaves free of the flash, and start it on a model of its chip
#[derive(Debug, clap::Args)]
pub struct Start {
    /// The board
    pub board: String,
    /// Where Cargo builds it
    #[arg(long)]
    pub into: Option<PathBuf>,
    /// Only from the states that matter most
    #[arg(long)]
    pub few: bool,
    /// Why it cannot be started: it is only built
    #[arg(long)]
    pub unstarted: Option<String>,
}
