//! The trapezoidal profile: acceleration changes at once, see [`profile`].

mod braking;
mod plan;
mod profile;

pub(super) use self::plan::{BrakingPlan, plan_part};
