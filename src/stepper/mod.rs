//! From segments of motion to timed edges on the step pins.
//!
//! `prepare` owns the [`Generator`], which makes [`StepEvent`]s of each [`Segment`]:
//!
//! ```text
//! segment ─▶ step_times ─▶ placement ─┬─────▶ direct ─────┬─▶ ring ─▶ step interrupt
//!               per axis              └─▶ slots ─▶ drain ─┘
//! ```
//!
//! The step interrupt reads the events with [`EventReader`] and sets pins by them: an event is one
//! word for any number of axes, and no step is counted. `segment_start`, which the step interrupt
//! releases, does what is due once in a segment: [`SegmentRing::start_segment`].

mod event;
mod generator;
mod integer_arc;
mod jitter;
mod phases;
mod placement;
mod position;
mod ring;
mod segment;
mod segment_ring;
#[cfg_attr(not(arc_machine), path = "no_step_arc.rs")]
mod step_arc;
mod step_times;

pub use event::StepEvent;
pub use generator::{END_SLOTS, Generator};
#[cfg(arc_machine)]
pub use generator::{MAX_ARC_STEPS, MAX_ARC_STRETCHES};
pub use integer_arc::{IntegerArc, StepRule, UnitStep};
pub use jitter::STEP_JITTER_TICKS;
pub use phases::{COILS, PHASES, PhaseDrive, PhaseSteps, Phases, coils};
pub use placement::{SLOTS, WORD_BITS};
pub use position::steps_after;
pub use ring::{EventReader, EventRing, EventTap, EventWriter, Upcoming};
pub use segment::{AxisMotion, Segment, SegmentInfo};
pub use segment_ring::{SegmentRing, SegmentStart};
pub use step_arc::StepArc;
#[cfg(arc_machine)]
pub use step_arc::{ArcProgress, ArcStep, ArcSteps};
