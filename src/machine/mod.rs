//! The machine's state and what is known of it elsewhere.

mod accessories;
mod alarm;
mod control;
mod inputs;
mod notice;
mod outputs;
mod overrides;
mod state;

pub use accessories::{Accessories, Power};
pub use alarm::Alarm;
pub use control::{Control, Effect, Ending, Event};
pub use inputs::{Inputs, Levels};
pub use notice::{Notice, Notices};
pub use outputs::Outputs;
pub use overrides::{Override, Overrides};
pub use state::{Probed, Snapshot, State};
