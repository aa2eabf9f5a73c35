//! `cargo xtask bring-up`: whether a board is what the firmware counts on.
//!
//! The program is `tests/target_bring_up.rs`, which measures and says facts; [`checks`] judges them. The report
//! is `bring-up/BOARD-NUMBER.json`, with the number that no other chip has, and a page beside it.

mod checks;
mod emulated;
mod exchange;
mod facts;
mod priorities;
mod probed;
mod report;
#[path = "../../../tests/bring_up/sequence.rs"]
mod sequence;

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use anstream::println;
use anyhow::{Context, Result, ensure};
use boards::Board;
use common::{cargo, check, ui};
use owo_colors::OwoColorize;

use self::{
    checks::{Expected, Verdict, chip_number, judge},
    facts::Facts,
    report::Report,
};
use crate::{flash, on_target};

/// The program.
const TEST: &str = "target_bring_up";
/// The table of vectors, and the end of the statics, behind which the guard of the stack is.
const VECTORS: &str = "__vector_table";
const STATICS_END: &str = "__sheap";
/// `GUARD_BYTES` of `src/board/stack.rs`.
const GUARD_BYTES: u64 = 4096;

/// Look whether a board is what the firmware counts on
///
/// Writes a program to the board that says which chip it is, times the step timer, exchanges bytes over
/// the serial port that `--port` names, and makes faults, each of which resets the chip. Take every wire
/// off the board that could switch or move something: spindle, coolant and laser are switched on, for up to
/// 0.3 s if a fault is not noticed. Writes a report, `bring-up/BOARD-NUMBER.json`, and a page beside it. The firmware must be
/// written again afterwards. docs/bring-up.md tells more.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// The board
    #[arg(long, value_name = "NAME", required_unless_present = "verify")]
    board: Option<String>,
    /// The probe, as `VID:PID` or `VID:PID:SERIAL`, where there is more than one
    #[arg(long, value_name = "PROBE")]
    probe: Option<String>,
    /// The serial port of the board; without it, what needs it stays open
    #[arg(long, value_name = "DEVICE")]
    port: Option<PathBuf>,
    /// What the emulator can show, under QEMU; the report is in `target/bring-up`
    #[arg(long, conflicts_with_all = ["probe", "port"])]
    qemu: bool,
    /// Instead, see whether a report is as it was written
    #[arg(long, value_name = "REPORT.json", conflicts_with_all = ["board", "probe", "port", "qemu"])]
    verify: Option<PathBuf>,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    if let Some(path) = &options.verify {
        report::verify(&boards::compile::read(path)?)?;
        ui::status("Verified", "the report is as it was written");
        return Ok(ExitCode::SUCCESS);
    }
    let name = options.board.as_deref().context("no board is named")?;
    let board = boards::named(name)?;
    if !options.qemu && !cfg!(feature = "probe") {
        return flash::again();
    }
    ensure!(
        !options.qemu || board.qemu.is_some(),
        "QEMU does not emulate {name}"
    );
    let elf = on_target::build(&board, TEST)?;
    let facts = if options.qemu {
        emulated::run(&elf, &[])?
    } else {
        probed::run(
            &board,
            &elf,
            options.probe.as_deref(),
            options.port.as_deref(),
        )?
    };
    let report = report(&board, &elf, facts)?;
    print(&report);
    for path in write(&report)? {
        ui::status("Written", &path.display().to_string());
    }
    Ok(ExitCode::from(u8::from(
        report.verdict() == Verdict::Failed,
    )))
}

/// Judges the facts of a program.
fn report(board: &Board, elf: &Path, facts: Facts) -> Result<Report> {
    let checks = judge(&facts, &expected(board, elf)?);
    let image = boards::compile::read(elf)?;
    Ok(Report::new(board, &image, facts, checks))
}

