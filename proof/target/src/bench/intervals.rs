//! How even the steps of a workload are: the error of the intervals between two steps of an axis, where all of them
//! move at constant rates.
//!
//! The library plays the program on the computer, event by event as the step interrupt would: times are exact to a tick,
//! and what a late interrupt does to an edge is not in them.

use anyhow::{Result, ensure};
use leadscrew::{
    settings::{Settings, StepRate},
    sim::{Edge, Simulator, Stream, StreamEnd, Watcher},
};

use super::workload::Workload;

/// Fast enough that no line is waited for.
const BAUD: u32 = 1_000_000;
/// The share of an axis' steps at the beginning and at the end that may be those of ramps.
const RAMP_SHARE: f64 = 0.1;

/// The times of the steps of the first three axes, ticks.
#[derive(Default)]
struct StepTimes([Vec<u64>; 3]);

impl Watcher for StepTimes {
    fn edge(&mut self, edge: &Edge) {
        for (axis, times) in self.0.iter_mut().enumerate() {
            if edge.raise >> axis & 1 != 0 {
                times.push(edge.ticks);
            }
        }
    }

    fn answer(&mut self, _: u64, _: &[u8]) {}

    fn message(&mut self, _: &Simulator, _: u64, _: &[u8]) {}
}

/// Returns the interval error of X, Y and Z, rms, as a part of the interval.
pub(super) fn interval_errors(workload: &Workload, step_rate_hz: u32) -> Result<[f64; 3]> {
    let mut simulator = Box::new(Simulator::off());
    simulator.switch_on(&Settings::new(StepRate::Proven(step_rate_hz)), None);
    let lines = workload.settings.iter().copied();
    let lines = lines.chain(workload.program.iter().map(String::as_str));
    let text: String = lines.flat_map(|line| [line, "\n"]).collect();
    let mut steps = StepTimes::default();
    let end = Stream::new(&mut *simulator, text.bytes(), BAUD)
        .with_statements_at_rest()
        .run(&mut steps);
    ensure!(end == StreamEnd::Complete, "{} stops", workload.name);
    Ok(steps.0.map(|times| relative_error(&times)))
}

/// Returns the error of intervals without those of ramps; 0 where there are none.
fn relative_error(times: &[u64]) -> f64 {
    let skipped = (RAMP_SHARE * times.len() as f64).ceil() as usize;
    let steady = times.get(skipped..times.len().saturating_sub(skipped));
    let (Some(steady), Some(intervals)) = (steady, steady.and_then(|of| of.len().checked_sub(1)))
    else {
        return 0.0;
    };
    if intervals == 0 {
        return 0.0;
    }
    let mean = (steady[intervals] - steady[0]) as f64 / intervals as f64;
    let squares = steady
        .windows(2)
        .map(|pair| ((pair[1] - pair[0]) as f64 / mean - 1.0).powi(2));
    (squares.sum::<f64>() / intervals as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::{super::workload, *};

    #[test]
    fn the_error_is_that_of_intervals_at_a_constant_rate() {
        let even: Vec<u64> = (0..100).map(|step| 840 * step).collect();
        assert_eq!(relative_error(&even), 0.0);
        // Every other interval is a tenth longer, or shorter.
        let uneven: Vec<u64> = (0..101).map(|step| 840 * step + 84 * (step % 2)).collect();
        assert!((relative_error(&uneven) - 0.1).abs() < 0.001);
        // Ramps do not count.
        let ramps: Vec<u64> = (0..100)
            .map(|step| if step < 5 { 0 } else { 840 * step })
            .collect();
        assert_eq!(relative_error(&ramps), 0.0);
        assert_eq!(relative_error(&[]), 0.0);
    }

    #[test]
    fn the_steps_of_the_axis_with_most_are_even() {
        let [x, y, z] = interval_errors(&workload::three_axes(), 500_000).unwrap();
        assert!(x < 0.005 && y < 0.06 && z < 0.06, "{x} {y} {z}");
    }
}
