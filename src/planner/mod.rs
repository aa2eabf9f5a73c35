//! From commands to planned blocks: geometry, junctions, look-ahead, speed profile.

mod block;
mod command;

pub use block::{Entry, Work};
pub use command::{Circle, Command, Coolant, Pace, Plane, Rotation, Spindle};
