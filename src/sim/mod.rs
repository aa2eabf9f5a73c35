//! The virtual machine: the real task bodies on a virtual clock.

mod contacts;
mod drive;
mod flash;
mod simulator;
mod stream;
mod tally;

pub use contacts::{Closes, Switch};
pub use drive::{Drive, ENTRY_RING, Edge};
pub use flash::{Flash, FlashError, SECTOR, SECTORS};
pub use simulator::{RECEIVED_RING, SENT_RING, Simulator};
pub use stream::{End, Stream, Watcher};
pub use tally::Tally;
