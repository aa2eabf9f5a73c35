//! The jerk-limited profile: acceleration is continuous.

mod average;
mod junctions;
mod plan;
mod profile;
mod reference;

pub(super) use self::{
    average::MovingAverage, junctions::RunningMin, plan::JunctionPlan, reference::ReferenceMotion,
};
