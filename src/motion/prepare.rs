//! The body of `prepare`: takes entries, plans them, keeps the step interrupt's queue filled.
//!
//! Joins the look-ahead, the speed profile, the step generator and the machine's state, and owns
//! them all. Runs when a segment begins to be played, when an entry or a request has come, and again
//! while there is more to do: each run does one [`Job`] of work, so that the longest of them bounds
//! it. Deadline: the events queued ahead, [`QUEUED_AHEAD_TICKS`](crate::model::timing::QUEUED_AHEAD_TICKS); a miss
//! starves the step interrupt, which is a fault.

mod cycles;
mod delays;
mod entries;
mod job;
mod parking;
mod requests;
mod segments;

use heapless::spsc::Consumer;

use self::{
    delays::{Delay, Restoring},
    job::{Context, Job},
    parking::Parking,
};
use super::{
    BLOCKS, Homing, LookAhead, cycles::probing::ProbingCycle, executor::Executor,
    jerk_limited::MovingAverage,
};
use crate::{
    axis::{AXES, Axes},
    machine::{Accessories, Control, Ending, Inputs, Snapshot},
    model::{
        Alarm, Awaited, Coolant, Levels, Notices, Outputs, Power, Probed, Requests, Spindle, State,
    },
    path::{AveragingWindow, Entry},
    settings::Settings,
    stepper::{EventWriter, Generator, Segment, SegmentRing},
};

/// What `prepare` asks of its shell after a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Prepared {
    /// Run it again: there is more to do.
    pub run_again: bool,
    /// Start the step timer, with [`StepCounts::start`]: it has stopped, and there are events. But
    /// not if there has been a cut meanwhile, to which another run has to see first.
    pub start_steps: bool,
    /// Release `interpret`: there is room, or what it may wait for has changed.
    pub wake_interpret: bool,
    /// Apply [`Motion::outputs`], and set the timer if [`Motion::take_delay_ms`] tells a time: one of
    /// them has changed.
    pub outputs_changed: bool,
}

impl Prepared {
    /// There is more to do, and nothing else.
    const AGAIN: Self = Self {
        run_again: true,
        start_steps: false,
        wake_interpret: false,
        outputs_changed: false,
    };
}

/// Everything between the entries and the events.
///
/// In this order in memory: what each run looks at is near its beginning, where one instruction
/// reaches it; the plan, which is large, comes last.
#[derive(Debug)]
#[repr(C)]
pub struct Motion {
    control: Control,
    /// The newest reset acted on.
    reset_count: u32,
    /// The requests acted on, by their count.
    handled: u32,
    /// When that was, by the motion played, or so long ago that it no longer matters.
    handled_ticks: u32,
    /// Motions ended before their target, wrapping.
    cancelled_motions: u32,
    finished: u32,
    /// The standstill segment has been put, and begins then on the generator's clock.
    standstill: Option<u32>,
    /// There was no room for a segment while the one with this start was being played.
    full: Option<u32>,
    /// When the newest segment begins on the generator's clock.
    newest: u32,
    /// Standstill still to come, ticks.
    dwell_ticks: u64,
    is_dwelling: bool,
    reset_in_motion: bool,
    /// The step interrupt ran out of events in motion: nothing is executed before the next reset.
    has_underrun: bool,
    /// An alarm has come that only a reset ends.
    is_critical: bool,
    /// The door has to be looked at when the reset is over.
    checks_door: bool,
    /// An alarm that comes when the machine is at rest.
    fault: Option<Alarm>,
    /// Waiting for cycle start after `M0`.
    is_paused: bool,
    /// A homing cycle has been asked for, and is not finished.
    is_homing: bool,
    restoring: Restoring,
    /// What the shell's timer has been asked for, and the time to be asked for.
    delay: Delay,
    delay_ms: Option<u16>,
    /// Drivers are released after an alarm whatever `$1` says.
    disables_drivers: bool,
    idle_delay_ms: u8,
    hard_limits: bool,
    /// The state has changed at rest, so that something more may follow from it.
    changed_at_standstill: bool,
    /// At rest: the next run makes a segment.
    is_first_segment_next: bool,
    accessories: Accessories,
    /// The power at rest, and what has been published.
    at_rest: Power,
    power: Power,
    outputs: Outputs,
    /// The outputs have changed since the shell was told.
    outputs_changed: bool,
    notices: Notices,
    probe: ProbingCycle,
    probed: Probed,
    inputs: Levels,
    executor: Executor,
    /// The segment being made.
    segment: Segment,
    generator: Generator,
    homing: Homing,
    parking: Parking,
    smooth: MovingAverage,
    plan: LookAhead,
}

