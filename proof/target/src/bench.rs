//! `cargo xtask bench`: what the firmware costs, in instructions and modelled cycles.
//!
//! The firmware itself runs in QEMU, is fed over its serial line, and a plugin (`proof/cost`)
//! charges every executed instruction to the exception handler it belongs to. A task is a handler;
//! what preempts it is not in its cost, and 24 cycles for entry and exit are. Not counted: code
//! outside of handlers (initialisation, idling), the handler that stands for the step timer, and
//! the cost of the workload's settings, which is measured in a run without the program.

mod emulator;
mod figures;
mod intervals;
mod monitor;
mod page;
mod profile;
mod report;
mod sender;
mod tasks;
mod workload;

use std::{fs, path::Path, process::ExitCode};

use anstream::println;
use anyhow::{Context, Result, ensure};
use common::options::Bench as Options;
use common::{cargo, ui};
use firmware::{boards::compile, image::compiler};
use owo_colors::OwoColorize;

use emulator::Emulator;
use figures::{Figure, Parts, Run};
use page::Page;
#[cfg(feature = "probe")]
pub(crate) use sender::Sender;
use tasks::Names;
use workload::{Part, Workload};

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let emulator = Emulator::new()?;
    match &options.elf {
        Some(elf) => program(&emulator, elf, options)?,
        None => firmware(&emulator, options)?,
    }
    Ok(ExitCode::SUCCESS)
}

/// Counts a program that ends by itself.
fn program(emulator: &Emulator, elf: &Path, options: &Options) -> Result<()> {
    let report = emulator.run(elf, &options.arguments)?;
    tasks::print(&report);
    if options.profile {
        profile::print(&report, elf)?;
    }
    Ok(())
}

/// Counts the firmware and prints its figures.
fn firmware(emulator: &Emulator, options: &Options) -> Result<()> {
    const APPLICATION: &str = "src/app.rs";
    /// Steps of all axes per second that no workload exceeds.
    const MOST_HZ: u32 = 500_000;
    /// Where the times of the steps are computed.
    const STEP_TIMES: [&str; 2] = [
        "leadscrew::stepper::generator::",
        "leadscrew::stepper::placement::",
    ];
    /// What makes a change of the state, and commands, of a line without blanks.
    const PARSE: [&str; 2] = ["leadscrew::gcode::", "leadscrew::decimal::"];
    /// What finds entry speeds, from the newest block back.
    const PASS: [&str; 2] = [
        "leadscrew::motion::trapezoid::plan_part",
        "leadscrew::motion::trapezoid::backward_part",
    ];
    let (board, _) = firmware::boards::emulated()?;
    let source = fs::read_to_string(cargo::root().join(APPLICATION))
        .with_context(|| format!("cannot read {APPLICATION}"))?;
    let names = Names::of(&source).context(APPLICATION)?;
    // What is counted does not depend on time, and shall not depend on what is proven.
    let elf = firmware::as_if_proven(&compile::firmware(&board)?, MOST_HZ)?;
    let count = |workload: &Workload| {
        ui::status("Counting", workload.name);
        let settings = emulator.stream(&elf, workload, Part::Settings)?;
        let whole = emulator.stream(&elf, workload, Part::Whole)?;
        let mut run = Run {
            step_times: profile::cost_of(&whole, &elf, &STEP_TIMES)?,
            settings,
            whole,
            count: workload.count,
        };
        names.apply(&mut run.settings);
        names.apply(&mut run.whole);
        if !options.check {
            println!("\n{}", workload.name.bold());
            tasks::print(&run.whole);
        }
        if options.profile {
            profile::print(&run.whole, &elf)?;
        }
        anyhow::Ok(run)
    };
    let one = count(&workload::one_axis())?;
    let three = count(&workload::three_axes())?;
    let lines = count(&workload::short_lines())?;
    let raster = count(&workload::raster())?;
    let replanned = count(&workload::replanned())?;
    // The sender may be too late for one block or another.
    let blocks = profile::rounds_of(&replanned.whole, &elf, &PASS)?;
    let blocks_a_line = blocks as f64 / replanned.count as f64;
    ensure!(
        (90.0..110.0).contains(&blocks_a_line),
        "each line re-planned {blocks_a_line:.0} blocks, not 100"
    );
    let parts = Parts {
        parse: profile::cost_of(&lines.whole, &elf, &PARSE)?.per(lines.count),
        pass: profile::cost_of(&replanned.whole, &elf, &PASS)?.per(blocks.div_ceil(100)),
    };
    let figures = figures::all([&one, &three, &lines, &raster], parts)?;
    let errors = intervals::interval_errors(&workload::three_axes(), MOST_HZ)?;
    let page = Page::new(&figures, errors, &board.name, &compiler(&elf)?);
    output(&figures, errors, &page, &one.whole.model, options)
}

/// Puts the figures where they are asked for.
fn output(
    figures: &[Figure],
    interval_errors: [f64; 3],
    page: &Page,
    model: &str,
    options: &Options,
) -> Result<()> {
    if options.check {
        page.check()?.print();
        return Ok(());
    }
    println!();
    figures::print(figures);
    println!(
        "{}: {}",
        page::INTERVAL_ERROR_LABEL,
        page::percents(interval_errors)
    );
    if options.write {
        page.write()?;
    }
    if let Some(path) = &options.json {
        let json = figures::json(figures, interval_errors, model);
        fs::write(path, format!("{json:#}\n"))
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}
