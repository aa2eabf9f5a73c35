//! From commands to blocks: geometry, limits along the path, corners, path control.

mod arc;
mod arc_jerk;
mod blending;
mod block;
mod jerk_window;
mod router;
mod travel_limits;

pub use blending::{BlendOutput, Blender, CornerArc};
pub(crate) use block::MIN_SPEED_MM_S;
pub use block::{Block, Curve, Entry, MoveKind, Shape, SpatialArc, Work};
pub(crate) use jerk_window::AveragingWindow;
pub(crate) use router::fastest_mm_s;
pub use router::{Checkpoint, Router};
pub use travel_limits::{is_outside, leaves_travel};
