//! The levels of the input pins and of the sender's line, and the timer that says when to look at them: TIM10.
//!
//! # Cost
//!
//! Everything that `inputs` calls is inlined, and the loop over the pins has the bound of the longest table of a board.

use leadscrew::{machine::SAMPLE_TICKS, model::Levels, units::TICKS_PER_US};

use super::{
    chosen::{TIMERS_MHZ, WIRING},
    pac,
    wiring::{PortList, read_port},
};

/// Time between two runs while the inputs do not change, µs: each also looks whether the next segment is due.
pub(super) const IDLE_PERIOD_US: u16 = 500;
/// Time between two samples, µs.
const SAMPLE_PERIOD_US: u16 = (SAMPLE_TICKS / TICKS_PER_US) as u16;

/// The timer of `inputs`.
pub(super) struct SampleTimer(pac::TIM10);

impl SampleTimer {
    /// Starts the timer with the period of inputs that do not change. Its clock must run.
    pub(super) fn new(timer: pac::TIM10) -> Self {
        timer.psc().write(|w| w.psc().set(TIMERS_MHZ - 1));
        timer.cr1().write(|w| w.urs().set_bit());
        timer.dier().write(|w| w.uie().set_bit());
        set_period(&timer, IDLE_PERIOD_US);
        timer.cr1().write(|w| w.urs().set_bit().cen().set_bit());
        Self(timer)
    }

    /// Takes the overflow of the timer.
    pub(super) fn take_due(&mut self) -> bool {
        let is_due = self.0.sr().read().uif().bit_is_set();
        if is_due {
            self.0.sr().write(|w| w.uif().clear_bit());
        }
        is_due
    }

    /// Begins periods of samples.
    pub(super) fn start_sampling(&mut self) {
        set_period(&self.0, SAMPLE_PERIOD_US);
    }

    /// Goes back to the period without samples.
    pub(super) fn stop_sampling(&mut self) {
        // The counter is below the new period, and goes on.
        self.0.arr().write(|w| w.arr().set(IDLE_PERIOD_US - 1));
    }
}

fn set_period(timer: &pac::TIM10, period_us: u16) {
    timer.arr().write(|w| w.arr().set(period_us - 1));
    timer.egr().write(|w| w.ug().set_bit());
}

/// Returns the time since the timer released the task, µs; `None` if the timer has not.
#[cfg(feature = "trace")]
#[expect(unsafe_code, reason = "the task owns the timer")]
pub(super) fn timer_release_age_us() -> Option<u16> {
    // SAFETY: reads registers without side effects.
    let timer = unsafe { &*pac::TIM10::ptr() };
    // In this order: the flag of a period that ends in between must not go with the period before.
    let is_due = timer.sr().read().uif().bit_is_set();
    let age = timer.cnt().read().cnt().bits();
    is_due.then_some(age)
}

/// The ports of the inputs.
const INPUT_PORTS: PortList = WIRING.input_ports();

/// Returns the closed contacts.
pub(super) fn read() -> Levels {
    let mut levels = [0; INPUT_PORTS.length];
    for (index, level) in levels.iter_mut().enumerate() {
        *level = read_port(INPUT_PORTS.port(index));
    }
    let mut closed = Levels::NONE;
    for input in WIRING.inputs {
        let level = levels[INPUT_PORTS.index(input.pin.port())];
        let is_high = level >> input.pin.number() & 1 != 0;
        if is_high != input.is_active_low {
            closed = closed | input.levels;
        }
    }
    closed
}

/// Returns whether the sender's line is low. The level of a pin can be read also while a peripheral has it (RM0090
/// 8.3.11).
pub(super) fn is_line_low() -> bool {
    let pin = WIRING.receive;
    read_port(pin.port()) >> pin.number() & 1 == 0
}
