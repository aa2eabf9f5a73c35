//! Times that several layers use: of segments, step events, pulses and samples.

use crate::units::{TICKS_PER_MS, TICKS_PER_US};

/// Bounds the motion queued ahead below which `prepare` makes another segment before anything else,
/// ticks. `prepare` looks as each segment begins, and `inputs` twice in a millisecond: what remains then is for one other
/// job and the next segment, which `cargo xtask schedule` proves. A feed hold waits for the motion queued and one more
/// segment: 4.5 ms, and 5 ms where few steps fall.
pub const QUEUED_AHEAD_TICKS: u32 = 3 * TICKS_PER_MS;
/// Length of a segment of a long motion, ticks.
pub const SEGMENT_TICKS: u32 = TICKS_PER_MS;
/// Longest segment, ticks.
pub const MAX_SEGMENT_TICKS: u32 = 3 * TICKS_PER_MS / 2;
/// Longest segment where few steps fall, ticks: no more than at the greatest step rate in [`MAX_SEGMENT_TICKS`].
pub const SPARSE_SEGMENT_TICKS: u32 = 2 * TICKS_PER_MS;
/// Shortest time between two events, ticks: 1.5 µs, longer than the response time of the step
/// interrupt by `cargo xtask schedule`. A power of two, as times are divided by it.
pub const EVENT_SPACING_TICKS: u32 = 128;
/// Largest number of events of a segment.
pub(crate) const MAX_SEGMENT_EVENTS: u32 = MAX_SEGMENT_TICKS / EVENT_SPACING_TICKS;
/// Greatest rate of arcs in whole steps, steps of all axes together per second: three motors that are
/// driven by phases make 1000 each.
pub const ARC_STEPS_PER_S: u32 = 3_000;
/// Shortest time between the end of a pulse and the next pulse of the axis, ticks.
///
/// 2.5 µs serve a DM542, the slowest of the common drivers; A4988 and DRV8825 need 1 and 1.9 µs.
pub const PULSE_LOW_TICKS: u32 = TICKS_PER_US * 5 / 2;
/// Shortest time between a change of direction and the next pulse, ticks: 5 µs, for a DM542.
pub const DIRECTION_SETUP_TICKS: u32 = TICKS_PER_US * 5;
/// Length of a slot, ticks: the shortest time between two events, so that a slot has one event at most.
pub(crate) const SLOT_TICKS: u32 = EVENT_SPACING_TICKS;
/// Slots from the end of a pulse to the next step of the axis, with one more, as an event may come
/// at the end of its slot.
pub(crate) const PULSE_LOW_SLOTS: u32 = 1 + PULSE_LOW_TICKS.div_ceil(SLOT_TICKS);
/// Period of the clock of `interpret`, ms: realtime bytes wait as long in the RepRap dialect.
pub const TICK_MS: u32 = 10;
/// Value of `$1` with which the drivers stay enabled at rest, as in Grbl 1.1 (`config.h`).
pub(crate) const IDLE_DELAY_INFINITE: u8 = 255;
/// Period of the samples of the reference motion, µs ...
pub const REFERENCE_SAMPLE_US: u32 = 1_000;
/// ... and s.
pub(crate) const SAMPLE_S: f32 = REFERENCE_SAMPLE_US as f32 / 1e6;

/// Returns the slots from a step to the end of its pulse.
#[must_use]
pub(crate) const fn pulse_slots(pulse_ticks: u32) -> u32 {
    1 + pulse_ticks.div_ceil(SLOT_TICKS)
}

/// Returns the shortest time between two steps of an axis, ticks.
#[must_use]
pub(crate) const fn min_period_ticks(pulse_ticks: u32) -> u32 {
    (pulse_slots(pulse_ticks) + PULSE_LOW_SLOTS) * SLOT_TICKS
}
