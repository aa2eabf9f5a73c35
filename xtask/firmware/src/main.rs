//! `cargo xtask build`, `size` and `board`: the firmware, as an ELF file for each board.

mod board;
mod size;

use std::{path::PathBuf, process::ExitCode};

use anyhow::{Result, ensure};
use clap::Parser;
use common::{cargo, ui};
use firmware::boards::{compile, layout};
use firmware::{card, rehearsal};

/// Builds the firmware and shows its size.
#[derive(Parser)]
#[command(bin_name = "cargo xtask", styles = ui::STYLES, disable_help_subcommand = true)]
#[command(max_term_width = 100, version, propagate_version = true)]
enum Verb {
    Build(Options),
    Size(size::Options),
    #[command(subcommand)]
    Board(board::Verb),
    /// Lists the boards, and which of them are emulated.
    #[command(hide = true)]
    Boards,
    /// Builds every firmware of a board.
    #[command(hide = true)]
    All {
        board: String,
    },
    /// Builds the firmware of a board, looks what it leaves free of the flash, and starts it on a model of its chip.
    #[command(hide = true)]
    Start {
        board: String,
        /// Where Cargo builds it.
        #[arg(long)]
        into: Option<PathBuf>,
        /// Why it cannot be started: it is only built.
        #[arg(long)]
        unstarted: Option<String>,
    },
    /// Builds the firmware and tests it over its serial line.
    #[command(hide = true)]
    Serial,
}

fn main() -> ExitCode {
    let verb = Verb::parse();
    common::main(|| match verb {
        Verb::Build(options) => run(&options),
        Verb::Size(options) => size::run(&options),
        Verb::Board(verb) => board::run(&verb),
        Verb::Boards => list(),
        Verb::All { board } => every_firmware(&board),
        Verb::Start {
            board,
            into,
            unstarted,
        } => start(&board, into, unstarted),
        Verb::Serial => over_serial(),
    })
}

/// Build the firmware
///
/// Leaves `target/firmware/BOARD.elf`, with the step rate in it for which its timing is proven, and
/// fails when it cannot be proven. Asks rustup for the compiler's target when it is missing.
#[derive(clap::Args)]
struct Options {
    /// A board's name, or the path of a file; netduino-plus-2 without it
    #[arg(long, value_name = "BOARD")]
    board: Option<String>,
    /// Every board of the project
    #[arg(long, conflicts_with = "board")]
    all: bool,
    /// Prove nothing: the firmware then keeps to 30 000 steps per second
    #[arg(long)]
    unproven: bool,
}

fn run(options: &Options) -> Result<ExitCode> {
    for board in firmware::boards::chosen(options.board.as_deref(), options.all)? {
        let elf = if options.unproven {
            compile::firmware(&board)?
        } else {
            firmware::proven(&board)?
        };
        ui::status("Built", &elf.display().to_string());
        if let Some(file) = card::write(&board, &elf)? {
            let what = format!("{}: copy it to the SD card", file.display());
            ui::status("Built", &what);
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Prints a line for each board.
fn list() -> Result<ExitCode> {
    for board in firmware::boards::all()? {
        let emulated = board.qemu.as_ref().map_or("", |_| " emulated");
        println!(
            "{} {}{emulated}",
            board.name,
            board.features(cargo::axes().into()).join(",")
        );
    }
    Ok(ExitCode::SUCCESS)
}

/// Builds what a board has beside the firmware, and that.
fn every_firmware(board: &str) -> Result<ExitCode> {
    let board = firmware::boards::named(board)?;
    firmware::traced(&board)?;
    firmware::firmware(&board)?;
    Ok(ExitCode::SUCCESS)
}

/// What is flashed: the room that it leaves, and its start on a model of the chip.
fn start(board: &str, into: Option<PathBuf>, unstarted: Option<String>) -> Result<ExitCode> {
    let board = firmware::boards::named(board)?;
    let image = compile::image_in(&into.unwrap_or_else(cargo::target_dir), &board, &[])?;
    let free = layout::check(&board, &image)?.free();
    let kib = format!("{:.1} KiB of flash are free", f64::from(free) / 1024.0);
    ensure!(
        free >= layout::LEAST_FREE_BYTES,
        "only {kib}: {} KiB have to be",
        layout::LEAST_FREE_BYTES / 1024
    );
    let elf = compile::place(&board, "-unproven");
    compile::replace(&elf, &image)?;
    let python = match unstarted {
        Some(reason) => Err(reason),
        None => rehearsal::python()?,
    };
    let told = match python {
        Ok(python) => format!("starts {}", rehearsal::rehearse(&board, &elf, &python)?),
        Err(reason) => format!("{}: {reason}", board::NOT_STARTED),
    };
    println!("{told}; {kib}");
    Ok(ExitCode::SUCCESS)
}

/// The firmware in QEMU, driven as a sender drives it.
fn over_serial() -> Result<ExitCode> {
    cargo::need_qemu()?;
    let (board, _) = firmware::boards::emulated()?;
    let elf = firmware::firmware(&board)?;
    let step_rate = firmware::image::read(&elf)?;
    let mut command = cargo::cargo(&["test", "--test", "firmware"]);
    command.env("FIRMWARE_STEP_RATE", step_rate.to_string());
    command.env("SLOW_FIRMWARE_ELF", firmware::as_if_proven(&elf, 20_000)?);
    command.env("UNPROVEN_FIRMWARE_ELF", firmware::as_if_proven(&elf, 0)?);
    // What this tool prints itself is the verdict.
    cargo::wait(command.env("FIRMWARE_ELF", elf).stdout(std::io::stderr()))?;
    Ok(ExitCode::SUCCESS)
}
