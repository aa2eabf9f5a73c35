//! `cargo xtask rehearse --faults`: whether the rehearsal of a board finds faults of the board's code, and names them.

use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use common::ui;

use super::{Fault, Sources, faults, is_found};

/// The table of faults.
pub(super) const TABLE: &str = "tests/virtual_board/faults.toml";

/// The board that is rehearsed, where a fault names none.
const BOARD: &str = "btt-skr-2";

/// Looks for each fault whose name contains `name`.
pub(crate) fn run(name: &str) -> Result<ExitCode> {
    let copy = Sources::new();
    let mut is_right = true;
    let all = faults(TABLE)?;
    let chosen: Vec<_> = all.iter().filter(|it| it.name.contains(name)).collect();
    ensure!(
        !chosen.is_empty(),
        "no fault of {TABLE} has that in its name"
    );
    for fault in chosen {
        let named = fault.message.as_deref();
        let named = named.with_context(|| format!("{}: no message", fault.name))?;
        let output = rehearse(&copy, fault).with_context(|| fault.name.clone())?;
        let mut lines = output.iter().flat_map(|output| output.lines());
        let line = lines.find(|line| line.contains(named));
        match (output.is_some(), line) {
            (_, Some(line)) => ui::status("Found", &format!("{}: {}", fault.name, line.trim())),
            (true, None) => ui::status("Unnamed", &fault.name),
            (false, None) => ui::status("Missed", &fault.name),
        }
        is_right &= line.is_some();
    }
    copy.restore()?;
    Ok(if is_right {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

/// What the rehearsal of a board with a fault says, if it fails.
fn rehearse(copy: &Sources, fault: &Fault) -> Result<Option<String>> {
    copy.insert(fault)?;
    let board = fault.board.as_deref().unwrap_or(BOARD);
    copy.build(&["build", "--package=xtask"])?;
    let mut command = copy.cargo(&["xtask", "rehearse", "--short", "--board", board]);
    let output = command.output()?;
    let message = [output.stdout, output.stderr].concat();
    let message = String::from_utf8_lossy(&message).into_owned();
    ensure!(
        !message.contains("error: could not compile"),
        "the compiler finds it\n{message}"
    );
    Ok(is_found(output.status)?.then_some(message))
}
