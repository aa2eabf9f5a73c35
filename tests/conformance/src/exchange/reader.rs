//! Two status reports, and how far they may differ at that time.

use super::{
    Exchange, Played,
    pairs::Paired,
    status::{Report, is_rounded_otherwise, is_tie, numbers},
    stops::{Allowance, Stops},
};
use crate::deviation::Deviation;
use simulation::session::track::Sample;

/// Two times that are the same, s.
pub(super) const SAME_S: f64 = 0.05;
/// What the axes may be apart in motion, as a time at their speed, s.
const MOTION_S: f64 = 0.03;
/// How far ahead Grbl's speed is of its position: that of the segment prepared last, s.
const GRBL_AHEAD_S: f64 = 0.06;
/// How long before and after a report the way is looked at, s.
const NEAR_S: f64 = 2.0;
/// Time of one byte on the line, s.
pub(super) const BYTE_S: f64 = 10.0 / 115_200.0;

/// What comes of a comparison.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Finding {
    /// Near enough.
    Same,
    /// A deviation explains it.
    Excused(Deviation),
    /// Nothing does.
    Differs,
}

impl Finding {
    fn excused_if(is_excused: bool, deviation: Deviation) -> Self {
        if is_excused {
            Self::Excused(deviation)
        } else {
            Self::Differs
        }
    }
}

/// How far ours is from Grbl's, mm.
pub(super) fn displacement(ours: &Report, theirs: &Report) -> Option<Vec<f64>> {
    let (ours, theirs) = (ours.position_mm()?, theirs.position_mm()?);
    (ours.len() == theirs.len()).then(|| ours.iter().zip(&theirs).map(|(a, b)| a - b).collect())
}

/// Two reports, and what is known of the machine then.
pub(super) struct Reader<'a> {
    pub(super) exchange: &'a Exchange,
    pub(super) played: &'a Played,
    pub(super) stops: &'a Stops,
    pub(super) pair: &'a Paired,
    pub(super) ours: &'a Report,
    pub(super) theirs: &'a Report,
}

