//! From segments of motion to timed edges on the step pins.
//!
//! `prepare` owns the [`Generator`], which turns each segment into [`StepEvent`]s. The step
//! interrupt takes them from a ring, [`EventReader`], and has its pins set by them, whatever the
//! number of axes: an event is one word, and no step is counted. What has to be done once in a
//! segment is left to `segment_start`, [`SegmentRing::start_segment`], which it releases.

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
pub use counts::{SegmentRing, SegmentStart};
pub use event::{SegmentInfo, StepEvent};
pub use generator::{Generator, Segment};
pub use history::steps_after;
pub use ring::{EventReader, EventRing, EventTap, EventWriter, Upcoming};
pub use shift::SHIFT_TICKS;
