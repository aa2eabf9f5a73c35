//! The bodies of the tasks, generic over the platform: a chip and its board, or the simulator.
//!
//! ```text
//!             serial_rx ──► interpret, report ──► prepare ──► step ──► pins
//!                                                  ▲   ▲        │
//!                                  inputs ─────────┘   └── segment_start
//! ```
//!
//! [`Platform`] and [`PreparePlatform`] have the functions of the machine that the tasks run on, [`StepPlatform`] the
//! functions for [`step`]. [`StepOutput`] plays step events for the other tasks.
//!
//! # Cost
//!
//! Everything is generic and inlined into the interrupt: the machine code is the same as of a body written for the
//! chip. [`step`] looks the pins up and releases `segment_start` without a branch. [`serial_rx`] is also inlined into
//! code in RAM. [`serial_tx`] releases a task twice at most while the queue drains: a release costs more than the
//! sending of a byte. [`prepare`] releases itself in its last call alone: of two calls the compiler makes one, for a task
//! that the proof does not know.

use heapless::spsc::{Consumer, Producer};
use rtic_core::Mutex;

use crate::{
    machine::{BreakDetector, Inputs, Snapshot, Watch},
    model::{Awaited, Levels, Outputs, Release, Requests, queues::SENT_RING},
    motion::{Motion, Prepared},
    path::Entry,
    protocol::{
        ByteCount, ByteReader, ByteWriter, DamagedByte, Progress, Session, Utf8RequestWatch,
        realtime,
    },
    settings::{Change, Erasing, StoreError, Stored, ToolTable},
    stepper::{EventReader, EventTap, EventWriter, SegmentRing, StepEvent, Upcoming},
};

/// A task that other tasks release.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// [`segment_start`].
    SegmentStart,
    /// [`prepare`].
    Prepare,
    /// `interpret`, and `report` if a status report is wanted: [`Requests::wants_status`].
    Wake,
}

/// The platform of every task.
pub trait Platform {
    /// Releases a task: it runs once more after this, also if it runs now.
    fn pend(&mut self, task: Task);

    /// Releases the task that a received byte asks for, if it does.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "nothing in flash may be called")]
    fn release(&mut self, release: Release) {
        match release {
            Release::Nobody => {}
            Release::Interpret | Release::Report => self.pend(Task::Wake),
            Release::Prepare => self.pend(Task::Prepare),
        }
    }

    /// Returns the time, ticks, wrapping: it goes on while steps are played.
    fn now_ticks(&self) -> u32;

    /// Outputs a duty of the spindle PWM, 0 to [`Outputs::FULL`].
    fn set_duty(&mut self, duty: u16);
}

/// The platform of `prepare`.
pub trait PreparePlatform: Platform {
    /// Takes the end of the delay: returns whether it has come since the last call.
    fn take_delay_end(&mut self) -> bool;

    /// Begins a delay of at least 1 ms, whose end releases `prepare`, instead of the one begun
    /// before.
    fn start_delay(&mut self, delay_ms: u16);

    /// Switches spindle, coolant and drivers; the duty stays as it is.
    fn switch(&mut self, outputs: &Outputs);
}

/// The player of step events, for the tasks of lower priority than `step`.
pub trait StepOutput {
    /// Sets up the first event and starts the step timer, unless the motion has been halted
    /// meanwhile. Only while the timer stands.
    fn start(&mut self, first: Upcoming, segments: &SegmentRing);

    /// Halts the step timer: the event that is set up is not played. Calls [`EventTap::halt`].
    fn stop(&mut self, segments: &SegmentRing);

    /// Sets the time of an event that was appended too late for `step` to know it.
    fn append(&mut self, event: StepEvent);

    /// Returns the view of the count of events that have been output.
    fn event_tap(&self) -> EventTap<'_>;
}

/// The platform of `step`: pins and timer.
pub trait StepPlatform {
    /// Outputs the event that was set up.
    fn output(&mut self);

