//! The report as one page of HTML that needs nothing else: for a browser, a printer or a talk.
//!
//! The same report gives the same bytes: no date, no folder, no hash of a file that names folders.

mod curve;
mod paths;
mod sections;
mod svg;
mod timeline;

use std::{fmt::Write as _, path::Path};

use anyhow::{Result, bail};
use common::text::separated;
use schedule::{Report, link};

use super::{
    instant::Instant,
    text::{self, calibration, proven_rates, shown_us, utilisation},
};
use svg::escaped;

const STYLE: &str = include_str!("page/style.css");

/// The page. `root` is where the sources are that it quotes.
///
/// # Errors
///
/// When the report contradicts a schedule that can happen.
pub(super) fn page(report: &Report, root: &Path) -> Result<String> {
    let instants = [
        Instant::of_the_most_urgent(report),
        Instant::of_the_least_urgent(report),
    ];
    for instant in &instants {
        if let Some(contradiction) = instant.contradiction(report) {
            bail!("the analysis is wrong: {contradiction}");
        }
    }
    let mut text = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>Leadscrew: proven timing, {}, {} axes</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n",
        escaped(&report.board),
        report.axes
    );
    text += &headline(report);
    text += &promises(report);
    text += &cards(report);
    text += &sections::flaws(report);
    text += &sections::tasks(report);
    text += &timelines(report, &instants);
    text += &heading(
        "Where the cycles go",
        "The longest path through each task, from the machine code, as lines of its source, and \
         what each line costs on it in all.",
    );
    text += &paths::all(report, root);
    text += &slack(report);
    text += &heading(
        "The stack",
        "All tasks share one stack, and a task is preempted by more urgent ones only: the worst case \
         is one task of each priority on top of the other, each at its deepest.",
    );
    text += &curve::stack(report);
    text += &sections::critical(report);
    text += &sections::requirements(report);
    text += &sections::assumptions(report);
    text += &footer(report);
    text += "</main>\n</body>\n</html>\n";
    Ok(text)
}

/// A number whose groups of digits stay on one line.
fn grouped(number: u64) -> String {
    separated(number).replace(' ', "\u{202f}")
}

/// A section's title and what it shows.
fn heading(title: &str, lead: &str) -> String {
    format!(
        "<h2>{}</h2>\n<p class=\"lead\">{}</p>\n",
        escaped(title),
        escaped(lead)
    )
}

/// The verdict.
fn headline(report: &Report) -> String {
    let mut text = format!(
        "<h1>Leadscrew on {}, {} axes, {} MHz</h1>\n",
        escaped(&report.board),
        report.axes,
        report.clock_hz / 1_000_000
    );
    let rate = text::rate(report).filter(|rate| *rate > 0);
    let unmet = text::unmet(report);
    match (report.flaws.len() - unmet, rate) {
        (0, Some(rate)) => {
            let _ = writeln!(
                text,
                "<p class=\"verdict\">Every deadline is met up to <b>{}&nbsp;steps a second</b>.</p>",
                grouped(rate.into())
            );
            if unmet > 0 {
                text += "<p class=\"bad\">More is required: see below.</p>\n";
            }
        }
        (0, None) => {
            text += "<p class=\"verdict no\"><b>No step rate is proven.</b></p>\n";
        }
        (1, _) => text += "<p class=\"verdict no\"><b>Not proven:</b> one thing is wrong.</p>\n",
        (count, _) => {
            let _ = writeln!(
                text,
                "<p class=\"verdict no\"><b>Not proven:</b> {count} things are wrong.</p>"
            );
        }
    }
    let class = if report.calibrated {
        "badge good"
    } else {
        "badge"
    };
    let _ = writeln!(
        text,
        "<p><span class=\"{class}\">{}</span></p>",
        escaped(&calibration(report))
    );
    if !report.calibrated {
        text += "<p class=\"lead\">The bound holds for every path through the flashed machine code, on the \
                 model of the processor in its manuals. That the chip is no slower than the model is to be \
                 measured on a board.</p>\n";
    }
    text
}

