//! The trapezoidal profile: acceleration changes at once.

mod braking;
mod profile;

pub(super) use self::{
    braking::{BlockGeometry, Braking},
    profile::{SPEED_TOLERANCE, SegmentProfile, segment_share_s},
};
