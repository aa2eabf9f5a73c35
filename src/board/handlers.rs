//! RTIC as the tasks use it, without what it does around each handler.
//!
//! RTIC reads `BASEPRI` before a handler and writes it back after it, although each lock restores it. Here a handler is
//! called and nothing else. The analysis of the image refuses a handler that leaves `BASEPRI` changed, or writes to it
//! what it has not read from it.

pub(crate) use rtic::*;

/// What the code that RTIC generates calls.
pub(crate) mod export {
    pub(crate) use rtic::export::*;

    /// Calls a handler.
    pub(crate) fn run(_priority: u8, handler: impl FnOnce()) {
        handler();
    }
}
