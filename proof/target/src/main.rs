//! What has to do with a board, emulated or not: one file for each command.

mod agree;
mod bench;
mod bring_up;
mod calibrate;
mod flash;
mod latency;
mod on_target;
mod qemu;
mod replay;
mod run;

use std::{path::Path, process::ExitCode};

use anyhow::Result;
use clap::Parser;
use common::ui;
use leadscrew::settings::StepRate;

/// Runs, measures and writes the firmware.
#[derive(Parser)]
#[command(bin_name = "cargo xtask", styles = ui::STYLES, disable_help_subcommand = true)]
#[command(max_term_width = 100, version, propagate_version = true)]
enum Verb {
    Bench(bench::Options),
    BringUp(bring_up::Options),
    Calibrate(calibrate::Options),
    Flash(flash::Options),
    Latency(latency::Options),
    Qemu(qemu::Options),
    Run(run::Options),
    #[command(hide = true)]
    Sim(on_target::Options),
    #[command(hide = true)]
    Replay(replay::Options),
    #[command(hide = true)]
    Check(agree::Options),
}

fn main() -> ExitCode {
    let verb = Verb::parse();
    common::main(|| match verb {
        Verb::Bench(options) => bench::run(&options),
        Verb::BringUp(options) => bring_up::run(&options),
        Verb::Calibrate(options) => calibrate::run(&options),
        Verb::Flash(options) => flash::run(&options),
        Verb::Latency(options) => latency::run(&options),
        Verb::Qemu(options) => qemu::run(&options),
        Verb::Run(options) => run::run(&options),
        Verb::Sim(options) => on_target::run(&options),
        Verb::Replay(options) => replay::run(&options),
        Verb::Check(options) => agree::run(&options),
    })
}

/// What an image says that it is proven for.
fn step_rate(elf: &Path) -> Result<StepRate> {
    firmware::image::read(elf).map(StepRate::of_image)
}
