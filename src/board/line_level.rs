//! The level of the sender's line, and what has come over it, which `idle` looks at.
//!
//! # Cost
//!
//! None in tasks with deadlines: in `inputs` the look would cost 5 600 steps a second at 1 Mbaud. `idle` comes
//! round once a millisecond at least, as `inputs` wakes it, unless the tasks need all of the time. [`LineLevel::look`]
//! is a function of its own: inlined into `idle`, the addresses of registers would be kept over all rounds, and the
//! proof would not know them.

use leadscrew::{
    machine::BreakDetector,
    model::Requests,
    protocol::{ByteCount, Utf8RequestWatch},
    tasks,
};

use super::{ChipPlatform, chosen::WIRING, emulation, pac, wiring::read_port};

/// Where in each of its periods, of 250 µs or 1 ms, the timer of `inputs` sets a flag for `idle`, µs: far from their
/// ends, which release `inputs` and so wake `idle`.
const FLAG_US: u16 = 125;

/// Has the timer of `inputs` set the flag, by a compare channel without an output and an interrupt (RM0090 19.5.5).
pub(super) fn mark_periods(timer: &pac::TIM10) {
    timer.ccr1().write(|w| w.ccr().set(FLAG_US));
}

/// The watch of `idle` over the line.
pub(crate) struct LineLevel {
    watches: (BreakDetector, Utf8RequestWatch),
    /// Bytes of lines that have been received.
    received: ByteCount<'static>,
}

impl LineLevel {
    /// Returns a watch that has not looked.
    pub(crate) const fn new(received: ByteCount<'static>) -> Self {
        Self {
            watches: (BreakDetector::new(), Utf8RequestWatch::new()),
            received,
        }
    }

    /// Takes a look.
    #[inline(never)]
    pub(crate) fn look(&mut self, requests: &Requests) {
        let periods = periods();
        tasks::look_at_line(
            is_low(),
            periods,
            self.received,
            &mut self.watches,
            requests,
            &mut ChipPlatform,
        );
    }
}

/// Returns how many periods of the timer of `inputs` have passed since the last look. One at most: a break is noticed
/// later, then.
#[expect(unsafe_code, reason = "`inputs` owns the timer")]
fn periods() -> u8 {
    if emulation::is_emulated() {
        return emulation::take_millisecond().into();
    }
    // SAFETY: the flag is of this function alone, and ones leave the other flags as they are.
    let timer = unsafe { &*pac::TIM10::ptr() };
    let has_passed = timer.sr().read().cc1if().bit_is_set();
    if has_passed {
        timer.sr().write(|w| w.cc1if().clear_bit());
    }
    has_passed.into()
}

/// Returns whether the line is low. The level of a pin can be read also while a peripheral has it (RM0090 8.3.11).
fn is_low() -> bool {
    if emulation::is_emulated() {
        return emulation::is_line_low();
    }
    let pin = WIRING.receive;
    read_port(pin.port()) >> pin.number() & 1 == 0
}
