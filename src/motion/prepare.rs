//! The body of `prepare`: dequeues entries, plans them, keeps the step interrupt's queue filled.
//!
//! Owns the look-ahead, the speed profile, the step generator and the machine's state. Runs when a
//! segment begins to be played or is due to be made, when an entry or a request has come, and again while there is more
//! to do. Deadline: the events queued ahead,
//! [`QUEUED_AHEAD_TICKS`](crate::model::timing::QUEUED_AHEAD_TICKS); a miss is an underrun of the step
//! interrupt, which is a fault.
//!
//! # Cost
//! Each run makes a segment, or a sample of the reference motion, or does a [`Job`], so the longest of them bounds the run. Segments are what most runs
//! make: such a run reads and publishes little, and all jobs are out of line. The fields of [`Motion`] are in this
//! order in memory: fields that each run reads are near its beginning, where one instruction reaches them; the plan,
//! which is large, comes last.

mod backlash;
mod cycles;
mod delays;
mod job;
mod publish;
mod requests;
mod standstill;

pub use job::REQUEST_INTERVAL_TICKS;

use heapless::spsc::Consumer;

use self::{
    backlash::{Backlash, TakeUpMove},
    delays::Delays,
    job::{Job, NextRun, RunConditions},
    publish::Published,
};
use super::{
    BLOCKS, Homing, LookAhead,
    cycles::{parking::Parking, probing::ProbingCycle},
    executor::Executor,
    jerk_limited::MovingAverage,
};
use crate::{
    axis::{AXES, Axes},
    machine::{Accessories, Control, Inputs, Snapshot},
    model::{
        Alarm, Awaited, HAS_SECOND_MOTORS, Levels, Notice, Outputs, Requests, StandingMotors,
        State, timing::IDLE_DELAY_INFINITE,
    },
    path::{Block, Entry, RampTime},
    settings::Settings,
    stepper::{EventWriter, Generator, Segment, SegmentRing},
    units::FineSteps,
};

/// What `prepare` asks of its platform after a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Prepared {
    /// Run it again: there is more to do.
    pub run_again: bool,
    /// Start the step timer, which has stopped: there are events. But not after a halt meanwhile, on
    /// which another run has to act first.
    pub start_steps: bool,
    /// Release `interpret`: there is room, or what it may wait for has changed.
    pub wake_interpret: bool,
    /// Apply [`Motion::outputs`], and set the timer if [`Motion::take_delay_ms`] returns a time: one
    /// of them has changed.
    pub outputs_changed: bool,
}

impl Prepared {
    /// There is more to do, and nothing else.
    pub const RUN_AGAIN: Self = Self {
        run_again: true,
        start_steps: false,
        wake_interpret: false,
        outputs_changed: false,
    };
}

/// A run that has begun, with what was found then.
#[derive(Debug, Clone, Copy)]
pub struct RunInProgress<'a> {
    requests: &'a Requests,
    segments: &'a SegmentRing,
    conditions: RunConditions,
    /// It makes a segment, or does a job.
    makes_segment: bool,
}

/// Everything between the entries and the events. The blocks come last in memory.
#[derive(Debug)]
#[repr(C)]
pub struct Motion<const ROOM: usize = BLOCKS> {
    control: Control,
    handled: HandledRequests,
    queue: SegmentQueue,
    /// The time of the run, ticks of the motion's clock.
    now_ticks: u32,
    activity: Activity,
    faults: Faults,
    delays: Delays,
    /// The limit switches that stop the machine: with `$21` all but the switches that end a probing move.
    stopping_switches: Levels,
    inputs: Levels,
    accessories: Accessories,
    published: Published,
    average: MovingAverage,
    executor: Executor,
    /// The segment being made.
    segment: Segment,
    generator: Generator,
    homing: Homing,
    parking: Parking,
    /// `$21`.
    hard_limits: bool,
    /// `$777`.
    probing_alarm_switches_off: bool,
    /// `$798`.
    stops_at_contact: bool,
    /// A probing move has ended with a contact of the probe: it works.
    has_probed: bool,
    /// Number of entries finished before the block that has left a standstill on the contact of the probe.
    left_contact_in: Option<u32>,
    /// `$794`.
    #[cfg(arc_machine)]
    runs_stored_program: bool,
    backlash: Backlash,
    take_up: TakeUpMove,
    plan: LookAhead<ROOM>,
}

/// The entry in execution other than a move of the plan.
#[derive(Debug)]
enum Activity {
    /// None: the plan is executed.
    Path,
    /// Backlash is taken up.
    TakeUp,
    /// A dwell: standstill still to come, ticks.
    Dwell(u64),
    /// A program pause: it ends with cycle start.
    Pause,
    /// The same for a change of the tool.
    ToolPause,
    Homing,
    Probing(ProbingCycle),
}

