//! The level of the sender's line, which `idle` looks at.
//!
//! # Cost
//!
//! None in tasks with deadlines: the same look in a run of `inputs` cost 5 600 steps a second at 1 Mbaud. `idle` comes
//! round once a millisecond at least, as `inputs` runs then, unless the tasks need all of the time. [`LineLevel::look`]
//! is a function of its own: inlined into `idle`, the addresses of registers would be kept over all rounds, and the
//! proof would not know them.

use leadscrew::{machine::LineBreak, model::Requests, protocol::ByteCount, tasks};

use super::{ChipPlatform, chosen::WIRING, emulation, pac, wiring::read_port};

/// The watch of `idle` over the line.
pub(crate) struct LineLevel {
    line: LineBreak,
    /// Bytes of lines that have been received.
    received: ByteCount<'static>,
    /// The count of the timer of `inputs` at the last look.
    count: u16,
}

impl LineLevel {
    /// Returns a watch that has not looked.
    pub(crate) const fn new(received: ByteCount<'static>) -> Self {
        Self {
            line: LineBreak::new(),
            received,
            count: 0,
        }
    }

    /// Takes a look.
    #[inline(never)]
    pub(crate) fn look(&mut self, requests: &Requests) {
        let periods = self.periods();
        let received = self.received.enqueued();
        tasks::look_at_line(
            is_low(),
            periods,
            received,
            &mut self.line,
            requests,
            &mut ChipPlatform,
        );
    }

    /// Returns how many periods of the timer of `inputs`, of 250 µs or 1 ms, have ended since the last look. One at
    /// most: a break is noticed later, then.
    #[expect(unsafe_code, reason = "`inputs` owns the timer")]
    fn periods(&mut self) -> u8 {
        if emulation::is_emulated() {
            return emulation::take_milliseconds();
        }
        // SAFETY: the count is only read.
        let count = unsafe { &*pac::TIM10::ptr() }.cnt().read().cnt().bits();
        let has_ended = count < self.count;
        self.count = count;
        has_ended.into()
    }
}

/// Returns whether the line is low. The level of a pin can be read also while a peripheral has it (RM0090 8.3.11).
fn is_low() -> bool {
    if emulation::is_emulated() {
        return emulation::is_line_low();
    }
    let pin = WIRING.receive;
    read_port(pin.port()) >> pin.number() & 1 == 0
}
