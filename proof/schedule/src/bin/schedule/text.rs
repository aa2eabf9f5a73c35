//! The report as a table in the terminal.

use std::{collections::BTreeMap, fmt::Write as _, iter};

use common::text::separated;
use owo_colors::OwoColorize;
use schedule::{Flaw, KnownFigures, LoopCounts, Place, Report, Requirement, Rule, Task, link};

/// Says what a proof without measurements is.
pub(super) const NOT_CALIBRATED: &str = "model-proven, not silicon-calibrated";

/// A number of cycles in microseconds.
pub(super) fn micros(report: &Report, cycles: f64) -> f64 {
    cycles * 1e6 / report.clock_hz.max(1) as f64
}

/// Microseconds with as many digits as are worth reading.
pub(super) fn shown_us(us: f64) -> String {
    match us.abs() {
        0.0..10.0 => format!("{us:.2}"),
        10.0..100.0 => format!("{us:.1}"),
        _ => {
            let sign = if us < 0.0 { "-" } else { "" };
            format!("{sign}{}", separated(us.abs().round() as u64))
        }
    }
}

/// What is promised, and by which row.
const PROMISES: [(&str, &str); 8] = [
    ("No step comes late", "step"),
    ("No received byte is lost", "serial_rx"),
    ("Each packet of the host is taken in time", "usb"),
    ("The laser and the position follow", "segment_start"),
    ("A limit switch, the probe or a button is read", "inputs"),
    ("The motion does not run out of steps", "prepare: segment"),
    ("Nor with limits of jerk", "prepare: jerk_limited_segment"),
    ("A feed hold or a reset is taken up", "prepare: requests"),
];

/// What a proof promises, a sentence each, the first about the others; nothing, where a deadline can be missed.
pub(super) fn promises(report: &Report) -> Vec<String> {
    if report.flaws.len() > unmet(report) {
        return Vec::new();
    }
    let us = |cycles| shown_us(micros(report, cycles));
    let rows = PROMISES.iter().filter_map(|(promise, name)| {
        let task = report.tasks.iter().find(|task| task.name == *name)?;
        let (response, deadline) = (us(task.response_cycles? as f64), us(task.deadline_cycles?));
        Some(format!(
            "{promise}: {name} takes {response} of {deadline} µs."
        ))
    });
    let point = (report.step_rate_hz, report.baud);
    let mut waits = report.undeadlined_waits.iter();
    let wait = waits.find(|it| (it.step_rate_hz, it.baud) == point);
    let wait = wait.and_then(|it| it.cycles).map(|cycles| {
        let wait = us(cycles as f64);
        format!(
            "A status request (?) waits {wait} µs for these, and besides for the line being read."
        )
    });
    let (hz, link) = (separated(point.0.into()), link("and", point.1, separated));
    let lead = format!(
        "At {hz} steps a second of all axes {link}, whatever comes together, from release to end at most:"
    );
    iter::once(lead).chain(rows).chain(wait).collect()
}

/// How far figures are known, and the files that keep or check them.
pub(super) fn known(figures: &KnownFigures) -> String {
    format!("{}: {}", figures.known, figures.by.join(", "))
}

/// Where the cycle table is from.
pub(super) fn calibration(report: &Report) -> String {
    match (&report.calibration, report.calibrated) {
        (Some(file), true) => format!("cycle table measured on a board: {file}"),
        _ => NOT_CALIBRATED.into(),
    }
}

/// Share of the processor for tasks with deadlines, percent, when that is known.
pub(super) fn utilisation(report: &Report) -> Option<f64> {
    (report.utilisation > 0.0).then_some(report.utilisation * 100.0)
}

