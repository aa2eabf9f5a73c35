//! The machine's state and what is known of it elsewhere.

mod accessories;
mod alarm;
mod control;
mod filter;
mod homing;
mod inputs;
mod levels;
mod notice;
mod outputs;
mod overrides;
mod state;
mod watch;

pub use accessories::{Accessories, Power};
pub use alarm::Alarm;
pub use control::{Control, Effect, Ending, Event};
pub use filter::{Filter, SAMPLE_TICKS, SAMPLES};
pub use homing::Homing;
pub use inputs::{Contact, Inputs};
pub use levels::Levels;
pub use notice::{Notice, Notices};
pub use outputs::Outputs;
pub use overrides::{Override, Overrides};
pub use state::{Probed, Snapshot, State};
pub use watch::{Watch, Watched};
