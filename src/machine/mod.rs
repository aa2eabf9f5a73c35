//! The machine's state and what is known of it elsewhere.

mod alarm;
mod inputs;
mod notice;
mod outputs;
mod overrides;
mod state;

pub use alarm::Alarm;
pub use inputs::{Inputs, Levels};
pub use notice::{Notice, Notices};
pub use outputs::Outputs;
pub use overrides::{Override, Overrides};
pub use state::{Probed, Snapshot, State};
