//! RTIC as used by the tasks, without its code around each handler.
//!
//! RTIC reads `BASEPRI` before a handler and writes it back after the handler, although each lock restores it. Here a
//! handler is called and nothing else. The analysis of the image refuses a handler that leaves `BASEPRI` changed, or
//! writes another value to the register than the value read from it.

pub(crate) use rtic::*;

/// What the code that RTIC generates calls.
pub(crate) mod export {
    use cortex_m::peripheral;
    pub(crate) use rtic::export::*;

    use crate::board::{pac::Interrupt, vectors};

    /// The interrupt controller, for the vectors of all tasks in the source.
    #[expect(clippy::upper_case_acronyms, reason = "the name that RTIC uses")]
    pub(crate) struct NVIC;

    impl NVIC {
        /// Unmasks a vector, if this image has the task.
        #[inline(always)]
        #[expect(clippy::inline_always, reason = "a vector that is bound is a constant")]
        #[expect(unsafe_code, reason = "as the function whose place it takes")]
        pub(crate) unsafe fn unmask(vector: Interrupt) {
            if vectors::is_bound(vector) {
                // SAFETY: the caller's.
                unsafe { peripheral::NVIC::unmask(vector) };
            }
        }
    }

    /// Calls a handler.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "it stands for its argument")]
    pub(crate) fn run(_priority: u8, handler: impl FnOnce()) {
        handler();
    }
}
