//! What a run of `prepare` asks for: outputs, the step timer, other tasks, another run.

use leadscrew::{
    model::Requests,
    motion::{Motion, Prepared},
    stepper::{EventWriter, SegmentRing},
};

use super::{
    outputs::SwitchOutputs,
    pac,
    release::{PREPARE, SEGMENT_START, WAKE, pend},
    step_output::{self, StepSwitch},
    wake::WakeTimer,
};

/// What `prepare` drives, and it alone.
pub(crate) struct AfterPrepare {
    switches: SwitchOutputs,
    timer: WakeTimer,
}

impl AfterPrepare {
    /// Sets up the outputs and the timer, and releases `prepare` for what is to be switched at
    /// power-up. The clocks of both must run.
    pub(super) fn new(timer: pac::TIM6) -> Self {
        rtic::pend(PREPARE);
        Self {
            switches: SwitchOutputs::new(),
            timer: WakeTimer::new(timer),
        }
    }

    /// Before a run: tells it whether the time is over that it asked for.
    #[inline]
    pub(crate) fn begin(&mut self, requests: &Requests) {
        if self.timer.take_end() {
            requests.wake();
        }
    }

    /// After a run. The drivers are switched on before the first step.
    pub(crate) fn follow(
        &mut self,
        prepared: Prepared,
        motion: &mut Motion,
        events: &mut EventWriter<'_>,
        segments: &SegmentRing,
        mut step: impl rtic::Mutex<T = StepSwitch>,
    ) {
        step_output::go_on(events, segments);
        let is_at_rest = !segments.is_running() && !prepared.start_steps;
        // At rest the duty is theirs, too, and what has been switched in motion may be still to come.
        if prepared.outputs_changed || is_at_rest {
            self.switches.apply(motion.outputs(), is_at_rest);
        }
        if prepared.start_steps
            && let Some(then) = step_output::set_up(events)
        {
            step.lock(|step| step.start(then, segments));
            pend(SEGMENT_START);
        }
        if prepared.outputs_changed
            && let Some(milliseconds) = motion.take_delay_ms()
        {
            self.timer.set(milliseconds);
        }
        if prepared.run_again {
            pend(PREPARE);
        }
        if prepared.wake_interpret {
            rtic::pend(WAKE);
        }
    }
}
