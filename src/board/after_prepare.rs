//! What a run of `prepare` asks for: outputs, the step timer, other tasks, another run.

use leadscrew::{machine::Outputs, planner::Prepared, stepper::StepCounts};

use super::{
    outputs::SwitchOutputs,
    pac,
    release::{PREPARE, WAKE},
    step_output,
    wake::WakeTimer,
};

/// What `prepare` drives, and it alone.
pub(crate) struct AfterPrepare {
    switches: SwitchOutputs,
    timer: WakeTimer,
}

impl AfterPrepare {
    /// Sets up the outputs and the timer. The clocks of both must run.
    pub(super) fn new(timer: pac::TIM6) -> Self {
        Self {
            switches: SwitchOutputs::new(),
            timer: WakeTimer::new(timer),
        }
    }

    /// Before a run: the timer that may have released it has done so.
    #[inline]
    pub(crate) fn begin(&mut self) {
        self.timer.acknowledge();
    }

    /// After a run. The drivers are switched on before the first step.
    pub(crate) fn follow(&mut self, prepared: Prepared, outputs: &Outputs, counts: &StepCounts) {
        self.switches.apply(outputs, counts);
        if prepared.start {
            step_output::start();
        }
        if prepared.again {
            rtic::pend(PREPARE);
        }
        if prepared.news {
            rtic::pend(WAKE);
        }
    }
}