/// What is promised, if all is proven.
fn promises(report: &Report) -> String {
    let sentences = text::promises(report);
    let Some((lead, others)) = sentences.split_first() else {
        return String::new();
    };
    let others = escaped(&others.join("\n")).replace('\n', "</li>\n<li>");
    heading("What is promised", lead) + "<ul>\n<li>" + &others + "</li>\n</ul>\n"
}

/// The figures to remember.
fn cards(report: &Report) -> String {
    let mut text = String::from("<div class=\"cards\">\n");
    let mut card = |class: &str, value: &str, unit: &str, what: &str| {
        let _ = writeln!(
            text,
            "<div class=\"card{class}\"><b>{} <small>{}</small></b><span>{}</span></div>",
            escaped(value),
            escaped(unit),
            escaped(what)
        );
    };
    for (baud, rate) in proven_rates(report) {
        let class = if baud == report.baud { " main" } else { "" };
        let what = format!("steps a second proven {}", link("at", baud, grouped));
        card(class, &grouped(rate.into()), "/s", &what);
    }
    card(
        "",
        &grouped(report.step_wcet_cycles),
        "cycles",
        "worst step interrupt, warm cache",
    );
    card(
        "",
        &shown_us(report.step_edge_jitter_us),
        "µs",
        "worst move of an edge on a step pin",
    );
    card(
        "",
        &utilisation(report).map_or("?".into(), |share| format!("{share:.0}")),
        "%",
        &format!(
            "of the processor for all tasks with deadlines, at {} steps a second",
            grouped(report.step_rate_hz.into())
        ),
    );
    card(
        "",
        &grouped(report.stack_worst_bytes),
        "bytes",
        &format!(
            "of stack at worst, of {} there",
            grouped(report.stack_available_bytes)
        ),
    );
    text += "</div>\n";
    text
}

fn timelines(report: &Report, [first, whole]: &[Instant; 2]) -> String {
    if first.players.is_empty() {
        return String::new();
    }
    let mut text = heading(
        "The critical instant",
        "Nothing worse can happen: less urgent code has just begun its longest section that holds others \
         up, and in that moment every task is released at once, then again as soon as it ever can be. The \
         pictures are a simulation of that, with the longest path of every task and a warm cache.",
    );
    text += legend();
    text += &timeline::beginning(report, first);
    text += &timeline::whole(report, whole);
    text += "<p class=\"note\">A proven response time lies behind the end of the task in the picture because \
             the proof also charges misses of the flash cache, and what a preemption costs: lines that have to be \
             fetched again and instructions that have to be begun again.</p>\n";
    text
}

fn legend() -> &'static str {
    "<ul class=\"legend\">\
     <li><svg viewBox=\"0 0 26 14\"><path class=\"release\" d=\"M13 1v9m-3 -4l3 4l3 -4\"/></svg>released</li>\
     <li><svg viewBox=\"0 0 26 14\"><rect class=\"wait t0\" y=\"5\" width=\"26\" height=\"9\"/></svg>waits</li>\
     <li><svg viewBox=\"0 0 26 14\"><rect class=\"run t0\" width=\"26\" height=\"14\"/></svg>runs</li>\
     <li><svg viewBox=\"0 0 26 14\"><path class=\"response\" d=\"M13 0v14\"/></svg>proven response time</li>\
     <li><svg viewBox=\"0 0 26 14\"><path class=\"deadline\" d=\"M13 0v7\"/><path class=\"flag\" d=\"M13 6l-4.5 8h9z\"/></svg>deadline</li>\
     </ul>\n"
}

