//! What `prepare` drives beside the steps: spindle, coolant, drivers and the timer of its delays.

use leadscrew::{
    model::Outputs,
    tasks::{Platform, PreparePlatform, Task},
};

use super::{
    delay_timer::DelayTimer,
    motion_clock,
    outputs::{self, SwitchOutputs},
    pac,
    release::pend,
};

/// The outputs and the timer, owned by `prepare`.
pub(crate) struct Actuators {
    switches: SwitchOutputs,
    timer: DelayTimer,
}

impl Actuators {
    /// Sets up the outputs and the timer, whose clocks must run.
    pub(super) fn new(timer: pac::TIM9) -> Self {
        Self {
            switches: SwitchOutputs::new(),
            timer: DelayTimer::new(timer),
        }
    }
}

impl Platform for Actuators {
    fn pend(&mut self, task: Task) {
        pend(task);
    }

    fn now_ticks(&self) -> u32 {
        motion_clock::now_ticks()
    }

    fn set_duty(&mut self, duty: u16) {
        outputs::set_duty(duty);
    }
}

impl PreparePlatform for Actuators {
    fn take_delay_end(&mut self) -> bool {
        self.timer.take_end()
    }

    fn start_delay(&mut self, delay_ms: u16) {
        self.timer.start(delay_ms);
    }

    fn switch(&mut self, outputs: &Outputs) {
        self.switches.apply(outputs);
    }
}