/// The requests that have been acted on.
#[derive(Debug)]
struct HandledRequests {
    /// The newest reset.
    reset_count: u32,
    /// Number of requests.
    requests: u32,
    /// Start of the segment played then, moved up by `age_handled`, so that the wrapping clock never makes it look new.
    ticks: u32,
}

/// What has been made for the step interrupt, as starts of segments on the generator's clock.
#[derive(Debug)]
struct SegmentQueue {
    /// The newest segment.
    newest: u32,
    /// The standstill after the last motion.
    standstill: Option<u32>,
    /// The segment that was played when the event ring had no room for another.
    full: Option<u32>,
    /// At standstill: the next run makes a segment.
    is_first_next: bool,
}

/// What keeps the machine from executing its entries.
#[derive(Debug)]
struct Faults {
    /// An alarm that comes when the machine is at rest.
    at_standstill: Option<Alarm>,
    /// The step interrupt ran out of events in motion: nothing is executed before the next reset.
    has_underrun: bool,
    /// An alarm has come that only a reset ends.
    is_critical: bool,
    reset_in_motion: bool,
    /// The self-test at power-up has failed: locked until the machine is switched off.
    failed_self_test: bool,
    /// The state of the door counts when the reset is over.
    checks_door: bool,
}

impl Motion<0> {
    /// What comes before the blocks in the memory of a [`Motion::new`].
    #[must_use]
    pub const fn without_blocks() -> Self {
        Self::with_room()
    }
}

impl<const ROOM: usize> Motion<ROOM> {
    const fn with_room() -> Self {
        Self {
            control: Control::IDLE,
            handled: HandledRequests {
                reset_count: 0,
                requests: 0,
                ticks: 0,
            },
            queue: SegmentQueue {
                newest: 0,
                standstill: Some(0),
                full: None,
                is_first_next: false,
            },
            now_ticks: 0,
            activity: Activity::Path,
            faults: Faults {
                at_standstill: None,
                has_underrun: false,
                is_critical: false,
                reset_in_motion: false,
                failed_self_test: false,
                checks_door: false,
            },
            delays: Delays::new(),
            stopping_switches: Levels::NONE,
            inputs: Levels::NONE,
            accessories: Accessories::new(),
            published: Published::new(),
            executor: Executor::new(),
            segment: Segment::NONE,
            generator: Generator::new(),
            homing: Homing::new(),
            parking: Parking::new(),
            backlash: Backlash::new(),
            take_up: TakeUpMove::new(),
            average: MovingAverage::new(),
            hard_limits: false,
            probing_alarm_switches_off: false,
            stops_at_contact: false,
            has_probed: false,
            left_contact_in: None,
            #[cfg(arc_machine)]
            runs_stored_program: false,
            plan: LookAhead::with_room(),
        }
    }
}

impl Motion {
    /// At rest at zero, not yet configured: a constant, so that it is built in place.
    #[must_use]
    pub const fn new() -> Self {
        Self::with_room()
    }

    /// Locks the machine before power-up: something that is stored is damaged.
    pub const fn lock(&mut self) {
        self.control.state = State::Alarm;
    }

    /// Takes over the settings at power-up, and returns the machine as it is then: locked with homing
    /// enabled, on a limit switch with hard limits enabled, or by an alarm.
    ///
    /// The first run must follow: it reads the door and arms the limit switches.
    pub fn power_up(
        &mut self,
        settings: &Settings,
        inputs: &Inputs,
        alarm: Option<Alarm>,
    ) -> Snapshot {
        self.configure(settings, inputs);
        self.published.outputs.drivers = settings.idle_delay_ms == IDLE_DELAY_INFINITE;
        if settings.is_homing_on() || self.is_on_limit() {
            self.control.state = State::Alarm;
        }
        if let Some(alarm) = alarm {
            self.control.state = State::Alarm;
            self.published.notices.push(Notice::Alarm(alarm));
            self.faults.failed_self_test = alarm == Alarm::SelfTest;
        }
        Snapshot {
            state: self.control.state,
            inputs: self.inputs,
            blocks_free: BLOCKS as u16,
            is_at_rest: true,
            notices: self.published.notices,
            failed_self_test: self.faults.failed_self_test,
            ..Snapshot::default()
        }
    }

