//! From segments of motion to timed edges on the step pins.
//!
//! `prepare` owns the [`Generator`], which turns each segment into [`StepEvent`]s. The step
//! interrupt takes them from a ring, [`EventReader`], and has its pins set by them, whatever the
//! number of axes: an event is one word, and no step is counted. What has to be done once in a
//! segment is left to `turn`, [`StepCounts::turn`], which it releases.

mod alone;
mod axis_steps;
mod counts;
mod event;
mod generator;
mod history;
mod placing;
mod ring;
mod shift;
mod slots;

pub use axis_steps::AxisMotion;
pub use counts::{StepCounts, Turned};
pub use event::{SegmentInfo, StepEvent};
pub(crate) use generator::least_period_ticks;
pub use generator::{Generator, Segment};
pub use history::steps_after;
pub use ring::{EVENT_RING, EventReader, EventRing, EventTap, EventWriter, Upcoming};
pub use shift::SHIFT_TICKS;

use crate::units::{TICKS_PER_MS, TICKS_PER_US};

/// Segments that may wait for the step interrupt, and one more: a power of two.
pub const SEGMENT_RING: usize = 32;
/// Motion ahead below which `prepare` makes another segment before anything else, ticks, counted from
/// where the segment being played begins. At the end of that one, 2 ms are left, for one other unit of
/// work and the next segment. A feed hold waits for it and for a segment more: 5 ms.
pub const AHEAD_TICKS: u32 = 7 * TICKS_PER_MS / 2;
/// A segment of a long motion, ticks.
pub const SEGMENT_TICKS: u32 = TICKS_PER_MS;
/// Longest segment, ticks.
pub const LONGEST_SEGMENT_TICKS: u32 = 3 * TICKS_PER_MS / 2;
/// Shortest time between two events, ticks, 1.5 µs: longer than the step interrupt takes to serve
/// one, by `cargo xtask schedule`. A power of two, as times are divided by it.
pub const EVENT_SPACING_TICKS: u32 = 128;
/// Most events of a segment.
const SEGMENT_EVENTS: u32 = LONGEST_SEGMENT_TICKS / EVENT_SPACING_TICKS;
/// Shortest time between the end of a pulse and the next pulse of the axis, ticks.
///
/// 2.5 µs serve a DM542, the slowest of the common drivers; A4988 and DRV8825 need 1 and 1.9 µs.
pub const PULSE_LOW_TICKS: u32 = TICKS_PER_US * 5 / 2;
/// Shortest time between a change of direction and the next pulse, ticks: 5 µs, for a DM542.
pub const DIRECTION_SETUP_TICKS: u32 = TICKS_PER_US * 5;
