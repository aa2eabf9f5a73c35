//! The step timer, its interrupt and that of the inputs on a virtual clock.

use heapless::spsc::Queue;

use super::{Switch, contacts::Contacts};
use crate::{
    axis::Axes,
    machine::{Inputs, SAMPLE_TICKS, Snapshot, Watch},
    model::{Levels, Outputs, Requests, queues::ENTRY_RING},
    motion::Motion,
    path::Entry,
    settings::Settings,
    stepper::{EventRing, SegmentRing, StepEvent, Upcoming},
    units::TICKS_PER_MS,
};

/// What the step pins do at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Edge {
    /// When, ticks since power-up.
    pub ticks: u64,
    /// Pulses that begin, bit 0 = X.
    pub raise: u32,
    /// Pulses that end, bit 0 = X.
    pub drop: u32,
    /// Levels of the direction outputs, bit 0 = X, 1 = negative.
    pub directions: u8,
    /// Spindle PWM then, 0 to [`Outputs::FULL`].
    pub duty: u16,
}

/// `prepare`, the interrupts of steps and inputs, and what is between them.
#[derive(Debug)]
pub struct Drive {
    motion: Motion,
    pub(super) snapshot: Snapshot,
    /// What the step interrupt and `segment_start` tell of what they have played.
    pub segments: SegmentRing,
    /// Switches, probe and buttons.
    pub inputs: Inputs,
    /// Entries for `prepare`.
    pub entries: Queue<Entry, ENTRY_RING>,
    events: EventRing,
    /// When the step interrupt is due, and what the pins do then: what is set up.
    due: Option<Edge>,
    /// Levels of the direction outputs.
    directions: u8,
    /// When `prepare` wants to be woken.
    wake_due: Option<u64>,
    outputs: Outputs,
    contacts: Contacts,
    watch: Watch,
    /// When the inputs are sampled next, ticks.
    sample_due: Option<u64>,
    /// A contact has changed, and the input interrupt has not run since.
    is_watch_released: bool,
    is_prepare_released: bool,
    has_news: bool,
}

impl Drive {
    /// At rest, with these settings.
    #[must_use]
    #[inline(never)]
    pub fn new(settings: &Settings) -> Self {
        let inputs = Inputs::new();
        // Constants, which are copied to where they stay: an emulated chip has no room for two of them.
        let mut drive = Self {
            motion: const { Motion::new() },
            snapshot: Snapshot::default(),
            segments: const { SegmentRing::new() },
            contacts: Contacts::new(),
            watch: Watch::new(Levels::NONE, &inputs),
            sample_due: None,
            is_watch_released: false,
            inputs,
            entries: Queue::new(),
            events: const { EventRing::new() },
            due: None,
            directions: 0,
            wake_due: None,
            outputs: Outputs::default(),
            is_prepare_released: true,
            has_news: false,
        };
        drive.snapshot = drive.motion.power_up(settings, &drive.inputs);
        drive.watch = Watch::new(Levels::NONE, &drive.inputs);
        drive.outputs = *drive.motion.outputs();
        drive
    }

    /// The machine as `prepare` last published it.
    #[must_use]
    pub const fn snapshot(&self) -> &Snapshot {
        &self.snapshot
    }

    /// When the step interrupt is due, ticks.
    #[must_use]
    pub fn due(&self) -> Option<u64> {
        self.due.map(|edge| edge.ticks)
    }

    /// When `prepare` wants to be woken, ticks: [`Drive::wake`] does it.
    #[must_use]
    pub const fn wake_due(&self) -> Option<u64> {
        self.wake_due
    }

    /// Wakes `prepare` if it is time.
    pub fn wake(&mut self, requests: &Requests, now: u64) {
        if self.wake_due.is_some_and(|due| due <= now) {
            self.wake_due = None;
            requests.wake();
            self.release_prepare();
        }
    }

    /// What is switched now, with the duty that is output.
    #[must_use]
    pub const fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// When the inputs are sampled next, ticks: [`Drive::watch`] does it.
    #[must_use]
    pub const fn sample_due(&self) -> Option<u64> {
        self.sample_due
    }

    /// Events that came too late: the virtual step interrupt never lets any.
    #[must_use]
    pub fn late(&self) -> u32 {
        self.events.late()
    }

    /// Physical steps of each axis since power-up.
    #[must_use]
    pub const fn physical_steps(&self) -> Axes<i32> {
        self.contacts.steps()
    }

    /// Mounts a switch; whether it fits. It counts from where the axes stood at power-up.
    pub fn mount(&mut self, switch: Switch) -> bool {
        let fits = self.contacts.mount(switch);
        self.look();
        fits
    }