/// Returns what the facts must be.
fn expected(board: &Board, elf: &Path) -> Result<Expected> {
    let guard = emulator::symbol(elf, STATICS_END)?.next_multiple_of(GUARD_BYTES);
    Ok(Expected {
        chip: chip_number(&board.chip.hal),
        flash_kib: board.part.flash_kib.into(),
        wait_states: board.chip.clocks.flash_wait_states.into(),
        vectors: emulator::symbol(elf, VECTORS)?.cast_signed(),
        guard: guard.cast_signed(),
        priorities: priorities::of_tasks()?,
    })
}

fn print(report: &Report) {
    for check in report.checks() {
        println!("{}: {}", check.title.bold(), shown(check.verdict()));
        for item in &check.items {
            let line = format!("  {:<50}{}", item.name, item.measured);
            match item.verdict {
                Verdict::Passed => println!("{line}"),
                Verdict::Open => println!("{}", line.dimmed()),
                Verdict::Failed => {
                    let expected = format!("must be {}", item.expected);
                    println!("{line}  {}", expected.red());
                }
            }
        }
    }
    println!("{}", report.summary());
}

fn shown(verdict: Verdict) -> String {
    match verdict {
        Verdict::Passed => "passed".green().to_string(),
        Verdict::Failed => "failed".red().to_string(),
        Verdict::Open => "open".yellow().to_string(),
    }
}

/// Writes the report and its page.
fn write(report: &Report) -> Result<[PathBuf; 2]> {
    let folder = if report.is_emulated() {
        cargo::target_dir().join("bring-up")
    } else {
        cargo::root().join("bring-up")
    };
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let files = [("json", report.json()), ("html", report.page())].map(|(ending, text)| {
        let path = folder.join(format!("{}.{ending}", report.name()));
        let written = fs::write(&path, text);
        written.with_context(|| format!("cannot write {}", path.display()))?;
        Ok(path)
    });
    let [json, page] = files;
    let paths: Result<_> = json.and_then(|json| Ok([json, page?]));
    paths
}

/// Parts that the emulator leaves open: the others must pass there.
const OPEN_IN_QEMU: usize = 29;

/// What the emulator can show is as it must be.
pub(crate) fn check() -> Result<check::Verdict> {
    let (board, _) = boards::emulated()?;
    let elf = on_target::build(&board, TEST)?;
    let report = report(&board, &elf, emulated::run(&elf, &[])?)?;
    report::verify(report.json().as_bytes())?;
    let items: Vec<_> = report
        .checks()
        .iter()
        .flat_map(|check| &check.items)
        .collect();
    for item in &items {
        ensure!(
            item.verdict != Verdict::Failed,
            "{}: {}, must be {}",
            item.name,
            item.measured,
            item.expected
        );
    }
    let open = items.iter().filter(|item| item.verdict == Verdict::Open);
    let open = open.count();
    ensure!(
        open == OPEN_IN_QEMU,
        "{open} parts are left open in QEMU, not {OPEN_IN_QEMU}"
    );
    check_unguarded(&board, &elf)?;
    let passed = items.len() - open;
    Ok(check::Verdict::Counted(format!("{passed} parts passed")))
}

/// What fails without the guard of the stack.
const UNGUARDED: [&str; 5] = [
    "size of the guard",
    "control of the guard",
    "guard of the stack",
    "stack too deep: made",
    "processor faults told to the sender",
];

/// A stack without a guard is noticed before it overwrites anything, and the program comes to its end.
fn check_unguarded(board: &Board, elf: &Path) -> Result<()> {
    let facts = emulated::run(elf, &[emulated::UNGUARDED])?;
    let report = report(board, elf, facts)?;
    let items = report.checks().iter().flat_map(|check| &check.items);
    let failed = items.filter(|item| item.verdict == Verdict::Failed);
    let failed: Vec<_> = failed.map(|item| item.name.as_str()).collect();
    ensure!(
        failed == UNGUARDED,
        "without the guard of the stack these fail: {failed:?}"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_that_the_emulator_does_not_have_is_refused_before_anything_is_compiled() {
        let options = Options {
            board: Some("nucleo-f446re".into()),
            probe: None,
            port: None,
            qemu: true,
            verify: None,
        };
        let error = run(&options).unwrap_err().to_string();
        assert_eq!(error, "QEMU does not emulate nucleo-f446re");
    }
}