/// Step rates by their baud rates, in words.
fn rates_shown(rates: &BTreeMap<String, u32>) -> String {
    let shown = sorted(rates).into_iter().map(|(baud, rate)| match rate {
        0 => format!("none at {}", separated(baud.into())),
        rate => format!(
            "{} Hz at {}",
            separated(rate.into()),
            separated(baud.into())
        ),
    });
    let shown: Vec<_> = shown.collect();
    match rates.get("0") {
        Some(0) => "none over USB".into(),
        Some(rate) => format!("{} Hz over USB", separated((*rate).into())),
        None if shown.is_empty() => "none".into(),
        None => format!("{} baud", shown.join(", ")),
    }
}

/// The highest proven step rates, by rising baud rate.
pub(super) fn proven_rates(report: &Report) -> Vec<(u32, u32)> {
    sorted(&report.proven_step_rate_hz)
}

fn sorted(rates: &BTreeMap<String, u32>) -> Vec<(u32, u32)> {
    let rates = rates.iter();
    let mut rates: Vec<_> = rates
        .filter_map(|(baud, rate)| Some((baud.parse().ok()?, *rate)))
        .collect();
    rates.sort_unstable();
    rates
}

/// The analysed program, its rates, and how far to trust the report.
pub(super) fn heading(report: &Report) -> Vec<String> {
    vec![
        format!(
            "{}, {} axes, {} MHz",
            report.board,
            report.axes,
            report.clock_hz / 1_000_000
        ),
        format!(
            "table for {} steps a second (all axes together) {}",
            separated(report.step_rate_hz.into()),
            link("and", report.baud, separated)
        ),
        format!("{}, ELF {:.12}", calibration(report), report.elf_sha256),
    ]
}

/// One requirement of `schedule.toml`.
pub(super) fn requirement(row: &Requirement) -> String {
    let verdict = if row.is_met { "" } else { ": not met" };
    format!(
        "{} {} {unit}, found {} {unit}{verdict}",
        row.what,
        shown(row.required),
        shown(row.found),
        unit = row.unit
    )
}

/// Whole numbers in groups, others with two decimals.
pub(super) fn shown(value: f64) -> String {
    if value.fract() == 0.0 && value >= 0.0 {
        separated(value as u64)
    } else {
        format!("{value:.2}")
    }
}

/// The highest proven step rate at the baud rate of the table.
pub(super) fn rate(report: &Report) -> Option<u32> {
    let rates = &report.proven_step_rate_hz;
    rates.get(&report.baud.to_string()).copied()
}

/// Requirements that are not met: flaws that leave the proven rates valid.
pub(super) fn unmet(report: &Report) -> usize {
    let flaws = report.flaws.iter();
    flaws.filter(|flaw| flaw.rule == Rule::Requirement).count()
}

/// The verdict of the analysis, in a sentence.
pub(super) fn verdict(report: &Report) -> String {
    let unmet = unmet(report);
    match (report.flaws.len() - unmet, rate(report)) {
        (0, Some(rate)) if rate > 0 => format!(
            "every deadline is met up to {} steps a second {} ({}){}",
            separated(rate.into()),
            link("at", report.baud, separated),
            calibration(report),
            if unmet > 0 {
                ", but more is required"
            } else {
                ""
            }
        ),
        (0, _) => "no step rate".into(),
        (1, _) => "one thing is wrong".into(),
        (count, _) => format!("{count} things are wrong"),
    }
}

/// The tasks with deadlines, one line each, and who holds them up.
pub(super) fn tasks(report: &Report) -> String {
    let rows = || report.tasks.iter().filter(|task| task.kind_of.is_none());
    let names = rows().map(|task| task.name.len());
    let first = names.max().unwrap_or_default() + 1;
    let mut text = format!(
        "{:<first$}{:>5}{:>8}{:>10}{:>9}{:>11}{:>10}{:>10}{:>6}{:>7}\n",
        "task",
        "prio",
        "period",
        "WCET",
        "blocked",
        "response",
        "deadline",
        "slack",
        "lines",
        "stack"
    );
    let units = [
        "", "", "µs", "cycles", "cycles", "µs", "µs", "µs", "", "bytes",
    ];
    let widths = [first, 5, 8, 10, 9, 11, 10, 10, 6, 7];
    for (unit, width) in units.iter().zip(widths) {
        let _ = write!(text, "{unit:>width$}");
    }
    text.push('\n');
    for task in rows() {
        text += &row(report, task, first);
    }
    text
}

