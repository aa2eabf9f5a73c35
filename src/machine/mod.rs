//! The machine's state and what is known of it elsewhere.

mod state;

pub use state::{Snapshot, State};
