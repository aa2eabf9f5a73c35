//! What the machine did over time: for whoever has to judge a report from in between.

use leadscrew::{axis::AXES, model::State};

/// The machine from one instant to the next sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// When, seconds from the first step.
    pub time_s: f64,
    /// State.
    pub state: State,
    /// Position, steps.
    pub steps: [i32; AXES],
    /// Feed.
    pub feed_mm_min: f32,
    /// Spindle speed.
    pub spindle_rpm: f32,
}

/// Samples in the order of time; each differs from the one before.
#[derive(Debug, Default)]
pub struct Track(Vec<Sample>);

impl Track {
    /// Adds a sample if anything has changed.
    pub(super) fn push(&mut self, sample: Sample) {
        if let Some(last) = self.0.last() {
            let mut now = sample;
            now.time_s = last.time_s;
            if now == *last {
                return;
            }
        }
        self.0.push(sample);
    }

    /// The machine between two times, with the sample that was in force at the first.
    pub fn between(&self, from_s: f64, to_s: f64) -> &[Sample] {
        let first = self.0.partition_point(|sample| sample.time_s <= from_s);
        let end = self.0.partition_point(|sample| sample.time_s <= to_s);
        let first = first.saturating_sub(1);
        &self.0[first..end.max(first + 1).min(self.0.len())]
    }

    /// The machine at a time; `None` before power-up.
    pub fn at(&self, time_s: f64) -> Option<&Sample> {
        let end = self.0.partition_point(|sample| sample.time_s <= time_s);
        self.0.get(end.checked_sub(1)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(time_s: f64, x: i32) -> Sample {
        let mut steps = [0; AXES];
        steps[0] = x;
        Sample {
            time_s,
            state: State::Run,
            steps,
            feed_mm_min: 100.0,
            spindle_rpm: 0.0,
        }
    }

    #[test]
    fn a_time_between_two_samples_has_the_earlier() {
        let mut track = Track::default();
        for (time_s, x) in [(0.0, 0), (0.1, 0), (0.2, 1), (0.3, 2)] {
            track.push(sample(time_s, x));
        }
        let xs = |from_s, to_s| {
            let samples = track.between(from_s, to_s).iter();
            samples.map(|sample| sample.steps[0]).collect::<Vec<_>>()
        };
        assert_eq!(xs(0.15, 0.16), [0]);
        assert_eq!(xs(0.15, 0.25), [0, 1]);
        assert_eq!(xs(0.0, 9.0), [0, 1, 2]);
        assert_eq!(xs(8.0, 9.0), [2]);
        assert_eq!(track.at(-1.0), None);
        assert_eq!(track.at(0.25).map(|sample| sample.steps[0]), Some(1));
    }
}
