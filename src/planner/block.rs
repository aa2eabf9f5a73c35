//! What waits in the look-ahead.

use super::{Coolant, Spindle};
use crate::settings::Settings;

/// One entry of the queue from `interpret` to `prepare`.
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    /// The reset after which it was made: an entry of an older epoch is dropped.
    pub epoch: u32,
    /// What to do.
    pub work: Work,
}

/// What an entry asks for.
#[derive(Debug, Clone, Copy)]
pub enum Work {
    /// Standstill, ms.
    Dwell(u32),
    /// A state of the spindle and its speed, rpm.
    Spindle(Spindle, f32),
    /// A state of the coolant.
    Coolant(Coolant),
    /// Wait for cycle start.
    Pause,
    /// Leave the alarm state.
    Unlock,
    /// New settings. Sent at rest only.
    Configure(Settings),
}
