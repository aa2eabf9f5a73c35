//! Settings of a file to a machine: only what differs, in an order that the machine accepts.

use std::path::Path;

use anstream::println;
use anyhow::{Context as _, Result, anyhow, bail};
use common::ui;
use grbl_client::{Machine, Response, answer};
use leadscrew::settings::Settings;
use simulation::settings::{self, Dump, Entry};

use crate::compare::{self, Difference};

/// The settings of a file, of two with one number the later one.
///
/// # Errors
/// Every line that cannot be read.
pub(crate) fn wanted(file: &Path, dump: &Dump) -> Result<Vec<Entry>> {
    let entries = settings::last_of_each(&dump.entries);
    let nothing = settings::combine(&Settings::default(), &[]);
    settings::check(Some(file), dump, nothing)?;
    if entries.is_empty() {
        bail!("{} has no settings", file.display());
    }
    Ok(entries)
}

/// The settings of the machine that this tool knows.
pub(crate) fn settings(machine: &mut Machine) -> Result<Vec<Entry>> {
    Ok(Dump::read(&machine.settings()?.join("\n")).entries)
}

/// Changes the machine's settings to those of a file.
///
/// # Errors
/// Every setting that is refused: before anything is sent, where the machine is of this firmware.
pub(crate) fn load(machine: &mut Machine, file: &Path, dump: &Dump) -> Result<()> {
    let wanted = wanted(file, dump)?;
    let before = settings(machine)?;
    let is_there = |entry: &Entry| compare::value(&before, entry.number).is_some();
    let (there, missing): (Vec<_>, Vec<_>) = wanted.into_iter().partition(is_there);
    let missing: Vec<_> = missing
        .iter()
        .map(|entry| format!("${}", entry.number))
        .collect();
    if !missing.is_empty() {
        let names = Dump::in_ranges(&missing).join(", ");
        ui::warning(&format!("the machine does not have {names}"));
    }
    let order = in_order(machine, file, dump, &before, there)?;
    let differs = |entry: &Entry| {
        let has = compare::value(&before, entry.number);
        !has.is_some_and(|has| compare::is_equal(entry, has))
    };
    let (pending, equal): (Vec<_>, Vec<_>) = order.into_iter().partition(differs);
    if pending.is_empty() {
        ui::status("Equal", &format!("{} settings", equal.len()));
        return Ok(());
    }
    let refused = send(machine, pending.clone())?;
    report(machine, &before, &pending, &refused)
}

/// The settings in an order that a machine of this firmware accepts, and checked as that one would.
fn in_order(
    machine: &mut Machine,
    file: &Path,
    dump: &Dump,
    before: &[Entry],
    wanted: Vec<Entry>,
) -> Result<Vec<Entry>> {
    let version = machine.ask("$I", machine.timeout)?.lines;
    // Other firmware does not tell.
    let Some(step_rate) = version.iter().find_map(|line| answer::step_rate(line)) else {
        return Ok(wanted);
    };
    // What is stored may be more than this firmware is proven for: then the machine decides.
    let Ok(now) = settings::combine(&Settings::new(step_rate), before) else {
        return Ok(wanted);
    };
    let combined = settings::combine(&now.settings, &wanted);
    Ok(settings::check(Some(file), dump, combined)?.order)
}

/// Sends settings, those that are refused again after the others as long as that helps. Returns what
/// stays refused, with the numbers of the errors.
fn send(machine: &mut Machine, mut pending: Vec<Entry>) -> Result<Vec<(Entry, u16)>> {
    loop {
        let before = pending.len();
        let mut refused = Vec::new();
        for entry in pending {
            let text = format!("${}", entry.statement());
            let answer = machine.ask(&text, machine.timeout);
            match answer.context("not all was sent: see --diff")?.response {
                Response::Ok => {}
                // It is in a state in which it takes none.
                Response::Error(number @ (8 | 9)) => return Err(machine.refused(&text, number)),
                Response::Error(number) => refused.push((entry, number)),
            }
        }
        if refused.is_empty() || refused.len() == before {
            return Ok(refused);
        }
        pending = refused.into_iter().map(|(entry, _)| entry).collect();
    }
}

/// Reads the settings back, and tells what has changed.
///
/// # Errors
/// What is refused, or not as it was sent.
fn report(
    machine: &mut Machine,
    before: &[Entry],
    sent: &[Entry],
    refused: &[(Entry, u16)],
) -> Result<()> {
    let after = settings(machine)?;
    let value = |entries: &[Entry], number| compare::value(entries, number).unwrap_or("-").into();
    let changes: Vec<_> = sent
        .iter()
        .filter(|entry| !refused.iter().any(|(other, _)| other == *entry))
        .map(|entry| Difference {
            number: entry.number,
            left: value(before, entry.number),
            right: value(&after, entry.number),
        })
        .collect();
    if !changes.is_empty() {
        println!("{}", compare::table("before", "now", &changes));
    }
    let mut wrong: Vec<_> = refused
        .iter()
        .map(|(entry, number)| machine.refused(&format!("${}", entry.statement()), *number))
        .map(|error| error.to_string())
        .collect();
    let differences = compare::compare(sent, &after).differences.into_iter();
    let others = differences.filter(|difference| {
        let number = difference.number;
        !refused.iter().any(|(entry, _)| entry.number == number)
    });
    wrong.extend(others.map(
        |Difference {
             number,
             left,
             right,
         }| { format!("${number}={left} was accepted, and the machine shows {right}") },
    ));
    if wrong.is_empty() {
        ui::status("Loaded", &format!("{} settings", changes.len()));
        return Ok(());
    }
    let title = format!("{} of {} settings are not loaded", wrong.len(), sent.len());
    Err(anyhow!(wrong.join("\n")).context(title))
}