fn slack(report: &Report) -> String {
    let mut text = String::new();
    if !report.curve.is_empty() {
        text += &heading(
            "How far it is to the limit",
            &format!(
                "What each task has left of its deadline, by step rate, {}. Where the first curve \
                 falls to nothing, the proof ends; the firmware refuses settings that ask for more.",
                link("at", report.baud, grouped)
            ),
        );
        text += &curve::slack(report);
    }
    text += &heading(
        "Where the processor's time goes",
        &format!(
            "At {} steps a second {}, when every release takes its worst time.",
            grouped(report.step_rate_hz.into()),
            link("and", report.baud, grouped)
        ),
    );
    text += &curve::processor(report);
    text
}

fn footer(report: &Report) -> String {
    format!(
        "<footer class=\"note\">Made by <code>cargo xtask schedule --board {}</code> from the firmware's ELF \
         file; docs/scheduling.md explains the proof. {}.</footer>\n",
        escaped(&report.board),
        escaped(&calibration(report))
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::cargo;

    use crate::{sample, text::NOT_CALIBRATED};

    fn made(report: &Report) -> String {
        page(report, cargo::root()).unwrap()
    }

    /// Fails unless every tag that is opened is closed, in its order.
    fn assert_well_formed(page: &str) {
        let mut open = Vec::new();
        for tag in page.split('<').skip(1) {
            let (tag, _) = tag.split_once('>').expect("a tag ends");
            let name = tag
                .split([' ', '/'])
                .find(|word| !word.is_empty())
                .unwrap_or_default();
            if tag.starts_with('/') {
                assert_eq!(open.pop(), Some(name), "</{name}> closes another");
            } else if !tag.ends_with('/') && !tag.starts_with('!') && name != "meta" {
                open.push(name);
            }
        }
        assert!(open.is_empty(), "{open:?} are not closed");
    }

    #[test]
    fn the_page_is_whole_and_needs_nothing_else() {
        for report in [sample::report(), sample::flawed(), sample::empty()] {
            let page = made(&report);
            assert_well_formed(&page);
            for word in [
                "http", "src=", "href=", "@import", "url(", "<script", "NaN", "inf",
            ] {
                assert!(!page.contains(word), "{word}");
            }
        }
    }

    #[test]
    fn the_page_has_the_figures_and_what_is_not_proven() {
        let page = made(&sample::report());
        assert!(page.contains("176\u{202f}000&nbsp;steps a second"));
        assert!(page.contains(NOT_CALIBRATED));
        for task in sample::report().tasks {
            assert!(page.contains(&task.name), "{}", task.name);
        }
        assert!(
            !page.contains(&sample::report().elf_sha256),
            "it depends on the folder"
        );
    }

    #[test]
    fn a_flaw_is_on_the_page_with_place_and_remedy() {
        let page = made(&sample::flawed());
        assert!(page.contains("Not proven:</b> 2 things are wrong"));
        assert!(page.contains("src/protocol/realtime.rs:77"));
        assert!(page.contains("&lt;index&gt; &amp; &quot;bounds&quot;"));
        assert!(page.contains("use `get`, a mask or an iterator"));
    }

    #[test]
    fn the_same_report_gives_the_same_page() {
        assert_eq!(made(&sample::report()), made(&sample::report()));
    }

    #[test]
    fn a_report_that_contradicts_itself_is_not_shown() {
        let mut report = sample::report();
        report.tasks[0].response_cycles = Some(100);
        let error = page(&report, cargo::root()).unwrap_err().to_string();
        assert!(error.contains("response time of `step`"), "{error}");
    }

    /// Leaves the pages of the samples where `KEEP_PAGES` says, to be looked at.
    #[test]
    fn pages_are_less_than_half_a_megabyte() {
        for (name, report) in [("good", sample::report()), ("flawed", sample::flawed())] {
            let page = made(&report);
            assert!(page.len() < 500_000, "{} bytes", page.len());
            if let Some(folder) = std::env::var_os("KEEP_PAGES") {
                std::fs::write(Path::new(&folder).join(format!("{name}.html")), page).unwrap();
            }
        }
    }
}
