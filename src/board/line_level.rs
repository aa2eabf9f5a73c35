//! The level of the sender's line, and what has come over it, which `idle` looks at.
//!
//! # Cost
//!
//! None in tasks with deadlines: in `inputs` the look would cost 5 600 steps a second at 1 Mbaud. `idle` comes
//! round twice a millisecond at least, as `inputs` wakes it, unless the tasks need all of the time. [`LineLevel::check`]
//! is a function of its own: inlined into `idle`, the addresses of registers would be kept over all rounds, and the
//! proof would not know them.

use leadscrew::{
    machine::BreakDetector,
    model::Requests,
    protocol::{ByteCount, Utf8RequestWatch},
    tasks,
};

use super::{contacts, motion_clock, release::ChipPlatform};

/// The watch of `idle` over the line.
pub(crate) struct LineLevel {
    watches: (BreakDetector, Utf8RequestWatch),
    /// Bytes of lines that have been received.
    received: ByteCount<'static>,
    /// Time of the last millisecond that has been counted, ticks.
    counted_ticks: u32,
}

impl LineLevel {
    /// Returns a watch without samples.
    pub(crate) const fn new(received: ByteCount<'static>) -> Self {
        Self {
            watches: (BreakDetector::new(), Utf8RequestWatch::new()),
            received,
            counted_ticks: 0,
        }
    }

    /// Checks the level and the new bytes.
    #[inline(never)]
    pub(crate) fn check(&mut self, requests: &Requests) {
        tasks::sample_line(
            // USB has a request for a break.
            !cfg!(feature = "usb") && contacts::is_line_low(),
            motion_clock::take_millisecond(&mut self.counted_ticks).into(),
            self.received,
            &mut self.watches,
            requests,
            &mut ChipPlatform,
        );
    }
}
