//! The tasks with deadlines on a virtual clock: `step`, `segment_start`, `inputs` and `prepare`.
//!
//! # Cost
//!
//! [`Drive::new`] is out of line and copies constants to their place: an emulated chip has no room
//! for a second ring of events.

use heapless::spsc::{Producer, Queue};
use rtic_core::Exclusive;

use super::{
    Switch,
    contacts::{Contacts, ProbeBlock},
    platform::{VirtualPlatform, VirtualSteps, VirtualTimer},
    playback::{Origin, Playback, PlayedSegment},
};
use crate::{
    axis::Axes,
    machine::{BreakDetector, Inputs, SAMPLE_TICKS, Snapshot, Watch},
    model::{Alarm, Levels, Outputs, Requests, queues::ENTRY_RING},
    motion::Motion,
    path::Entry,
    protocol::{ByteCount, ByteWriter, DamagedByte, Utf8RequestWatch},
    settings::Settings,
    stepper::{EventRing, PhaseSteps, SegmentRing},
    tasks::{self, InputTrigger, Platform, SharedAtomics, Task},
    units::{FineSteps, TICKS_PER_MS},
};

/// A change of the step and direction pins at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Edge {
    /// Time, ticks since power-up.
    pub ticks: u64,
    /// Pulses that begin, bit 0 = X.
    pub raise: u32,
    /// Pulses that end, bit 0 = X.
    pub drop: u32,
    /// Levels of the direction outputs, bit 0 = X, 1 = negative.
    pub directions: u8,
    /// Duty of the spindle PWM, 0 to [`Outputs::FULL`].
    pub duty: u16,
    /// Whether the move is a rapid.
    pub is_rapid: bool,
}

/// The tasks with deadlines, and the queues between them.
#[derive(Debug)]
pub struct Drive {
    motion: Motion,
    /// The machine as `prepare` publishes it.
    published: Snapshot,
    /// The segments that wait or are played.
    pub segments: SegmentRing,
    /// Further facts of the segments, and the segments that have begun.
    playback: Playback,
    /// Switches, probe and buttons.
    pub inputs: Inputs,
    /// The queue from `interpret` to `prepare`.
    entries: Queue<Entry, ENTRY_RING>,
    events: EventRing,
    timer: VirtualTimer,
    platform: VirtualPlatform,
    contacts: Contacts,
    watch: Watch,
    /// Time of the next sample of the inputs, ticks.
    sample_due: Option<u64>,
    /// Time of the last look whether a segment is due, ticks.
    looked: u64,
    /// Whether a contact has changed since the last run of `inputs`.
    is_edge_pending: bool,
    watches: (BreakDetector, Utf8RequestWatch),
    /// Number of bytes at the last sample of the line, and its time.
    sampled_bytes: usize,
    sampled_ticks: u64,
    /// Time of the next sample of the line while it is low, ticks.
    line_sample_due: Option<u64>,
}

impl Drive {
    /// Returns a drive at rest with these settings.
    #[must_use]
    #[inline(never)]
    pub fn new(settings: &Settings) -> Self {
        Self::power_up(settings, None)
    }

    /// Returns a drive that comes up with an alarm.
    #[must_use]
    #[inline(never)]
    pub fn power_up(settings: &Settings, alarm: Option<Alarm>) -> Self {
        Self::with_inputs(settings, alarm, Inputs::new())
    }

    /// Returns a drive at rest of which some axes have two motors with a switch each, bit 0 = X.
    #[must_use]
    pub fn ganged(settings: &Settings, axes: u8) -> Self {
        let wired = !Levels::SECOND_LIMITS | Levels::second_limits(axes);
        Self::with_inputs(settings, None, Inputs::wired(wired))
    }

    fn with_inputs(settings: &Settings, alarm: Option<Alarm>, inputs: Inputs) -> Self {
        let mut drive = Self::off(inputs);
        drive.switch_on(settings, alarm);
        drive
    }

