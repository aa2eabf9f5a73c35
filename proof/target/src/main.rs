//! Commands for a board, emulated or not: one file for each command.

mod bench;
mod bring_up;
mod calibrate;
mod compare_with_target;
mod flash;
mod latency;
mod on_target;
mod qemu;
mod replay;
mod run;

use std::{path::Path, process::ExitCode};

use anyhow::Result;
use common::options::{self, Verb};
use leadscrew::settings::StepRate;

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::Bench(options) => bench::run(&options),
        Verb::BringUp(options) => bring_up::run(&options),
        Verb::Calibrate(options) => calibrate::run(&options),
        Verb::Check(options) => compare_with_target::run(&options),
        Verb::Flash(options) => flash::run(&options),
        Verb::Latency(options) => latency::run(&options),
        Verb::Qemu(options) => qemu::run(&options),
        Verb::Replay(options) => replay::run(&options),
        Verb::Run(options) => run::run(&options),
        Verb::SimOnTarget(options) => on_target::run(&options),
        other => other.refuse(),
    })
}

/// The step rate for which an image is proven.
fn step_rate(elf: &Path) -> Result<StepRate> {
    firmware::image::read(elf).map(StepRate::of_image)
}
