//! The segment rate: durations of blocks that `prepare` keeps up with.
//!
//! Segments may follow each other in 0.7 ms on average. A block with longer segments leaves *slack*, which the next
//! blocks may use for shorter segments; tests/motion/segments.rs checks random programs, `docs/motion-planning.md`
//! derives the rule, and `schedule.toml` counts on it.

use crate::{
    axis::AXES,
    math,
    model::{
        queues::{EVENT_RING, SEGMENT_RING},
        timing::{QUEUED_AHEAD_TICKS, SAMPLE_S},
    },
    motion::limits::{
        JERK_LIMITED_MIN_SECTION_S, LONGEST_SEGMENT_S, MIN_SECTION_S, NOMINAL_SEGMENT_S,
        SHORTEST_SEGMENT_S,
    },
    path::{Block, Curve},
    units::{FineSteps, TICKS_PER_SECOND},
};

/// Shortest mean duration of segments, µs: `prepare` keeps up with it at the greatest step rate. `segment`
/// in `schedule.toml`.
pub const MEAN_SEGMENT_US: u32 = 700;
/// The same, s.
const MEAN_SEGMENT_S: f32 = MEAN_SEGMENT_US as f32 / 1e6;
/// Steps that cost no less than a segment of a line: for each as many steps below the step rate, one more
/// segment may be made. `[substitution]` in `schedule.toml` proves it.
pub const STEPS_PER_SEGMENT: u32 = 78 + 12 * (AXES as u32 - 3);
/// Greatest step rate counted on for that, Hz: the ring of segments then always holds as much time as
/// `prepare` needs, by the assertion below.
pub const MAX_STEP_RATE_HZ: u32 = 200_000;
const _: () = {
    let ahead_s = QUEUED_AHEAD_TICKS as f32 / TICKS_PER_SECOND as f32;
    let segments =
        ahead_s / MEAN_SEGMENT_S + ahead_s * MAX_STEP_RATE_HZ as f32 / STEPS_PER_SEGMENT as f32;
    assert!(segments + 3.0 <= SEGMENT_RING as f32);
    // Two events of each step and each segment, and a burst of them (`task.step` in schedule.toml).
    let queued_s = ahead_s + LONGEST_SEGMENT_S;
    let events = 2.0 * queued_s * (MAX_STEP_RATE_HZ as f32 + 1.0 / MEAN_SEGMENT_S);
    assert!(events + 2.0 * (AXES as f32 + 3.0) < EVENT_RING as f32);
};
/// Slack that the first or the last section of an arc can use, s: it may be the shortest section.
const ARC_END_S: f32 = MEAN_SEGMENT_S - MIN_SECTION_S;
/// Greatest slack, s: that of one segment. The standstill at the end, or the beginning of an arc, may
/// use as much again.
const MAX_SLACK_S: f32 = MEAN_SEGMENT_S;
/// Least slack of a line of several segments, s.
const MIN_SAVED_S: f32 = 2.0 * (SHORTEST_SEGMENT_S - MEAN_SEGMENT_S);
/// The share of its duration that a long section leaves as slack, without the last two segments: the
/// others take 1 ms.
const SAVED_SHARE: f32 = 1.0 - MEAN_SEGMENT_S / NOMINAL_SEGMENT_S;
/// The slack of the last two segments below that of two others: they take 1.5 ms together at least.
const SECTION_END_S: f32 = (1.0 - SAVED_SHARE) * (2.0 * NOMINAL_SEGMENT_S - LONGEST_SEGMENT_S);

/// Duration that a step adds to the shortest duration of a line in one segment, s, at a step rate S.
///
/// A line of n steps in the time T leaves S T - n steps out. It uses no slack if
/// T / [`MEAN_SEGMENT_S`] + (S T - n) / [`STEPS_PER_SEGMENT`] is 1.
pub(super) const fn duration_per_step_s(steps_per_s: u32) -> f32 {
    let steps_per_s = if steps_per_s < MAX_STEP_RATE_HZ {
        steps_per_s
    } else {
        MAX_STEP_RATE_HZ
    };
    1.0 / (STEPS_PER_SEGMENT as f32 / MEAN_SEGMENT_S + steps_per_s as f32)
}

/// The shortest duration of a line that is one segment and uses no slack, s; `f32::MAX` for other
/// blocks.
#[inline]
pub(super) fn min_duration_s(block: &Block, duration_per_step_s: f32) -> f32 {
    if block.curve.is_some() || block.length_mm >= MEAN_SEGMENT_S * block.limit_mm_s {
        return f32::MAX;
    }
    // The most steps of each axis, wherever within a step the line begins.
    let steps =
        |delta: &i64| (delta.unsigned_abs().wrapping_add(FineSteps::ONE as u64 - 1) >> 32) as u32;
    let steps: u32 = block
        .delta
        .iter()
        .map(steps)
        .fold(STEPS_PER_SEGMENT, u32::wrapping_add);
    steps as f32 * duration_per_step_s
}