    /// Returns a drive that is switched off: it waits for [`Drive::switch_on`].
    #[inline(never)]
    pub(super) fn off(inputs: Inputs) -> Self {
        // Constants, which are copied to where they stay, by a function that is called with the place: an
        // emulated chip has no room for two of them.
        Self {
            motion: const { Motion::new() },
            published: Snapshot::default(),
            segments: const { SegmentRing::new() },
            playback: const { Playback::new() },
            contacts: Contacts::new(),
            watch: Watch::new(Levels::NONE, &inputs),
            sample_due: None,
            looked: 0,
            is_edge_pending: false,
            watches: (BreakDetector::new(), Utf8RequestWatch::new()),
            sampled_bytes: 0,
            sampled_ticks: 0,
            line_sample_due: None,
            inputs,
            entries: Queue::new(),
            events: const { EventRing::new() },
            timer: VirtualTimer::new(),
            platform: VirtualPlatform::new(Outputs::default()),
        }
    }

    /// Switches the drive on with these settings.
    /// Locks the machine that is going to be switched on.
    pub(super) fn lock(&mut self) {
        self.motion.lock();
    }

    pub(super) fn switch_on(&mut self, settings: &Settings, alarm: Option<Alarm>) {
        self.published = self.motion.power_up(settings, &self.inputs, alarm);
        self.watch = Watch::new(Levels::NONE, &self.inputs);
        self.platform.outputs = *self.motion.outputs();
        self.configure_mechanics(settings);
    }

