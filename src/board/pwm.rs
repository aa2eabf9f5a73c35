//! The PWM of the spindle: an output of a timer, which the board's file chooses.
//!
//! Registers: RM0090 17.4, 18.4, 19.5, the same for all timers with outputs.
#![expect(unsafe_code, reason = "a timer by its address")]

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use leadscrew::{model::Outputs, settings::Settings};

use super::{
    chosen,
    wiring::{Pull, Pwm},
};

/// Registers of a timer, in words from its first.
const CR1: usize = 0;
const EGR: usize = 5;
const CCMR1: usize = 6;
const CCER: usize = 8;
const PSC: usize = 10;
const ARR: usize = 11;
const CCR1: usize = 13;
const BDTR: usize = 17;
/// Bits: the counter runs, new values count at once, all outputs are released.
const CEN: u32 = 1;
const UG: u32 = 1;
const MOE: u32 = 1 << 15;
/// PWM mode 1, whose compare value changes at once: at 100 Hz a beam would stay on for 10 ms.
const MODE: u32 = 0b110_0000;

/// The prescaler in use; 0 before [`configure`].
static PRESCALER: AtomicU32 = AtomicU32::new(0);

/// Starts the PWM with no pulse, at 5.1 kHz, and gives it its pin. The clock of the timer must run.
pub(super) fn init() {
    let Some(pwm) = &chosen::WIRING.pwm else {
        return;
    };
    let index = pwm.channel - 1;
    pwm.write(PSC, pwm.prescaler - 1);
    pwm.write(ARR, u32::from(Outputs::FULL) - 1);
    pwm.write(CCMR1 + index / 2, MODE << (8 * (index % 2)));
    pwm.write(CCER, 1 << (4 * index));
    if pwm.has_break {
        pwm.write(BDTR, MOE);
    }
    pwm.write(EGR, UG);
    pwm.write(CR1, CEN);
    pwm.pin.make_alternate(pwm.function, Pull::None);
}

/// Sets the frequency of the PWM from its next period on, unless it is the same. At rest only.
pub(super) fn configure(settings: &Settings) {
    let Some(pwm) = &chosen::WIRING.pwm else {
        return;
    };
    let prescaler = Outputs::prescaler(pwm.prescaler, settings.pwm_hz);
    if prescaler != PRESCALER.load(Relaxed) {
        PRESCALER.store(prescaler, Relaxed);
        pwm.write(PSC, prescaler - 1);
    }
}

/// Sets the high time of the PWM at once, 0 to [`Outputs::FULL`].
pub(super) fn set_pulse(duty: u32) {
    if let Some(pwm) = &chosen::WIRING.pwm {
        pwm.write(CCR1 + pwm.channel - 1, duty);
    }
}

impl Pwm {
    fn write(&self, register: usize, word: u32) {
        let first = self.timer as *mut u32;
        // SAFETY: a single write to a register of a timer that the chip has, and that only this file uses.
        unsafe { first.add(register).write_volatile(word) };
    }
}