impl Motion {
    /// At rest at zero, not yet configured: a constant, so that it is built in place.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            plan: LookAhead::new(),
            smooth: MovingAverage::new(),
            executor: Executor::new(),
            segment: Segment::NONE,
            generator: Generator::new(),
            control: Control::IDLE,
            parking: Parking::new(),
            changed_at_standstill: false,
            is_first_segment_next: false,
            accessories: Accessories::new(),
            at_rest: Power::OFF,
            power: Power::OFF,
            reset_count: 0,
            handled: 0,
            handled_ticks: 0,
            cancelled_motions: 0,
            reset_in_motion: false,
            has_underrun: false,
            is_critical: false,
            checks_door: false,
            fault: None,
            is_paused: false,
            dwell_ticks: 0,
            is_dwelling: false,
            restoring: Restoring::None,
            homing: Homing::new(),
            is_homing: false,
            probe: ProbingCycle::new(),
            probed: Probed {
                steps: Axes([0; AXES]),
                success: false,
            },
            delay: Delay::None,
            delay_ms: None,
            disables_drivers: false,
            idle_delay_ms: 25,
            hard_limits: false,
            finished: 0,
            standstill: Some(0),
            full: None,
            newest: 0,
            notices: Notices::new(),
            inputs: Levels::NONE,
            outputs: Outputs {
                spindle: Spindle::Off,
                duty: 0,
                coolant: Coolant::OFF,
                drivers: false,
            },
            outputs_changed: true,
        }
    }

    /// Takes over the settings at power-up, and tells the machine as it is then. It wakes up locked
    /// with homing enabled, or on a limit switch with hard limits enabled.
    ///
    /// The first run must follow: it looks at the door and arms the limit switches.
    pub fn power_up(&mut self, settings: &Settings, inputs: &Inputs) -> Snapshot {
        self.configure(settings, inputs);
        self.outputs.drivers = settings.idle_delay_ms == delays::ALWAYS_ENABLED;
        if settings.homing || self.is_on_limit() {
            self.control.state = State::Alarm;
        }
        Snapshot {
            state: self.control.state,
            inputs: self.inputs,
            blocks_free: BLOCKS as u16,
            is_at_rest: true,
            ..Snapshot::default()
        }
    }

    fn configure(&mut self, settings: &Settings, inputs: &Inputs) {
        let window = AveragingWindow::new(settings);
        self.smooth.configure(window);
        self.plan.set_window(window.samples, window.seconds());
        self.plan.set_step_rate(settings.step_rate.hz());
        self.generator.set_pulse_us(settings.step_pulse_us);
        self.accessories.configure(settings);
        self.homing.configure(settings);
        self.parking.configure(settings);
        self.idle_delay_ms = settings.idle_delay_ms;
        self.hard_limits = settings.hard_limits;
        inputs.configure(settings);
        self.inputs = inputs.active();
    }

    /// Whether a limit switch is active that stops the machine.
    fn is_on_limit(&self) -> bool {
        self.hard_limits && self.inputs.has(Levels::LIMITS)
    }

    /// What is to be switched; the shell applies it after each run in which it has changed, before it
    /// starts the timer.
    ///
    /// While the step timer runs, the duty is that of the segments instead: the shell leaves the
    /// PWM to `segment_start`.
    #[must_use]
    pub const fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// The time from now, ms, at which the shell is to call [`Requests::wake`] and run it again, instead
    /// of at the time asked for before. Without a value, that stays as it is.
    pub fn take_delay_ms(&mut self) -> Option<u16> {
        self.delay_ms.take()
    }

    /// One run. The machine as it is afterwards replaces the `snapshot` of the run before.
    pub fn run(
        &mut self,
        requests: &Requests,
        inputs: &Inputs,
        segments: &SegmentRing,
        entries: &mut Consumer<'_, Entry>,
        events: &mut EventWriter<'_>,
        snapshot: &mut Snapshot,
    ) -> Prepared {
        let context = self.context(requests, segments);
        if !self.is_segment_due(context, segments) {
            return self.run_job(requests, inputs, segments, entries, events, snapshot);
        }
        if self.needs_sample() {
            // Nothing that anybody sees changes, and what needs the cell follows.
            self.sample_reference();
            return Prepared::AGAIN;
        }
        self.make_segment(inputs, segments, events);
        // Nothing else that is published has changed.
        let is_still = self.is_at_standstill(context);
        if self.control.state == State::Alarm {
            self.arm_hard_limits(inputs, is_still);
        }
        let is_toggled = self.publish_accessories(segments, snapshot);
        let has_rested = self.publish_progress(is_still, snapshot);
        let again = is_still
            || self.may_need_segment(context, segments)
            || self.has_more(context, inputs, entries);
        Prepared {
            run_again: again,
            start_steps: context.starts_steps(again, events),
            wake_interpret: is_toggled || has_rested || requests.awaits(Awaited::SEGMENTS),
            outputs_changed: core::mem::take(&mut self.outputs_changed),
        }
    }

    /// A run in which no segment is due.
    #[inline(never)]
    fn run_job(
        &mut self,
        requests: &Requests,
        inputs: &Inputs,
        segments: &SegmentRing,
        entries: &mut Consumer<'_, Entry>,
        events: &mut EventWriter<'_>,
        snapshot: &mut Snapshot,
    ) -> Prepared {
        let context = self.context(requests, segments);
        self.inputs = inputs.active();
        let was_dwelling = self.is_dwelling;
        let job = self.next_job(context, requests, inputs, segments, entries);
        self.is_first_segment_next = job == Job::FirstSegment;
        match job {
            Job::None | Job::FirstSegment => {}
            Job::Underrun => self.handle_underrun(segments),
            Job::Halted => self.handle_halted(segments, events),
            Job::Reset => self.handle_reset(requests, segments),
            Job::Requests => self.handle_requests(requests, segments),
            Job::LatchPosition => self.latch_position(inputs, segments, events),
            Job::Plan => self.continue_planning(),
            Job::Dequeue => self.dequeue_entry(entries, inputs),
            Job::Standstill => {
                let before = self.control;
                self.enter_standstill();
                self.changed_at_standstill = self.control != before;
            }
        }
        let is_still = self.is_at_standstill(context);
        self.arm_hard_limits(inputs, is_still);
        if !self.probe.is_active() {
            inputs.disarm_probe();
        }
        let is_toggled = self.publish_accessories(segments, snapshot);
        let has_rested = self.publish_progress(is_still, snapshot);
        let has_changed = self.publish_state(snapshot);
        let is_awaited = job == Job::Dequeue && requests.awaits(Awaited::ENTRIES);
        let again = match job {
            Job::None => false,
            // What is seldom done: another run looks what follows.
            Job::Underrun
            | Job::Halted
            | Job::Reset
            | Job::Requests
            | Job::LatchPosition
            | Job::FirstSegment => true,
            Job::Plan | Job::Dequeue | Job::Standstill => {
                // Z may have to stop nowhere on its way, so that nothing was to be played.
                let settles = job != Job::Standstill
                    || self.parking.is_moving()
                    || self.changed_at_standstill;
                is_still && settles
                    || self.needs_segment(context, segments)
                    || self.has_more(context, inputs, entries)
            }
        };
        let has_waited = was_dwelling != self.is_dwelling;
        Prepared {
            run_again: again,
            start_steps: context.starts_steps(again, events),
            wake_interpret: is_toggled || has_rested || has_changed || has_waited || is_awaited,
            outputs_changed: core::mem::take(&mut self.outputs_changed),
        }
    }

    /// Everything generated has been played, and the machine is at rest.
    #[inline]
    fn is_at_standstill(&self, context: Context) -> bool {
        !context.is_running && !self.generator.is_open() && self.standstill == Some(context.played)
    }

    /// Drops what has not been executed; the machine is at rest and stays where it is.
    fn drop_plan(&mut self) {
        let entries = if self.probe.is_active() {
            1
        } else {
            self.plan.len() as u32
        };
        self.finished = self.finished.wrapping_add(entries);
        self.probe.cancel();
        self.plan.clear();
        self.executor.abandon();
        self.smooth.reset();
        self.parking.abandon();
        self.snap_to_steps();
    }

    /// Makes the whole steps the exact position: `interpret` goes on from there.
    fn snap_to_steps(&mut self) {
        self.generator.set_steps(self.generator.steps());
    }

    /// Publishes how far the machine has come; tells whether it has come to rest, or left it.
    #[inline]
    fn publish_progress(&mut self, is_still: bool, new: &mut Snapshot) -> bool {
        let is_at_rest = is_still
            && self.plan.is_empty()
            && !self.is_dwelling
            && !self.is_in_cycle()
            && !self.parking.is_away()
            && self.control.ending == Ending::None;
        let changed = new.is_at_rest != is_at_rest;
        new.is_at_rest = is_at_rest;
        new.blocks_free = self.plan.free() as u16;
        // A finished block alone is no news: who waits for all of them waits for rest.
        new.finished = self.finished;
        changed
    }

    /// Publishes the machine as it is; tells whether anything changed that a task waits for.
    #[inline]
    fn publish_state(&mut self, new: &mut Snapshot) -> bool {
        let has_notices = new.notices.count() != self.notices.count();
        let changed = new.state != self.control.state
            || new.reset_count != self.reset_count
            || new.cancelled_motions != self.cancelled_motions
            || has_notices;
        new.state = self.control.state;
        if has_notices {
            new.notices = self.notices;
        }
        new.probed = self.probed;
        new.reset_count = self.reset_count;
        new.cancelled_motions = self.cancelled_motions;
        new.reset_in_motion = self.reset_in_motion;
        new.has_underrun = self.has_underrun;
        new.is_critical = self.is_critical;
        changed
    }

    /// Publishes spindle, laser and coolant, which rarely change; tells whether coolant has been
    /// toggled, for which a task waits.
    #[inline]
    fn publish_accessories(&mut self, segments: &SegmentRing, new: &mut Snapshot) -> bool {
        // Off, a spindle has no power at rest nor in motion.
        let is_changed = self.accessories.take_changed();
        (is_changed || !self.accessories.is_spindle_off())
            && self.publish_power(is_changed, segments, new)
    }

    /// The same for a spindle that is on, or where something has changed.
    #[inline(never)]
    fn publish_power(
        &mut self,
        is_changed: bool,
        segments: &SegmentRing,
        new: &mut Snapshot,
    ) -> bool {
        if is_changed {
            self.at_rest = self.accessories.power_at_rest();
        }
        let power = if segments.is_running() && !self.accessories.is_spindle_off() {
            Power {
                rpm: segments.spindle_rpm(),
                duty: segments.duty(),
            }
        } else {
            self.at_rest
        };
        if !is_changed && power == self.power {
            return false;
        }
        self.power = power;
        self.switch_outputs(power, segments, new)
    }

    /// Switches spindle, laser and coolant, and publishes them.
    #[inline]
    fn switch_outputs(&mut self, power: Power, segments: &SegmentRing, new: &mut Snapshot) -> bool {
        self.outputs_changed = true;
        let accessories = &self.accessories;
        segments.inhibit_spindle(accessories.is_spindle_off());
        self.outputs.spindle = accessories.switched(power);
        self.outputs.duty = self.at_rest.duty;
        self.outputs.coolant = accessories.coolant();
        let (coolant_asked, coolant_toggles) = accessories.coolant_asked();
        let is_toggled = new.coolant_toggles != coolant_toggles;
        new.spindle_rpm = power.rpm;
        new.spindle = accessories.direction(power);
        new.coolant = self.outputs.coolant;
        new.coolant_asked = coolant_asked;
        new.coolant_toggles = coolant_toggles;
        new.accessory_changes = accessories.changes();
        new.overrides = accessories.overrides();
        is_toggled
    }
}

impl Default for Motion {
    fn default() -> Self {
        Self::new()
    }
}
