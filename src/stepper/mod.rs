//! From segments of motion to timed edges on the step pins.
//!
//! `prepare` owns the [`Generator`], which turns each segment into [`StepEvent`]s. The step
//! interrupt takes them from a ring, [`EventReader`], and has its pins set by them, whatever the
//! number of axes: an event is one word, and no step is counted. What has to be done once in a
//! segment is left to `segment_start`, [`SegmentRing::start_segment`], which it releases.

mod alone;
mod event;
mod generator;
mod placing;
mod position;
mod ring;
mod segment_ring;
mod shift;
mod slots;
mod step_times;

pub use event::{SegmentInfo, StepEvent};
pub use generator::{Generator, Segment};
pub use position::steps_after;
pub use ring::{EventReader, EventRing, EventTap, EventWriter, Upcoming};
pub use segment_ring::{SegmentRing, SegmentStart};
pub use shift::STEP_JITTER_TICKS;
pub use step_times::AxisMotion;