    /// Sets the time from the next event to the event after it. Returns 1 if the next event is late, otherwise 0.
    fn set_reload(&mut self, following: StepEvent) -> u32;

    /// Sets up the outputs of the next event.
    fn set_up(&mut self, event: StepEvent);

    /// Releases `segment_start` if an event is the first of a segment.
    fn pend_segment_start(&mut self, event: StepEvent);

    /// Stops the timer, and releases `segment_start`.
    fn stop(&mut self);
}

/// The state that tasks share without a lock.
#[derive(Debug, Clone, Copy)]
pub struct SharedAtomics<'a> {
    /// Requests to `prepare`, `interpret` and `report`.
    pub requests: &'a Requests,
    /// Switches, probe and buttons.
    pub inputs: &'a Inputs,
    /// The segments that wait or are played.
    pub segments: &'a SegmentRing,
}

impl<'a> SharedAtomics<'a> {
    /// Gathers the references.
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

/// Outputs the event that is due and sets up the next one.
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

/// Takes a received byte or a damaged one; `before` is the number of bytes enqueued so far.
#[inline(always)]
#[expect(clippy::inline_always, reason = "it is called from RAM, too")]
pub fn serial_rx(
    byte: Result<u8, DamagedByte>,
    before: usize,
    requests: &Requests,
    received: &mut ByteWriter<'_>,
    platform: &mut impl Platform,
) {
    platform.release(realtime::receive(byte, before, requests, received));
}

/// Releases the tasks that wait for room to send, when the queue of bytes to be sent has become half
/// empty or empty. The arguments are its lengths `before` bytes were sent and `after`.
#[inline]
pub fn serial_tx(before: usize, after: usize, requests: &Requests, platform: &mut impl Platform) {
    let has_come_to = |waiting| after <= waiting && waiting < before;
    let has_room = has_come_to(0) || has_come_to(SENT_RING / 2);
    if has_room && requests.awaits(Awaited::ROOM) {
        platform.pend(Task::Wake);
    }
}

/// Begins the segment whose first event `step` has set up, or ends the motion if there is none.
#[inline]
pub fn segment_start(
    segments: &SegmentRing,
    event_tap: EventTap<'_>,
    platform: &mut impl Platform,
) {
    let begun = segments.start_segment(event_tap);
    if let Some(duty) = begun.duty {
        segments.set_begin(platform.now_ticks());
        platform.set_duty(duty);
    }
    platform.pend(Task::Prepare);
    if begun.has_more {
        platform.pend(Task::SegmentStart);
    }
}

/// The trigger of a run of `inputs`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputTrigger {
    /// A change of a contact.
    Edge,
    /// The time of a sample.
    Sample,
}

/// Filters the closed contacts, and releases `prepare` when the next segment is due. Returns whether a sample is needed
/// after this run.
#[inline]
pub fn inputs(
    trigger: InputTrigger,
    closed: Levels,
    watch: &mut Watch,
    shared: SharedAtomics<'_>,
    steps: &mut impl StepOutput,
    platform: &mut impl Platform,
) -> bool {
    let mut releases = watch.latch(closed, shared.inputs, steps.event_tap());
    let needs_sample = match trigger {
        InputTrigger::Edge => watch.edge(),
        InputTrigger::Sample => {
            let actions = watch.sample(shared.inputs, shared.requests);
            if actions.halt_steps {
                steps.stop(shared.segments);
            }
            releases |= actions.release_prepare;
            actions.sample_again
        }
    };
    if releases || shared.segments.is_next_due(platform.now_ticks()) {
        platform.pend(Task::Prepare);
    }
    needs_sample
}

