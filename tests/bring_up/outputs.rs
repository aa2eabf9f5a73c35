//! The outputs of the firmware, and whether a fault has left one of them on.

#[path = "../../src/board/outputs.rs"]
#[allow(dead_code, reason = "the emulator has no pins")]
mod production;

use leadscrew::model::{Coolant, Outputs, Spindle};

use super::{
    chosen::{self, WIRING},
    clock,
    kept::{leave, left},
    pins, pwm,
    wiring::{self, AccessoryPins, Output},
};

/// Where a fault leaves its time, and the numbers of outputs on before and after.
pub(super) const START: usize = 0;
pub(super) const ON: usize = 1;
pub(super) const CYCLES: usize = 2;
pub(super) const LEFT_ON: usize = 3;
/// Where it is left that the watchdog has ended a hang.
pub(super) const HAS_WATCHDOG: usize = 4;

/// What a fault leaves if the outputs have not been switched off.
pub(super) const NOT_REACHED: u32 = u32::MAX;

/// As in the firmware.
pub(super) fn make_safe() {
    production::make_safe();
}

/// Never called: there is no motion.
pub(super) fn set_duty(duty: u16) {
    production::set_duty(duty);
}

/// Switches spindle, coolant and PWM on. Returns how many outputs are on.
pub(super) fn switch_on() -> u32 {
    let on = Outputs {
        spindle: Spindle::CounterClockwise,
        coolant: Coolant {
            flood: true,
            mist: true,
        },
        ..Outputs::default()
    };
    production::SwitchOutputs::new().apply(&on);
    production::set_duty(Outputs::FULL);
    count_active()
}

/// As in the firmware, for `fault`; leaves the time taken, and the number of outputs still on.
pub(super) fn switch_off() {
    production::switch_off();
    let taken = clock::now().wrapping_sub(left(START));
    leave(CYCLES, clock::cycles(taken) as u32);
    leave(LEFT_ON, count_active());
}

/// Returns how many of the outputs are on, by the levels of the pins; of the PWM, by its compare value, as
/// the period is played to its end.
fn count_active() -> u32 {
    let AccessoryPins {
        spindle,
        counter_clockwise,
        flood,
        mist,
    } = WIRING.accessories;
    // An edge takes 100 ns, and the register of the levels follows two cycles later.
    cortex_m::asm::delay(64);
    let switched = [spindle, counter_clockwise, flood, mist];
    let active = switched
        .into_iter()
        .flatten()
        .filter(|output| is_active(*output))
        .count();
    active as u32 + u32::from(has_pulse())
}

fn is_active(output: Output) -> bool {
    let is_high = wiring::read_port(output.pin.port()) >> output.pin.number() & 1 != 0;
    is_high != output.is_active_low
}

/// Compare register of channel 1, in words from the first register of a timer: RM0090 18.4.
const CCR1: usize = 13;

#[expect(unsafe_code, reason = "a timer by its address")]
fn has_pulse() -> bool {
    WIRING.pwm.as_ref().is_some_and(|pwm| {
        let first = pwm.timer as *const u32;
        // SAFETY: reads a register without side effects of a timer that the chip has.
        unsafe { first.add(CCR1 + pwm.channel - 1).read_volatile() != 0 }
    })
}
