//! Rules for what a sender knows by status reports and results of probing.

use std::collections::VecDeque;

use grbl_client::{Report, numbers};
use leadscrew::{
    axis::{AXES, Axes},
    sim::Simulator,
    units::Nm,
};

/// Reports without the work offset between two with it, at most: Grbl sends each thirtieth.
const MOST_WITHOUT_OFFSET: u32 = 29;
/// How far a coordinate may be from its text of three decimals, mm.
const ROUNDING_MM: f64 = 0.0006;
/// The newest places at which the probe has changed.
const PROBE_CHANGES: usize = 32;

/// What the sender knows, and what is true.
#[derive(Default)]
pub(crate) struct ReportRules {
    /// The work offset as it was told last, since the last welcome.
    reported_offset: Option<[f64; AXES]>,
    /// Reports since then.
    without_offset: u32,
    /// The offsets that have been in effect, each with the time at which it came into effect.
    offsets: VecDeque<(u64, Axes<Nm>)>,
    /// Where the machine was when the probe changed, mm.
    probe_changes: VecDeque<Axes<f64>>,
    /// The result of probing that was told last.
    reported_probe: String,
}

impl ReportRules {
    /// The machine has been switched on, or reset: the next report has the work offset.
    pub(crate) fn restart(&mut self) {
        self.reported_offset = None;
        self.without_offset = 0;
    }

    /// Whether the sender has been told a work offset.
    pub(crate) fn knows_offset(&self) -> bool {
        self.reported_offset.is_some()
    }

    /// Notes the work offset in effect. What was before `since` is forgotten.
    pub(crate) fn note_offset(&mut self, simulator: &Simulator, since: u64) {
        let steps = simulator.snapshot().steps;
        let session = simulator.session();
        let position = session.settings().position_of(steps);
        let offset = session.interpreter().work_offset(&position);
        if self.offsets.back().is_none_or(|(_, last)| *last != offset) {
            self.offsets.push_back((simulator.now(), offset));
        }
        while self.offsets.get(1).is_some_and(|(begin, _)| *begin < since) {
            self.offsets.pop_front();
        }
    }

    /// Panics if a report lets the sender believe in an offset that has not been in effect lately.
    pub(crate) fn check_report(&mut self, report: &str, is_rotated: bool) {
        let reported = Report::read(report).expect("a report").work_offset();
        if let Some(reported) = reported {
            self.reported_offset = reported.try_into().ok();
            self.without_offset = 0;
        } else {
            self.without_offset += 1;
        }
        assert!(
            self.without_offset <= MOST_WITHOUT_OFFSET,
            "{} reports have no WCO",
            self.without_offset
        );
        let believed = self.reported_offset.expect("no WCO since the welcome");
        let is_true = |(_, offset): &(u64, Axes<Nm>)| {
            let mut axes = believed.iter().zip(offset);
            axes.all(|(believed, offset)| (believed - offset.0 as f64 * 1.0e-6).abs() < ROUNDING_MM)
        };
        assert!(
            is_rotated || self.offsets.iter().any(is_true),
            "{report} leaves the sender with the offset {believed:?} and not {:?}",
            self.offsets
        );
    }

    /// Notes where the machine is while the probe changes, mm.
    pub(crate) fn note_probe_change(&mut self, place: Axes<f64>) {
        if self.probe_changes.len() == PROBE_CHANGES {
            self.probe_changes.pop_front();
        }
        self.probe_changes.push_back(place);
    }

    /// Panics if a probe is told to have changed where it has not. The machine's own coordinates are those of the
    /// changes if `is_comparable`.
    pub(crate) fn check_probe(&mut self, reported: &str, is_comparable: bool) {
        let place = reported
            .strip_prefix("[PRB:")
            .and_then(|reported| reported.strip_suffix(":1]"));
        if let Some(place) = place.and_then(coordinates)
            && is_comparable
            && reported != self.reported_probe
        {
            let is_at = |change: &Axes<f64>| {
                let mut axes = place.iter().zip(change);
                axes.all(|(reported, true_mm)| (reported - true_mm).abs() < ROUNDING_MM)
            };
            assert!(
                self.probe_changes.iter().any(is_at),
                "{reported}, but the probe has changed at {:?} mm",
                self.probe_changes
            );
        }
        reported.clone_into(&mut self.reported_probe);
    }
}

/// The coordinates in a text, mm.
fn coordinates(text: &str) -> Option<[f64; AXES]> {
    numbers(text)?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use leadscrew::settings::Settings;

    use super::*;
    use crate::quiet::panic_of;

    #[test]
    fn the_work_offset_is_reported_in_each_thirtieth_report() {
        let mut rules = ReportRules::default();
        rules.note_offset(&Simulator::new(&Settings::default()), 0);
        let zeros = ["0.000"; AXES].join(",");
        let without = format!("<Run|MPos:{zeros}|FS:0,0>");
        assert!(panic_of(|| rules.check_report(&without, false)).is_some());
        let ones = ["1.000"; AXES].join(",");
        let with = |offset| format!("<Run|MPos:{zeros}|FS:0,0|WCO:{offset}>");
        let panic = panic_of(|| rules.check_report(&with(&ones), false)).expect("it is 0");
        assert!(
            panic.contains("leaves the sender with the offset"),
            "{panic}"
        );
        rules.check_report(&with(&zeros), false);
        for _ in 0..MOST_WITHOUT_OFFSET {
            rules.check_report(&without, false);
        }
        let panic = panic_of(|| rules.check_report(&without, false)).expect("one too many");
        assert!(panic.contains("30 reports have no WCO"), "{panic}");
    }
}