/// Looks at the level of the line and at the bytes that have come, so many milliseconds after the last look. A part of
/// `idle`.
pub fn sample_line(
    is_low: bool,
    elapsed_ms: u8,
    received: ByteCount<'_>,
    watches: &mut (BreakDetector, Utf8RequestWatch),
    requests: &Requests,
    platform: &mut impl Platform,
) {
    let (line, forms) = watches;
    let has_break = line.sample(is_low, elapsed_ms, received.enqueued(), requests);
    let seen = forms.scan(elapsed_ms, received, requests);
    if seen.has_requests {
        platform.pend(Task::Prepare);
    }
    if has_break || seen.has_text && requests.awaits_line() {
        platform.pend(Task::Wake);
    }
}

/// Keeps the event queue filled. The drivers are switched on before the first step.
#[inline]
pub fn prepare(
    motion: &mut Motion,
    entries: &mut Consumer<'_, Entry>,
    events: &mut EventWriter<'_>,
    shared: SharedAtomics<'_>,
    snapshot: &mut impl Mutex<T = Snapshot>,
    steps: &mut impl StepOutput,
    platform: &mut impl PreparePlatform,
) {
    let SharedAtomics {
        requests,
        inputs,
        segments,
    } = shared;
    if platform.take_delay_end() {
        requests.end_delay();
    }
    motion.set_time(platform.now_ticks());
    let mut prepared = Prepared::RUN_AGAIN;
    if let Some(begun) = motion.begin_run(requests, segments) {
        prepared = snapshot.lock(|snapshot| motion.run(begun, inputs, entries, events, snapshot));
        if let Some(event) = events.appended_late(segments) {
            steps.append(event);
            events.append(event);
        }
        let is_at_rest = !segments.is_running() && !prepared.start_steps;
        if is_at_rest {
            platform.set_duty(motion.outputs().duty);
        }
        // A change made in motion may still have to be switched at rest.
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
            && let Some(delay_ms) = motion.take_delay_ms()
        {
            platform.start_delay(delay_ms);
        }
    }
    if prepared.wake_interpret {
        platform.pend(Task::Wake);
    }
    if prepared.run_again {
        platform.pend(Task::Prepare);
    }
}

/// The session and the queues of its serial line.
#[derive(Debug)]
pub struct SessionIo<'a, 'q> {
    /// The session.
    pub session: &'a mut Session,
    /// Received bytes.
    pub received: &'a mut ByteReader<'q>,
    /// Bytes to be sent.
    pub sent: &'a mut ByteWriter<'q>,
}

/// Executes received lines, sends the position if it is streamed, and stores the change that the session
/// wants stored, which is at rest only.
#[inline]
pub fn interpret<'q>(
    io: SessionIo<'_, 'q>,
    snapshot: &Snapshot,
    requests: &Requests,
    segments: &SegmentRing,
    entries: &mut Producer<'q, Entry>,
    store: impl FnOnce(Change, Erasing, &Stored, &ToolTable) -> Result<(), StoreError>,
    platform: &mut impl Platform,
) -> Progress {
    let SessionIo {
        session,
        received,
        sent,
    } = io;
    let entered = session.entered();
    let progress = session.run(snapshot, requests, received, sent, entries);
    session.stream_position(progress, snapshot, segments, requests, sent);
    let new = session.entered().wrapping_sub(entered) as usize;
    if session.takes_release() | needs_release(new, entries) {
        platform.pend(Task::Prepare);
    }
    let Some(change) = session.wants_store() else {
        return progress;
    };
    let erasing = session.erasing(snapshot);
    let result = store(change, erasing, session.stored(), session.tools());
    session.has_stored(result);
    Progress::Again
}

/// Returns whether `new` entries, just enqueued, release `prepare`: while an older entry waits,
/// `prepare` runs again by itself.
#[inline]
pub(crate) fn needs_release(new: usize, entries: &Producer<'_, Entry>) -> bool {
    new != 0 && entries.len() <= new
}

/// Sends a status report, if one is requested.
#[inline]
pub fn report(io: SessionIo<'_, '_>, snapshot: &Snapshot, requests: &Requests) -> Progress {
    let free = io.received.capacity() - io.received.len();
    let sent = io.sent;
    io.session.report(snapshot, requests, free, sent)
}
