//! `cargo xtask schedule --replay`: checks the analysis against a busy run in QEMU.
//!
//! A plugin of QEMU (`proof/cost`, which calls `schedule::replay`) follows every instruction of the
//! tasks with deadlines; the caller judges the result.

mod driver;
mod workload;

use std::process::ExitCode;

use anyhow::{Context, Result};
use common::options::Replay as Options;
use common::{cargo, tools, ui};

use self::driver::Driver;

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    cargo::need_qemu()?;
    let board = firmware::boards::named(&options.board)?;
    let wiring = board.wiring(cargo::axes().into());
    let usart = wiring
        .context("the board has no pins for so many axes")?
        .serial
        .usart;
    let (_, machine) = firmware::boards::emulated()?;
    let elf = firmware::as_if_proven(&options.elf, options.step_rate)?;
    let plugin = tools::plugin()?;
    let load = [
        plugin.to_string_lossy().replace(',', ",,"),
        argument("elf", &elf.to_string_lossy()),
        argument("root", &cargo::root().to_string_lossy()),
        argument("board", &board.name),
        argument("clock", &board.chip.clocks.to_string()),
        argument("axes", &cargo::axes().to_string()),
        argument("rate", &options.step_rate.to_string()),
        argument("baud", &options.baud.to_string()),
        argument("out", &options.out.to_string_lossy()),
    ];
    let mut driver = Driver::boot(&elf, &machine, usart, &["-plugin", &load.join(",")])?;
    ui::status(
        "Replaying",
        "the firmware in QEMU, every instruction followed",
    );
    let played = workload::run(&mut driver, options.step_rate);
    ui::status("Replayed", &driver.counts());
    driver.quit()?;
    played?;
    Ok(ExitCode::SUCCESS)
}

/// An argument of the plugin, with QEMU's own escape for a comma.
fn argument(key: &str, value: &str) -> String {
    format!("{key}={}", value.replace(',', ",,"))
}
