//! The jerk-limited profile: acceleration is continuous, see [`average`].

mod average;
mod junctions;
mod plan;
mod profile;
mod reference;

pub use junctions::TARGETS_AHEAD;
pub use plan::BLOCKS_PER_PART;

pub(super) use self::{
    average::MovingAverage,
    plan::{BlockPlan, Plan, end_path},
    reference::{LeavingSample, ReferenceMotion, Sample},
};
