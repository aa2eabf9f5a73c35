//! Speed and acceleration, measured on the steps.

use leadscrew::{axis::AXES, settings::Settings};

use super::{SHIFT_S, Step, Trace};

/// A trace's figures for one axis over windows of a given length, each within one block.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Peaks {
    /// Greatest speed, mm/s.
    pub(crate) speed_mm_s: f64,
    /// Greatest change of speed over time, mm/s².
    pub(crate) acceleration_mm_s2: f64,
    /// When, s.
    pub(crate) fastest_at: f64,
    pub(crate) hardest_at: f64,
}

/// Position in steps when a step is due, half-way to it.
fn crossing(step: &Step) -> f64 {
    f64::from(step.position) - 0.5 * f64::from(step.sign)
}

/// Peaks within blocks over windows of at least `window_s`, less what the shift of two events can make of them.
///
/// The mean speeds of two neighbouring windows differ by at most the acceleration times half of their duration. A step
/// that is early or late by `SHIFT_S` at speed v changes a mean by v·shift/T.
pub(crate) fn peaks(settings: &Settings, trace: &Trace, axis: usize, window_s: f64) -> Peaks {
    let steps = trace.steps(axis);
    let mm = 1.0 / f64::from(settings.steps_per_mm[axis].to_f32());
    let mut peaks = Peaks::default();
    let (mut j, mut k) = (0, 0);
    let waits = trace.waits(axis);
    for (i, first) in steps.iter().enumerate() {
        // A step that is late because the axis reversed says nothing about the speed from there on.
        let next = waits.partition_point(|wait| wait.end < first.ticks);
        if waits.get(next).is_some_and(|it| it.start < first.ticks) {
            continue;
        }
        let ends_at = |from: usize, index: &mut usize| {
            *index = (*index).max(from);
            while steps
                .get(*index)
                .is_some_and(|s| s.seconds - steps[from].seconds < window_s)
            {
                *index += 1;
            }
            steps.get(*index)
        };
        let Some(middle) = ends_at(i, &mut j) else {
            break;
        };
        let mean = |a: &Step, b: &Step| {
            (
                (crossing(b) - crossing(a)) / (b.seconds - a.seconds) * mm,
                b.seconds - a.seconds,
            )
        };
        let (v1, t1) = mean(first, middle);
        if first.is_of_block(middle) {
            let shift = 2.0 * SHIFT_S * v1.abs() / t1;
            if v1.abs() - shift > peaks.speed_mm_s {
                (peaks.speed_mm_s, peaks.fastest_at) = (v1.abs() - shift, first.seconds);
            }
        }
        let Some(last) = ends_at(j, &mut k) else {
            continue;
        };
        if first.is_of_block(last) {
            let (v2, t2) = mean(middle, last);
            let v = v1.abs().max(v2.abs());
            let noise = 2.0 * SHIFT_S * v * (1.0 / t1 + 1.0 / t2);
            let a = ((v2 - v1).abs() - noise) / (0.5 * (t1 + t2));
            if a > peaks.acceleration_mm_s2 {
                (peaks.acceleration_mm_s2, peaks.hardest_at) = (a, first.seconds);
            }
        }
    }
    peaks
}

/// No axis exceeds its rate or its acceleration within a block.
pub(crate) fn check_limits(settings: &Settings, trace: &Trace) {
    for axis in 0..AXES {
        for window_s in [0.001, 0.003, 0.008] {
            let peaks = peaks(settings, trace, axis, window_s);
            let rate = f64::from(settings.max_rate_mm_min[axis]) / 60.0;
            let acceleration = f64::from(settings.acceleration_mm_s2[axis]);
            assert!(
                peaks.speed_mm_s <= rate * 1.002,
                "axis {axis}: {} of {rate} mm/s at {} s",
                peaks.speed_mm_s,
                peaks.fastest_at
            );
            assert!(
                peaks.acceleration_mm_s2 <= acceleration * 1.02,
                "axis {axis}, {window_s} s: {} of {acceleration} mm/s² at {} s",
                peaks.acceleration_mm_s2,
                peaks.hardest_at
            );
        }
    }
}