fn row(report: &Report, task: &Task, first: usize) -> String {
    let us = |cycles: Option<f64>, none: &str| {
        cycles.map_or(none.to_owned(), |cycles| shown_us(micros(report, cycles)))
    };
    let has_deadline = task.deadline_cycles.is_some();
    let response = match task.response_cycles {
        None if has_deadline => "unbounded".to_owned(),
        response => us(response.map(|cycles| cycles as f64), "-"),
    };
    let cycles = |cycles: Option<u64>| cycles.map_or("-".to_owned(), separated);
    format!(
        "{:<first$}{:>5}{:>8}{:>10}{:>9}{response:>11}{:>10}{:>10}{:>6}{:>7}\n",
        task.name,
        task.priority,
        us(task.period_cycles, "-"),
        cycles(wcet(task)),
        cycles(has_deadline.then_some(task.blocking_cycles)),
        us(task.deadline_cycles, "none"),
        task.slack_us.map_or("-".to_owned(), shown_us),
        task.icache_lines,
        separated(task.stack_bytes),
    )
}

/// The execution time of a task: with a cold cache, where its response time is not known.
pub(super) fn wcet(task: &Task) -> Option<u64> {
    let bound = task.wcet.map(|wcet| match wcet.cold {
        0 => wcet.uncached,
        cold => cold,
    });
    task.wcet_cycles.or(bound)
}

/// A place or a reason, without the paths of RTIC's own types.
pub(super) fn readable(place: &str) -> String {
    let resource = place.split_once("shared_resources::");
    let resource = resource.and_then(|(_, name)| name.split_once("_that_needs_to_be_locked"));
    match (resource, place.rsplit_once(" (")) {
        (Some((name, _)), Some((_, line))) => format!("the lock of `{name}` ({line}"),
        (Some((name, _)), None) => format!("the lock of `{name}`"),
        (None, _) if place.is_empty() => "a transfer on the bus that must end first".into(),
        (None, _) => place.into(),
    }
}

/// The blocking of each task.
pub(super) fn blocking(report: &Report) -> Vec<(String, String)> {
    let mut found: Vec<(String, Vec<&str>)> = Vec::new();
    for task in &report.tasks {
        if task.blocking_cycles == 0 || task.deadline_cycles.is_none() {
            continue;
        }
        let source = format!(
            "{} cycles: {}",
            separated(task.blocking_cycles),
            readable(&task.blocking_source)
        );
        match found.iter_mut().find(|(known, _)| *known == source) {
            Some((_, names)) => names.push(&task.name),
            None => found.push((source, vec![&task.name])),
        }
    }
    let joined = found
        .into_iter()
        .map(|(source, names)| (names.join(", "), source));
    joined.collect()
}

/// How long tasks without deadlines wait for the others, at each rate.
fn waits(report: &Report) -> String {
    if report.undeadlined_waits.is_empty() {
        return "unknown".into();
    }
    let waits = report.undeadlined_waits.iter().map(|it| {
        let us = match it.us(report.clock_hz) {
            f64::INFINITY => "unbounded".to_owned(),
            us => format!("{} µs", shown_us(us)),
        };
        let (hz, link) = (
            separated(it.step_rate_hz.into()),
            link("and", it.baud, separated),
        );
        format!("{us} at {hz} Hz {link}")
    });
    let waits = waits.collect::<Vec<_>>().join(", ");
    format!("at most {waits}, before the line being read and their own time")
}

