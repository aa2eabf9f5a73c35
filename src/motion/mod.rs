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
pub use lookahead::LookAhead;
pub use prepare::{Motion, Prepared};
pub use queue::{BLOCKS, QueuedBlock};
