//! The figures in `docs/benchmarks.md`: written there, and compared with fresh ones.

use std::fmt::Write as _;

use anyhow::{Context, Result, bail};
use common::{check::Verdict, document, text::separated};

use super::figures::{Cost, Figure};

const PAGE: &str = "docs/benchmarks.md";
const BEGIN: &str = "<!-- begin: cargo xtask bench --write -->\n";
const END: &str = "<!-- end of bench -->\n";
/// The figure whose terms the page shows.
const OF_TASKS: &str = "cycles_per_g1_line";
/// How far a fresh figure may be from the one that is shown: bytes and lines arrive in the host's time.
const TOLERANCE: f64 = 0.02;
/// The least share of a figure that is shown as one of its terms.
const LEAST_SHARE: f64 = 0.01;
/// The column of the cycles, where the text before the first `|` counts.
const CYCLES: usize = 2;
/// What a figure above its target is marked with.
const MISSED: &str = ", **missed**";

/// The figures of grblHAL, counted in the same model.
const GRBLHAL: [(&str, &str); 7] = [
    ("step_isr_mean_cycles", "278 to 327, both its interrupts"),
    ("step_isr_max_cycles", "502"),
    ("cycles_per_step_1axis", "278, its interrupts alone"),
    (
        "cycles_per_period_3axis",
        "305, its interrupts alone, with 14 to 30 % interval error",
    ),
    (OF_TASKS, "8 155, with 10 ms segments"),
    ("cycles_parse_g1_line", "2 868"),
    ("cycles_replan_100_blocks", "5 808, both its passes"),
];

/// What the errors of intervals are called.
pub(super) const INTERVAL_ERROR_LABEL: &str = "Interval error of 3 axes at 100, 73, 51 kHz, rms";

/// What the cycles of a short line are for, by task.
const PURPOSES: [(&str, &str); 4] = [
    ("serial_rx", "a run for each byte"),
    (
        "interpret, report",
        "parsing; exact steps, geometry, limits, the corner and the entry; its run, the way to the queue and the answer",
    ),
    (
        "prepare",
        "one job in a run: the profile, and the axes' motion over each segment",
    ),
    ("segment_start", "once a segment"),
];

/// What the page shows, and the compiler whose code that is.
pub(super) struct Page {
    block: String,
    compiler: String,
}

impl Page {
    pub(super) fn new(
        figures: &[Figure],
        interval_errors: [f64; 3],
        board: &str,
        compiler: &str,
    ) -> Self {
        let compiler = compiler.split(" (").next().unwrap_or(compiler).to_owned();
        let mut block = format!(
            "`cargo xtask bench` on {board}, {compiler}:\n\n\
             | figure | cycles | target | grblHAL in the same model |\n|---|---|---|---|\n"
        );
        for figure in figures {
            let target = figure.target.map_or_else(String::new, |most| {
                let missed = if figure.cost.cycles > most {
                    MISSED
                } else {
                    ""
                };
                shown(most) + missed
            });
            let peer = GRBLHAL.iter().find(|(key, _)| *key == figure.key);
            let peer = peer.map_or("", |(_, text)| text);
            let _ = writeln!(
                block,
                "| {} | {} | {target} | {peer} |",
                figure.meaning.trim_start(),
                shown(figure.cost.cycles)
            );
        }
        let _ = writeln!(
            block,
            "\n{INTERVAL_ERROR_LABEL}: {}, of X, Y and Z. grblHAL: 14 to 30 %.",
            percents(interval_errors)
        );
        block += "\nWhere the cycles of a short G1 line go:\n\n| task | cycles | what for |\n|---|---|---|\n";
        let mut row = |name: &str, cost: Cost, what: &str| {
            let _ = writeln!(block, "| {name} | {} | {what} |", shown(cost.cycles));
        };
        for figure in figures.iter().filter(|figure| figure.key == OF_TASKS) {
            let least = LEAST_SHARE * figure.cost.cycles;
            for (task, cost) in figure.parts.iter().filter(|(_, cost)| cost.cycles > least) {
                let purpose = PURPOSES.iter().find(|(name, _)| name == task);
                row(task, *cost, purpose.map_or("", |(_, text)| text));
            }
            let times = figure.step_times.unwrap_or_default();
            row("`prepare` besides", times, "the times of the line's steps");
        }
        Self { block, compiler }
    }

