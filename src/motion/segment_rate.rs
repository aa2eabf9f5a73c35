//! Time that blocks have to take so that `prepare` keeps up with their segments.

use crate::{
    axis::AXES,
    math,
    model::{
        queues::SEGMENT_RING,
        timing::{QUEUED_AHEAD_TICKS, SAMPLE_S},
    },
    motion::limits::{
        JERK_LIMITED_MIN_SECTION_S, LONGEST_SEGMENT_S, MIN_SECTION_S, NOMINAL_SEGMENT_S,
        SHORTEST_SEGMENT_S,
    },
    path::{Block, Curve},
    units::{FineSteps, TICKS_PER_SECOND},
};

/// Shortest mean time of segments, s: what `prepare` keeps up with at the greatest step rate. See
/// `docs/decisions.md`.
const MEAN_SEGMENT_S: f32 = 0.7e-3;
/// Steps that cost no less than a segment of a line: where so many fewer are made than could be, one
/// more may be. `[trade]` in `schedule.toml`.
const TRADED_STEPS: u32 = 78 + 12 * (AXES as u32 - 3);
/// The greatest step rate that is reckoned with for that, Hz: so that the ring of segments always holds
/// as much time as `prepare` needs.
const TRADED_HZ: u32 = 200_000;
const _: () = {
    let ahead_s = QUEUED_AHEAD_TICKS as f32 / TICKS_PER_SECOND as f32;
    let segments = ahead_s / MEAN_SEGMENT_S + ahead_s * TRADED_HZ as f32 / TRADED_STEPS as f32;
    assert!(segments + 3.0 <= SEGMENT_RING as f32);
};
/// What a first or a last piece of an arc can cost, s: it may be as short as a piece can be.
const ARC_END_S: f32 = MEAN_SEGMENT_S - MIN_SECTION_S;
/// What blocks before may have taken longer than that, for one that is shorter, s. The
/// standstill at the end, or the beginning of an arc, may come on top.
const MAX_SLACK_S: f32 = MEAN_SEGMENT_S;
/// What a line of several segments saves at least, s.
const MIN_SAVED_S: f32 = 2.0 * (SHORTEST_SEGMENT_S - MEAN_SEGMENT_S);
/// The part of its time that a long piece saves, but for the last two segments: the others take 1 ms.
const SAVED_SHARE: f32 = 1.0 - MEAN_SEGMENT_S / NOMINAL_SEGMENT_S;
/// What those two take less than two such, of that: they take 1.5 ms together at least.
const SECTION_END_S: f32 = (1.0 - SAVED_SHARE) * (2.0 * NOMINAL_SEGMENT_S - LONGEST_SEGMENT_S);

/// What a step adds to the shortest time of a line that is one segment, s, at the greatest step rate.
///
/// In the time T it leaves S T - n steps out of those at that rate, and if it is to cost nothing,
/// T / [`MEAN_S`] + (S T - n) / [`TRADED_STEPS`] is 1.
pub(super) const fn duration_per_step_s(steps_per_s: u32) -> f32 {
    let steps_per_s = if steps_per_s < TRADED_HZ {
        steps_per_s
    } else {
        TRADED_HZ
    };
    1.0 / (TRADED_STEPS as f32 / MEAN_SEGMENT_S + steps_per_s as f32)
}

/// The shortest time of a block that is one segment, for the steps that it leaves out, s.
#[inline]
pub(super) fn min_duration_s(block: &Block, step_s: f32) -> f32 {
    if block.curve.is_some() || block.length_mm >= MEAN_SEGMENT_S * block.limit_mm_s {
        return f32::MAX;
    }
    // Wherever it begins within a step, no axis makes more.
    let steps =
        |way: &i64| (way.unsigned_abs().wrapping_add(FineSteps::ONE as u64 - 1) >> 32) as u32;
    let steps: u32 = block
        .delta
        .iter()
        .map(steps)
        .fold(TRADED_STEPS, u32::wrapping_add);
    steps as f32 * step_s
}

/// The speed of a block that has to leave `prepare` its time, and what is left to spare then.
///
/// Whatever its ramps are: a block that takes longer than it could never saves less. It may still be
/// gone through at the speed that it has.
#[inline]
pub(super) fn limit_segment_rate(
    block: &Block,
    speed_mm_s: f32,
    traded_s: f32,
    spare_s: f32,
) -> (f32, f32) {
    let quarters = block.curve.as_ref().map(Curve::inner_sections);
    let (least_s, ends_s) = match quarters {
        None => (MEAN_SEGMENT_S - spare_s, SECTION_END_S),
        Some(quarters) => {
            let ends_s = 2.0 * ARC_END_S + SECTION_END_S * quarters as f32;
            ((ends_s - spare_s) * (1.0 / SAVED_SHARE), ends_s)
        }
    };
    if block.length_mm < least_s * speed_mm_s {
        if traded_s < least_s {
            // It neither costs time nor saves any.
            return (math::min(speed_mm_s, block.length_mm / traded_s), spare_s);
        }
        return (block.length_mm / least_s, 0.0);
    }
    let seconds = block.length_mm / math::max(speed_mm_s, block.nominal_mm_s);
    let saved_s = SAVED_SHARE * seconds - ends_s;
    if quarters.is_some() {
        // Its last piece alone saves nothing.
        let spare_s = math::min(spare_s + saved_s, MAX_SLACK_S - ARC_END_S);
        return (speed_mm_s, math::max(spare_s, 0.0));
    }
    let saved_s = math::min(seconds - MEAN_SEGMENT_S, math::max(saved_s, MIN_SAVED_S));
    let spare_s = math::min(spare_s + saved_s, MAX_SLACK_S);
    (speed_mm_s, math::max(spare_s, 0.0))
}

/// Shortest time of an arc where acceleration is continuous, s, and what each of its quarter turns
/// adds: so that segments have a mean of [`SMOOTH_MEAN_S`], as lines that take a cell have.
const JERK_LIMITED_ARC_S: f32 =
    2.0 * (JERK_LIMITED_MEAN_SEGMENT_S - JERK_LIMITED_MIN_SECTION_S) / JERK_LIMITED_SAVED_SHARE;
const JERK_LIMITED_QUARTER_S: f32 = (1.0 - JERK_LIMITED_SAVED_SHARE)
    * (2.0 * NOMINAL_SEGMENT_S - LONGEST_SEGMENT_S)
    / JERK_LIMITED_SAVED_SHARE;
/// Shortest mean time of segments there, s.
const JERK_LIMITED_MEAN_SEGMENT_S: f32 = 0.75e-3;
/// The part of its time that a long piece saves.
const JERK_LIMITED_SAVED_SHARE: f32 = 1.0 - JERK_LIMITED_MEAN_SEGMENT_S / NOMINAL_SEGMENT_S;

/// The speed of a block that takes as long as a cell of the reference at least.
#[inline]
pub(super) fn limit_block_rate(block: &Block, speed_mm_s: f32) -> f32 {
    let least_s = match &block.curve {
        None => SAMPLE_S,
        Some(curve) => {
            let quarters = (curve.sweep.unsigned_abs() >> 30) as u32 as f32;
            JERK_LIMITED_ARC_S + JERK_LIMITED_QUARTER_S * quarters
        }
    };
    if block.length_mm < least_s * speed_mm_s {
        block.length_mm / least_s
    } else {
        speed_mm_s
    }
}