    /// Returns the machine as a task reads it now.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        let mut snapshot = Snapshot::default();
        snapshot.copy_from(&self.published, &self.segments, &self.inputs);
        snapshot
    }

    /// Returns the time of the next step event, ticks.
    #[must_use]
    pub fn due(&self) -> Option<u64> {
        self.timer.due()
    }

    /// Returns the time at which [`Drive::end_delay`] ends the delay of `prepare`, ticks.
    #[must_use]
    pub const fn delay_due(&self) -> Option<u64> {
        self.platform.delay_due
    }

    /// Releases `prepare` if its delay is over.
    pub fn end_delay(&mut self, now: u64) {
        if self.platform.delay_due.is_some_and(|due| due <= now) {
            self.platform.delay_due = None;
            self.platform.is_delay_over = true;
            self.platform.pend(Task::Prepare);
        }
    }

    /// Returns the outputs, with the duty that is output.
    #[must_use]
    pub const fn outputs(&self) -> &Outputs {
        &self.platform.outputs
    }

    /// Returns the time at which [`Drive::watch`] takes the next sample of the inputs, ticks.
    #[must_use]
    pub const fn sample_due(&self) -> Option<u64> {
        self.sample_due
    }

    /// Returns the number of late events: none, as tasks take no time.
    #[must_use]
    pub fn late(&self) -> u32 {
        self.events.late()
    }

    /// Returns the physical steps of each axis since power-up.
    #[must_use]
    pub const fn physical_steps(&self) -> Axes<i32> {
        self.contacts.steps()
    }

    /// Returns the same of the axes, which are not those of the motors on a `CoreXY` machine.
    #[must_use]
    pub fn physical_position(&self) -> Axes<i32> {
        self.contacts.position()
    }

    /// Returns the exact position at the end of all segments that were made.
    #[must_use]
    pub const fn exact_position(&self) -> &Axes<FineSteps> {
        self.motion.position()
    }

    /// Returns the coils that are energised if motors are driven by phases, bit 0 = IN1, for each axis: none while
    /// the drivers are disabled.
    #[must_use]
    pub fn coils(&self) -> Axes<u8> {
        if self.platform.outputs.drivers {
            self.timer.phases.phases().coils()
        } else {
            Axes::all(0)
        }
    }

    /// Applies `$3` and `$791` to such motors, and `$795` to the switches. At rest only.
    pub(super) fn configure_mechanics(&mut self, settings: &Settings) {
        if self.contacts.is_core_xy != settings.core_xy {
            self.contacts.is_core_xy = settings.core_xy;
            self.update_contacts();
        }
        let steps = PhaseSteps::new(settings.half_steps, settings.direction_invert);
        self.timer.phases.configure(steps);
    }

    /// Mounts a switch, at steps from the position at power-up. Returns false without room or such
    /// an axis.
    pub fn mount(&mut self, switch: Switch) -> bool {
        let fits = self.contacts.mount(switch);
        self.update_contacts();
        fits
    }

    /// Puts a block on the table, in place of any other.
    pub fn put(&mut self, block: ProbeBlock) {
        self.contacts.put(block);
        self.update_contacts();
    }

    /// Takes away the block, and all switches that have been mounted by [`Self::mount`].
    pub fn dismount(&mut self) {
        self.contacts.dismount();
        self.update_contacts();
    }

    /// Mounts a switch that the second motor of an axis closes, in its steps. Returns false without room or such an
    /// axis.
    pub fn mount_second(&mut self, switch: Switch) -> bool {
        let fits = self.contacts.mount_second(switch);
        self.update_contacts();
        fits
    }

    /// Puts the second motor of an axis some steps ahead of the first: the gantry is skewed.
    pub fn skew(&mut self, axis: usize, steps: i32) {
        self.contacts.skew(axis, steps);
        self.update_contacts();
    }

    /// Returns the physical steps of second motors since power-up, with what they were ahead.
    #[must_use]
    pub const fn second_steps(&self) -> Axes<i32> {
        self.contacts.second_steps()
    }

    /// Leaves motors out of the outputs, as `prepare` has ordered: for `interpret`, which makes the table of outputs
    /// on a chip.
    pub fn follow_standing_order(&mut self) {
        if let Some(standing) = self.inputs.standing_order() {
            self.contacts.leave_out(standing);
            self.inputs.carry_out(standing);
        }
    }

    /// Closes contacts as the operator does, or opens them again.
    pub fn set_pin(&mut self, inputs: Levels, closed: bool) {
        self.contacts.hold(inputs, closed);
        self.update_contacts();
    }

    fn update_contacts(&mut self) {
        self.is_edge_pending |= self.contacts.update();
    }

    /// Runs `inputs` if an edge, a sample or a due segment releases it. Its priority is above that of `prepare`.
    pub fn watch(&mut self, requests: &Requests, now: u64) {
        let is_edge = core::mem::take(&mut self.is_edge_pending);
        let is_sample = !is_edge && self.sample_due.is_some_and(|due| due <= now);
        // What is due may have to wait: one look is enough.
        let is_look = core::mem::replace(&mut self.looked, now) != now;
        self.platform.now = now;
        let is_due = is_look && self.segments.is_next_due(now as u32);
        if !(is_edge || is_sample || is_due) {
            return;
        }
        let trigger = if is_sample {
            self.sample_due = None;
            InputTrigger::Sample
        } else {
            InputTrigger::Edge
        };
        let shared = SharedAtomics::new(requests, &self.inputs, &self.segments);
        let mut steps = VirtualSteps {
            timer: &mut self.timer,
            events: self.events.split().0.tap(),
        };
        let (closed, watch) = (self.contacts.closed, &mut self.watch);
        let needs_sample = tasks::inputs(
            trigger,
            closed,
            watch,
            shared,
            &mut steps,
            &mut self.platform,
        );
        if needs_sample && self.sample_due.is_none() {
            self.sample_due = Some(now + u64::from(SAMPLE_TICKS));
        }
    }

    /// Returns the time of the next sample of the line, ticks.
    #[must_use]
    pub(super) const fn line_sample_due(&self) -> Option<u64> {
        self.line_sample_due
    }

    /// Pulls the line low, or releases it.
    pub(super) fn pull_line(&mut self, low: bool, now: u64) {
        self.line_sample_due = low.then(|| now + u64::from(TICKS_PER_MS));
        if !low {
            self.watches.0 = BreakDetector::new();
        }
    }

    /// Samples the line as `idle` does: once a millisecond while it is low, and otherwise when bytes have come.
    pub(super) fn sample_line(&mut self, received: ByteCount<'_>, requests: &Requests, now: u64) {
        let is_due = self.line_sample_due.is_some_and(|due| due <= now);
        if is_due {
            self.line_sample_due = Some(now + u64::from(TICKS_PER_MS));
        } else if received.enqueued() == self.sampled_bytes {
            return;
        }
        let elapsed_ms = (now - self.sampled_ticks) / u64::from(TICKS_PER_MS);
        (self.sampled_bytes, self.sampled_ticks) = (received.enqueued(), now);
        let is_low = self.line_sample_due.is_some();
        let (elapsed_ms, watches) = (elapsed_ms.min(255) as u8, &mut self.watches);
        tasks::sample_line(
            is_low,
            elapsed_ms,
            received,
            watches,
            requests,
            &mut self.platform,
        );
    }

    /// Returns the queue filled by `interpret`, the segments read by it, and its platform.
    pub(super) fn for_interpret(
        &mut self,
    ) -> (Producer<'_, Entry>, &SegmentRing, &mut VirtualPlatform) {
        (self.entries.split().0, &self.segments, &mut self.platform)
    }

    /// Runs `serial_rx` for a received byte, or a damaged one.
    pub fn receive(
        &mut self,
        byte: Result<u8, DamagedByte>,
        requests: &Requests,
        received: &mut ByteWriter<'_>,
    ) {
        tasks::serial_rx(
            byte,
            received.enqueued(),
            requests,
            received,
            &mut self.platform,
        );
    }

    /// Releases the tasks that wait for room to send, after bytes have been sent.
    pub(super) fn sent(&mut self, before: usize, after: usize, requests: &Requests) {
        tasks::serial_tx(before, after, requests, &mut self.platform);
    }

    /// Enqueues an entry as `interpret` does. Returns whether there was room.
    pub fn enqueue(&mut self, entry: Entry) -> bool {
        let (mut entries, _) = self.entries.split();
        let is_enqueued = entries.enqueue(entry).is_ok();
        if tasks::needs_release(is_enqueued.into(), &entries) {
            self.platform.pend(Task::Prepare);
        }
        is_enqueued
    }

    /// Returns whether `prepare` has dequeued every entry.
    #[must_use]
    pub fn has_no_entry(&self) -> bool {
        self.entries.is_empty()
    }

    /// Releases `prepare`.
    pub fn release_prepare(&mut self) {
        self.platform.pend(Task::Prepare);
    }

    /// Takes the release of `wake`: returns whether it has been released since the last call.
    pub fn take_wake_release(&mut self) -> bool {
        core::mem::take(&mut self.platform.is_wake_released)
    }

    /// Runs `prepare` if it has been released. Returns whether it ran.
    pub fn prepare(&mut self, requests: &Requests, now: u64) -> bool {
        if !core::mem::take(&mut self.platform.is_prepare_released) {
            return false;
        }
        (self.timer.now, self.platform.now) = (now, now);
        let (_, mut entries) = self.entries.split();
        let (mut events, _) = self.events.split();
        let shared = SharedAtomics::new(requests, &self.inputs, &self.segments);
        let mut steps = VirtualSteps {
            timer: &mut self.timer,
            events: events.tap(),
        };
        // A run makes one segment at most: of the block that was in execution before.
        let origin = Origin::of(&self.motion, self.published.state);
        let (before, _) = self.segments.numbers();
        tasks::prepare(
            &mut self.motion,
            &mut entries,
            &mut events,
            shared,
            &mut Exclusive(&mut self.published),
            &mut steps,
            &mut self.platform,
        );
        let (newest, _) = self.segments.numbers();
        if newest != before {
            self.playback.note(newest, &origin, &self.motion);
        }
        self.segment_start();
        true
    }

    /// Runs `step`, and `segment_start` if it is released. Returns the change of the pins.
    pub fn step(&mut self) -> Option<Edge> {
        let (_, played) = self.segments.numbers();
        let is_rapid = self.playback.is_rapid(played);
        let edge = self.timer.edge(self.platform.outputs.duty, is_rapid)?;
        let (_, mut events) = self.events.split();
        tasks::step(&mut self.timer, &mut events, &self.segments);
        if core::mem::take(&mut self.timer.is_segment_start_released) {
            self.platform.pend(Task::SegmentStart);
        }
        self.segment_start();
        debug_assert!(
            edge.raise | edge.drop == 0 || self.inputs.standing_order().is_none(),
            "a motor moves while it is left out or taken in"
        );
        if edge.raise != 0 {
            self.contacts.step(&edge);
            self.update_contacts();
        }
        Some(edge)
    }

    /// Runs `segment_start` while it is released. Its priority is above that of all tasks here but
    /// `step`.
    fn segment_start(&mut self) {
        self.platform.now = self.timer.now;
        while core::mem::take(&mut self.platform.is_segment_start_released) {
            let event_tap = self.events.split().0.tap();
            tasks::segment_start(&self.segments, event_tap, &mut self.platform);
            self.playback.begin(&self.segments, self.timer.now);
        }
    }

    /// Takes the oldest segment that has begun and not been taken, see [`PlayedSegment`].
    pub fn take_segment(&mut self) -> Option<PlayedSegment> {
        self.playback.take()
    }
}
