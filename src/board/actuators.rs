//! What `prepare` drives beside the steps: switched outputs, and the timer that releases it.

use leadscrew::{
    model::Outputs,
    tasks::{Platform, PreparePlatform, Task},
};

use super::{
    outputs::{self, SwitchOutputs},
    pac,
    release::{PREPARE, pend},
    wake::WakeTimer,
};

/// The outputs and the timer, owned by `prepare`.
pub(crate) struct Actuators {
    switches: SwitchOutputs,
    timer: WakeTimer,
}

impl Actuators {
    /// Sets up the outputs and the timer, and releases `prepare` for what is to be switched at
    /// power-up. The clocks of both must run.
    pub(super) fn new(timer: pac::TIM6) -> Self {
        rtic::pend(PREPARE);
        Self {
            switches: SwitchOutputs::new(),
            timer: WakeTimer::new(timer),
        }
    }
}

impl Platform for Actuators {
    #[inline]
    fn pend(&mut self, task: Task) {
        pend(task);
    }

    #[inline]
    fn set_duty(&mut self, duty: u16) {
        outputs::set_duty(duty);
    }
}

impl PreparePlatform for Actuators {
    #[inline]
    fn take_wake(&mut self) -> bool {
        self.timer.take_end()
    }

    #[inline]
    fn wake_in(&mut self, milliseconds: u16) {
        self.timer.set(milliseconds);
    }

    #[inline]
    fn switch(&mut self, outputs: &Outputs) {
        self.switches.apply(outputs);
    }
}