/// The tasks without a deadline: how their loops end, and how long they take besides.
fn undeadlined(report: &Report) -> Option<(&'static str, String)> {
    let it = report.undeadlined.as_ref()?;
    let cycles_text = it.rest_cycles.map_or("unknown".into(), |cycles| {
        let us = shown_us(micros(report, cycles as f64));
        format!("{us} µs at most, alone on the processor,")
    });
    let uncounted: usize = it.uncounted.iter().map(|loops| loops.places.len()).sum();
    Some((
        "no deadline",
        format!(
            "{}: {cycles_text} for a run of each, and the rounds of {uncounted} loops that nothing counts; {} others are counted",
            it.tasks.join(", "),
            it.counted,
        ),
    ))
}

/// The loops of tasks without a deadline that nothing counts, by what ends them; and the bounds that are believed.
pub(super) fn uncounted_loops(report: &Report) -> Vec<String> {
    let entries = report.undeadlined.iter().flat_map(|it| &it.uncounted);
    let lines = entries.flat_map(|loops| {
        let heading = format!("{} loops: {}", loops.places.len(), loops.reason);
        let places = loops.places.iter().map(|place| format!("  {place}"));
        [heading].into_iter().chain(places)
    });
    lines.chain(believed(report)).collect()
}

/// How far the bounds of the loops of each row are known.
fn loop_bounds(report: &Report) -> String {
    let rows = report
        .tasks
        .iter()
        .filter(|task| task.loops != LoopCounts::default());
    let rows = rows.map(|task| {
        let it = task.loops;
        let [counted, stated, believed] = [it.counted, it.counted_and_stated, it.believed];
        format!("{} {counted} + {stated} + {believed}", task.name)
    });
    let rows = rows.collect::<Vec<_>>().join(", ");
    format!("counted + counted and stated + believed: {rows}")
}

/// The bounds that are believed.
pub(super) fn believed(report: &Report) -> Vec<String> {
    let believed = report.believed.iter();
    let lines = believed.map(|it| format!("{}: {}: {}", it.place, it.count, it.reason));
    lines.collect()
}

/// The figures under the table: name and value.
pub(super) fn figures(report: &Report) -> Vec<(&'static str, String)> {
    let rates = rates_shown(&report.proven_step_rate_hz);
    let uncached = rates_shown(&report.uncached_step_rate_hz);
    let stack = report.stack_worst_bytes as f64 / report.stack_available_bytes.max(1) as f64;
    let lines = report
        .tasks
        .iter()
        .map(|task| format!("{} {}", task.name, task.icache_lines));
    let substitution = report.substitution.as_ref().map(|substitution| {
        format!(
            "{} may come instead of {} steps, and costs as much as {:.2} at most",
            substitution.row, substitution.units, substitution.costs
        )
    });
    let substitution = substitution.map(|substitution| ("substitution", substitution));
    let facts = [
        (
            "utilisation",
            utilisation(report).map_or("unknown".into(), |share| format!("{share:.1} %")),
        ),
        ("proven step rate", rates),
        ("without the cache", uncached),
        ("`?` and lines wait", waits(report)),
        (
            "step interrupt",
            format!(
                "{} cycles at most with a warm cache",
                report.step_wcet_cycles
            ),
        ),
        (
            "pin-edge jitter",
            format!("{:.2} µs at most", report.step_edge_jitter_us),
        ),
        ("cache lines", lines.collect::<Vec<_>>().join(", ")),
        ("releases", releases(report)),
        ("constants", constants(report)),
        ("loop bounds", loop_bounds(report)),
        (
            "stack",
            format!(
                "{} of {} bytes, {:.0} %",
                separated(report.stack_worst_bytes),
                separated(report.stack_available_bytes),
                stack * 100.0
            ),
        ),
    ];
    let facts = facts.into_iter().chain(undeadlined(report));
    facts.chain(substitution).collect()
}

/// What each task releases.
fn releases(report: &Report) -> String {
    let all = report.releases.iter().filter(|(_, of)| !of.is_empty());
    let all = all.map(|(task, of)| {
        let of: Vec<&str> = of.iter().map(String::as_str).collect();
        format!("{task}: {}", of.join(", "))
    });
    all.collect::<Vec<_>>().join("; ")
}

