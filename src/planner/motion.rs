//! The body of `prepare`: takes entries, plans them, keeps the step interrupt's queue filled.
//!
//! Owns the look-ahead, the speed profile, the step generator and the machine's state. Runs when a
//! segment begins to be played, when an entry or a request has come. Deadline: the events queued
//! ahead, [`AHEAD_TICKS`]; a miss starves the step interrupt, which is a fault.

use heapless::spsc::Consumer;

use super::{
    BLOCKS, Coolant, Entry, LookAhead, Spindle, Work,
    executor::{Executor, Goal},
};
use crate::{
    axis::{AXES, Axes},
    machine::{Inputs, Levels, Notices, Outputs, Overrides, Probed, Snapshot, State},
    protocol::realtime::Requests,
    settings::Settings,
    stepper::{
        AHEAD_TICKS, AxisMotion, EventWriter, Generator, SEGMENT_RING, SEGMENT_TICKS, Segment,
        StepCounts,
    },
    units::{FineSteps, TICKS_PER_MS},
};

/// Entries taken in one run, so that a run stays short.
const ENTRIES_PER_RUN: usize = 4;

/// What `prepare` asks of its shell after a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Prepared {
    /// Run it again: there is more to do.
    pub again: bool,
    /// Start the step timer: it has stopped, and there are events.
    pub start: bool,
    /// Release `interpret`: there is room, or what it may wait for has changed.
    pub news: bool,
}

/// Everything between the entries and the events.
#[derive(Debug)]
pub struct Motion {
    plan: LookAhead,
    executor: Executor,
    generator: Generator,
    state: State,
    /// The newest reset acted on.
    epoch: u32,
    reset_in_motion: bool,
    /// The step interrupt ran out of events in motion: nothing is executed before the next reset.
    is_starved: bool,
    /// Decelerating after a reset; then the plan is dropped.
    is_aborting: bool,
    /// Waiting for cycle start after `M0`.
    is_paused: bool,
    /// Standstill still to come, ticks.
    dwell_ticks: u64,
    is_dwelling: bool,
    finished: u32,
    spindle_rpm: f32,
    /// The standstill segment has been put, and begins then on the generator's clock.
    rest: Option<u32>,
    /// When the newest segment begins on the generator's clock.
    newest: u32,
    snapshot: Snapshot,
    outputs: Outputs,
}

