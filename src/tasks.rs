//! The bodies of the tasks, for whatever runs them: a chip and its board, or the simulator.
//!
//! ```text
//!             serial_rx ──► interpret, report ──► prepare ──► step ──► pins
//!                                                  ▲   ▲        │
//!                                  inputs ─────────┘   └── segment_start
//! ```
//!
//! [`Platform`] and [`PreparePlatform`] are what the tasks need of their machine, [`StepOutput`] is what plays
//! step events: [`step`] with a [`StepPlatform`], or something else that starts, stops and appends.
//!
//! # Cost
//!
//! Everything is generic and inlined into the interrupt that calls it: the machine code is that of a
//! body written for the chip. [`step`] looks the pins up and releases `segment_start` without a branch.

use heapless::spsc::{Consumer, Producer};
use rtic_core::Mutex;

use crate::{
    machine::{Inputs, Snapshot, Watch},
    model::{Levels, Outputs, Release, Requests},
    motion::Motion,
    path::Entry,
    protocol::{ByteReader, ByteWriter, Progress, Session, realtime},
    settings::{Change, StoreError, Stored},
    stepper::{EventReader, EventTap, EventWriter, SegmentRing, StepEvent, Upcoming},
};

/// A task that others release.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// [`segment_start`].
    SegmentStart,
    /// [`prepare`].
    Prepare,
    /// `interpret`, and `report` if a status report is wanted: [`Requests::wants_status`].
    Wake,
}

/// The machine under every task.
pub trait Platform {
    /// Releases a task: it runs once more after this, whether or not it runs now.
    fn pend(&mut self, task: Task);

    /// Outputs a duty of the spindle PWM, 0 to [`Outputs::FULL`].
    fn set_duty(&mut self, duty: u16);
}

/// The machine under `prepare`.
pub trait PreparePlatform: Platform {
    /// Returns once whether the time of [`PreparePlatform::wake_in`] is over.
    fn take_wake(&mut self) -> bool;

    /// Releases `prepare` in some milliseconds, at least 1, instead of at the time asked for before.
    fn wake_in(&mut self, milliseconds: u16);

    /// Switches spindle, coolant and drivers; not the duty.
    fn switch(&mut self, outputs: &Outputs);
}

/// What plays step events, for the tasks below `step`.
pub trait StepOutput {
    /// Sets up the first event and plays it after its time, unless the motion has been halted since.
    /// Only while nothing is played.
    fn start(&mut self, first: Upcoming, segments: &SegmentRing);

    /// Stops at once: the event that is set up is not played. Calls [`EventTap::halt`].
    fn stop(&mut self, segments: &SegmentRing);

    /// Takes the time of an event that was written too late for `step` to know it.
    fn append(&mut self, event: StepEvent);

    /// Returns the count of the events played.
    fn played(&self) -> EventTap<'_>;
}

/// The pins and the timer of `step`.
pub trait StepPlatform {
    /// Outputs the event that is due.
    fn output(&mut self);

    /// Sets the time from the next event to the one that follows it. Returns 1 if the next event is
    /// late, otherwise 0.
    fn set_reload(&mut self, following: StepEvent) -> u32;

    /// Sets up what the next event outputs.
    fn set_up(&mut self, event: StepEvent);

    /// Releases `segment_start` if an event is the first of a segment.
    fn pend_segment_start(&mut self, event: StepEvent);

    /// Sets nothing up, and releases `segment_start`.
    fn stop(&mut self);
}

/// What tasks share without a lock.
#[derive(Debug, Clone, Copy)]
pub struct Unlocked<'a> {
    /// What is asked of `prepare` and the two tasks of the protocol.
    pub requests: &'a Requests,
    /// Switches, probe and buttons.
    pub inputs: &'a Inputs,
    /// The segments that are played, and how far.
    pub segments: &'a SegmentRing,
}

impl<'a> Unlocked<'a> {
    /// Gathers references to them.
    #[must_use]
    #[inline]
    pub const fn new(
        requests: &'a Requests,
        inputs: &'a Inputs,
        segments: &'a SegmentRing,
    ) -> Self {
        Self {
            requests,
            inputs,
            segments,
        }
    }
}

/// Outputs the event that is due and sets up the next.
#[inline]
pub fn step(
    platform: &mut impl StepPlatform,
    events: &mut EventReader<'_>,
    segments: &SegmentRing,
) {
    platform.output();
    if let Some(Upcoming { event, following }) = events.advance() {
        let late = platform.set_reload(following);
        events.count_late(late);
        platform.set_up(event);
        platform.pend_segment_start(event);
    } else {
        segments.stop();
        platform.stop();
    }
}

/// Takes a received byte.
#[inline(always)]
#[expect(clippy::inline_always, reason = "it is called from RAM, too")]
pub fn serial_rx(
    byte: u8,
    requests: &Requests,
    received: &mut ByteWriter<'_>,
    platform: &mut impl Platform,
) {
    match realtime::receive(byte, requests, received) {
        Release::Nobody => {}
        Release::Interpret | Release::Report => platform.pend(Task::Wake),
        Release::Prepare => platform.pend(Task::Prepare),
    }
}