impl Reader<'_> {
    /// What stops in motion allow, and how far ours is ahead.
    fn allowance(&self) -> Allowance {
        let time_s = self.pair.ours.as_ref().and_then(|received| received.time_s);
        let ahead_s = time_s.map_or(0.0, |time_s| self.exchange.ahead_s(time_s));
        let mut allowed = self.stops.allowance(self.pair.own_s);
        allowed.seconds += ahead_s;
        allowed
    }

    /// Why something differs that a stop or our being ahead may explain.
    fn excuse(&self) -> Deviation {
        if self.stops.allowance(self.pair.own_s).mm > 0.0 {
            Deviation::ShortStops
        } else {
            Deviation::NoPause
        }
    }

    /// The machine around the time of the report.
    fn samples(&self, tolerance_s: f64) -> &[Sample] {
        let at = self.pair.own_s;
        self.played
            .track
            .between(at - tolerance_s, at + tolerance_s)
    }

    /// Whether nothing moves, for either.
    pub(super) fn stands_still(&self) -> bool {
        let samples = self.samples(SAME_S);
        self.theirs.feed_mm_min() == 0.0
            && samples
                .windows(2)
                .all(|pair| pair[0].steps == pair[1].steps)
    }

    /// The state, or one that the machine had just before or after.
    pub(super) fn state(&self) -> Finding {
        if self.ours.state == self.theirs.state {
            return Finding::Same;
        }
        let has = |tolerance_s| {
            let samples = self.samples(tolerance_s);
            samples
                .iter()
                .any(|sample| sample.state.name() == self.theirs.state)
        };
        if has(SAME_S) {
            return Finding::Same;
        }
        let allowed = self.allowance().seconds;
        Finding::excused_if(allowed > 0.0 && has(SAME_S + allowed), self.excuse())
    }

    /// Which fields there are. `is_count_off`: those that only some reports have may differ.
    pub(super) fn names(&self, is_count_off: bool) -> Finding {
        if self.ours.names() == self.theirs.names() {
            return Finding::Same;
        }
        let is_lit = |names: &[&str]| names.last().is_some_and(|name| *name == "A");
        if self.is_dark_hold() && is_lit(&self.theirs.names()) && !is_lit(&self.ours.names()) {
            return Finding::Excused(Deviation::DarkHold);
        }
        if self.exchange.has_mist(self.pair.step)
            && self.ours.lasting_names() == self.theirs.lasting_names()
        {
            return Finding::Excused(Deviation::Mist);
        }
        let is_count = is_count_off && self.ours.lasting_names() == self.theirs.lasting_names();
        Finding::excused_if(is_count, Deviation::PromptReports)
    }

    /// The position: exact at rest.
    pub(super) fn position(&self) -> Finding {
        let Some(by) = displacement(self.ours, self.theirs) else {
            return Finding::Differs;
        };
        let rounding = self.ours.rounding_mm() * 2.0;
        let farthest = by.iter().fold(0.0_f64, |most, part| most.max(part.abs()));
        let scale = self.exchange.scale();
        let step_mm = scale
            .iter()
            .fold(0.0_f64, |most, scale| most.max(1.0 / scale));
        if farthest <= rounding {
            match (self.ours.field("MPos"), self.theirs.field("MPos")) {
                (Some(a), Some(b)) if self.stands_still() && a != b => {
                    Finding::excused_if(is_tie(a, b, &self.exact()), Deviation::Rounding)
                }
                _ => Finding::Same,
            }
        } else if self.stands_still() {
            let is_stop = self.stops.explain(self.pair.own_s, &by, step_mm);
            if !is_stop && self.exchange.has_failed_homing(self.pair.step) {
                return Finding::Excused(Deviation::HomingMotion);
            }
            Finding::excused_if(
                is_stop || self.passes_by(&by, step_mm),
                Deviation::ShortStops,
            )
        } else {
            self.position_in_motion(farthest - step_mm - rounding)
        }
    }

    /// Where the axes are, in the unit of the report.
    fn exact(&self) -> Vec<f64> {
        let sample = self.played.track.at(self.pair.own_s);
        let steps = sample.map(|sample| sample.steps).unwrap_or_default();
        let unit = self.ours.mm_per_unit();
        let axes = steps.iter().zip(self.exchange.scale());
        axes.map(|(steps, scale)| f64::from(*steps) / scale / unit)
            .collect()
    }

    /// Whether the axes were or will be where Grbl's stand, not farther off than stops allow: along
    /// an arc no straight line says so.
    fn passes_by(&self, by: &[f64], step_mm: f64) -> bool {
        let allowed_mm = self.stops.allowance(self.pair.own_s).mm;
        let norm = |by: &[f64]| by.iter().map(|part| part * part).sum::<f64>().sqrt();
        let Some(theirs) = self.theirs.position_mm() else {
            return false;
        };
        if allowed_mm == 0.0 || norm(by) > allowed_mm + step_mm || self.ours.field("MPos").is_none()
        {
            return false;
        }
        let scale = self.exchange.scale_at(self.pair.step);
        self.samples(NEAR_S).iter().any(|sample| {
            let off: Vec<_> = (theirs.iter().zip(sample.steps).zip(scale))
                .map(|((at, steps), scale)| at - f64::from(steps) / scale)
                .collect();
            norm(&off) <= step_mm * 3.0
        })
    }

    /// The position in motion, this far apart, mm.
    fn position_in_motion(&self, deviation_mm: f64) -> Finding {
        let fastest = |tolerance_s: f64| {
            let samples = self.samples(tolerance_s).iter();
            let fastest = samples.fold(self.theirs.feed_mm_min(), |most, sample| {
                most.max(f64::from(sample.feed_mm_min))
            });
            fastest / 60.0
        };
        if deviation_mm <= fastest(SAME_S) * MOTION_S {
            return Finding::Same;
        }
        let allowed = self.allowance();
        let seconds = MOTION_S + allowed.seconds;
        let reach_mm = allowed.mm + fastest(SAME_S + allowed.seconds) * seconds;
        let is_excused = allowed.seconds > 0.0 && deviation_mm <= reach_mm;
        Finding::excused_if(is_excused, self.excuse())
    }

    /// The other fields that differ.
    pub(super) fn values(&self) -> Vec<(String, Finding)> {
        let mut found = Vec::new();
        for (name, theirs) in &self.theirs.fields {
            let Some(ours) = self.ours.field(name) else {
                continue;
            };
            if ours == theirs || name == "MPos" || name == "WPos" {
                continue;
            }
            let finding = match name.as_str() {
                "FS" | "F" => self.speeds(),
                "Bf" => buffers(ours, theirs),
                "A" if ours.replace('M', "") == *theirs => {
                    Finding::excused_if(self.exchange.has_mist(self.pair.step), Deviation::Mist)
                }
                "WCO" if is_rounded_otherwise(ours, theirs) => {
                    Finding::Excused(Deviation::Rounding)
                }
                "WCO" => self.offsets(ours, theirs),
                _ => Finding::Differs,
            };
            found.push((name.clone(), finding));
        }
        found
    }

    /// Offsets that were set where the axes stood after a stop.
    fn offsets(&self, ours: &str, theirs: &str) -> Finding {
        let (Some(ours), Some(theirs)) = (numbers(ours), numbers(theirs)) else {
            return Finding::Differs;
        };
        let unit_mm = self.ours.mm_per_unit();
        let by: Vec<_> = (ours.iter().zip(&theirs))
            .map(|(a, b)| (a - b) * unit_mm)
            .collect();
        let step_mm = self.exchange.step_mm();
        let is_stop = self.stops.explain(self.pair.own_s, &by, step_mm);
        Finding::excused_if(is_stop, Deviation::ShortStops)
    }

    /// Whether this is a laser at rest in a hold, where Grbl's can be switched on.
    fn is_dark_hold(&self) -> bool {
        self.exchange.is_laser() && self.theirs.state == "Hold:0" && self.ours.speed_rpm() == 0.0
    }

    /// Feed and spindle speed: 10 % in ramps, 1 % else.
    fn speeds(&self) -> Finding {
        let allowed = self.allowance().seconds;
        let around = self.samples(MOTION_S + GRBL_AHEAD_S);
        let is_ramp = around
            .windows(2)
            .any(|pair| (pair[0].feed_mm_min - pair[1].feed_mm_min).abs() > 1e-3);
        let share = if is_ramp { 0.1 } else { 0.01 };
        if self.has_feed(MOTION_S, share) && self.has_spindle(SAME_S) {
            Finding::Same
        } else if self.is_dark_hold() && self.has_feed(MOTION_S, share) {
            Finding::Excused(Deviation::DarkHold)
        } else {
            let is_excused = allowed > 0.0
                && self.has_feed(MOTION_S + allowed, 0.1)
                && self.has_spindle(SAME_S + allowed);
            Finding::excused_if(is_excused, self.excuse())
        }
    }

    /// Whether ours had Grbl's feed at nearly that time.
    fn has_feed(&self, tolerance_s: f64, share: f64) -> bool {
        let (ours, theirs) = (self.ours.feed_mm_min(), self.theirs.feed_mm_min());
        let at = self.pair.own_s;
        let until = at + tolerance_s + GRBL_AHEAD_S;
        let samples = self.played.track.between(at - tolerance_s, until);
        let feeds = samples.iter().map(|sample| f64::from(sample.feed_mm_min));
        let (least, most) = feeds.fold((ours, ours), |(least, most), feed| {
            (least.min(feed), most.max(feed))
        });
        let slack = theirs * share + self.ours.mm_per_unit();
        (least - slack..=most + slack).contains(&theirs)
    }

    /// Whether ours had Grbl's spindle speed at nearly that time.
    fn has_spindle(&self, tolerance_s: f64) -> bool {
        let theirs = self.theirs.speed_rpm();
        let mut samples = self.samples(tolerance_s).iter();
        self.ours.speed_rpm() == theirs
            || samples.any(|sample| (f64::from(sample.spindle_rpm) - theirs).abs() < 1.0)
    }
}

/// Free blocks and bytes: ours are never fewer.
fn buffers(ours: &str, theirs: &str) -> Finding {
    let is_larger = match (numbers(ours).as_deref(), numbers(theirs).as_deref()) {
        (Some([blocks, bytes]), Some([their_blocks, their_bytes])) => {
            blocks >= their_blocks && bytes >= their_bytes
        }
        _ => false,
    };
    Finding::excused_if(is_larger, Deviation::Buffers)
}
