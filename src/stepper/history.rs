//! Where the axes were at any instant: from the events that had been output by then.
//!
//! The step interrupt counts nothing. But the ring keeps the events it has played, and each segment
//! the position at which it began; what was output in between are the pulses of these events. The
//! interrupt that has to know takes one number, [`EventTap::output`](super::EventTap::output), and
//! `prepare` counts, before it has overwritten so much.

use super::{EVENT_RING, EventWriter, StepCounts};
use crate::axis::Axes;

/// Step count of each axis when so many events had been output; `None` when that is too long ago.
///
/// The event and its segment must be among the last [`EVENT_RING`] and
/// [`SEGMENT_RING`](super::SEGMENT_RING): one run of `prepare` does not overwrite more.
#[must_use]
pub fn steps_after(
    output: u32,
    counts: &StepCounts,
    events: &EventWriter<'_>,
) -> Option<Axes<i32>> {
    let (mut steps, directions, first) = counts.segment_at(output)?;
    let length = output.wrapping_sub(first);
    if length > EVENT_RING as u32 {
        return None;
    }
    // wcet-bound: 2048
    for number in (0..length).map(|after| first.wrapping_add(after)) {
        let raise = events.event(number).raise();
        // wcet-bound: 6
        for (axis, steps) in steps.iter_mut().enumerate() {
            let pulse = (raise >> axis & 1).cast_signed();
            let is_negative = directions >> axis & 1 != 0;
            *steps = steps.wrapping_add(if is_negative { -pulse } else { pulse });
        }
    }
    Some(steps)
}