/// Begins the segment whose first event `step` has set up, or sees that there is none.
#[inline]
pub fn segment_start(segments: &SegmentRing, played: EventTap<'_>, platform: &mut impl Platform) {
    let begun = segments.start_segment(played);
    if let Some(duty) = begun.duty {
        platform.set_duty(duty);
    }
    platform.pend(Task::Prepare);
    if begun.has_more {
        platform.pend(Task::SegmentStart);
    }
}

/// Why `inputs` runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputTrigger {
    /// A contact has changed.
    Edge,
    /// A sample is due.
    Sample,
}

/// Filters the contacts that are closed now. Returns whether a sample is needed after this run.
#[inline]
pub fn inputs(
    trigger: InputTrigger,
    closed: Levels,
    watch: &mut Watch,
    shared: Unlocked<'_>,
    steps: &mut impl StepOutput,
    platform: &mut impl Platform,
) -> bool {
    let mut releases = watch.latch(closed, shared.inputs, steps.played());
    let needs_sample = match trigger {
        InputTrigger::Edge => watch.edge(),
        InputTrigger::Sample => {
            let watched = watch.sample(shared.inputs, shared.requests);
            if watched.halt_steps {
                steps.stop(shared.segments);
            }
            releases |= watched.release_prepare;
            watched.sample_again
        }
    };
    if releases {
        platform.pend(Task::Prepare);
    }
    needs_sample
}

/// Keeps the event queue filled. The drivers are switched on before the first step.
#[inline]
pub fn prepare(
    motion: &mut Motion,
    entries: &mut Consumer<'_, Entry>,
    events: &mut EventWriter<'_>,
    shared: Unlocked<'_>,
    snapshot: &mut impl Mutex<T = Snapshot>,
    steps: &mut impl StepOutput,
    platform: &mut impl PreparePlatform,
) {
    let Unlocked {
        requests,
        inputs,
        segments,
    } = shared;
    if platform.take_wake() {
        requests.wake();
    }
    let prepared =
        snapshot.lock(|snapshot| motion.run(requests, inputs, segments, entries, events, snapshot));
    if let Some(event) = events.appended_late(segments) {
        steps.append(event);
        events.append(event);
    }
    let is_at_rest = !segments.is_running() && !prepared.start_steps;
    if is_at_rest {
        platform.set_duty(motion.outputs().duty);
    }
    // What has been switched in motion may be still to come at rest.
    if prepared.outputs_changed || is_at_rest {
        platform.switch(motion.outputs());
    }
    if prepared.start_steps
        && let Some(first) = events.set_up()
    {
        steps.start(first, segments);
        platform.pend(Task::SegmentStart);
    }
    if prepared.outputs_changed
        && let Some(milliseconds) = motion.take_delay_ms()
    {
        platform.wake_in(milliseconds);
    }
    if prepared.run_again {
        platform.pend(Task::Prepare);
    }
    if prepared.wake_interpret {
        platform.pend(Task::Wake);
    }
}

/// The session and the queues of its serial line.
#[derive(Debug)]
pub struct SessionIo<'a, 'q> {
    /// The state of the protocol.
    pub session: &'a mut Session,
    /// What has been received.
    pub received: &'a mut ByteReader<'q>,
    /// What is to be sent.
    pub sent: &'a mut ByteWriter<'q>,
}

/// Executes received lines. What the session wants stored is written at rest only.
#[inline]
pub fn interpret<'q>(
    io: SessionIo<'_, 'q>,
    snapshot: &Snapshot,
    requests: &Requests,
    entries: &mut Producer<'q, Entry>,
    store: impl FnOnce(Change, &Stored) -> Result<(), StoreError>,
    platform: &mut impl Platform,
) -> Progress {
    let SessionIo {
        session,
        received,
        sent,
    } = io;
    let entered = session.entered();
    let progress = session.run(snapshot, requests, received, sent, entries);
    let new = session.entered().wrapping_sub(entered) as usize;
    if session.takes_release() | needs_release(new, entries) {
        platform.pend(Task::Prepare);
    }
    let Some(change) = session.wants_store() else {
        return progress;
    };
    let result = store(change, session.stored());
    session.has_stored(result);
    Progress::Again
}

/// Returns whether entries that have just been enqueued release `prepare`: while an older entry waits,
/// `prepare` runs again by itself.
#[inline]
pub(crate) fn needs_release(new: usize, entries: &Producer<'_, Entry>) -> bool {
    new != 0 && entries.len() <= new
}

/// Answers `?`.
#[inline]
pub fn report(io: SessionIo<'_, '_>, snapshot: &Snapshot, requests: &Requests) -> Progress {
    let free = io.received.capacity() - io.received.len();
    let sent = io.sent;
    io.session.report(snapshot, requests, free, sent)
}
