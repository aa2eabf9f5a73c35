//! `cargo xtask bring-up`: whether a board is what the firmware counts on.
//!
//! The program is `tests/target_bring_up.rs`, which measures and says facts; [`checks`] judges them. The report
//! is `bring-up/BOARD-NUMBER.json`, with the unique number of the chip, and a page with the same name.

mod checks;
mod emulated;
mod exchange;
mod facts;
mod priorities;
mod probed;
mod report;
#[path = "../../../tests/bring_up/sequence.rs"]
#[allow(dead_code, reason = "the board has the other half")]
mod sequence;
mod stream;
mod virtual_board;

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use anstream::println;
use anyhow::{Context, Result, ensure};
use common::options::BringUp as Options;
use common::{cargo, check, ui};
use firmware::boards::{Board, FlashSector};
use owo_colors::OwoColorize;

use self::{
    checks::{Expected, Verdict, chip_number, judge},
    facts::Facts,
    report::Report,
};
use crate::{flash, on_target};

/// The program.
const TEST: &str = "target_bring_up";
/// The table of vectors, and the end of the statics, after which the guard of the stack lies.
const VECTORS: &str = "__vector_table";
const STATICS_END: &str = "__sheap";
/// The beginning and the end of variables with a value in RAM, and where their values are in the flash, as the last
/// of the program.
const DATA_SYMBOLS: [&str; 3] = ["__sdata", "__edata", "__sidata"];
/// `GUARD_BYTES` of `src/board/stack.rs`.
const GUARD_BYTES: u64 = 4096;

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    if let Some(path) = &options.verify {
        report::verify(&firmware::boards::compile::read(path)?)?;
        ui::status("Verified", "the report is as it was written");
        return Ok(ExitCode::SUCCESS);
    }
    let name = options.board.as_deref().context("no board is named")?;
    let mut board = firmware::boards::named(name)?;
    let needs_probe = !options.qemu && !options.virtual_board;
    if needs_probe && !cfg!(feature = "probe") {
        return flash::again();
    }
    ensure!(
        !options.qemu || board.qemu.is_some(),
        "QEMU does not emulate {name}"
    );
    if options.qemu {
        board = board.in_emulator()?;
    }
    let elf = on_target::build(&board, TEST)?;
    let last = board.memory(cargo::axes().into()).last;
    check_room(image_end(&elf)?, last)?;
    let facts = if options.qemu {
        emulated::run(&elf)?
    } else if options.virtual_board {
        virtual_board::run(&board, &elf)?
    } else {
        ui::warning(&format!(
            "the firmware on the board is replaced, and sector {} of its flash erased, from {:#x} on; the settings \
             stay. Afterwards: cargo xtask flash --board {name}",
            last.sector, last.address
        ));
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

/// Returns the address after the program in the flash.
fn image_end(elf: &Path) -> Result<u64> {
    let [start, end, values] = DATA_SYMBOLS.map(|name| target::emulator::symbol(elf, name));
    Ok(values? + (end? - start?))
}

/// The sector that is erased holds nothing of the program.
fn check_room(image_end: u64, sector: FlashSector) -> Result<()> {
    ensure!(
        image_end <= sector.address.into(),
        "the program ends at {image_end:#x}, in sector {} or behind it, which it erases",
        sector.sector
    );
    Ok(())
}

/// Judges the facts of a program.
fn report(board: &Board, elf: &Path, facts: Facts) -> Result<Report> {
    let checks = judge(&facts, &expected(board, elf)?);
    let image = firmware::boards::compile::read(elf)?;
    Ok(Report::new(board, &image, facts, checks))
}

/// Returns what the facts must be.
fn expected(board: &Board, elf: &Path) -> Result<Expected> {
    let guard = target::emulator::symbol(elf, STATICS_END)?.next_multiple_of(GUARD_BYTES);
    Ok(Expected {
        chip: chip_number(&board.chip.hal),
        flash_kib: board.part.flash_kib.into(),
        wait_states: board.chip.clocks.flash_wait_states.into(),
        core_hz: i64::from(board.chip.clocks.core_mhz) * 1_000_000,
        vectors: target::emulator::symbol(elf, VECTORS)?.cast_signed(),
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
const OPEN_IN_QEMU: usize = 40;

/// Every fact that the emulator can measure passes.
pub(crate) fn check() -> Result<check::Verdict> {
    let (board, _) = firmware::boards::emulated()?;
    let elf = on_target::build(&board, TEST)?;
    let report = report(&board, &elf, emulated::run(&elf)?)?;
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
    check_flawed(&board, &elf)?;
    let passed = items.len() - open;
    Ok(check::Verdict::Counted(format!("{passed} parts passed")))
}

/// The checks that fail with a flash that does not erase, with a serial line that damages bytes,
/// and without the guard of the stack.
const FAILED_WITH_FLAWS: [&str; 10] = [
    "size of the guard",
    "control of the guard",
    "guard of the stack",
    "wrong among those to it",
    "erase: bytes",
    "words: bytes",
    "erase of these words: done",
    "erase of these words: bytes",
    "stack too deep: made",
    "processor faults told to the sender",
];

/// Each flaw is noticed: a stack without a guard before it overwrites anything. The program comes to its end.
fn check_flawed(board: &Board, elf: &Path) -> Result<()> {
    let facts = emulated::run_flawed(elf, &[emulated::UNGUARDED, emulated::WORN_FLASH])?;
    let report = report(board, elf, facts)?;
    let items = report.checks().iter().flat_map(|check| &check.items);
    let failed = items.filter(|item| item.verdict == Verdict::Failed);
    let failed: Vec<_> = failed.map(|item| item.name.as_str()).collect();
    ensure!(
        failed == FAILED_WITH_FLAWS,
        "with flaws these fail: {failed:?}"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_reaches_the_sector_which_it_erases_is_refused() {
        let sector = firmware::boards::named("nucleo-f446re")
            .unwrap()
            .memory(3)
            .last;
        assert_eq!((sector.sector, sector.address), (7, 0x0806_0000));
        assert!(check_room(0x0806_0000, sector).is_ok());
        let error = check_room(0x0806_0001, sector).unwrap_err().to_string();
        assert!(error.contains("in sector 7"), "{error}");
    }

    #[test]
    fn a_board_that_the_emulator_does_not_have_is_refused_before_anything_is_compiled() {
        let options = Options {
            board: Some("nucleo-f446re".into()),
            probe: None,
            port: None,
            qemu: true,
            virtual_board: false,
            verify: None,
        };
        let error = run(&options).unwrap_err().to_string();
        assert_eq!(error, "QEMU does not emulate nucleo-f446re");
    }
}
