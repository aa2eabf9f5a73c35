//! The levels of contacts and of the sender's line, which a test writes, and when to look at them.

use leadscrew::machine::SAMPLE_TICKS;

use super::{pac, qemu};

pub(super) use qemu::{memory::contacts as read, memory::is_line_low};

/// Time between two runs while the inputs do not change, µs: the stand-in counts milliseconds.
pub(super) const IDLE_PERIOD_US: u16 = 1000;

/// In place of the timer of `inputs`, which does not exist: the stand-in counts the time between samples.
pub(super) struct SampleTimer;

#[expect(clippy::unused_self, reason = "whoever has it is `inputs`")]
impl SampleTimer {
    pub(super) const fn new(_: pac::TIM10) -> Self {
        Self
    }

    /// Takes the release of `inputs` for a sample.
    #[inline]
    pub(super) fn take_due(&mut self) -> bool {
        qemu::take_sample_release()
    }

    /// Begins periods of samples.
    #[inline]
    pub(super) fn start_sampling(&mut self) {
        qemu::sample_every(SAMPLE_TICKS);
    }

    /// Ends them.
    #[inline]
    pub(super) fn stop_sampling(&mut self) {
        qemu::sample_every(0);
    }
}

/// Returns the time since the timer released the task: it never does.
#[cfg(feature = "trace")]
pub(super) const fn timer_release_age_us() -> Option<u16> {
    None
}
