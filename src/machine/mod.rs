//! The machine's state, its inputs and its accessories. Nothing here makes motion.

mod accessories;
mod input_filter;
mod inputs;
mod line_break;
mod snapshot;
mod state_machine;
mod watch;

pub use accessories::Accessories;
pub use input_filter::{Filter, SAMPLE_TICKS, SAMPLES};
pub use inputs::{Contact, Inputs};
pub use line_break::BreakDetector;
pub use snapshot::Snapshot;
pub use state_machine::{Control, Effect, Ending, Event};
pub use watch::{SampleActions, Watch};
