//! The summary of a run: what is printed at its end.

use common::{
    text::{duration, row, separated},
    ui,
};
use owo_colors::OwoColorize;

use crate::{Refusals, figures::Figures, program::encoding_warning};

/// Causes of refusals, and messages, that are printed: a file that is no program has one in each line.
const CAUSES: usize = 24;

/// Prints the summary.
pub fn print(figures: &Figures) {
    let refused = match figures.responses.refused() {
        0 => String::new(),
        count => format!(", {} refused", separated(count)).red().to_string(),
    };
    row("lines", &format!("{}{refused}", separated(figures.lines)));
    let letters = "XYZABC".chars();
    let axes = letters.zip(&figures.end.mpos_mm).zip(&figures.end.steps);
    let ends: Vec<_> = axes
        .map(|((letter, position), steps)| {
            let unit = if "ABC".contains(letter) { "°" } else { "mm" };
            format!("{letter} {position:.3} {unit} ({} steps)", grouped(*steps))
        })
        .collect();
    row(
        "final position",
        &format!("{}, {}", ends.join(", "), figures.end.state),
    );
    row("motion time", &duration(figures.whole_time_s()));
    if let Some(text) = figures.times.text() {
        row("of it", &text);
    }
    let pulses: Vec<_> = "XYZABC"
        .chars()
        .zip(&figures.steps_axis)
        .map(|(letter, count)| format!("{letter} {}", separated(*count)))
        .collect();
    row("steps", &pulses.join(", "));
    let late = match figures.late {
        0 => String::new(),
        count => format!(", {} late", separated(count)).red().to_string(),
    };
    row(
        "step events",
        &format!(
            "{}{late}, hash {}",
            separated(figures.events),
            figures.event_hash
        ),
    );
    print_faults(figures);
}

/// The same for numbers with a sign.
fn grouped(number: i32) -> String {
    let sign = if number < 0 { "-" } else { "" };
    format!("{sign}{}", separated(u64::from(number.unsigned_abs())))
}

/// Prints what was wrong with the program: text that was not sent, what the machine said of it, and refused lines.
pub fn print_faults(figures: &Figures) {
    if let Some(line) = figures.foreign_line {
        ui::warning(&encoding_warning(line));
    }
    for (index, line) in messages(&figures.messages).iter().enumerate() {
        row(if index == 0 { "messages" } else { "" }, line);
    }
    print_refusals(&figures.refusals);
}

/// The messages of the machine, each once and where it came first, but not the one that ends a program.
fn messages(all: &[(u64, String)]) -> Vec<String> {
    let mut kinds: Vec<(&str, u64, u64)> = Vec::new();
    for (answers, line) in all {
        let text = line
            .strip_prefix("[MSG:")
            .and_then(|it| it.strip_suffix(']'));
        let Some(text) = text.filter(|&it| it != "Pgm End") else {
            continue;
        };
        match kinds.iter().position(|(known, ..)| *known == text) {
            Some(index) => kinds[index].2 += 1,
            None if kinds.len() == CAUSES => {}
            None => kinds.push((text, *answers, 1)),
        }
    }
    let rows = kinds.into_iter().map(|(text, answers, count)| {
        let times = match count {
            1 => String::new(),
            count => format!("{} × ", separated(count)),
        };
        format!("{times}{text} (after line {})", separated(answers))
    });
    rows.collect()
}

/// Prints the table of refusals, most frequent first; nothing when no line was refused.
pub fn print_refusals(refusals: &Refusals) {
    for (index, line) in table(refusals).iter().enumerate() {
        row(if index == 0 { "refused" } else { "" }, line);
    }
}

/// The lines of the table.
fn table(refusals: &Refusals) -> Vec<String> {
    let causes = refusals.causes();
    let width = causes.first().map_or(0, |most| separated(most.count).len());
    let rows = causes.iter().take(CAUSES).map(|cause| {
        let count = separated(cause.count);
        let what = match cause.what.as_str() {
            "" => String::new(),
            what => format!("{}: ", what.red()),
        };
        let (why, response, first) = (&cause.why, cause.response, separated(cause.first));
        format!("{count:>width$} × {what}{why} ({response}, first in line {first})")
    });
    let mut rows: Vec<_> = rows.collect();
    if let Some(others) = causes.len().checked_sub(CAUSES + 1) {
        rows.push(format!("and {} more causes", separated(others as u64 + 1)));
    }
    rows
}

#[cfg(test)]
mod tests {
    use leadscrew::axis::AXES;

