//! The parts of the page that are tables and lists.

use std::fmt::Write as _;

use schedule::{Report, Task, link};

use super::{grouped, heading, svg::escaped, timeline::colour};
use crate::text::{self, blocking, known, micros, places, readable, shown, shown_us, wcet};

/// Assumptions that are independent of `schedule.toml`.
const ASSUMPTIONS: [&str; 6] = [
    "The cycle table: one entry for each class of instruction, from Arm's and ST's manuals, each at its \
     longest. It has not been compared with the chip, unless the top of this page names measurements.",
    "The flash cache keeps the lines that were used last, as ST describes it. Where that is not enough \
     for the proof, every line counts as missing each time.",
    "Prefetch of the flash is off, as the firmware sets it up.",
    "Peripherals and memory answer in the time of their bus; nothing else uses the buses.",
    "Pointers stay within the memory that Rust lets them point to.",
    "Faults and the non-maskable interrupt do not occur: after one, the machine stops.",
];

/// Everything that is wrong.
pub(super) fn flaws(report: &Report) -> String {
    let mut text = String::new();
    for flaw in &report.flaws {
        let _ = write!(text, "<div class=\"flaw\"><b>{}</b>", escaped(&flaw.what));
        for place in places(&flaw.place) {
            let _ = write!(text, "<span class=\"code\">{}</span>", escaped(&place));
        }
        let _ = writeln!(text, "<p>{}</p></div>", escaped(&flaw.remedy));
    }
    text
}

/// The table of all tasks.
pub(super) fn tasks(report: &Report) -> String {
    let mut text = heading(
        "The tasks",
        &format!(
            "At {} step pulses a second over all axes {}. A task is proven when its response time, \
             from its release to its end with everything that can come between, is within its deadline.",
            grouped(report.step_rate_hz.into()),
            link("and", report.baud, grouped)
        ),
    );
    text += "<div class=\"scroll\"><table class=\"tasks\">\n<tr><th>task</th><th>priority</th><th>period µs</th>\
             <th>execution cycles</th><th>blocked cycles</th><th>response µs</th><th>deadline µs</th>\
             <th>slack µs</th><th>cache lines</th><th>stack bytes</th></tr>\n";
    let tasks = report.tasks.iter().enumerate();
    for (index, task) in tasks.filter(|(_, task)| task.kind_of.is_none()) {
        row(&mut text, report, task, &colour(index));
    }
    text += "</table></div>\n<ul class=\"note\">\n";
    for (tasks, source) in blocking(report) {
        let _ = writeln!(
            text,
            "<li>Held up: {}, {}</li>",
            escaped(&tasks),
            escaped(&source)
        );
    }
    text += "</ul>\n";
    text
}

fn row(text: &mut String, report: &Report, task: &Task, colour: &str) {
    let us = |cycles: Option<f64>| {
        cycles.map_or("–".to_owned(), |cycles| shown_us(micros(report, cycles)))
    };
    let cycles = |cycles: Option<u64>| cycles.map_or("–".to_owned(), grouped);
    let has_deadline = task.deadline_cycles.is_some();
    let response = task.response_cycles.map(|cycles| cycles as f64);
    let response = if has_deadline && response.is_none() {
        "unbounded".to_owned()
    } else {
        us(response)
    };
    let (class, slack) = match task.slack_us {
        Some(slack) if slack >= 0.0 => (" class=\"good\"", shown_us(slack)),
        Some(slack) => (" class=\"bad\"", shown_us(slack)),
        None if has_deadline => (" class=\"bad\"", "none".into()),
        None => ("", "no deadline".into()),
    };
    let _ = writeln!(
        text,
        "<tr><td><b class=\"ink {colour}\">{}</b> <span class=\"note\">{}</span></td><td>{}</td><td>{}</td>\
         <td>{}</td><td>{}</td><td>{response}</td><td>{}</td><td{class}>{slack}</td><td>{}</td><td>{}</td></tr>",
        escaped(&task.name),
        escaped(&task.vector),
        task.priority,
        us(task.period_cycles),
        cycles(wcet(task)),
        cycles(has_deadline.then_some(task.blocking_cycles)),
        us(task.deadline_cycles),
        task.icache_lines,
        grouped(task.stack_bytes),
    );
}

