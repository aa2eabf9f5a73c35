//! From segments of motion to timed edges on the step pins.
//!
//! `prepare` owns the [`Generator`], which turns each segment into [`StepEvent`]s; the step
//! interrupt owns the [`Stepper`], which plays them. Between them lie the ring of
//! events and that of segments.

mod axis_steps;
mod counts;
mod event;
mod generator;
mod history;
mod interrupt;
mod pulses;
mod ring;

pub use axis_steps::AxisMotion;
pub use counts::{Begun, StepCounts};
pub use event::{SegmentInfo, StepEvent};
pub use generator::{Generator, Segment};
pub use history::steps_after;
pub use interrupt::{Advance, Stepper};
pub use ring::{EVENT_RING, EventReader, EventRing, EventTap, EventWriter};

use crate::units::{TICKS_PER_MS, TICKS_PER_US};

/// Segments that may wait for the step interrupt, and one more: a power of two.
pub const SEGMENT_RING: usize = 32;
/// Motion that is prepared ahead: what a feed hold has to wait for, ticks.
pub const AHEAD_TICKS: u32 = 4 * TICKS_PER_MS;
/// Longest segment, ticks.
pub const SEGMENT_TICKS: u32 = TICKS_PER_MS;
/// Shortest time between two events, ticks: longer than the longest run of the step interrupt.
pub const EVENT_SPACING_TICKS: u32 = TICKS_PER_US * 3 / 2;
/// Most events of a segment: as one that ends by braking may last twice its time.
const SEGMENT_EVENTS: u32 = 2 * SEGMENT_TICKS / EVENT_SPACING_TICKS;
/// Shortest time between the end of a pulse and the next pulse of the axis, ticks.
///
/// 2.5 µs serve a DM542, the slowest of the common drivers; A4988 and DRV8825 need 1 and 1.9 µs.
pub const PULSE_LOW_TICKS: u32 = TICKS_PER_US * 5 / 2;
/// Shortest time between a change of direction and the next pulse, ticks: 5 µs, for a DM542.
pub const DIRECTION_SETUP_TICKS: u32 = TICKS_PER_US * 5;
