//! The machine's state and what is known of it elsewhere.

mod alarm;
mod state;

pub use alarm::Alarm;
pub use state::{Snapshot, State};