/// Every stretch of code that holds tasks up.
pub(super) fn critical(report: &Report) -> String {
    if report.sections.is_empty() {
        return String::new();
    }
    let mut text = heading(
        "Sections that hold tasks up",
        "Every place in the image, library code too, where interrupts are off or held back, found in the \
         machine code.",
    );
    text += "<div class=\"scroll\"><table>\n<tr><th>where</th><th>in priority</th><th>holds up</th>\
             <th>cycles</th></tr>\n";
    let mut sections: Vec<_> = report.sections.iter().collect();
    sections.sort_by_key(|section| (section.exempt.is_some(), std::cmp::Reverse(section.cycles)));
    for section in sections {
        let ceiling = match section.ceiling {
            Some(ceiling) => format!("priorities to {ceiling}"),
            None => "all tasks".into(),
        };
        let exempt = section.exempt.as_ref().map_or(String::new(), |reason| {
            format!(
                " <span class=\"note\">not counted: {}</span>",
                escaped(reason)
            )
        });
        let _ = writeln!(
            text,
            "<tr><td class=\"text\"><span class=\"code\">{}</span>{exempt}</td><td>{}</td><td>{ceiling}</td><td>{}</td></tr>",
            escaped(&readable(&section.place)),
            section.priority,
            grouped(section.cycles)
        );
    }
    text += "</table></div>\n";
    text
}

/// The requirements of `schedule.toml`.
pub(super) fn requirements(report: &Report) -> String {
    if report.requirements.is_empty() {
        return String::new();
    }
    let mut text = heading(
        "What is required",
        "The analysis fails when one of these is not met.",
    );
    text += "<div class=\"scroll\"><table>\n<tr><th>what</th><th>required</th><th>found</th><th></th></tr>\n";
    for row in &report.requirements {
        let (class, verdict) = if row.is_met {
            ("good", "met")
        } else {
            ("bad", "not met")
        };
        let _ = writeln!(
            text,
            "<tr><td>{}</td><td>{} {unit}</td><td>{} {unit}</td><td class=\"{class}\">{verdict}</td></tr>",
            escaped(&row.what),
            shown(row.required),
            shown(row.found),
            unit = escaped(&row.unit)
        );
    }
    text += "</table></div>\n";
    text
}

/// The assumptions of the proof.
pub(super) fn assumptions(report: &Report) -> String {
    let mut text = heading(
        "What is taken for granted",
        "A proof is as good as what it stands on. This one stands on:",
    );
    text += "<ul>\n";
    let all = ASSUMPTIONS
        .into_iter()
        .chain(report.assumptions.iter().map(String::as_str));
    for assumption in all {
        let _ = writeln!(text, "<li>{}</li>", escaped(assumption));
    }
    text += "</ul>\n";
    text += &figures(report);
    text += &believed(report);
    text += "<p>Not proven: how fast G-code is read and planned (that has no deadline: when it is late, \
             the machine slows down on its path and waits); what happens after a fault; anything about \
             mechanics or electronics beyond the pins.</p>\n";
    text
}

/// The bounds of loops that nothing counts.
fn believed(report: &Report) -> String {
    let lines = text::believed(report);
    let lines = lines
        .iter()
        .map(|line| format!("<li>{}</li>\n", escaped(line)));
    format!(
        "<p>Loops that nothing counts run no more often than these comments say:</p>\n<ul>\n{}</ul>\n",
        lines.collect::<String>()
    )
}

/// The numbers that the proof counts on.
fn figures(report: &Report) -> String {
    if report.figures.is_empty() {
        return String::new();
    }
    let mut text = String::from(
        "<p>The numbers that it counts on, which no analysis of the code gives:</p>\n\
         <div class=\"scroll\"><table>\n<tr><th>numbers of schedule.toml</th><th>what they claim</th>\
         <th>how far that is known</th></tr>\n",
    );
    for figures in &report.figures {
        text += "<tr><td class=\"text\">";
        for (name, formula) in &figures.formulas {
            let line = escaped(&format!("{name} = {formula}"));
            let _ = write!(text, "<span class=\"code\">{line}</span> ");
        }
        let _ = writeln!(
            text,
            "</td><td class=\"text\">{}</td><td class=\"text\">{}</td></tr>",
            escaped(&figures.claim),
            escaped(&known(figures))
        );
    }
    text + "</table></div>\n"
}
