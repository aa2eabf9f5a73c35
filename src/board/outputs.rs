//! Spindle, laser and coolant outputs.
//!
//! `prepare` switches the outputs; `segment_start` changes only the duty of the PWM, with the segments.
//!
//! # Cost
//!
//! The duty is kept in memory and written only when it changes: the register of the timer is on the
//! slow bus.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use leadscrew::model::{Outputs, Spindle};

use super::{
    chosen, emulation, pins, pwm,
    wiring::{Output, Wiring},
};

/// The duty that is output.
static DUTY: AtomicU32 = AtomicU32::new(0);

/// The outputs that `prepare` switches, with their present state.
pub(crate) struct SwitchOutputs(Outputs);

impl SwitchOutputs {
    /// Makes outputs of the pins, all off. The clocks of the ports must run.
    pub(super) fn new() -> Self {
        let Wiring {
            accessories, pwm, ..
        } = &chosen::WIRING;
        let pins = [
            accessories.spindle,
            accessories.counter_clockwise,
            accessories.flood,
            accessories.mist,
        ];
        let off = Outputs::default();
        switch(&off);
        for output in pins.into_iter().flatten() {
            output.pin.make_output();
        }
        if let Some(pwm) = pwm {
            pwm.pin.make_alternate(pwm.function);
        }
        Self(off)
    }

    /// Switches the outputs that have changed; not the duty.
    pub(super) fn apply(&mut self, outputs: &Outputs) {
        if *outputs != self.0 {
            if outputs.drivers != self.0.drivers {
                pins::enable(outputs.drivers);
            }
            self.0 = *outputs;
            switch(outputs);
            emulation::record_outputs(outputs);
        }
    }
}

/// Switches everything off, after a fault, when no task runs any more.
pub(super) fn switch_off() {
    pwm::set_pulse(0);
    switch(&Outputs::default());
}

/// Switches all outputs but the duty.
fn switch(outputs: &Outputs) {
    let accessories = &chosen::WIRING.accessories;
    let is_reversed = outputs.spindle == Spindle::CounterClockwise;
    // The direction first: a spindle must not start in the wrong direction.
    set(accessories.counter_clockwise, is_reversed);
    set(accessories.spindle, outputs.spindle != Spindle::Off);
    set(accessories.flood, outputs.coolant.flood);
    set(accessories.mist, outputs.coolant.mist);
}

/// Sets the share of time for which the PWM is high, 0 to [`Outputs::FULL`].
///
/// Takes effect with the next period, at most 0.2 ms later. For `segment_start` while the step timer
/// runs, and for `prepare` while it stands.
#[inline]
pub(super) fn set_duty(duty: u16) {
    let duty = u32::from(duty);
    if duty != DUTY.load(Relaxed) {
        DUTY.store(duty, Relaxed);
        pwm::set_pulse(duty);
    }
}

/// Returns the duty that is output.
#[cfg(feature = "emulated")]
pub(super) fn duty() -> u32 {
    DUTY.load(Relaxed)
}

fn set(output: Option<Output>, on: bool) {
    if let Some(output) = output {
        output.pin.set(on ^ output.is_active_low);
    }
}
