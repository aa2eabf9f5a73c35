//! The platform of the tasks on a virtual clock.

use super::Edge;
use crate::{
    model::Outputs,
    stepper::{EventTap, PhaseDrive, SegmentRing, StepEvent, Upcoming},
    tasks::{Platform, PreparePlatform, StepOutput, StepPlatform, Task},
    units::TICKS_PER_MS,
};

/// The released tasks, the outputs, and the delay timer of `prepare`.
#[derive(Debug)]
pub(super) struct VirtualPlatform {
    /// The time, ticks.
    pub(super) now: u64,
    /// The outputs, with the duty that is output.
    pub(super) outputs: Outputs,
    /// When the delay of `prepare` ends, ticks.
    pub(super) delay_due: Option<u64>,
    /// The delay has ended, and `prepare` has not run since.
    pub(super) is_delay_over: bool,
    pub(super) is_segment_start_released: bool,
    pub(super) is_prepare_released: bool,
    pub(super) is_wake_released: bool,
}

impl VirtualPlatform {
    /// Returns a platform on which `prepare` is released, as at power-up.
    pub(super) const fn new(outputs: Outputs) -> Self {
        Self {
            now: 0,
            outputs,
            delay_due: None,
            is_delay_over: false,
            is_segment_start_released: false,
            is_prepare_released: true,
            is_wake_released: false,
        }
    }
}

impl Platform for VirtualPlatform {
    fn pend(&mut self, task: Task) {
        match task {
            Task::SegmentStart => self.is_segment_start_released = true,
            Task::Prepare => self.is_prepare_released = true,
            Task::Wake => self.is_wake_released = true,
        }
    }

    fn now_ticks(&self) -> u32 {
        self.now as u32
    }

    fn set_duty(&mut self, duty: u16) {
        self.outputs.duty = duty;
    }
}

impl PreparePlatform for VirtualPlatform {
    fn take_delay_end(&mut self) -> bool {
        core::mem::take(&mut self.is_delay_over)
    }

    fn start_delay(&mut self, delay_ms: u16) {
        let ticks = u64::from(delay_ms) * u64::from(TICKS_PER_MS);
        self.delay_due = Some(self.now + ticks);
    }

    fn switch(&mut self, outputs: &Outputs) {
        let duty = self.outputs.duty;
        self.outputs = Outputs { duty, ..*outputs };
    }
}

/// The step timer and the pins of an event. It is never late.
#[derive(Debug)]
pub(super) struct VirtualTimer {
    /// Time of the last event, or of the start of the timer, ticks.
    pub(super) now: u64,
    /// The event that is set up, and its time, ticks.
    due: Option<(u64, StepEvent)>,
    /// Levels of the direction outputs.
    directions: u8,
    /// Motors that the steps would turn by phases.
    pub(super) phases: PhaseDrive,
    /// Whether `segment_start` is released: the event set up is the first of a segment, or there is
    /// none.
    pub(super) is_segment_start_released: bool,
}

impl VirtualTimer {
    /// Returns a timer that stands.
    pub(super) const fn new() -> Self {
        Self {
            now: 0,
            due: None,
            directions: 0,
            phases: PhaseDrive::new(),
            is_segment_start_released: false,
        }
    }

    /// Returns the time of the event that is set up, ticks.
    pub(super) fn due(&self) -> Option<u64> {
        self.due.map(|(ticks, _)| ticks)
    }

    /// Returns the change of the pins by the event that is set up.
    pub(super) fn edge(&self, duty: u16, is_rapid: bool) -> Option<Edge> {
        let (ticks, event) = self.due?;
        Some(Edge {
            ticks,
            raise: event.raise(),
            drop: event.drop(),
            directions: event.directions().unwrap_or(self.directions),
            duty,
            is_rapid,
        })
    }
}

impl StepPlatform for VirtualTimer {
    fn output(&mut self) {
        if let Some((ticks, event)) = self.due.take() {
            self.now = ticks;
            self.directions = event.directions().unwrap_or(self.directions);
            self.phases.output();
        }
    }

    fn set_reload(&mut self, _following: StepEvent) -> u32 {
        0
    }

    fn set_up(&mut self, event: StepEvent) {
        self.due = Some((self.now + u64::from(event.ticks()), event));
        self.phases.set_up(event);
    }

    fn pend_segment_start(&mut self, event: StepEvent) {
        self.is_segment_start_released |= event.is_boundary();
    }

    fn stop(&mut self) {
        self.is_segment_start_released = true;
    }
}

/// The step timer for the tasks below `step`.
pub(super) struct VirtualSteps<'a> {
    pub(super) timer: &'a mut VirtualTimer,
    pub(super) events: EventTap<'a>,
}

impl StepOutput for VirtualSteps<'_> {
    fn start(&mut self, first: Upcoming, segments: &SegmentRing) {
        debug_assert!(self.timer.due.is_none(), "a timer that runs is started");
        if !segments.is_halted() {
            segments.start();
            self.timer.set_up(first.event);
        }
    }

    fn stop(&mut self, segments: &SegmentRing) {
        self.timer.due = None;
        self.timer.phases.give_up();
        self.events.halt(segments);
    }

    fn append(&mut self, _event: StepEvent) {}

    fn event_tap(&self) -> EventTap<'_> {
        self.events
    }
}
