//! What the user sees of the comparisons.

use std::collections::BTreeMap;

use anstream::println;
use owo_colors::OwoColorize;

use super::{
    Outcome,
    compare::{Difference, Verdict},
    deviation::Deviation,
};

/// Differences that are printed, per category, unless all are asked for.
const SHOWN: usize = 8;
/// Places that are named for each deviation.
const NAMED: usize = 3;

/// Prints everything.
pub(super) fn all(outcomes: &[Outcome], shows_all: bool) {
    let mut categories: BTreeMap<&str, Vec<&Outcome>> = BTreeMap::new();
    for outcome in outcomes {
        categories
            .entry(&outcome.category)
            .or_default()
            .push(outcome);
    }
    table(&categories);
    deviations(outcomes, shows_all);
    for (category, outcomes) in &categories {
        differences(category, outcomes, shows_all);
    }
}

fn table(categories: &BTreeMap<&str, Vec<&Outcome>>) {
    let head = format!(
        "{:<16}{:>6}{:>8}{:>8}{:>12}{:>9}{:>14}",
        "category", "runs", "rows", "agree", "by design", "differ", "time, median"
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
            "{category:<16}{:>6}{:>8}{:>8}{:>12}{differ_text}{ratio:>14}",
            outcomes.len(),
            outcomes.iter().map(|outcome| outcome.rows).sum::<usize>(),
            count(Verdict::Agrees),
            count(Verdict::ByDesign),
        );
    }
}

/// Motion time over recorded motion time, in the middle of all runs that move.
fn median_ratio(outcomes: &[&Outcome]) -> Option<f64> {
    let mut ratios: Vec<_> = outcomes
        .iter()
        .filter_map(|outcome| Some((outcome.motion_time_s?, outcome.recorded_motion_time_s?)))
        .filter(|(_, recorded)| *recorded > 0.0)
        .map(|(ours, recorded)| ours / recorded)
        .collect();
    ratios.sort_by(f64::total_cmp);
    ratios.get(ratios.len() / 2).copied()
}

/// Names and counts the deviations that are by design, and where they are.
fn deviations(outcomes: &[Outcome], shows_all: bool) {
    let mut places: BTreeMap<Deviation, Vec<String>> = BTreeMap::new();
    for outcome in outcomes {
        for difference in &outcome.differences {
            if let Some(deviation) = difference.by_design {
                let place = match difference.text.split_once(':') {
                    Some((row, _)) if row.starts_with("line ") => {
                        format!("{} {row}", outcome.program)
                    }
                    _ => outcome.program.clone(),
                };
                places.entry(deviation).or_default().push(place);
            }
        }
    }
    if !places.is_empty() {
        println!("\n{}", "by design:".bold());
    }
    for (deviation, mut places) in places {
        let count = places.len();
        let row = deviation.row();
        println!("{count:>6} × {:<8}{}", row.id, row.text);
        places.dedup();
        let shown = if shows_all { places.len() } else { NAMED };
        let more = places.len().saturating_sub(shown);
        let named = places[..places.len() - more].join(", ");
        let more = if more > 0 {
            format!(" and {more} more")
        } else {
            String::new()
        };
        println!("{:17}{}", "", format!("{named}{more}").dimmed());
    }
}

fn differences(category: &str, outcomes: &[&Outcome], shows_all: bool) {
    let is_shown = |difference: &Difference| shows_all || difference.by_design.is_none();
    let shown: Vec<_> = outcomes
        .iter()
        .flat_map(|outcome| {
            outcome
                .differences
                .iter()
                .map(move |found| (outcome, found))
        })
        .filter(|(_, difference)| is_shown(difference))
        .collect();
    if shown.is_empty() {
        return;
    }
    println!("\n{}", format!("{category}:").bold());
    let most = if shows_all { shown.len() } else { SHOWN };
    for (outcome, difference) in shown.iter().take(most) {
        let settings = match outcome.settings.as_str() {
            "" => String::new(),
            settings => format!(" ({settings})"),
        };
        let why = difference.by_design.map_or(String::new(), |deviation| {
            format!(" [{}]", deviation.row().id)
        });
        println!(
            "  {}{settings}{why}\n      {}: {}",
            outcome.program, difference.what, difference.text
        );
    }
    if shown.len() > most {
        println!("  … and {} more", shown.len() - most);
    }
}
