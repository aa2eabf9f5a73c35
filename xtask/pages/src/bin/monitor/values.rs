//! What a status report has beside the position, in words: each field by its name.

use grbl_client::{
    Status,
    words::{accessory_words, mode_words, pin_words, with_set},
};
use leadscrew::axis::LETTERS;

use crate::track::AXES;

/// A name and its value, for the page.
pub(crate) type NamedValue = (String, String);

/// The fields that are shown in words; every other one is shown as it comes.
const WORDED_FIELDS: [&str; 10] = [
    "MPos", "WPos", "WCO", "F", "FS", "Bf", "Ln", "Pn", "Ov", "A",
];

/// What the modes of `$G` are.
#[derive(Debug, Clone, Default)]
pub(crate) struct Modes {
    /// Its words.
    pub(crate) words: Vec<String>,
    /// Lines have been sent since: they may have changed them.
    pub(crate) are_old: bool,
}

/// Returns the values of the newest report, in the unit of the reports.
pub(crate) fn of(status: &Status, modes: &Modes, is_in_inches: bool) -> Vec<NamedValue> {
    let unit = if is_in_inches { "in" } else { "mm" };
    let report = &status.report;
    let mut values = Vec::new();
    let mut add = |name: &str, value: String| {
        if !value.is_empty() {
            values.push((name.to_owned(), value));
        }
    };
    // What was set is known as long as nobody has set anything else.
    let set = if modes.are_old { &[][..] } else { &modes.words };
    if let Some(feed) = report.feed() {
        add("Feed", with_set(feed, &format!("{unit}/min"), set, 'F'));
    }
    if let Some(speed) = report.spindle_speed() {
        add("Spindle", with_set(speed, "rpm", set, 'S'));
    }
    let [feed, rapids, spindle] = status.overrides;
    add(
        "Overrides",
        format!("feed {feed} %, rapids {rapids} %, spindle {spindle} %"),
    );
    add("On", accessory_words(status.accessories()));
    add("Inputs", pin_words(report.pins()));
    for (name, word) in mode_words(&modes.words) {
        // Reports that have it are newer.
        if name != "Tool" || report.field("T").is_none() {
            let since = if modes.are_old { ", at first" } else { "" };
            add(&format!("{name}{since}"), word);
        }
    }
    let room = report.room();
    add(
        "Free",
        room.map_or_else(String::new, |room| {
            format!("{} moves, {} bytes", room.blocks, room.bytes)
        }),
    );
    let line = report.line_number();
    add(
        "Line",
        line.map_or_else(String::new, |line| line.to_string()),
    );
    if let Some(offset) = status.work_offset() {
        add("Work zero", places(offset, 0));
    }
    let (machine, work) = (status.machine_position(), status.work_position());
    let rotary = |place: Option<Vec<f64>>| place.map_or_else(String::new, |it| places(&it, AXES));
    add("Rotary axes, machine", rotary(machine));
    add("Rotary axes, work", rotary(work));
    for (name, value) in &report.fields {
        match name.as_str() {
            "T" => add("Tool", format!("T{value}")),
            other if !WORDED_FIELDS.contains(&other) => add(other, value.clone()),
            _ => {}
        }
    }
    values
}

/// The coordinates of the axes from a number on, with their letters.
fn places(place: &[f64], first: usize) -> String {
    let axes = LETTERS.iter().zip(place).skip(first);
    let axes = axes.map(|(letter, at)| format!("{} {at:.3}", char::from(*letter)));
    axes.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(lines: &[&str], modes: &Modes) -> Vec<String> {
        let mut status = Status::default();
        for line in lines {
            assert!(status.read(line), "{line}");
        }
        let values = of(&status, modes, false);
        let values = values
            .iter()
            .map(|(name, value)| format!("{name}: {value}"));
        values.collect()
    }

    #[test]
    fn every_field_of_a_report_is_shown() {
        let mut modes = Modes {
            words: ["G54", "G21", "T3", "F500"].map(str::to_owned).to_vec(),
            are_old: false,
        };
        let overrides = "<Run|MPos:0.000,0.000,0.000,90.000|FS:0,0|Ov:80,50,110|A:SF>";
        let report = "<Run|MPos:1.000,2.000,3.000,90.000|Bf:12,100|Ln:7|FS:450,9000|Pn:PX\
                      |WCO:1.000,0.000,-0.500,0.000|T:4|SD:3.5>";
        let expected = [
            "Feed: 450 mm/min, set 500",
            "Spindle: 9000 rpm",
            "Overrides: feed 80 %, rapids 50 %, spindle 110 %",
            "On: spindle clockwise, flood",
            "Inputs: probe, limit X",
            "Work system: G54",
            "Unit: mm (G21)",
            "Free: 12 moves, 100 bytes",
            "Line: 7",
            "Work zero: X 1.000, Y 0.000, Z -0.500, A 0.000",
            "Rotary axes, machine: A 90.000",
            "Rotary axes, work: A 90.000",
            "Tool: T4",
            "SD: 3.5",
        ];
        assert_eq!(shown(&[overrides, report], &modes), expected);
        modes.are_old = true;
        let values = shown(&[overrides, report], &modes);
        assert_eq!(values[0], "Feed: 450 mm/min");
        assert!(
            values.contains(&"Work system, at first: G54".into()),
            "{values:?}"
        );
    }
}