    use super::*;
    use crate::playing::RaisedAlarm;
    use crate::sender::Response;

    fn refused(lines: &[(&str, u16)]) -> Vec<String> {
        let mut refusals = Refusals::default();
        for (number, (line, error)) in (1..).zip(lines) {
            refusals.add(number, line.as_bytes(), Response::Error(*error));
        }
        plain(&refusals)
    }

    fn plain(refusals: &Refusals) -> Vec<String> {
        let table = table(refusals);
        let lines = table.iter();
        lines
            .map(|line| anstream::adapter::strip_str(line).to_string())
            .collect()
    }

    #[test]
    fn causes_are_counted_and_the_most_frequent_comes_first() {
        let mut lines = vec![("T1 M0106", 20), ("o100 call", 20), ("#1=3", 1)];
        lines.extend([("G1 X[#1+2]", 2), ("M98 P100", 20), ("M106", 20)]);
        lines.extend(vec![("G0 X1 C5.5 (turn)", 20); 1000]);
        let table = refused(&lines);
        if AXES < 6 {
            let built = ["three", "four", "five"][AXES - 3];
            let axis = format!("1 000 × C: this build has {built} axes, --axes 6");
            assert!(table[0].starts_with(&axis), "{table:?}");
            assert!(
                table[0].ends_with("(error:20, first in line 7)"),
                "{table:?}"
            );
        }
        let expected =
            "    2 × M106: this command or word is not supported (error:20, first in line 1)";
        assert!(table.contains(&expected.to_owned()), "{table:#?}");
        let expressions = "O-words and expressions: the machine has no interpreter for them";
        let of_them = table.iter().filter(|line| line.contains(expressions));
        // Each error once: 1, 2, 20.
        assert_eq!(of_them.count(), 3, "{table:#?}");
    }

    #[test]
    fn messages_are_shown_once_with_the_line_before_them() {
        let all = [(3, "[MSG:hello]"), (3, "ALARM:2"), (5, "[MSG:hello]")];
        let end = [(9, "[MSG:Spindle speed is 0]"), (12, "[MSG:Pgm End]")];
        let owned = |&(line, text): &(u64, &str)| (line, text.to_owned());
        let all: Vec<_> = all.iter().chain(&end).map(owned).collect();
        let expected = [
            "2 × hello (after line 3)",
            "Spindle speed is 0 (after line 9)",
        ];
        assert_eq!(messages(&all), expected);
        let different = (0..100).map(|number| (number, format!("[MSG:{number}]")));
        assert_eq!(messages(&different.collect::<Vec<_>>()).len(), CAUSES);
    }

    #[test]
    fn lines_after_an_alarm_are_one_cause_that_names_it() {
        let mut refusals = Refusals::default();
        refusals.raise(RaisedAlarm {
            line: 12,
            text: "X250".into(),
            name: "ALARM:2".into(),
            why: "the target is outside the machine's travel".into(),
        });
        for number in 13..40 {
            let is_printed = refusals.add(number, b"G1 A5 M6", Response::Error(9));
            assert_eq!(is_printed, number < 33);
        }
        let table = plain(&refusals);
        assert_eq!(table.len(), 1);
        let reason = "locked by ALARM:2 at line 12, the target is outside the machine's travel";
        assert!(table[0].starts_with(&format!("27 × {reason}")), "{table:?}");
    }

    #[test]
    fn what_has_a_remedy_names_it() {
        for (line, error, part) in [
            ("$H", 5, "--set '$22=1' --switches"),
            ("G1 X1\x7f5", 2, "a byte of a realtime command"),
            ("G33 X1", 20, "1 × G33: this"),
            ("G5.1 I1", 20, "1 × G5.1: this"),
            ("G1 X1 D3", 20, "1 × D: this"),
            ("G1 G2 X1", 21, "1 × two commands"),
        ] {
            let table = refused(&[(line, error)]);
            assert!(table[0].contains(part), "{line}: {table:?}");
        }
        assert!(refused(&[]).is_empty());
    }

    #[test]
    fn a_file_that_is_no_program_fills_no_page() {
        let numbers: Vec<_> = (200..256).map(|number| format!("G{number}")).collect();
        let lines: Vec<_> = numbers.iter().map(|line| (line.as_str(), 20)).collect();
        let table = refused(&lines);
        assert_eq!(table.len(), CAUSES + 1);
        assert_eq!(table[CAUSES], "and 32 more causes");
    }
}
