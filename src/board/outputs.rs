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
    chosen, pins, pwm,
    wiring::{AccessoryPins, Output, Pin, Wiring},
};

/// The duty that is output.
static DUTY: AtomicU32 = AtomicU32::new(0);

/// The outputs that `prepare` switches, with their present state.
pub(crate) struct SwitchOutputs(pub(super) Outputs);

impl SwitchOutputs {
    /// Returns the outputs as [`make_safe`] leaves them.
    pub(super) fn new() -> Self {
        Self(Outputs::default())
    }

    /// Switches the outputs that have changed; not the duty.
    pub(super) fn apply(&mut self, outputs: &Outputs) {
        if *outputs != self.0 {
            if outputs.drivers != self.0.drivers {
                pins::enable(outputs.drivers);
            }
            self.0 = *outputs;
            switch(outputs);
        }
    }
}

/// Makes outputs of all pins that drive something, and none of them does: spindle, laser and coolant off,
/// drivers disabled, no pulse. The first that is set up after a reset, in which the pins float; the clocks of the ports must run.
pub(super) fn make_safe() {
    let Wiring {
        at_boot,
        enable,
        motors,
        accessories,
        pwm,
        ..
    } = &chosen::WIRING;
    // What the board itself needs, as the supply of a header, comes first.
    for &(pin, high) in *at_boot {
        make_output(pin, high);
    }
    let AccessoryPins {
        spindle,
        counter_clockwise,
        flood,
        mist,
    } = *accessories;
    let switched = [spindle, counter_clockwise, flood, mist];
    // `$4` is not known yet: these are the levels of the board's file.
    for output in enable.iter().copied().chain(switched.into_iter().flatten()) {
        make_output(output.pin, output.is_active_low);
    }
    for index in 0..motors.count() {
        make_output(motors.pin(index), false);
    }
    if let Some(pwm) = pwm {
        make_output(pwm.pin, false);
    }
}

/// Makes an output of a pin. The level comes first: none before it may show.
fn make_output(pin: Pin, high: bool) {
    pin.set(high);
    pin.make_output();
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
/// Takes effect at once. For `segment_start` while the step timer
/// runs, and for `prepare` while it stands.
pub(super) fn set_duty(duty: u16) {
    let duty = u32::from(duty);
    if duty != DUTY.load(Relaxed) {
        DUTY.store(duty, Relaxed);
        pwm::set_pulse(duty);
    }
}

fn set(output: Option<Output>, on: bool) {
    if let Some(output) = output {
        output.pin.set(on ^ output.is_active_low);
    }
}
