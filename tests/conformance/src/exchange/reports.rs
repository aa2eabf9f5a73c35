//! Status reports against recorded ones.

use leadscrew::{axis::AXES, model::State};

use super::{
    Exchange, Played,
    pairs::Paired,
    reader::{BYTE_S, Finding, Reader, displacement},
    received::ReceivedLine,
    status::Report,
    stops::Stops,
};
use crate::{compare::Difference, deviation::Deviation};

/// Longest time from a `?` to the first byte of its report, s.
const PROMPT_S: f64 = 0.005;
/// Longest message that may be on the line before it, as a time, s.
const MESSAGE_S: f64 = 0.02;

/// What is known from the reports before.
struct Comparison<'a> {
    exchange: &'a Exchange,
    played: &'a Played,
    stops: &'a Stops,
    /// Grbl's count of reports differs from ours: Grbl left a report out, or the machine was busy for one of the two
    /// and idle for the other.
    is_count_off: bool,
    /// When the report before was sent, in our time.
    since_s: f64,
    /// How far ours stood from Grbl's after the last stop, and when that was seen.
    displaced: Option<(f64, Vec<f64>)>,
}

/// A difference in the reports to one `?`.
type Found = Vec<(String, Option<Deviation>)>;

/// Compares every `?`'s reports.
pub(super) fn compare(
    exchange: &Exchange,
    played: &Played,
    stops: &Stops,
    pairs: &[&Paired],
    found: &mut Vec<Difference>,
) {
    let mut comparison = Comparison {
        exchange,
        played,
        stops,
        is_count_off: false,
        since_s: f64::NEG_INFINITY,
        displaced: None,
    };
    for pair in pairs {
        let name = exchange.step_name(pair.step);
        let differences = comparison.compare(pair).into_iter();
        found.extend(differences.map(|(text, by_design)| Difference {
            what: "report",
            text: format!("step {} {name}: {text}", pair.step + 1),
            by_design,
        }));
    }
}