    fn configure(&mut self, settings: &Settings, inputs: &Inputs) {
        let ramp_time = RampTime::new(settings);
        self.average.configure(ramp_time.is_jerk_limited());
        self.plan.set_ramp_time(ramp_time);
        self.plan.set_step_rate(settings.step_rate.hz());
        self.executor.set_step_rate(settings.step_rate.hz());
        self.generator.set_pulse_us(settings.step_pulse_us);
        self.accessories.configure(settings);
        self.homing.configure(settings);
        self.parking.configure(settings);
        self.backlash.configure(settings);
        self.take_up.configure(settings);
        self.delays.configure(settings);
        self.hard_limits = settings.hard_limits;
        self.probing_alarm_switches_off = settings.probing_alarm_switches_off;
        self.stops_at_contact = settings.stops_at_contact;
        #[cfg(arc_machine)]
        {
            self.runs_stored_program = settings.runs_stored_program;
        }
        self.arm_all_switches();
        inputs.configure(settings);
        self.inputs = inputs.active();
    }

    /// Has all limit switches stop the machine, where `$21` is set.
    fn arm_all_switches(&mut self) {
        self.stopping_switches = if self.hard_limits {
            Levels::limits((1 << AXES) - 1)
        } else {
            Levels::NONE
        };
    }

    /// Whether a limit switch is active that stops the machine.
    fn is_on_limit(&self) -> bool {
        self.hard_limits && self.inputs.has(Levels::LIMITS)
    }

    /// Returns the outputs to be switched; the platform applies them after each run in which they have
    /// changed, before it starts the timer.
    ///
    /// While the step timer runs, the duty is that of the segments instead: the platform leaves the
    /// PWM to `segment_start`.
    #[must_use]
    pub const fn outputs(&self) -> &Outputs {
        &self.published.outputs
    }

    /// Returns the block in execution, which the next segment of the plan is a part of.
    #[must_use]
    pub fn block(&self) -> Option<&Block> {
        self.plan.current()
    }

    /// Returns the last segment that was made.
    #[must_use]
    pub const fn segment(&self) -> &Segment {
        &self.segment
    }

    /// Returns the exact position at the end of all segments that were made.
    #[must_use]
    pub const fn position(&self) -> &Axes<FineSteps> {
        self.generator.position()
    }

    /// Takes the delay from now, ms, after which the platform is to call [`Requests::end_delay`] and run
    /// `prepare` again, instead of after the delay asked for before. Without a value, that stays.
    pub fn take_delay_ms(&mut self) -> Option<u16> {
        self.delays.requested_ms.take()
    }

    /// Sets the time of the run that follows, ticks of the motion's clock.
    #[inline]
    pub const fn set_time(&mut self, now_ticks: u32) {
        self.now_ticks = now_ticks;
    }

