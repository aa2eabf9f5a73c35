//! `cargo xtask board` and `rehearse`: what is wrong with a board's file, the step rate that is proven for it, files made
//! of printers' configurations, and boards that run on models of their chips.

use std::{
    collections::{BTreeSet, VecDeque},
    path::Path,
    process::{ExitCode, Stdio},
    sync::Mutex,
    thread,
};

use anstream::{print, println};
use anyhow::{Context, Result, anyhow, bail};
use common::options::Board as Verb;
use common::options::BoardCheck as Options;
use common::options::{Rehearse, Release};
use common::{cargo, check, tools, ui};
use firmware::boards::{Board, pins, rates};
use firmware::{rehearsal, release};
use owo_colors::OwoColorize;

pub(crate) fn run(verb: &Verb) -> Result<ExitCode> {
    match verb {
        Verb::Check(options) => check(options),
        Verb::Import(options) => import(&options.printer),
        Verb::Run(options) => {
            let board = firmware::boards::named(&options.board)?;
            let lines = [("--tcp", &options.tcp), ("--usbip", &options.usbip)];
            let mut lines = { lines.iter() }.filter_map(|(by, at)| Some((by, at.as_ref()?)));
            let (by, address) = lines.next().context("no line is given")?;
            let mut command = rehearsal::served(&board, by, address)?;
            if options.switches {
                command.args(["--switches", ""]);
            }
            if let Some(events) = &options.against {
                command.arg("--against").arg(&**events);
            }
            cargo::wait(&mut command)?;
            Ok(ExitCode::SUCCESS)
        }
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
            for table in pins::tables(board) {
                print!("\n{table}");
            }
            println!();
        }
        if options.prove {
            is_right &= prove(board)?;
        }
    }
    if options.all || options.prove {
        is_right &= with_each_firmware(&boards, None, &["room"])?;
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
            polled => format!("looked at twice a millisecond: {}", polled.join(", ")),
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

/// Builds and proves a board's firmware with each number of axes, and prints the rates; false where none is proven.
fn prove(board: &Board) -> Result<bool> {
    let mut are_proven = true;
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
                "  {axes} axes: {} steps/s proven over {}",
                rate.trim(),
                board.sender()
            );
        } else if output.status.code() == Some(1) {
            println!("  {axes} axes: not proven");
            are_proven = false;
        } else {
            bail!("the proof of {} has failed", board.name);
        }
    }
    Ok(are_proven)
}

/// Makes a release.
pub(crate) fn release(options: &Release) -> Result<ExitCode> {
    let boards = match &options.board {
        Some(name) => vec![firmware::boards::named(name)?],
        None => firmware::boards::all()?,
    };
    let out = std::path::absolute(&options.out)?;
    let only = options.with_axes;
    let index = release::release(&boards, &out, only, || {
        let folder = out.to_string_lossy();
        let arguments = ["release-image", "--out", &folder, "--board"];
        with_each_firmware(&boards, only, &arguments)
    })?;
    if options.write {
        rates::write(&boards, &index)?;
    }
    ui::status("Released", &out.display().to_string());
    Ok(ExitCode::SUCCESS)
}

/// Rehearses boards on models of their chips.
pub(crate) fn rehearse(options: &Rehearse) -> Result<ExitCode> {
    if options.all {
        let mut arguments = vec!["rehearse"];
        arguments.extend(extent(options));
        arguments.push("--board");
        let is_right = with_each_firmware(&firmware::boards::all()?, None, &arguments)?;
        return Ok(if is_right {
            ExitCode::SUCCESS
        } else {
            ExitCode::FAILURE
        });
    }
    let name = options.board.as_deref().unwrap_or_default();
    let board = firmware::boards::named(name)?;
    let own = cargo::target_dir();
    let parts = rehearsal::rehearse(
        &board,
        rehearsal::Options {
            extent: extent(options),
            shows_lines: options.lines,
            into: options.into.as_deref().unwrap_or(&own),
            from: options.from.as_deref(),
        },
    )?;
    if check::is_check() {
        let parts = parts.lines().filter(|line| !line.ends_with(':'));
        println!("{} parts, nothing is wrong", parts.count());
    } else {
        println!(
            "{} with {} axes, nothing is wrong\n{parts}",
            board.name.bold(),
            cargo::axes()
        );
    }
    Ok(ExitCode::SUCCESS)
}

/// How much of a rehearsal is wanted.
fn extent(options: &Rehearse) -> Option<&'static str> {
    let extents = [(options.short, "--short"), (options.start, "--start")];
    extents
        .iter()
        .find(|(is_wanted, _)| *is_wanted)
        .map(|it| it.1)
}

/// Has something done with the firmware of boards with each number of axes, or one only. Two firmwares are made at a time, each in a
/// folder of its own: of the boards by chip, one is next at the beginning and one at the end, so that what a chip needs is
/// seldom compiled twice. Returns false where one fails.
fn with_each_firmware(boards: &[Board], only: Option<u8>, arguments: &[&str]) -> Result<bool> {
    let mut by_chip: Vec<_> = boards.iter().collect();
    by_chip.sort_by_key(|board| &board.chip.hal);
    let boards = Mutex::new(VecDeque::from(by_chip));
    let next = |is_first: bool| -> Option<&Board> {
        let mut boards = boards.lock().ok()?;
        if is_first {
            boards.pop_front()
        } else {
            boards.pop_back()
        }
    };
    let work = |is_first: bool, into: &Path| -> Result<bool> {
        let mut is_right = true;
        while let Some(board) = next(is_first) {
            for axes in board.numbers_of_axes(only) {
                is_right &= with_firmware(board, axes, into, arguments)?;
            }
        }
        Ok(is_right)
    };
    let top = cargo::target_dir_for(3);
    thread::scope(|scope| {
        let second = scope.spawn(|| work(false, &top.join("second")));
        let own = work(true, &top);
        let second = second
            .join()
            .map_err(|_| anyhow!("a thread has panicked"))?;
        Ok(own? & second?)
    })
}

/// Has something done with one firmware, and prints what became of it.
fn with_firmware(board: &Board, axes: u8, into: &Path, arguments: &[&str]) -> Result<bool> {
    let mut command = tools::command_for(tools::FIRMWARE, axes)?;
    command.args(arguments).arg(board.argument());
    command.arg("--into").arg(into);
    command.env(cargo::AXES, axes.to_string());
    let output = check::as_check(&mut command).output()?;
    // A check prints its verdict; a fault of the tool itself is elsewhere.
    let texts = [output.stdout, output.stderr].map(|it| String::from_utf8_lossy(&it).into_owned());
    let mut texts = texts.iter().map(|text| text.trim_end());
    let verdict = texts.find(|text| !text.is_empty()).unwrap_or_default();
    println!("{} with {axes} axes: {verdict}", board.name);
    Ok(output.status.success())
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
