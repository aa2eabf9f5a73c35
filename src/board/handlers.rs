//! RTIC as used by the tasks, without its code around each handler.
//!
//! RTIC reads `BASEPRI` before a handler and writes it back after the handler, although each lock restores it. Here a
//! handler is called and nothing else. The analysis of the image refuses a handler that leaves `BASEPRI` changed, or
//! writes another value to the register than the value read from it.

pub(crate) use rtic::*;

/// What the code that RTIC generates calls.
pub(crate) mod export {
    pub(crate) use rtic::export::*;

    /// Calls a handler.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "it stands for its argument")]
    pub(crate) fn run(_priority: u8, handler: impl FnOnce()) {
        handler();
    }
}