    /// Writes the page.
    pub(super) fn write(&self) -> Result<()> {
        document::write_part(PAGE, BEGIN, END, &self.block)
    }

    /// Fails when the page shows other rows, or figures that are farther from fresh ones than chance explains.
    pub(super) fn check(&self) -> Result<Verdict> {
        let old = document::read(PAGE)?;
        let new = document::with_part(&old, BEGIN, END, &self.block);
        let new = new.with_context(|| format!("{PAGE} has no line {BEGIN}"))?;
        if !old.contains(&format!(", {}:\n", self.compiler)) {
            return Ok(Verdict::Skipped(format!(
                "{PAGE} shows the code of another compiler than {}",
                self.compiler
            )));
        }
        if let Some((old, new)) = difference(&old, &new) {
            bail!(
                "{PAGE} is out of date, where it says\n{old}\nand not\n{new}\nrun `cargo xtask bench --write`"
            );
        }
        Ok(Verdict::Counted(format!("{PAGE} shows these figures")))
    }
}

/// Parts as percent.
pub(super) fn percents(parts: [f64; 3]) -> String {
    let [x, y, z] = parts.map(|part| 100.0 * part);
    format!("{x:.2}, {y:.2}, {z:.2} %")
}

/// A number of cycles as the page shows it.
fn shown(cycles: f64) -> String {
    separated(cycles.round() as u64)
}

/// The first lines of two texts that differ by more than chance explains.
fn difference<'a>(old: &'a str, new: &'a str) -> Option<(&'a str, &'a str)> {
    let (mut old, mut new) = (old.lines(), new.lines());
    loop {
        match (old.next(), new.next()) {
            (None, None) => return None,
            (Some(old), Some(new)) if is_close(old, new) => {}
            (old, new) => return Some((old.unwrap_or_default(), new.unwrap_or_default())),
        }
    }
}

/// Whether the cells of two lines are the same, but for cycles that are as close as chance makes them.
fn is_close(old: &str, new: &str) -> bool {
    let cells = |line: &str| {
        let cells = line.split('|').map(|cell| cell.replace(MISSED, ""));
        cells.collect::<Vec<_>>()
    };
    let number = |cell: &str| cell.replace(' ', "").parse::<f64>();
    let is_same =
        |(column, (old, new)): (usize, (&String, &String))| match (number(old), number(new)) {
            (Ok(old), Ok(new)) if column == CYCLES => (new - old).abs() <= TOLERANCE * old,
            _ => old == new,
        };
    let (old, new) = (cells(old), cells(new));
    old.len() == new.len() && old.iter().zip(&new).enumerate().all(is_same)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_of_another_form_or_with_other_figures_is_out_of_date() {
        let old = "a:\n\n| x | 10 000 | 8 000, **missed** | 7 |\n| y | 30 | | |\n";
        let with = |from: &str, to: &str| old.replace(from, to);
        for chance in [old.to_owned(), with("10 000", "10 190"), with(MISSED, "")] {
            assert_eq!(difference(old, &chance), None, "{chance}");
        }
        let row = "| x | 10 000 | 8 000, **missed** | 7 |";
        for (from, to) in [
            ("10 000", "11 000"),
            ("8 000", "9 000"),
            ("| 7 |", "| |"),
            ("| x", "| z"),
        ] {
            let new = with(from, to);
            let found = difference(old, &new);
            assert_eq!(found, Some((row, &*row.replace(from, to))));
        }
        let longer = with("| y", "| more | 1 | | |\n| y");
        assert!(difference(old, &longer).is_some() && difference(&longer, old).is_some());
    }
}
