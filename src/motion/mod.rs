//! From blocks to segments: look-ahead, speed profile, motion cycles, and the task that runs them.

mod cycles;
mod executor;
mod jerk_limited;
mod kinematics;
mod limits;
mod lookahead;
mod pass;
mod prepare;
mod queue;
mod segment_rate;
mod trapezoid;

pub use cycles::homing::Homing;
pub use jerk_limited::{BLOCKS_PER_PART, TARGETS_AHEAD};
pub use lookahead::LookAhead;
pub use prepare::{Motion, Prepared, REQUEST_INTERVAL_TICKS, RunInProgress};
pub use queue::{BLOCKS, QueuedBlock};
pub use segment_rate::{MAX_STEP_RATE_HZ, MEAN_SEGMENT_US, STEPS_PER_SEGMENT};
