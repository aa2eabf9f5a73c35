//! `cargo xtask board`: what is wrong with a board's file, the step rate that is proven for it, and files made of
//! printers' configurations.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
    process::{ExitCode, Stdio},
    sync::Mutex,
    thread,
};

use anstream::{print, println};
use anyhow::{Context, Result, anyhow, bail};
use common::options::Board as Verb;
use common::options::BoardCheck as Options;
use common::{cargo, tools};
use firmware::boards::{Board, pins, rates};
use firmware::rehearsal;
use owo_colors::OwoColorize;

pub(crate) fn run(verb: &Verb) -> Result<ExitCode> {
    match verb {
        Verb::Check(options) => check(options),
        Verb::Import(options) => import(&options.printer),
    }
}

/// Prints the board's file of a printer.
#[cfg(feature = "import")]
fn import(printer: &Path) -> Result<ExitCode> {
    print!("{}", board_data::board_file(printer)?);
    Ok(ExitCode::SUCCESS)
}

/// `cargo xtask` starts a program that can.
#[cfg(not(feature = "import"))]
fn import(_printer: &Path) -> Result<ExitCode> {
    bail!("this program reads no configurations of printers")
}

fn check(options: &Options) -> Result<ExitCode> {
    let boards = firmware::boards::chosen(options.board.as_deref(), options.all)?;
    let mut is_right = true;
    for board in &boards {
        show(board);
        if !options.all {
            print!("\n{}\n", pins::table(board)?);
        }
        if options.prove {
            let rates = prove(board)?;
            is_right &= !rates.contains(&0);
            if options.write {
                rates::write(board, rates)?;
            }
        }
    }
    if options.all || options.prove {
        is_right &= starts(&boards)?;
    }
    Ok(if is_right {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

/// Prints what a build makes of a board.
fn show(board: &Board) {
    println!("{}: {}, nothing is wrong", board.name.bold(), board.title);
    let memory = board.memory(3);
    println!(
        "  STM32{} at {} MHz, program from {:#010x}, {} KiB of RAM",
        board.part_name,
        board.chip.clocks.core_mhz,
        memory.flash_start,
        memory.ram_bytes / 1024
    );
    for axes in 3..=board.most_axes() {
        let Some(wiring) = board.wiring(axes) else {
            continue;
        };
        let polled: Vec<_> = wiring.polled().iter().map(|input| input.key()).collect();
        let polled = match polled.as_slice() {
            [] => "every input interrupts".to_owned(),
            polled => format!("looked at each millisecond: {}", polled.join(", ")),
        };
        let settings = match board.memory(axes).journal {
            Some([first, second]) => format!("sectors {} and {}", first.sector, second.sector),
            None => "the EEPROM".into(),
        };
        println!(
            "  {axes} axes: settings in {settings}; an event writes {} ports; {polled}",
            wiring.step_ports().len()
        );
    }
    if let Some(warning) = weak_outputs(board) {
        println!("  {} {warning}", "warning:".yellow());
    }
}

/// What is to be known of outputs that drive little.
fn weak_outputs(board: &Board) -> Option<String> {
    let wirings = (3..=board.most_axes()).filter_map(|axes| board.wiring(axes));
    let weak: BTreeSet<_> = wirings.flat_map(board_data::Wiring::weak_outputs).collect();
    let names: Vec<_> = weak.iter().map(ToString::to_string).collect();
    (!names.is_empty()).then(|| {
        format!(
            "{}: such an output gives 3 mA at most, enough for the input of a driver or of a transistor, not for \
             an LED, an optocoupler or a relay",
            names.join(", ")
        )
    })
}

/// Builds and proves a board's firmware with each number of axes: the rates, steps/s, 0 where none is proven.
fn prove(board: &Board) -> Result<Vec<u32>> {
    let mut rates = Vec::new();
    for axes in 3..=board.most_axes() {
        let axes = u8::try_from(axes).context("a machine has six axes at most")?;
        let file = board.argument();
        let output = tools::command_for(tools::SCHEDULE, axes)?
            .args(["--board", &file, "--rate"])
            .stderr(Stdio::inherit())
            .output()
            .context("the proof cannot be started")?;
        let rate = String::from_utf8_lossy(&output.stdout);
        if output.status.success() {
            println!(
                "  {axes} axes: {} steps/s proven at 115 200 baud",
                rate.trim()
            );
            rates.push(rate.trim().parse().context("the proof gives no rate")?);
        } else if output.status.code() == Some(1) {
            println!("  {axes} axes: not proven");
            rates.push(0);
        } else {
            bail!("the proof of {} has failed", board.name);
        }
    }
    Ok(rates)
}

/// What is said first of a firmware that cannot be started on this computer.
pub(crate) const NOT_STARTED: &str = "not started";

/// What became of a firmware.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Started,
    NotStarted,
    Failed,
}

/// Builds the firmware of boards with each number of axes, measures the free flash, and starts each firmware on a
/// model of its chip. Two chips run at a time, each in its own folder; the firmwares of a chip run one after the
/// other. Returns false where one does not start or leaves too little.
fn starts(boards: &[Board]) -> Result<bool> {
    // Once: what cannot be had is not asked for with each.
    let unstarted = rehearsal::python()?.err();
    let mut by_chip: BTreeMap<&str, Vec<&Board>> = BTreeMap::new();
    for board in boards {
        by_chip.entry(&board.chip.hal).or_default().push(board);
    }
    let chips = Mutex::new(by_chip.into_values());
    let top = cargo::target_dir_for(3);
    let next = || chips.lock().ok()?.next();
    let work = |into: &Path| -> Result<Vec<Outcome>> {
        let mut outcomes = Vec::new();
        while let Some(boards) = next() {
            for board in boards {
                for axes in 3..=board.most_axes() {
                    outcomes.push(start(board, axes, into, unstarted.as_deref())?);
                }
            }
        }
        Ok(outcomes)
    };
    let outcomes = thread::scope(|scope| {
        let second = scope.spawn(|| work(&top.join("second")));
        let own = work(&top);
        let second = second
            .join()
            .map_err(|_| anyhow!("a thread has panicked"))?;
        anyhow::Ok([own?, second?].concat())
    })?;
    let count = |which| outcomes.iter().filter(|it| **it == which).count();
    let (left_out, all) = (count(Outcome::NotStarted), outcomes.len());
    if left_out > 0 {
        let reason = unstarted.unwrap_or_else(|| "see above".into());
        println!("{left_out} of {all} were {NOT_STARTED}: {reason}");
    }
    Ok(count(Outcome::Failed) == 0)
}

/// Has a firmware built and started, unless there is a reason why none can be, and prints what became of it.
fn start(board: &Board, axes: usize, into: &Path, unstarted: Option<&str>) -> Result<Outcome> {
    let axes = u8::try_from(axes).context("a machine has six axes at most")?;
    let mut command = tools::command_for(tools::FIRMWARE, axes)?;
    command.args(["start", &board.argument(), "--into"]);
    command.arg(into).env(cargo::AXES, axes.to_string());
    if let Some(reason) = unstarted {
        command.arg(format!("--unstarted={reason}"));
    }
    let output = command.output()?;
    let (outcome, message) = if !output.status.success() {
        (Outcome::Failed, output.stderr)
    } else if output.stdout.starts_with(NOT_STARTED.as_bytes()) {
        (Outcome::NotStarted, output.stdout)
    } else {
        (Outcome::Started, output.stdout)
    };
    let message = String::from_utf8_lossy(&message);
    println!("{} with {axes} axes: {}", board.name, message.trim_end());
    Ok(outcome)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_of_3_ma_are_reported() {
        for (name, pins) in [
            ("blackpill-f411", Some("PC14, PC15: ")),
            ("btt-skr-2", Some("PC13: ")),
            ("fysetc-spider", Some("PC13, PC14: ")),
            // An input may be there.
            ("flexi-hal", Some("PC15: ")),
            ("netduino-plus-2", None),
        ] {
            let board = firmware::boards::chosen(Some(name), false)
                .unwrap()
                .remove(0);
            let warning = weak_outputs(&board);
            assert_eq!(warning.is_some(), pins.is_some(), "{name}");
            let begins = |text: &String| text.starts_with(pins.unwrap_or_default());
            assert!(warning.as_ref().is_none_or(begins), "{name}: {warning:?}");
        }
    }
}