/// Limits the speed of a block to the segment rate; returns the speed and the slack behind the block.
///
/// The slack is computed at the greater of nominal and present speed, whatever the ramps are: a block that takes longer
/// never leaves less.
#[inline]
pub(super) fn limit_segment_rate(
    block: &Block,
    speed_mm_s: f32,
    min_duration_s: f32,
    slack_s: f32,
) -> (f32, f32) {
    let sections = block.curve.as_ref().map(Curve::inner_sections);
    let (shortest_s, ends_s) = match sections {
        None => (MEAN_SEGMENT_S - slack_s, SECTION_END_S),
        Some(sections) => {
            let ends_s = 2.0 * ARC_END_S + SECTION_END_S * sections as f32;
            ((ends_s - slack_s) * (1.0 / SAVED_SHARE), ends_s)
        }
    };
    if block.length_mm < shortest_s * speed_mm_s {
        if min_duration_s < shortest_s {
            // It neither uses slack nor adds any.
            return (
                math::min(speed_mm_s, block.length_mm / min_duration_s),
                slack_s,
            );
        }
        return (block.length_mm / shortest_s, 0.0);
    }
    let seconds = block.length_mm / math::max(speed_mm_s, block.nominal_mm_s);
    let added_s = SAVED_SHARE * seconds - ends_s;
    if sections.is_some() {
        // Its last section alone leaves none.
        let slack_s = math::min(slack_s + added_s, MAX_SLACK_S - ARC_END_S);
        return (speed_mm_s, math::max(slack_s, 0.0));
    }
    let added_s = math::min(seconds - MEAN_SEGMENT_S, math::max(added_s, MIN_SAVED_S));
    let slack_s = math::min(slack_s + added_s, MAX_SLACK_S);
    (speed_mm_s, math::max(slack_s, 0.0))
}

/// Shortest duration of an arc with the jerk-limited profile, s, and the addition of each quarter turn:
/// its segments then have a mean of [`JERK_LIMITED_MEAN_SEGMENT_S`], as those of lines that take a
/// sample.
const JERK_LIMITED_ARC_S: f32 =
    2.0 * (JERK_LIMITED_MEAN_SEGMENT_S - JERK_LIMITED_MIN_SECTION_S) / JERK_LIMITED_SAVED_SHARE;
const JERK_LIMITED_QUARTER_S: f32 = (1.0 - JERK_LIMITED_SAVED_SHARE)
    * (2.0 * NOMINAL_SEGMENT_S - LONGEST_SEGMENT_S)
    / JERK_LIMITED_SAVED_SHARE;
/// Shortest mean duration of segments with the jerk-limited profile, s: `jerk_limited_segment` in
/// `schedule.toml`.
const JERK_LIMITED_MEAN_SEGMENT_S: f32 = 0.75e-3;
/// [`SAVED_SHARE`] with that mean.
const JERK_LIMITED_SAVED_SHARE: f32 = 1.0 - JERK_LIMITED_MEAN_SEGMENT_S / NOMINAL_SEGMENT_S;

/// Limits the speed of a block to one that takes a sample of the reference at least.
#[inline]
pub(super) fn limit_block_rate(block: &Block, speed_mm_s: f32) -> f32 {
    let shortest_s = match &block.curve {
        None => SAMPLE_S,
        Some(curve) => {
            let quarters = (curve.sweep.unsigned_abs() >> 30) as u32 as f32;
            JERK_LIMITED_ARC_S + JERK_LIMITED_QUARTER_S * quarters
        }
    };
    if block.length_mm < shortest_s * speed_mm_s {
        block.length_mm / shortest_s
    } else {
        speed_mm_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::queue::QueuedBlock;

    #[test]
    fn lines_that_use_slack_leave_none() {
        let speed_mm_s = 100.0;
        for part in [0.01, 0.1, 0.5, 0.9] {
            let block = Block {
                length_mm: part * MEAN_SEGMENT_S * speed_mm_s,
                limit_mm_s: speed_mm_s,
                nominal_mm_s: speed_mm_s,
                ..QueuedBlock::NONE.block
            };
            let begun_s = 0.3e-3;
            let (mut slack_s, mut passed_s) = (begun_s, 0.0);
            for lines in 1..=20 {
                let limited = limit_segment_rate(&block, speed_mm_s, f32::MAX, slack_s);
                slack_s = limited.1;
                passed_s += block.length_mm / limited.0;
                let least_s = lines as f32 * MEAN_SEGMENT_S - begun_s;
                assert!(
                    passed_s >= 0.999 * least_s,
                    "{part}: {lines} lines in {passed_s} s"
                );
            }
        }
    }
}
