//! From commands to blocks: path control (`G64`), geometry, limits along the path, soft limits.

mod arc;
mod blending;
mod block;
mod compensation;
mod entry;
mod programmed_speed;
mod ramp_time;
mod router;
mod tilted_arc;
mod travel_limits;

pub use blending::{BlendOutput, Blender, CornerArc};
pub use block::{Block, Curve, MoveKind, Shape, SpatialArc};
pub use compensation::{Compensator, Misfit};
pub use entry::{Entry, TakeUp, Work};
pub(crate) use ramp_time::RampTime;
pub(crate) use router::Limits;
pub use router::Router;
pub use tilted_arc::TiltedArc;
pub use travel_limits::{OutsideTravel, is_axis_outside, is_outside, leaves_travel};