impl Motion {
    /// At rest at zero, not yet configured: a constant, so that it is built in place.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            plan: LookAhead::new(),
            executor: Executor::new(),
            generator: Generator::new(),
            state: State::Idle,
            epoch: 0,
            reset_in_motion: false,
            is_starved: false,
            is_aborting: false,
            is_paused: false,
            dwell_ticks: 0,
            is_dwelling: false,
            finished: 0,
            spindle_rpm: 0.0,
            rest: Some(0),
            newest: 0,
            snapshot: Snapshot {
                state: State::Idle,
                steps: Axes([0; AXES]),
                feed_mm_min: 0.0,
                spindle_rpm: 0.0,
                spindle: Spindle::Off,
                coolant: Coolant::OFF,
                coolant_asked: Coolant::OFF,
                coolant_toggles: 0,
                overrides: Overrides::NONE,
                inputs: Levels::NONE,
                probed: Probed {
                    steps: Axes([0; AXES]),
                    success: false,
                },
                notices: Notices::new(),
                line: 0,
                blocks_free: BLOCKS as u16,
                finished: 0,
                is_at_rest: true,
                epoch: 0,
                reset_in_motion: false,
                is_starved: false,
                is_critical: false,
            },
            outputs: Outputs {
                spindle: Spindle::Off,
                duty: 0,
                coolant: Coolant::OFF,
                drivers: false,
            },
        }
    }

    /// Takes over the settings at power-up. With homing enabled the machine wakes up locked, as
    /// Grbl does.
    pub fn power_up(&mut self, settings: &Settings) {
        self.generator.set_pulse_us(settings.step_pulse_us);
        if settings.homing {
            self.state = State::Alarm;
            self.snapshot.state = State::Alarm;
        }
    }

    /// The machine as it is after the last run.
    #[must_use]
    pub const fn snapshot(&self) -> &Snapshot {
        &self.snapshot
    }

    /// What is to be switched; the shell applies it after each run.
    #[must_use]
    pub const fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// One run.
    pub fn run(
        &mut self,
        requests: &Requests,
        inputs: &Inputs,
        counts: &StepCounts,
        entries: &mut Consumer<'_, Entry>,
        events: &mut EventWriter<'_>,
    ) -> Prepared {
        self.snapshot.inputs = inputs.active();
        if counts.take_starved() {
            self.fail();
        }
        if requests.epoch() != self.epoch {
            self.reset(requests.epoch(), counts);
        }
        self.hold_or_start(requests);
        let taken = self.take(entries, counts);
        self.generate(counts, events);
        self.settle(counts);
        let changed = self.publish(counts);
        let start = !counts.is_running() && !self.is_still(counts);
        if start {
            counts.start();
        }
        Prepared {
            again: taken == ENTRIES_PER_RUN,
            start,
            news: taken != 0 || changed,
        }
    }

    /// Everything generated has been played, and the machine is at rest.
    fn is_still(&self, counts: &StepCounts) -> bool {
        !self.generator.is_open()
            && !counts.is_running()
            && self.rest == Some(counts.played_ticks())
    }

    /// The step interrupt ran out of events in motion. The axes stopped dead and may have lost
    /// steps: whatever was planned is void, and so is what still comes, up to the next reset.
    fn fail(&mut self) {
        self.generator.cut();
        self.drop_wait();
        self.drop_plan();
        self.is_starved = true;
        self.state = State::Alarm;
    }

    /// Ends a program pause or a dwell before its time.
    fn drop_wait(&mut self) {
        if self.is_paused || self.is_dwelling {
            self.finished = self.finished.wrapping_add(1);
        }
        self.is_paused = false;
        self.is_dwelling = false;
        self.dwell_ticks = 0;
        self.spindle_rpm = 0.0;
    }

    fn reset(&mut self, epoch: u32, counts: &StepCounts) {
        self.epoch = epoch;
        self.is_starved = false;
        self.drop_wait();
        let moves = matches!(self.state, State::Run | State::HoldSlowing);
        self.reset_in_motion = moves;
        self.is_aborting = moves || !self.is_still(counts);
        if moves {
            self.state = State::Alarm;
        } else {
            if self.state != State::Alarm {
                self.state = State::Idle;
            }
            if !self.is_aborting {
                self.drop_plan();
            }
        }
    }

    /// Drops what has not been executed; the machine is at rest and stays where it is.
    fn drop_plan(&mut self) {
        self.is_aborting = false;
        self.finished = self.finished.wrapping_add(self.plan.len() as u32);
        self.plan.clear();
        self.executor.abandon();
        self.settle_on_steps();
    }

    /// Makes the whole steps the exact position: `interpret` goes on from there.
    fn settle_on_steps(&mut self) {
        let steps = self.generator.steps();
        self.generator
            .settle(steps.map(|steps| FineSteps(i64::from(steps) << 32)));
    }

    fn hold_or_start(&mut self, requests: &Requests) {
        let (is_hold, is_start) = (requests.take_hold(), requests.take_start());
        if is_hold {
            self.state = match self.state {
                State::Run => State::HoldSlowing,
                State::Idle => State::HoldComplete,
                held => held,
            };
        }
        // Of two requests at once the hold counts, as in Grbl: it is the safe one.
        if is_start && !is_hold && self.state == State::HoldComplete {
            self.state = State::Idle;
            if self.is_paused {
                self.is_paused = false;
                self.finished = self.finished.wrapping_add(1);
            }
        }
    }

    /// Takes entries, and tells how many.
    fn take(&mut self, entries: &mut Consumer<'_, Entry>, counts: &StepCounts) -> usize {
        // wcet-bound: 4
        for taken in 0..ENTRIES_PER_RUN {
            let Some(entry) = entries.peek() else {
                return taken;
            };
            // Settings are void for nobody: the session has taken them over already, at rest.
            let is_void = (entry.epoch != self.epoch || self.is_starved)
                && !matches!(entry.work, Work::Configure(_));
            if is_void {
                self.finished = self.finished.wrapping_add(1);
            } else if !self.accept(&entry.work, counts) {
                return taken;
            }
            let _ = entries.dequeue();
        }
        ENTRIES_PER_RUN
    }

    /// Begins the work if it can begin now.
    fn accept(&mut self, work: &Work, counts: &StepCounts) -> bool {
        if let Work::Move(block) = work {
            let has_room = !self.is_aborting && self.plan.free() > 0;
            if has_room {
                self.plan.push(block);
            }
            return has_room;
        }
        let is_held = matches!(self.state, State::HoldSlowing | State::HoldComplete);
        let is_busy = !self.plan.is_empty() || self.is_dwelling || !self.is_still(counts);
        if is_held || is_busy || self.is_aborting {
            return false;
        }
        match work {
            Work::Move(_)
            | Work::Coolant(_)
            | Work::Probe(..)
            | Work::Home(_)
            | Work::Check
            | Work::Sleep
            | Work::Fault(_)
            | Work::EndOverrides => {}
            Work::Dwell(milliseconds) => {
                self.dwell_ticks = u64::from(*milliseconds) * u64::from(TICKS_PER_MS);
                self.is_dwelling = true;
                return true;
            }
            Work::Pause => {
                self.state = State::HoldComplete;
                self.is_paused = true;
                return true;
            }
            Work::Spindle(_, rpm) => self.spindle_rpm = *rpm,
            Work::Unlock => {
                if self.state == State::Alarm {
                    self.state = State::Idle;
                }
            }
            Work::Configure(settings) => {
                self.generator.set_pulse_us(settings.step_pulse_us);
                self.settle_on_steps();
            }
        }
        self.finished = self.finished.wrapping_add(1);
        true
    }

    fn generate(&mut self, counts: &StepCounts, events: &mut EventWriter<'_>) {
        // wcet-bound: 32
        for _ in 0..SEGMENT_RING {
            if self.generator.is_open() && !self.generator.fill(events) {
                return;
            }
            let ahead = self
                .generator
                .clock_ticks()
                .wrapping_sub(counts.played_ticks());
            // A segment that had to be stretched may last longer than that, and still needs another.
            let is_ahead = ahead >= AHEAD_TICKS && counts.played_ticks() != self.newest;
            if is_ahead || !counts.has_room() {
                return;
            }
            let start = self.generator.clock_ticks();
            if let Some(segment) = self.next_segment() {
                self.rest = None;
                self.generator.begin(&segment, counts);
            } else if self.rest.is_none() {
                self.rest = Some(start);
                self.generator.rest(counts);
            } else {
                return;
            }
            self.newest = start;
        }
    }

    fn next_segment(&mut self) -> Option<Segment> {
        let is_held = matches!(self.state, State::HoldSlowing | State::HoldComplete);
        if self.dwell_ticks != 0 && !is_held {
            let ticks = self.dwell_ticks.min(u64::from(SEGMENT_TICKS)) as u32;
            self.dwell_ticks -= u64::from(ticks);
            return Some(Segment {
                ticks,
                axes: self.generator.position().map(|to| AxisMotion {
                    to,
                    acceleration: 0.0,
                }),
                feed_mm_min: 0.0,
                line: 0,
            });
        }
        let goal = if is_held || self.is_aborting {
            Goal::Stop
        } else {
            Goal::Run
        };
        let blocks = self.plan.len();
        let position = self.generator.position();
        let segment = self.executor.next(&mut self.plan, &position, goal);
        let done = blocks - self.plan.len();
        self.finished = self.finished.wrapping_add(done as u32);
        segment
    }

    /// The state that follows from what has been played.
    fn settle(&mut self, counts: &StepCounts) {
        let is_still = self.is_still(counts);
        if is_still && self.is_aborting {
            self.drop_plan();
        }
        if is_still && self.is_dwelling && self.dwell_ticks == 0 {
            self.is_dwelling = false;
            self.finished = self.finished.wrapping_add(1);
        }
        self.state = match self.state {
            State::HoldSlowing if is_still => State::HoldComplete,
            State::Idle | State::Run if self.is_dwelling => State::Idle,
            State::Idle | State::Run if self.plan.is_empty() && is_still => State::Idle,
            State::Idle | State::Run => State::Run,
            state => state,
        };
    }

    /// Publishes the machine as it is; tells whether anything changed that a task waits for.
    fn publish(&mut self, counts: &StepCounts) -> bool {
        let is_at_rest =
            self.is_still(counts) && self.plan.is_empty() && !self.is_dwelling && !self.is_aborting;
        let new = &mut self.snapshot;
        // A finished block alone is no news: who waits for all of them waits for rest.
        let changed =
            new.state != self.state || new.is_at_rest != is_at_rest || new.epoch != self.epoch;
        new.state = self.state;
        new.steps = counts.position();
        new.feed_mm_min = counts.feed_mm_min();
        new.spindle_rpm = self.spindle_rpm;
        new.line = counts.line();
        new.blocks_free = self.plan.free() as u16;
        new.finished = self.finished;
        new.is_at_rest = is_at_rest;
        new.epoch = self.epoch;
        new.reset_in_motion = self.reset_in_motion;
        new.is_starved = self.is_starved;
        changed
    }
}

impl Default for Motion {
    fn default() -> Self {
        Self::new()
    }
}
