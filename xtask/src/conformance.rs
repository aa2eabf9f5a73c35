//! `cargo xtask conformance`: recorded programs against the virtual machine.

mod compare;
mod golden;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

use anstream::println;
use anyhow::{Context, Result, ensure};
use owo_colors::OwoColorize;
use serde::Serialize;

use self::{
    compare::{Difference, Verdict},
    golden::Case,
};
use crate::{figures, sim, ui};

/// Replay recorded programs and compare with what Grbl did
///
/// DIR holds `golden/CATEGORY/NAME.grbl.json` and the programs that they name. Each program runs
/// once with each of its recorded sets of settings. Answers, messages, final steps, steps per axis
/// and motion time are compared; deviations that are by design are named and counted, and any other
/// difference makes the exit status 1.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// The recorded data
    dir: PathBuf,
    /// Only this category; repeatable
    #[arg(long, value_name = "NAME")]
    category: Vec<String>,
    /// Write every comparison as JSON
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
}

/// Differences that are printed, per category.
const SHOWN: usize = 8;

/// One comparison.
#[derive(Debug, Serialize)]
struct Outcome {
    category: String,
    program: String,
    settings: String,
    verdict: Verdict,
    motion_time_s: f64,
    recorded_motion_time_s: f64,
    differences: Vec<Difference>,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let cases = golden::load(&options.dir, &options.category)?;
    ensure!(
        !cases.is_empty(),
        "there is nothing to compare in {}: it should hold golden/CATEGORY/NAME.grbl.json",
        options.dir.display()
    );
    let outcomes = replay_all(&options.dir, &cases)?;
    let mut categories: BTreeMap<&str, Vec<&Outcome>> = BTreeMap::new();
    for outcome in &outcomes {
        categories
            .entry(&outcome.category)
            .or_default()
            .push(outcome);
    }
    print_table(&categories);
    print_deviations(&outcomes);
    for (category, outcomes) in &categories {
        print_differences(category, outcomes);
    }
    if let Some(path) = &options.json {
        figures::write_json(path, &outcomes)?;
    }
    let differs = |outcome: &Outcome| outcome.verdict == Verdict::Differs;
    Ok(ExitCode::from(u8::from(outcomes.iter().any(differs))))
}

/// Runs every case, on every core.
fn replay_all(dir: &Path, cases: &[Case]) -> Result<Vec<Outcome>> {
    let bar = ui::progress(cases.len() as u64, "programs");
    let (next, outcomes) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let work = || -> Result<()> {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(case) = cases.get(index) else {
                return Ok(());
            };
            let outcome = replay(dir, case).with_context(|| {
                format!("{} with settings {}", case.program, case.settings_name)
            })?;
            let mut outcomes = outcomes.lock().expect("no other thread panicked");
            outcomes.push((index, outcome));
            bar.inc(1);
        }
    };
    let threads = thread::available_parallelism().map_or(1, usize::from);
    thread::scope(|scope| {
        let running: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        running
            .into_iter()
            .try_for_each(|thread| thread.join().expect("a replay does not panic"))
    })?;
    bar.finish_and_clear();
    let mut outcomes = outcomes.into_inner().expect("no other thread panicked");
    outcomes.sort_by_key(|(index, _)| *index);
    Ok(outcomes.into_iter().map(|(_, outcome)| outcome).collect())
}

fn replay(dir: &Path, case: &Case) -> Result<Outcome> {
    let path = dir.join(&case.program);
    let settings = case.settings()?;
    let figures = sim::play(&path, &settings)?;
    let traits = golden::Traits::of(&path, &settings)?;
    let differences = compare::compare(&case.run, &figures, &traits);
    Ok(Outcome {
        category: case.category.clone(),
        program: case.program.clone(),
        settings: case.settings_name.clone(),
        verdict: Verdict::of(&differences),
        motion_time_s: figures.motion_time_s,
        recorded_motion_time_s: case.run.motion_time_s,
        differences,
    })
}

fn print_table(categories: &BTreeMap<&str, Vec<&Outcome>>) {
    let head = format!(
        "{:<16}{:>6}{:>8}{:>12}{:>9}{:>14}",
        "category", "runs", "agree", "by design", "differ", "time, median"
    );
    println!("{}", head.bold());
    for (category, outcomes) in categories {
        let count = |verdict| {
            let matching = outcomes.iter().filter(|outcome| outcome.verdict == verdict);
            matching.count()
        };
        let differ = count(Verdict::Differs);
        let differ_text = format!("{differ:>9}");
        let differ_text = if differ == 0 {
            differ_text.green().to_string()
        } else {
            differ_text.red().bold().to_string()
        };
        let ratio = median_ratio(outcomes).map_or("-".into(), |ratio| format!("{ratio:.3}"));
        println!(
            "{category:<16}{:>6}{:>8}{:>12}{differ_text}{ratio:>14}",
            outcomes.len(),
            count(Verdict::Agrees),
            count(Verdict::ByDesign),
        );
    }
}

/// Motion time over recorded motion time, in the middle of all runs that move.
fn median_ratio(outcomes: &[&Outcome]) -> Option<f64> {
    let moving = outcomes
        .iter()
        .filter(|outcome| outcome.recorded_motion_time_s > 0.0);
    let mut ratios: Vec<_> = moving
        .map(|outcome| outcome.motion_time_s / outcome.recorded_motion_time_s)
        .collect();
    ratios.sort_by(f64::total_cmp);
    ratios.get(ratios.len() / 2).copied()
}

/// Names and counts the deviations that are by design.
fn print_deviations(outcomes: &[Outcome]) {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for difference in outcomes.iter().flat_map(|outcome| &outcome.differences) {
        if let Some(reason) = difference.by_design {
            *counts.entry(reason).or_default() += 1;
        }
    }
    if !counts.is_empty() {
        println!("\n{}", "by design:".bold());
    }
    for (reason, count) in counts {
        println!("{count:>6} × {reason}");
    }
}

fn print_differences(category: &str, outcomes: &[&Outcome]) {
    let unexplained: Vec<_> = outcomes
        .iter()
        .flat_map(|outcome| {
            outcome
                .differences
                .iter()
                .map(move |found| (outcome, found))
        })
        .filter(|(_, difference)| difference.by_design.is_none())
        .collect();
    if unexplained.is_empty() {
        return;
    }
    println!("\n{}", format!("{category}:").bold());
    for (outcome, difference) in unexplained.iter().take(SHOWN) {
        let place = format!("{} ({})", outcome.program, outcome.settings);
        println!("  {place}\n      {}: {}", difference.what, difference.text);
    }
    if unexplained.len() > SHOWN {
        println!("  … and {} more", unexplained.len() - SHOWN);
    }
}