    /// Begins a run. A sample of the reference is made here as a whole: the run asks for [`Prepared::RUN_AGAIN`] then, as
    /// nothing that is published has changed, and the segment that needs the sample follows.
    #[inline]
    pub fn begin_run<'a>(
        &mut self,
        requests: &'a Requests,
        segments: &'a SegmentRing,
    ) -> Option<RunInProgress<'a>> {
        let conditions = self.conditions(requests, segments);
        let makes_segment = match self.next_run(conditions, segments) {
            NextRun::Segment => true,
            NextRun::Job => false,
            NextRun::Sample => {
                self.sample_reference();
                return None;
            }
        };
        Some(RunInProgress {
            requests,
            segments,
            conditions,
            makes_segment,
        })
    }

    /// Does what remains of a run, and publishes the machine in `snapshot`.
    pub fn run(
        &mut self,
        begun: RunInProgress<'_>,
        inputs: &Inputs,
        entries: &mut Consumer<'_, Entry>,
        events: &mut EventWriter<'_>,
        snapshot: &mut Snapshot,
    ) -> Prepared {
        let RunInProgress {
            requests,
            segments,
            conditions,
            makes_segment,
        } = begun;
        if !makes_segment {
            return self.run_job(requests, inputs, segments, entries, events, snapshot);
        }
        self.make_segment(inputs, segments, events);
        let is_still = self.is_at_standstill(conditions);
        if self.control.state == State::Alarm {
            self.arm_hard_limits(inputs, is_still);
        }
        let changed = self.publish_motion(is_still, segments, snapshot);
        // What another segment would be made of is not asked here: the run that finds nothing starts the steps.
        let run_again = is_still
            || (self.is_in_motion() || !conditions.is_running)
                && self.has_queue_room(conditions, segments)
            || self.has_other_job(conditions, inputs, entries);
        Prepared {
            wake_interpret: changed
                || requests.awaits(Awaited::SEGMENTS)
                || inputs.standing_order().is_some(),
            ..self.prepared(conditions, run_again, events)
        }
    }

    /// Does one run in which no segment is due.
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
        let conditions = self.conditions(requests, segments);
        self.inputs = inputs.active();
        let was_dwelling = self.is_dwelling();
        let job = self.next_job(conditions, requests, inputs, segments, entries);
        self.queue.is_first_next = false;
        let mut is_settled = false;
        match job {
            Job::None => {}
            Job::FirstSegment => {
                self.queue.is_first_next = self.is_ready_for_motion();
                let is_on_contact = self.inputs.has(Levels::PROBE);
                self.left_contact_in = is_on_contact.then_some(self.published.finished);
            }
            Job::Underrun => self.handle_underrun(segments),
            Job::Halted => self.handle_halted(segments, events),
            Job::Reset => self.handle_reset(requests, segments),
            Job::Requests => self.handle_requests(requests, segments),
            Job::LatchPosition => self.latch_position(inputs, segments, events),
            Job::Plan => self.continue_planning(),
            Job::Dequeue => self.dequeue_entry(entries, inputs),
            Job::Standstill => {
                let before = self.control;
                self.enter_standstill(inputs);
                // Z may have to stop nowhere on its way, so that nothing was to be played.
                is_settled = self.control == before && !self.parking.is_moving();
            }
        }
        let is_still = self.is_at_standstill(conditions);
        if HAS_SECOND_MOTORS && !self.homing.is_active() {
            // A cycle that ends at once has come to a standstill.
            inputs.order_standing(StandingMotors::NONE);
        }
        self.arm_hard_limits(inputs, is_still);
        if !self.is_probing() {
            inputs.disarm_probe();
        }
        let changed = self.publish_motion(is_still, segments, snapshot)
            | self.publish_state(snapshot)
            | (was_dwelling != self.is_dwelling())
            | (job == Job::Dequeue && requests.awaits(Awaited::ENTRIES));
        let run_again = match job {
            Job::None => false,
            // These are rare: another run finds what follows.
            Job::Underrun
            | Job::Halted
            | Job::Reset
            | Job::Requests
            | Job::LatchPosition
            | Job::FirstSegment => true,
            Job::Plan | Job::Dequeue | Job::Standstill => {
                is_still && !is_settled
                    || self.needs_segment(conditions, segments)
                    || self.has_other_job(conditions, inputs, entries)
            }
        };
        Prepared {
            wake_interpret: changed || inputs.standing_order().is_some(),
            ..self.prepared(conditions, run_again, events)
        }
    }

    /// Returns what a run asks of its platform, without `wake_interpret`.
    #[inline]
    fn prepared(
        &mut self,
        conditions: RunConditions,
        run_again: bool,
        events: &EventWriter<'_>,
    ) -> Prepared {
        // The steps start when the queue is full, so that no short segment ends while others are made.
        let can_start = !conditions.is_running && !run_again;
        Prepared {
            run_again,
            start_steps: can_start && events.has_pending(),
            wake_interpret: false,
            outputs_changed: self.published.take_outputs_changed(),
        }
    }

    /// Whether everything generated has been played, and the machine is at rest.
    #[inline]
    fn is_at_standstill(&self, conditions: RunConditions) -> bool {
        !conditions.is_running
            && !self.generator.is_open()
            && self.queue.standstill == Some(conditions.played)
    }

    /// Drops what has not been executed; the machine is at rest and stays where it is.
    fn drop_plan(&mut self) {
        if self.is_probing() {
            self.finish_activity();
        } else {
            self.finish_entries(self.plan.len());
            if self.takes_up_backlash() {
                self.activity = Activity::Path;
                self.finish_entries(1);
            }
        }
        self.plan.clear();
        self.executor.abandon();
        self.average.reset();
        self.parking.abandon();
        self.snap_to_steps();
    }

    /// Counts entries that are finished, executed or not.
    fn finish_entries(&mut self, n: usize) {
        self.published.finished = self.published.finished.wrapping_add(n as u32);
    }

    /// Ends the entry in execution.
    fn finish_activity(&mut self) {
        self.activity = Activity::Path;
        self.arm_all_switches();
        self.finish_entries(1);
    }

    const fn is_dwelling(&self) -> bool {
        matches!(self.activity, Activity::Dwell(_))
    }

    const fn is_probing(&self) -> bool {
        matches!(self.activity, Activity::Probing(_))
    }

    /// Makes the whole steps the exact position: `interpret` goes on from there.
    fn snap_to_steps(&mut self) {
        self.generator.set_steps(self.generator.steps());
    }
}

impl Default for Motion {
    fn default() -> Self {
        Self::new()
    }
}
