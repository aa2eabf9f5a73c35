//! The simulator: the bodies of the tasks on a virtual clock.

mod contacts;
mod drive;
mod flash;
mod numbers;
mod platform;
mod playback;
mod simulator;
mod step_statistics;
mod stream;

pub use contacts::{Closes, ProbeBlock, Switch};
pub use drive::{Drive, Edge};
pub use flash::{Flash, FlashError, SECTOR, SECTORS};
pub use playback::{PlayedSegment, SegmentKind};
pub use simulator::Simulator;
pub use step_statistics::StepStatistics;
pub use stream::{Stream, StreamEnd, WINDOW, Watcher};
