//! Whether the drivers or the coils of the motors are enabled.

use core::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// The state: disabled at first.
pub(super) struct EnableState(AtomicBool);

impl EnableState {
    pub(super) const fn new() -> Self {
        Self(AtomicBool::new(false))
    }

    /// Outputs a new state. For `prepare`, and before tasks run.
    pub(super) fn set(&self, on: bool, output: impl FnOnce(bool)) {
        self.0.store(on, Relaxed);
        output(on);
    }

    /// Outputs the state once more. `prepare` may change the state in the middle: then the new state.
    pub(super) fn output_again(&self, output: impl Fn(bool)) {
        loop {
            let on = self.0.load(Relaxed);
            output(on);
            if self.0.load(Relaxed) == on {
                return;
            }
        }
    }
}
