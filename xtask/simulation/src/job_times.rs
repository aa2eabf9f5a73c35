//! What the time of a job goes into, and how far it goes, from its segments.

use common::text::duration;
use leadscrew::{
    sim::{PlayedSegment, SegmentKind},
    units::TICKS_PER_SECOND,
};

/// Time from the first motion to the last one, by what happens in it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JobTimes {
    /// Feed moves, s.
    pub cutting_s: f64,
    /// Rapids, s.
    pub rapid_s: f64,
    /// Nothing moves between two motions: dwells, pauses, tool changes, waiting for lines, s.
    pub standstill_s: f64,
    /// Jogs, probing, homing, parking, s.
    pub other_s: f64,
    /// Distance of feed moves, mm; degrees where only rotary axes move.
    pub cutting_mm: f64,
    /// Distance of rapids, mm.
    pub rapid_mm: f64,
    /// What is played, since when, ticks, and its speeds at both ends, mm/min.
    played: Option<(SegmentKind, u64, [f32; 2])>,
    /// Standstill that counts once something moves again, s.
    pending_s: f64,
}

impl JobTimes {
    /// Adds the segment that begins: the one before it has ended.
    pub fn add(&mut self, segment: &PlayedSegment) {
        self.end_played(segment.start_ticks);
        let is_first = self.played.is_none() && segment.kind == SegmentKind::Standstill;
        if !is_first {
            let begin_mm_min = self.played.map_or(0.0, |(.., [_, end])| end);
            let speeds = [begin_mm_min, segment.end_mm_min];
            self.played = Some((segment.kind, segment.start_ticks, speeds));
        }
    }

    /// Returns the times of a job that has ended now, at `ticks`.
    #[must_use]
    pub fn finish(mut self, ticks: u64) -> Self {
        self.end_played(ticks);
        self.played = None;
        self.pending_s = 0.0;
        self
    }

    fn end_played(&mut self, ticks: u64) {
        let Some((kind, begun, speeds)) = self.played else {
            return;
        };
        let seconds = ticks.saturating_sub(begun) as f64 / f64::from(TICKS_PER_SECOND);
        if kind == SegmentKind::Standstill {
            self.pending_s += seconds;
            return;
        }
        self.standstill_s += std::mem::take(&mut self.pending_s);
        // The speed changes evenly within a segment.
        let [begin, end] = speeds.map(f64::from);
        let distance = f64::midpoint(begin, end) / 60.0 * seconds;
        match kind {
            SegmentKind::Feed => {
                self.cutting_s += seconds;
                self.cutting_mm += distance;
            }
            SegmentKind::Rapid => {
                self.rapid_s += seconds;
                self.rapid_mm += distance;
            }
            SegmentKind::Standstill
            | SegmentKind::Jog
            | SegmentKind::Probe
            | SegmentKind::Homing
            | SegmentKind::Parking => self.other_s += seconds,
        }
    }

    /// Returns all of it, s.
    pub fn total_s(&self) -> f64 {
        self.cutting_s + self.rapid_s + self.standstill_s + self.other_s
    }

    /// Returns the parts in words; `None` if nothing has moved.
    pub fn text(&self) -> Option<String> {
        let parts = [
            ("cutting", self.cutting_s),
            ("rapids", self.rapid_s),
            ("standing still", self.standstill_s),
            ("homing, probing, jogs and backlash", self.other_s),
        ];
        let parts = parts.iter().filter(|(_, seconds)| *seconds > 0.0);
        let parts: Vec<_> = parts
            .map(|(name, seconds)| format!("{name} {}", duration(*seconds)))
            .collect();
        (!parts.is_empty()).then(|| parts.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use leadscrew::axis::{AXES, Axes};

    use super::*;

    fn times(segments: &[(SegmentKind, u64)], end_s: u64) -> JobTimes {
        let mut times = JobTimes::default();
        for (kind, seconds) in segments {
            times.add(&PlayedSegment {
                start_ticks: seconds * u64::from(TICKS_PER_SECOND),
                steps: Axes([0; AXES]),
                end_mm_min: 60.0,
                begin_steps_s: Axes([0.0; AXES]),
                end_steps_s: Axes([0.0; AXES]),
                programmed_mm_min: 0.0,
                line: 0,
                kind: *kind,
                duty: 0,
            });
        }
        times.finish(end_s * u64::from(TICKS_PER_SECOND))
    }

    #[test]
    fn standstill_before_the_first_motion_and_after_the_last_is_no_part_of_the_job() {
        let times = times(
            &[
                (SegmentKind::Standstill, 1),
                (SegmentKind::Rapid, 3),
                (SegmentKind::Standstill, 5),
                (SegmentKind::Standstill, 6),
                (SegmentKind::Feed, 10),
                (SegmentKind::Homing, 20),
                (SegmentKind::Standstill, 21),
            ],
            100,
        );
        let parts = [
            times.rapid_s,
            times.standstill_s,
            times.cutting_s,
            times.other_s,
        ];
        assert_eq!(parts, [2.0, 5.0, 10.0, 1.0]);
        assert_eq!(times.total_s(), 18.0);
        // The speed is 1 mm/s at each end, and 0 where the job begins.
        assert_eq!((times.rapid_mm, times.cutting_mm), (1.0, 10.0));
        let text = "cutting 10.000 s, rapids 2.000 s, standing still 5.000 s, homing, probing, jogs and backlash 1.000 s";
        assert_eq!(times.text().as_deref(), Some(text));
    }

    #[test]
    fn a_job_without_motion_has_no_parts() {
        assert_eq!(times(&[], 5).text(), None);
        assert_eq!(times(&[(SegmentKind::Standstill, 1)], 5).text(), None);
    }
}