/// The constants of the program, and those that are times in µs.
fn constants(report: &Report) -> String {
    let all = report.constants.iter().map(|(name, value)| {
        let ticks_us = value * 1e6 / report.timer_hz.max(1) as f64;
        match name.rsplit('_').next() {
            Some("TICKS") => format!("{name} = {} µs", shown(ticks_us)),
            Some("US") => format!("{name} = {} µs", shown(*value)),
            _ => format!("{name} = {}", shown(*value)),
        }
    });
    all.collect::<Vec<_>>().join(", ")
}

/// One flaw: description, place and remedy.
pub(super) fn flaw(flaw: &Flaw) -> String {
    let mut text = format!("{} {}", "error:".red().bold(), flaw.what);
    for (index, place) in places(&flaw.place).into_iter().enumerate() {
        let lead = if index == 0 { "at" } else { "in" };
        let _ = write!(text, "\n{:>9} {place}", lead.dimmed());
    }
    let _ = write!(text, "\n{:>9} {}", "do".dimmed(), flaw.remedy);
    text
}

/// Where something is: its lines, or its address where there are none.
pub(super) fn places(place: &Place) -> Vec<String> {
    match (place.frames.as_slice(), place.address) {
        ([], 0) => Vec::new(),
        ([], address) => vec![format!("{address:#010x}")],
        (frames, _) => frames.to_vec(),
    }
}

#[cfg(test)]
mod tests {
    use schedule::{TasksWithoutDeadline, UncountedLoops};

    use super::*;
    use crate::sample;

    #[test]
    fn the_table_fits_a_hundred_columns_and_names_its_units() {
        let text = tasks(&sample::report());
        for line in text.lines() {
            assert!(line.chars().count() <= 100, "{line}");
        }
        let lines: Vec<_> = text.lines().collect();
        assert_eq!(lines.len(), 2 + 6);
        assert!(
            lines[1].contains("cycles") && lines[1].contains("µs") && lines[1].contains("bytes")
        );
        let words: Vec<_> = lines[2].split_whitespace().collect();
        assert_eq!(
            words,
            [
                "step", "5", "3.33", "220", "54", "1.85", "2.00", "0.15", "24", "104"
            ]
        );
        let words: Vec<_> = lines[7].split_whitespace().collect();
        assert_eq!(
            words,
            ["wake", "1", "-", "-", "-", "-", "none", "-", "0", "0"]
        );
    }

    #[test]
    fn what_is_promised_is_said_where_no_deadline_is_missed() {
        let sentences = promises(&sample::report());
        assert!(sentences.len() <= 10 && sentences[0].starts_with("At 150 000 steps"));
        assert_eq!(
            sentences[1],
            "No step comes late: step takes 1.85 of 2.00 µs."
        );
        assert!(sentences.concat().contains("(?) waits 4 225 µs for these"));
        assert!(promises(&sample::flawed()).is_empty());
    }

    #[test]
    fn loops_that_nothing_counts_are_reported_with_what_ends_them() {
        let mut report = sample::report();
        let is_no_deadline = |(name, _): &(&str, String)| *name == "no deadline";
        assert!(!figures(&report).iter().any(is_no_deadline));
        report.undeadlined = Some(TasksWithoutDeadline {
            tasks: vec!["interpret".into()],
            counted: 7,
            fed: 1,
            uncounted: vec![UncountedLoops {
                reason: "the end of the line".into(),
                places: vec!["read: a (src/a.rs:1)".into(), "read: a (src/a.rs:9)".into()],
            }],
            rest_cycles: Some(168_000),
        });
        let (_, text) = figures(&report).into_iter().find(is_no_deadline).unwrap();
        assert!(text.starts_with("interpret: 1 000 µs at most"), "{text}");
        assert!(
            text.contains("2 loops") && text.ends_with("7 others are counted"),
            "{text}"
        );
        let lines = uncounted_loops(&report);
        assert_eq!(lines[0], "2 loops: the end of the line");
        assert_eq!(lines[2], "  read: a (src/a.rs:9)");
        if let Some(it) = &mut report.undeadlined {
            it.rest_cycles = None;
        }
        let (_, text) = figures(&report).into_iter().find(is_no_deadline).unwrap();
        assert!(text.starts_with("interpret: unknown"), "{text}");
    }

