//! `cargo xtask calibrate`: measures on a board what the timing analysis takes for granted.
//!
//! The program is `tests/target_calibrate.rs`; the measurements become `calibration/BOARD.toml`,
//! which `cargo xtask schedule` uses where a measured cost is above the manuals'.

mod compare;
mod file;
mod samples;

use std::process::ExitCode;

use anstream::println;
use anyhow::{Context, Result, bail, ensure};
use common::options::Calibrate as Options;
use common::{cargo, tools, ui};
use firmware::boards::Board;
use owo_colors::OwoColorize;
use target::emulator::semihosting;

use self::{
    compare::{Row, compare},
    samples::Measurement,
};
use crate::{flash, on_target};

/// The program.
const TEST: &str = "target_calibrate";

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let board = firmware::boards::named(&options.board)?;
    let output = if options.qemu {
        in_qemu(&board)?
    } else if cfg!(feature = "probe") {
        on_board(&board, options.probe.as_deref())?
    } else {
        return flash::again();
    };
    let measurement = Measurement::read(&output)?;
    let Measurement::Samples(samples) = measurement else {
        bail!(
            "there is no cycle counter: the program runs, but to measure needs a board\n\
             (`cargo xtask calibrate --board {}` without --qemu)",
            board.name
        );
    };
    let rows = compare(&table(&board)?, &samples)?;
    print(&rows);
    let path = file::write(&board, &rows)?;
    ui::status("Written", &path.display().to_string());
    let raised = rows.iter().filter(|row| row.is_above()).count();
    let text = match raised {
        0 => "the table is safe for this board: no class takes longer than it says".into(),
        count => format!("{count} classes take longer than the table says: they are raised"),
    };
    ui::status("Calibrated", &text);
    Ok(ExitCode::SUCCESS)
}

/// Runs the program in QEMU and returns what it prints.
fn in_qemu(board: &Board) -> Result<String> {
    cargo::need_qemu()?;
    ensure!(board.qemu.is_some(), "QEMU does not emulate {}", board.name);
    let elf = on_target::build(board, TEST)?;
    semihosting::output(&elf, elf.parent().unwrap_or(&elf))
}

/// The program runs in QEMU to its end, and says there that it can measure nothing.
pub(crate) fn check() -> Result<()> {
    let (board, _) = firmware::boards::emulated()?;
    let measurement = Measurement::read(&in_qemu(&board)?)?;
    ensure!(
        measurement == Measurement::NoCounter,
        "the program has measured something in QEMU: {measurement:?}"
    );
    Ok(())
}

/// The table of the analysis for a board, without any calibration.
fn table(board: &Board) -> Result<Vec<(String, u64)>> {
    let text = tools::output(tools::SCHEDULE, ["--table", "--board", &board.argument()])?;
    let rows = text.lines().map(|line| {
        let (class, cycles) = line.split_once(' ').context("no cycles")?;
        Ok((class.to_owned(), cycles.parse()?))
    });
    let rows: Result<_> = rows.collect();
    rows.context("the table of the analysis cannot be read")
}

fn print(rows: &[Row]) {
    let head = format!("{:<14}{:>10}{:>8}  verdict", "class", "measured", "table");
    println!("{}", head.bold());
    for row in rows {
        let verdict = if row.is_above() {
            "raised".red().to_string()
        } else {
            "the table is safe".green().to_string()
        };
        println!(
            "{:<14}{:>10}{:>8}  {verdict} ({})",
            row.class, row.measured, row.table, row.variant
        );
    }
}

/// Writes the program to a board and returns what it sends.
#[cfg(not(feature = "probe"))]
fn on_board(board: &Board, _probe: Option<&str>) -> Result<String> {
    bail!("this program has no probe-rs for a {}", board.part.probe_rs)
}

#[cfg(feature = "probe")]
use with_probe::on_board;

#[cfg(feature = "probe")]
mod with_probe {
    use std::{
        thread,
        time::{Duration, Instant},
    };

    use probe_rs::rtt::Rtt;

    use super::{Board, Context, Result, TEST, bail, flash, on_target, samples, ui};

    /// The address of the channels.
    const RTT_SYMBOL: &str = "_SEGGER_RTT";
    /// The name of the program's channel.
    const CHANNEL: &str = "calibrate";
    /// Time for which the probe leaves the chip alone, whose memory it would have to share: the
    /// program measures for less.
    const UNREAD_TIME: Duration = Duration::from_secs(1);
    /// How long the program may take.
    const TIMEOUT: Duration = Duration::from_secs(30);

    /// Writes the program to a board and returns what it sends.
    pub(super) fn on_board(board: &Board, probe: Option<&str>) -> Result<String> {
        let elf = on_target::build(board, TEST)?;
        let place = target::emulator::symbol(&elf, RTT_SYMBOL)?;
        let mut session = flash::start(board, probe, &elf)?;
        let mut core = session.core(0).context("the chip does not answer")?;
        ui::status("Measuring", &board.name);
        let start = Instant::now();
        thread::sleep(UNREAD_TIME);
        let mut text = String::new();
        let mut chunk = [0; 1024];
        let mut channels = None;
        while !samples::is_complete(&text) {
            if start.elapsed() > TIMEOUT {
                bail!("the program does not come to its end; it has said\n{text}");
            }
            if channels.is_none() {
                channels = Rtt::attach_at(&mut core, place).ok();
            }
            let channel = channels
                .as_mut()
                .and_then(|rtt: &mut Rtt| rtt.up_channel(0));
            // Another firmware may have left one.
            let channel = channel.filter(|channel| channel.name() == Some(CHANNEL));
            if channel.is_none() {
                channels = None;
                continue;
            }
            if let Some(channel) = channel {
                let length = channel.read(&mut core, &mut chunk);
                let length = length.context("the chip cannot be read")?;
                text.push_str(&String::from_utf8_lossy(&chunk[..length]));
            }
        }
        Ok(text)
    }
}