    /// Closes contacts, as whoever stands at the machine does, or opens them again.
    pub fn set_pin(&mut self, inputs: Levels, closed: bool) {
        self.contacts.hold(inputs, closed);
        self.look();
    }

    fn look(&mut self) {
        self.is_watch_released |= self.contacts.look();
    }

    /// Runs the input interrupt if it has been released: it comes before `prepare`.
    pub fn watch(&mut self, requests: &Requests, now: u64) {
        let events = self.events.split().0.tap();
        let closed = self.contacts.closed;
        let (watch, inputs) = (&mut self.watch, &self.inputs);
        let is_edge = core::mem::take(&mut self.is_watch_released);
        if !is_edge && self.sample_due.is_none_or(|due| due > now) {
            return;
        }
        self.is_prepare_released |= watch.latch(closed, inputs, events);
        let samples = if is_edge {
            watch.edge()
        } else {
            self.sample_due = None;
            let watched = watch.sample(inputs, requests);
            if watched.halt_steps {
                self.due = None;
                events.halt(&self.segments);
            }
            self.is_prepare_released |= watched.release_prepare;
            watched.sample_again
        };
        if samples && self.sample_due.is_none() {
            self.sample_due = Some(now + u64::from(SAMPLE_TICKS));
        }
    }

    /// Releases `prepare`.
    pub fn release_prepare(&mut self) {
        self.is_prepare_released = true;
    }

    /// Whether `prepare` has released `interpret` since this was asked last.
    pub fn take_news(&mut self) -> bool {
        core::mem::take(&mut self.has_news)
    }

    /// Runs `prepare` if it has been released; tells whether it ran.
    pub fn prepare(&mut self, requests: &Requests, now: u64) -> bool {
        if !self.is_prepare_released {
            return false;
        }
        let (_, mut entries) = self.entries.split();
        let (mut events, _) = self.events.split();
        let prepared = self.motion.run(
            requests,
            &self.inputs,
            &self.segments,
            &mut entries,
            &mut events,
            &mut self.snapshot,
        );
        self.snapshot.observe(&self.segments, &self.inputs);
        self.is_prepare_released = prepared.run_again;
        self.has_news |= prepared.wake_interpret;
        if prepared.outputs_changed
            && let Some(milliseconds) = self.motion.take_delay_ms()
        {
            self.wake_due = Some(now + u64::from(milliseconds) * u64::from(TICKS_PER_MS));
        }
        let outputs = self.motion.outputs();
        let duty = if self.segments.is_running() || prepared.start_steps {
            self.outputs.duty
        } else {
            outputs.duty
        };
        self.outputs = Outputs { duty, ..*outputs };
        if let Some(missed) = events.appended_late(&self.segments) {
            events.append(missed);
        }
        if prepared.start_steps {
            self.start(now);
        }
        true
    }

    /// Starts the step timer, which stands.
    fn start(&mut self, now: u64) {
        debug_assert!(self.due.is_none(), "a timer that runs is started");
        let (mut events, _) = self.events.split();
        let upcoming = events.set_up();
        self.segments.start();
        self.set_up(now, upcoming);
    }

    /// The step interrupt, and `segment_start` if that is released: what the pins do now.
    pub fn step(&mut self) -> Option<Edge> {
        let edge = self.due?;
        self.directions = edge.directions;
        let (_, mut events) = self.events.split();
        let upcoming = events.advance();
        if upcoming.is_none() {
            self.segments.stop();
        }
        self.set_up(edge.ticks, upcoming);
        if edge.raise != 0 {
            self.contacts.step(&edge);
            self.look();
        }
        Some(edge)
    }

    /// Sets up what comes after a time, and runs `segment_start` if that is released.
    fn set_up(&mut self, before: u64, upcoming: Option<Upcoming>) {
        let event = upcoming.map(|upcoming| upcoming.event);
        let mut releases_turn = event.is_none_or(StepEvent::is_boundary);
        while releases_turn {
            let (events, _) = self.events.split();
            let turned = self.segments.start_segment(events.tap());
            self.outputs.duty = turned.duty.unwrap_or(self.outputs.duty);
            self.is_prepare_released = true;
            releases_turn = turned.has_more;
        }
        self.due = event.map(|event| Edge {
            ticks: before + u64::from(event.ticks()),
            raise: event.raise(),
            drop: event.drop(),
            directions: event.directions().unwrap_or(self.directions),
            duty: self.outputs.duty,
        });
    }
}
