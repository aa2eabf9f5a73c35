//! `cargo xtask`: builds, simulates, tests and flashes Leadscrew.
//!
//! One file per verb; each verb has its options, documented where they are declared, and a `run`.

mod agree;
mod bench;
mod boards;
mod build;
mod calibrate;
mod cargo;
mod clients;
mod conformance;
mod curves;
mod docs;
mod figures;
mod flash;
mod latency;
mod machine;
mod on_target;
mod plot;
mod program;
mod proof;
mod qemu;
mod quality;
mod refusal;
mod replay;
mod run;
mod schedule;
mod sender;
mod serve;
mod session;
mod settings;
mod sim;
mod size;
mod test;
mod trace;
mod ui;

use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;

/// Builds, simulates, tests and flashes Leadscrew.
///
/// Start with `cargo xtask sim examples/…` to see a program run, and `cargo xtask test` to see
/// everything tested that needs no hardware.
#[derive(Parser)]
#[command(bin_name = "cargo xtask", styles = ui::STYLES, disable_help_subcommand = true)]
#[command(max_term_width = 100, arg_required_else_help = true)]
enum Verb {
    Bench(bench::Options),
    Build(build::Options),
    Calibrate(calibrate::Options),
    Conformance(conformance::Options),
    Docs(docs::Options),
    Flash(flash::Options),
    Latency(latency::Options),
    Qemu(qemu::Options),
    Run(run::Options),
    Schedule(schedule::Options),
    Sim(sim::Options),
    Size(size::Options),
    Test(test::Options),
}

fn main() -> ExitCode {
    let verb = Verb::parse();
    run(verb).unwrap_or_else(|error| {
        ui::error(&error);
        ExitCode::FAILURE
    })
}

fn run(verb: Verb) -> Result<ExitCode> {
    match verb {
        Verb::Bench(options) => bench::run(&options),
        Verb::Build(options) => build::run(&options),
        Verb::Calibrate(options) => calibrate::run(&options),
        Verb::Conformance(options) => conformance::run(&options),
        Verb::Docs(options) => docs::run(&options),
        Verb::Flash(options) => flash::run(&options),
        Verb::Latency(options) => latency::run(&options),
        Verb::Qemu(options) => qemu::run(&options),
        Verb::Run(options) => run::run(&options),
        Verb::Schedule(options) => schedule::run(&options),
        Verb::Sim(options) => sim::run(&options),
        Verb::Size(options) => size::run(&options),
        Verb::Test(options) => test::run(&options),
    }
}