    #[test]
    fn a_task_that_never_answers_is_said_to_be_unbounded() {
        let mut report = sample::report();
        report.tasks[4].response_cycles = None;
        report.tasks[4].slack_us = None;
        assert!(tasks(&report).contains("unbounded"));
    }

    #[test]
    fn tasks_that_wait_for_the_same_are_reported_together() {
        let rows = blocking(&sample::report());
        assert_eq!(rows[0].0, "step, serial_rx, segment_start");
        assert!(rows[0].1.starts_with("54 cycles: rtic::pend in"));
        assert_eq!(rows.len(), 3);
    }

    #[test]
    fn what_is_required_and_not_met_does_not_spoil_what_is_proven() {
        let mut report = sample::report();
        report.flaws = sample::flawed().flaws;
        assert_eq!(verdict(&report), "2 things are wrong");
        for flaw in &mut report.flaws {
            flaw.rule = Rule::Requirement;
        }
        let text = verdict(&report);
        assert!(
            text.contains("176 000 steps a second at 115 200 baud"),
            "{text}"
        );
        assert!(text.ends_with("but more is required"), "{text}");
    }

    #[test]
    fn a_lock_is_reported_by_the_name_of_its_resource() {
        let place = "leadscrew::app::app::<impl rtic_core::Mutex for leadscrew::app::app::\
                     shared_resources::snapshot_that_needs_to_be_locked>::lock (src/app.rs:23)";
        assert_eq!(readable(place), "the lock of `snapshot` (src/app.rs:23)");
        assert_eq!(readable("erase (src/a.rs:1)"), "erase (src/a.rs:1)");
        assert!(readable("").contains("bus"));
    }

    #[test]
    fn a_constant_that_is_a_time_has_its_unit() {
        let constants = [("A_TICKS", 128.0), ("B_US", 700.0), ("C", 2048.0)];
        let report = Report {
            constants: constants
                .map(|(name, value)| (name.to_owned(), value))
                .into(),
            timer_hz: 84_000_000,
            ..Report::default()
        };
        assert_eq!(
            super::constants(&report),
            "A_TICKS = 1.52 µs, B_US = 700 µs, C = 2 048"
        );
    }

    #[test]
    fn a_flaw_has_its_place_and_what_to_do() {
        let text = flaw(&sample::flawed().flaws[0]);
        let text = anstream::adapter::strip_str(&text).to_string();
        let lines: Vec<_> = text.lines().map(str::trim_start).collect();
        assert!(lines[0].starts_with("error: a loop that"));
        assert!(lines[1].starts_with("at leadscrew::protocol::realtime::receive (src/"));
        assert!(lines[2].starts_with("in app::app::step"));
        assert!(lines[3].starts_with("do write `// wcet-bound"));
    }

    #[test]
    fn without_a_calibration_the_report_says_so() {
        let mut report = sample::report();
        assert_eq!(calibration(&report), NOT_CALIBRATED);
        report.calibrated = true;
        report.calibration = Some("calibration/nucleo-f446re.toml".into());
        assert!(calibration(&report).contains("calibration/nucleo-f446re.toml"));
    }

    #[test]
    fn rates_are_in_the_order_of_their_baud_rates() {
        let bauds: Vec<_> = proven_rates(&sample::report())
            .into_iter()
            .map(|(baud, _)| baud)
            .collect();
        assert_eq!(bauds, [115_200, 250_000, 500_000, 1_000_000]);
    }
}
