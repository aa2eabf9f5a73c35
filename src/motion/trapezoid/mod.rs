//! The trapezoidal profile: acceleration changes at once.

mod braking;
mod profile;

pub(super) use self::{
    braking::{Braking, Course},
    profile::{Stretch, WITHIN, share},
};
