//! The actuators that `prepare` drives beside the steps: recorded outputs, and delays counted by the stand-in for the
//! timers.

use leadscrew::{
    model::Outputs,
    tasks::{Platform, PreparePlatform, Task},
};

use super::{
    motion_clock,
    outputs::{self, SwitchOutputs},
    pac, qemu,
    release::pend,
};

/// The outputs, owned by `prepare`.
pub(crate) struct Actuators(SwitchOutputs);

impl Actuators {
    /// Returns the outputs; the timer does not exist.
    pub(super) fn new(_: pac::TIM9) -> Self {
        Self(SwitchOutputs::new())
    }
}

impl Platform for Actuators {
    #[inline]
    fn pend(&mut self, task: Task) {
        pend(task);
    }

    #[inline]
    fn now_ticks(&self) -> u32 {
        motion_clock::now_ticks()
    }

    fn set_duty(&mut self, duty: u16) {
        outputs::set_duty(duty);
    }
}

impl PreparePlatform for Actuators {
    #[inline]
    fn take_delay_end(&mut self) -> bool {
        qemu::take_delay_end()
    }

    #[inline]
    fn start_delay(&mut self, delay_ms: u16) {
        qemu::start_delay(delay_ms);
    }

    #[inline]
    fn switch(&mut self, outputs: &Outputs) {
        if *outputs != self.0.0 {
            self.0.apply(outputs);
            qemu::memory::record_outputs(outputs);
        }
    }
}