impl Comparison<'_> {
    fn compare(&mut self, pair: &Paired) -> Found {
        let Some(ours) = &pair.ours else {
            let is_missed = !pair.is_followed;
            return Found::from_iter(is_missed.then(|| ("no report".into(), None)));
        };
        let Ok(report) = ours.text.parse::<Report>() else {
            return vec![(format!("`{}` cannot be read", ours.text), None)];
        };
        let mut found = Found::new();
        found.extend(lateness(self.exchange, pair, ours));
        if !self.is_where_the_axes_are(pair, &report) {
            let text = format!("`{}` is not where the axes are", ours.text);
            found.push((text, None));
        }
        if was_reset(self.played, self.since_s, pair.own_s) {
            self.is_count_off = false;
        }
        self.since_s = pair.own_s;
        match (&pair.theirs, &pair.late) {
            (Some(theirs), _) => found.extend(self.with_theirs(pair, (ours, &report), theirs)),
            (None, Some(late)) => {
                let text = format!("`{}`, Grbl `{}` later", ours.text, late.text);
                found.push((text, self.why_silent(pair)));
            }
            (None, None) => {
                let text = format!("`{}`, Grbl sent none", ours.text);
                found.push((text, self.why_silent(pair)));
                self.is_count_off = true;
            }
        }
        found
    }

    /// Ours against Grbl's.
    fn with_theirs(
        &mut self,
        pair: &Paired,
        (ours, report): (&ReceivedLine, &Report),
        theirs: &ReceivedLine,
    ) -> Found {
        let Ok(their_report) = theirs.text.parse::<Report>() else {
            return Found::new();
        };
        let reader = Reader {
            exchange: self.exchange,
            played: self.played,
            stops: self.stops,
            pair,
            ours: report,
            theirs: &their_report,
        };
        self.is_count_off |= counts_as_busy(&report.state) != counts_as_busy(&their_report.state);
        let mut findings = vec![
            ("state".to_owned(), reader.state()),
            ("fields".to_owned(), reader.names(self.is_count_off)),
            ("position".to_owned(), reader.position()),
        ];
        findings.extend(reader.values());
        let mut found = Found::new();
        let waits = self.exchange.is_after_spindle_stop(pair.step);
        let changes = self.exchange.is_after_speed(pair.step);
        for (what, finding) in findings {
            let text = || format!("{what}: `{}`, Grbl `{}`", ours.text, theirs.text);
            match finding {
                Finding::Same => {}
                Finding::Excused(deviation) => found.push((text(), Some(deviation))),
                Finding::Differs => {
                    let by_design = match what.as_str() {
                        "position" | "FS" => waits.then_some(Deviation::SpindleTime),
                        "fields" => changes.then_some(Deviation::SpeedInMotion),
                        _ => None,
                    };
                    found.push((text(), by_design));
                }
            }
        }
        if reader.stands_still() && !self.stands_as_before(&reader) {
            found.push(("the axes have moved while they stood".into(), None));
        }
        found
    }

    /// Where ours stood after a stop it must still stand, however often that is asked.
    fn stands_as_before(&mut self, reader: &Reader<'_>) -> bool {
        let Some(by) = displacement(reader.ours, reader.theirs) else {
            return true;
        };
        let rounding = reader.ours.rounding_mm() * 2.0;
        let own_s = reader.pair.own_s;
        if by.iter().all(|part| part.abs() <= rounding) {
            self.displaced = None;
            return true;
        }
        let is_same = match &self.displaced {
            Some((since_s, known)) if !self.stops.any_between(*since_s, own_s) => known
                .iter()
                .zip(&by)
                .all(|(a, b)| (a - b).abs() <= rounding * 2.0),
            _ => true,
        };
        self.displaced = Some((own_s, by));
        is_same
    }

    /// Whether a report shows a place at which the axes just were.
    fn is_where_the_axes_are(&self, pair: &Paired, ours: &Report) -> bool {
        let has_time = pair
            .ours
            .as_ref()
            .is_some_and(|received| received.time_s.is_some());
        if !has_time || ours.field("MPos").is_none() {
            return true;
        }
        let samples = self.played.track.between(pair.own_s - 0.03, pair.own_s);
        let scale = self.exchange.scale_at(pair.step);
        let Some(shown) = ours.position_mm() else {
            return false;
        };
        let tolerance = ours.rounding_mm();
        let is_there = |axis: usize| {
            let at = samples
                .iter()
                .map(|sample| f64::from(sample.steps[axis]) / scale[axis]);
            let (least, most) = at.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), at| {
                (least.min(at), most.max(at))
            });
            (least - tolerance..=most + tolerance).contains(&shown[axis])
        };
        shown.len() == AXES && (0..AXES).all(is_there)
    }

    /// Why Grbl was silent: it homes, dwells, waits after an alarm, or for a reset.
    fn why_silent(&self, pair: &Paired) -> Option<Deviation> {
        let state = self.played.track.at(pair.own_s)?.state;
        let waits = state == State::Home || self.exchange.is_dwelling(pair.step);
        let is_locked = self.exchange.is_after_alarm(pair.step);
        (waits || is_locked || pair.is_followed).then_some(Deviation::PromptReports)
    }
}

/// A report that came too late.
fn lateness(
    exchange: &Exchange,
    pair: &Paired,
    ours: &ReceivedLine,
) -> Option<(String, Option<Deviation>)> {
    let step = exchange.step(pair.step)?;
    step.rt.as_ref()?;
    // The `?`, the wait, the report, and its line end of two bytes.
    let wait_s = ours.time_s? - step.t? - BYTE_S * (ours.text.len() + 3) as f64;
    (wait_s > PROMPT_S + MESSAGE_S).then(|| {
        (
            format!("the report came after {:.1} ms", wait_s * 1e3),
            None,
        )
    })
}

/// Whether our machine has welcomed the sender between two times.
fn was_reset(played: &Played, from_s: f64, to_s: f64) -> bool {
    let mut welcomes = played
        .received
        .iter()
        .filter(|received| received.text.starts_with("Grbl "));
    welcomes.any(|received| {
        let time_s = received
            .time_s
            .map_or(played.began_s[received.step], |time_s| {
                played.own_time_s(received.step, time_s)
            });
        from_s < time_s && time_s <= to_s
    })
}

/// Whether reports are counted as those of a busy machine.
fn counts_as_busy(state: &str) -> bool {
    ["Run", "Jog", "Home", "Hold", "Door"]
        .iter()
        .any(|busy| state.starts_with(busy))
}
