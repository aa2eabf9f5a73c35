//! From commands to planned blocks: geometry, junctions, look-ahead, speed profile.

mod arc;
mod block;
mod command;
mod executor;
mod lookahead;
mod motion;
mod path;
mod probe;
mod router;
mod smooth;
mod travel;

pub(crate) use block::MIN_SPEED_MM_S;
pub use block::{Block, Curve, Entry, Laser, Oblique, Pacing, Probing, Shape, Work};
pub use command::{Circle, Command, Coolant, Pace, PathControl, Plane, Rotation, Spindle, Target};
pub use lookahead::{BLOCKS, LookAhead};
pub use motion::{Motion, Prepared};
pub use path::{Path, Round, Way};
pub(crate) use router::fastest_mm_s;
pub use router::{Mark, Router};
pub use travel::{is_outside, leaves_travel};
