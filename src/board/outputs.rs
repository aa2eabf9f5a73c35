//! Spindle, laser and coolant outputs.
//!
//! `prepare` switches; the duty of the PWM alone also changes with the segments, in `segment_start`.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use leadscrew::model::{Outputs, Spindle};

use super::{
    chosen, emulation, pins,
    wiring::{Pin, Wiring},
};

/// The duty output now: the timer's register is slow to reach.
static DUTY: AtomicU32 = AtomicU32::new(0);

/// What `prepare` switches.
pub(crate) struct SwitchOutputs(Outputs);

impl SwitchOutputs {
    /// Makes outputs of the pins, with everything off. The ports' clocks must run.
    pub(super) fn new() -> Self {
        let Wiring { switches, pwm, .. } = &chosen::WIRING;
        let pins = [
            switches.spindle,
            switches.counter_clockwise,
            switches.flood,
            switches.mist,
        ];
        let off = Outputs::default();
        switch(&off);
        pins.into_iter().flatten().for_each(Pin::make_output);
        if let Some((pin, function)) = *pwm {
            pin.make_alternate(function);
        }
        Self(off)
    }

    /// Switches what has changed, but for the duty.
    pub(super) fn apply(&mut self, outputs: &Outputs) {
        if *outputs != self.0 {
            if outputs.drivers != self.0.drivers {
                pins::enable(outputs.drivers);
            }
            self.0 = *outputs;
            switch(outputs);
            emulation::switched(outputs);
        }
    }
}

/// Switches everything off whatever it was: after a fault, when no task runs any more.
pub(super) fn switch_off() {
    chosen::set_pulse(0);
    switch(&Outputs::default());
}

/// Switches everything but the duty.
fn switch(outputs: &Outputs) {
    let switches = &chosen::WIRING.switches;
    let is_reversed = outputs.spindle == Spindle::CounterClockwise;
    // The direction first: a spindle must not start the wrong way.
    set(switches.counter_clockwise, is_reversed);
    set(switches.spindle, outputs.spindle != Spindle::Off);
    set(switches.flood, outputs.coolant.flood);
    set(switches.mist, outputs.coolant.mist);
}

/// Sets the share of time for which the PWM is high, 0 to [`Outputs::FULL`].
///
/// Takes effect with the next period, at most 0.2 ms later. `segment_start` calls it while the step
/// interrupt runs, `prepare` while it stands.
#[inline]
pub(super) fn set_duty(duty: u16) {
    let duty = u32::from(duty);
    if duty != DUTY.load(Relaxed) {
        DUTY.store(duty, Relaxed);
        chosen::set_pulse(duty);
    }
}

/// Returns the duty output now.
#[cfg(feature = "emulated")]
pub(super) fn duty() -> u32 {
    DUTY.load(Relaxed)
}

fn set(pin: Option<Pin>, high: bool) {
    if let Some(pin) = pin {
        let [a, b, c] = pin.word(high);
        pins::write_a_and_b([a, b]);
        pins::write_port_c(c);
    }
}
