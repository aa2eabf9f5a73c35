//! The virtual machine: the real task bodies on a virtual clock.

mod drive;

pub use drive::{Drive, ENTRY_RING, Edge};
