//! `cargo xtask build`, `size`, `board` and `rehearse`: the firmware of each board, as an ELF file and on a virtual board.

mod board;
mod size;

use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use common::{
    cargo,
    options::{self, Build, Flash, ReleaseImage, Room, Verb},
    ui,
};
use firmware::boards::{compile, layout};
use firmware::{drive, flash::FirmwareSource, release};

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::Build(options) => run(&options),
        Verb::Flash(options) => copy(&options),
        Verb::Size(options) => size::run(&options),
        Verb::Board(verb) => board::run(&verb),
        Verb::Boards => list(),
        Verb::All { board } => every_firmware(&board),
        Verb::Rehearse(options) => board::rehearse(&options),
        Verb::Release(options) => board::release(&options),
        Verb::ReleaseImage(options) => release_image(&options),
        Verb::Room(options) => room(options),
        Verb::Serial { only } => over_serial(&only),
        other => other.refuse(),
    })
}

fn run(options: &Build) -> Result<ExitCode> {
    for board in firmware::boards::chosen(options.board.as_deref(), options.all)? {
        let elf = if options.unproven {
            compile::firmware(&board)?
        } else {
            firmware::proven(&board)?
        };
        ui::status("Built", &elf.display().to_string());
        for (method, file) in release::write(&board, &elf)? {
            let what = format!("{}: for {}", file.display(), method.kind);
            ui::status("Built", &what);
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Copies the firmware of a board, built and proven or of a release, to the drive from which it is written.
fn copy(options: &Flash) -> Result<ExitCode> {
    let chosen = FirmwareSource::by(options)?;
    let folder = options.to.as_deref().context("no folder is given")?;
    let method = drive::method(&chosen.board, folder)?;
    let file = chosen.file(&method)?;
    drive::copy(&file, folder)?;
    ui::status(
        "Copied",
        &format!("{} to {}", method.file, folder.display()),
    );
    println!("{}", method.steps.join(" "));
    Ok(ExitCode::SUCCESS)
}

/// Prints a line for each board.
fn list() -> Result<ExitCode> {
    for board in firmware::boards::all()? {
        let emulated = board.qemu.as_ref().map_or("", |_| " qemu");
        println!(
            "{} {}{emulated}",
            board.name,
            board.features(cargo::axes().into()).join(",")
        );
    }
    Ok(ExitCode::SUCCESS)
}

/// Builds the firmware of a board, and that which records its activations.
fn every_firmware(board: &str) -> Result<ExitCode> {
    let board = firmware::boards::named(board)?;
    compile::image(&board, &[])?;
    let traced = compile::image(&board, &["--features", "trace"])?;
    compile::replace(&compile::place(&board, "-trace"), &traced)?;
    Ok(ExitCode::SUCCESS)
}

/// Makes the image of a board for a release.
fn release_image(options: &ReleaseImage) -> Result<ExitCode> {
    let board = firmware::boards::named(&options.board)?;
    let into = options.into.clone().unwrap_or_else(cargo::target_dir);
    println!("{}", release::image(&board, &into, &options.out)?.verdict());
    Ok(ExitCode::SUCCESS)
}

/// Builds a firmware, and measures the room that it leaves.
fn room(options: Room) -> Result<ExitCode> {
    let board = firmware::boards::named(&options.board)?;
    let image = compile::image_in(&options.into.unwrap_or_else(cargo::target_dir), &board, &[])?;
    let free = layout::check(&board, &image)?.free();
    let kib = format!("{:.1} KiB of flash are free", f64::from(free) / 1024.0);
    ensure!(
        free >= layout::MIN_FREE_BYTES,
        "only {kib}: {} KiB have to be",
        layout::MIN_FREE_BYTES / 1024
    );
    println!("{kib}");
    Ok(ExitCode::SUCCESS)
}

/// What the tests' firmware says that it is proven for, steps per second, as in `tests/firmware/proven.rs`. What is proven
/// is for the checks by `cargo xtask schedule`.
const TESTED_STEP_RATE_HZ: u32 = 200_000;

/// The firmware in QEMU, driven as a sender drives it.
fn over_serial(only: &[String]) -> Result<ExitCode> {
    cargo::need_qemu()?;
    let (board, _) = firmware::boards::emulated()?;
    let elf = compile::place(&board, "-unproven");
    compile::replace(&elf, &compile::image(&board, &[])?)?;
    let mut command = cargo::cargo(&["test", "--package", "tests", "--test", "firmware"]);
    command.arg("--").args(only);
    command.env(
        "FIRMWARE_ELF",
        firmware::as_if_proven(&elf, TESTED_STEP_RATE_HZ)?,
    );
    let for_chip = firmware::boards::named(&board.name)?;
    command.env("CHIP_FIRMWARE_ELF", compile::firmware(&for_chip)?);
    command.env("SLOW_FIRMWARE_ELF", firmware::as_if_proven(&elf, 20_000)?);
    command.env("UNPROVEN_FIRMWARE_ELF", firmware::as_if_proven(&elf, 0)?);
    // What this tool prints itself is the verdict.
    cargo::wait(command.stdout(std::io::stderr()))?;
    Ok(ExitCode::SUCCESS)
}
