//! The storage of everything that outlives power: records in a journal of two flash sectors.

mod journal;
mod record;
mod sectors;

pub use journal::{Journal, Loaded};
