//! The client's part in a probing cycle: one line after the other, each from rest.

use super::{
    Client, Event, Origin, QueuedLine, REST_REPORTS,
    probing::{Cycle, Next, Probing},
};
use crate::{Line, numbers};

/// A cycle, and the client's part in it.
#[derive(Debug)]
pub(super) struct ProbingCycle {
    cycle: Cycle,
    /// What has come of the last line.
    contact: Option<(Vec<f64>, bool)>,
    /// The words that were in force before, once they are known.
    modes: Option<String>,
}

impl Client {
    /// Begins a cycle, where the machine is idle and the probe open.
    pub(super) fn probe(&mut self, probing: Probing) {
        let report = &self.status.report;
        let fault = if !self.is_ready() || !self.is_free() {
            Some("a probing cycle begins at rest alone: the machine has to be idle".into())
        } else if self.in_flight.iter().any(|asked| asked.text == "$$") || !self.are_settings_known
        {
            Some("the settings of the machine are not known yet: try again".into())
        } else if self.state.accessories.contains(['S', 'C']) {
            Some("the spindle turns: stop it first".into())
        } else if report.pins().contains('P') {
            Some(
                "the probe is closed already: move it off the contact, or look at its wires".into(),
            )
        } else {
            probing.fault()
        };
        let start = self.position_mm().filter(|it| it.len() >= LINEAR_AXES);
        match (fault, start) {
            (None, Some(start)) => {
                self.cycle = Some(ProbingCycle {
                    cycle: Cycle::new(probing, start),
                    contact: None,
                    modes: None,
                });
                self.ask(Origin::Own, "$G".into());
            }
            (fault, _) => self.note(Event::Note {
                text: fault.unwrap_or_else(|| "the machine has not told its position".into()),
            }),
        }
    }

    /// Goes on with the cycle, where the machine has come to rest.
    pub(super) fn probe_on(&mut self) {
        if !self.is_ready() || !self.is_answered() || self.reports < REST_REPORTS {
            return;
        }
        let at = self.position_mm().filter(|it| it.len() >= LINEAR_AXES);
        let Some(at) = at else { return };
        let scale = self.mm_per_unit();
        let Some(cycle) = self.cycle.as_mut() else {
            return;
        };
        let contact = cycle.contact.take();
        let next = cycle.cycle.next(&at, contact);
        cycle
            .modes
            .get_or_insert_with(|| restored(&self.state.modes, scale));
        match next {
            Next::Line(line) => self.ask(Origin::Cycle, line),
            Next::Done(line, text) => self.finish_cycle(&text, line),
            Next::Reference(line, text, contact_mm) => {
                self.state.reference_mm = Some(contact_mm);
                self.finish_cycle(&text, line);
            }
            Next::Failed(text) => self.end_cycle(&text),
        }
    }

    fn finish_cycle(&mut self, text: &str, line: String) {
        self.end_cycle(text);
        self.send_line(QueuedLine::new(Origin::Page(None), line));
    }

    /// Ends the cycle for a reason. The modes from before are restored when the machine is at rest.
    pub(super) fn end_cycle(&mut self, text: &str) {
        if let Some(cycle) = self.cycle.take() {
            self.restores = cycle.modes;
            self.note(Event::Note { text: text.into() });
        }
    }

    /// Takes what a line of the cycle was answered.
    pub(super) fn take_contact(&mut self, lines: &[String], response: &str) {
        let scale = self.mm_per_unit();
        let Some(cycle) = &mut self.cycle else { return };
        cycle.contact = lines.iter().rev().find_map(|line| contact(line, scale));
        if response != "ok" {
            self.end_cycle(&format!(
                "the machine refuses a line of the cycle: {response}"
            ));
        }
    }

    /// What a unit of reports is, mm: `$13` has it.
    fn mm_per_unit(&self) -> f64 {
        if self.reports_inches() {
            MM_PER_INCH
        } else {
            1.0
        }
    }

    /// Whether `$13` is 1.
    pub(super) fn reports_inches(&self) -> bool {
        self.settings.get(&REPORTS_INCHES) == Some(&1.0)
    }

    /// The machine position, mm, and degrees of rotary axes.
    pub(super) fn position_mm(&self) -> Option<Vec<f64>> {
        let scale = self.mm_per_unit();
        let mut position = self.status.machine_position()?;
        for value in position.iter_mut().take(LINEAR_AXES) {
            *value *= scale;
        }
        Some(position)
    }
}

/// X, Y and Z.
pub(super) const LINEAR_AXES: usize = 3;
const MM_PER_INCH: f64 = 25.4;
/// The setting of reports in inches.
const REPORTS_INCHES: u16 = 13;

/// Reads `[PRB:1.000,2.000,3.000:1]`: the place of the contact in mm, and whether there was one.
fn contact(line: &str, scale: f64) -> Option<(Vec<f64>, bool)> {
    let Line::Answer("PRB", text) = Line::read(line) else {
        return None;
    };
    let (place, is_touched) = text.split_once(':')?;
    let place: Vec<f64> = numbers(place)?.iter().map(|value| value * scale).collect();
    (place.len() >= LINEAR_AXES).then_some((place, is_touched == "1"))
}

/// The line that makes of the words of a cycle those before: a motion that needs no more words, units, distances,
/// and the feed, which `$G` reports in the unit of reports.
fn restored(modes: &[String], mm_per_unit: f64) -> String {
    let has = |word: &str| modes.iter().any(|mode| mode == word);
    let word = |known: &str, usual: &str| if has(known) { known } else { usual }.to_owned();
    let feed = modes
        .iter()
        .find_map(|word| word.strip_prefix('F')?.parse::<f64>().ok());
    let unit_mm = if has("G20") { MM_PER_INCH } else { 1.0 };
    let feed = feed.filter(|feed| *feed > 0.0 && !has("G93"));
    let feed = feed.map(|feed| format!("F{:.3}", feed * mm_per_unit / unit_mm));
    [
        word("G1", "G0"),
        word("G20", "G21"),
        word("G91", "G90"),
        word("G93", "G94"),
        feed.unwrap_or_default(),
    ]
    .concat()
}
