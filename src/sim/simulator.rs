//! The whole simulated machine: bytes in, bytes and pin edges out.

use super::{Drive, Edge, Flash, PlayedSegment, ProbeBlock, Switch};
#[cfg(feature = "usb")]
use crate::usb::{Driver, Registers, SenderQueues, UsbControl};
use crate::{
    axis::Axes,
    machine::{Inputs, Snapshot},
    model::{
        Alarm, Levels, Outputs, Requests, ResetCause, SelfTestFault, Spindle, State,
        queues::{RECEIVED_RING, SENT_RING},
        timing::TICK_MS,
    },
    protocol::{Bytes, DamagedByte, Progress, Session},
    settings::{Change, Erasing, Journal, Loaded, Settings, StepRate, Stored, ToolTable},
    stepper::SegmentRing,
    tasks::{self, SessionIo},
    units::{FineSteps, TICKS_PER_MS},
};

/// The machine behind its serial line, on a virtual clock of timer ticks.
///
/// Tasks run in the order of their priorities and take no time: a task ends at the instant at which
/// it is released.
#[derive(Debug)]
pub struct Simulator {
    drive: Drive,
    session: Session,
    journal: Journal<Flash>,
    requests: Requests,
    received: Bytes<RECEIVED_RING>,
    sent: Bytes<SENT_RING>,
    now: u64,
    /// Time of the next tick of the clock of `interpret`, where it runs.
    tick_due: Option<u64>,
    is_interpret_released: bool,
    is_report_released: bool,
}

impl Simulator {
    /// Returns a machine that is switched on with these settings stored.
    #[must_use]
    pub fn new(settings: &Settings) -> Self {
        Self::with_alarm(settings, None)
    }

    /// Returns a machine that is switched on with these settings stored, and comes up with an alarm.
    #[must_use]
    pub fn with_alarm(settings: &Settings, alarm: Option<Alarm>) -> Self {
        let mut simulator = Self::off();
        simulator.switch_on(settings, alarm);
        simulator
    }

    /// Returns a new machine that is switched off: it waits for [`Simulator::switch_on`].
    #[must_use]
    pub fn off() -> Self {
        Self::with_flash(Flash::new())
    }

    /// Switches on a new machine with these settings stored. It stays where it is: a chip has no room for two.
    pub fn switch_on(&mut self, settings: &Settings, alarm: Option<Alarm>) {
        let stored = Stored {
            settings: *settings,
            ..Stored::default()
        };
        // A new flash whose power stays on has room for the settings.
        let _ = self.journal.load();
        let _ = self.journal.write(
            Change::Settings,
            Erasing::Allowed,
            &stored,
            &ToolTable::new(),
        );
        self.start(settings.step_rate, alarm);
    }

    /// Returns a machine that has these settings stored, after a reset.
    #[must_use]
    pub fn after(settings: &Settings, cause: ResetCause) -> Self {
        let mut simulator = Self::with_alarm(settings, cause.alarm());
        simulator.session.set_reset_cause(cause);
        simulator
    }

    /// Returns a machine that has these settings stored, and is switched on with something wrong.
    #[must_use]
    pub fn failing(settings: &Settings, fault: SelfTestFault) -> Self {
        let mut simulator = Self::with_alarm(settings, Some(Alarm::SelfTest));
        simulator.session.set_self_test_fault(Some(fault));
        simulator
    }

    /// Returns a machine that is switched on with these settings stored, and of which some axes have two motors with
    /// a switch each, bit 0 = X.
    #[must_use]
    pub fn ganged(settings: &Settings, axes: u8) -> Self {
        let mut simulator = Self::new(settings);
        simulator.gang(axes);
        simulator
    }

    /// Gives some axes of a machine that has just been switched on a second motor with a switch each, bit 0 = X.
    pub fn gang(&mut self, axes: u8) {
        self.drive = Drive::ganged(self.session.settings(), axes);
    }

    /// Returns a machine that is switched on for the first time.
    #[must_use]
    pub fn first_boot(step_rate: StepRate) -> Self {
        Self::power_up(Flash::new(), step_rate)
    }

    /// Returns a machine that is switched on with the contents of a flash.
    #[must_use]
    pub fn power_up(mut flash: Flash, step_rate: StepRate) -> Self {
        flash.power_up();
        let mut simulator = Self::with_flash(flash);
        simulator.start(step_rate, None);
        simulator
    }

    /// Returns a machine that is switched off.
    fn with_flash(flash: Flash) -> Self {
        Self {
            drive: Drive::off(Inputs::new()),
            session: Session::new(&Stored::default(), false),
            journal: Journal::new(flash),
            requests: Requests::new(),
            received: Bytes::new(),
            sent: Bytes::new(),
            now: 0,
            tick_due: None,
            is_interpret_released: true,
            is_report_released: false,
        }
    }

    /// Starts with the contents of the journal.
    fn start(&mut self, step_rate: StepRate, alarm: Option<Alarm>) {
        let Loaded {
            mut stored,
            is_first_boot,
            damaged,
        } = self.journal.load().unwrap_or_default();
        stored.settings.step_rate = step_rate;
        self.session = Session::new(&stored, is_first_boot);
        self.session.set_damaged(damaged);
        let _ = self.journal.load_tools(self.session.tools_mut());
        if !damaged.is_empty() {
            self.drive.lock();
        }
        self.drive.switch_on(&stored.settings, alarm);
    }

    /// Switches the machine off. Returns the flash.
    #[must_use]
    pub fn into_flash(self) -> Flash {
        self.journal.into_flash()
    }

    /// Returns the flash, to read its contents and to cut its power.
    pub fn flash(&mut self) -> &mut Flash {
        self.journal.flash()
    }

    /// Returns the time, ticks since power-up.
    #[must_use]
    pub const fn now(&self) -> u64 {
        self.now
    }

    /// Returns the machine as a task reads it now.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        self.drive.snapshot()
    }

    /// Returns the session with the sender.
    #[must_use]
    pub const fn session(&self) -> &Session {
        &self.session
    }

    /// Returns the segments that wait or are played.
    #[must_use]
    pub const fn segments(&self) -> &SegmentRing {
        &self.drive.segments
    }

    /// Takes the oldest segment that has begun and not been taken. Without a taker, old ones are dropped.
    pub fn take_segment(&mut self) -> Option<PlayedSegment> {
        self.drive.take_segment()
    }

    /// Returns the number of late events.
    #[must_use]
    pub fn late(&self) -> u32 {
        self.drive.late()
    }

    /// Returns the number of bytes for which the receive queue has room.
    #[must_use]
    pub fn received_free(&self) -> usize {
        self.received.free()
    }

    /// Returns the number of received bytes lost so far.
    #[must_use]
    pub fn lost(&self) -> u32 {
        self.requests.lost()
    }

    /// Returns the number of resets that have been requested so far.
    #[must_use]
    pub fn requested_resets(&self) -> u32 {
        self.requests.reset_count()
    }

    /// Receives a byte.
    pub fn receive(&mut self, byte: u8) {
        self.receive_or_lose(Ok(byte));
    }

    /// Receives a byte that was damaged on the line, or behind which another byte is lost.
    pub fn receive_damaged(&mut self) {
        self.receive_or_lose(Err(DamagedByte));
    }

    /// Pulls the line from the sender low, or releases it. What the receiver makes of that comes on its own, by
    /// [`Simulator::receive_damaged`] or [`Simulator::receive`]: low bits of bytes are low, too.
    pub fn pull_line(&mut self, low: bool) {
        self.drive.pull_line(low, self.now);
    }

    fn receive_or_lose(&mut self, byte: Result<u8, DamagedByte>) {
        let (mut line, _) = self.received.split();
        self.drive.receive(byte, &self.requests, &mut line);
        self.wake();
    }

    /// Runs `usb`, in place of the serial line, and of [`Simulator::send`]. Returns whether `usb_control` is released.
    #[cfg(feature = "usb")]
    pub fn serve_usb(&mut self, driver: &mut Driver<'_>, otg: &mut impl Registers) -> bool {
        let (_, _, platform) = self.drive.for_interpret();
        let mut line = SenderQueues {
            requests: &self.requests,
            received: &mut self.received.split().0,
            sent: &mut self.sent.split().1,
        };
        let is_control_released = driver.serve(otg, &mut line, platform);
        self.wake();
        is_control_released
    }

    /// Runs `usb_control`.
    #[cfg(feature = "usb")]
    pub fn serve_usb_control(&mut self, control: &mut UsbControl<'_>) {
        self.is_interpret_released |= control.serve(&self.requests);
    }

    /// Releases the tasks of the protocol as `wake` does.
    fn wake(&mut self) {
        if self.drive.take_wake_release() {
            self.is_interpret_released = true;
            self.is_report_released |= self.requests.wants_status();
        }
    }

    /// Takes the next byte that the machine sends. The virtual port is ready for each at once.
    pub fn send(&mut self) -> Option<u8> {
        let (_, mut sent) = self.sent.split();
        let before = sent.len();
        let byte = sent.dequeue();
        let after = sent.len();
        self.drive.sent(before, after, &self.requests);
        self.wake();
        byte
    }

    /// Returns whether bytes wait to be sent.
    #[must_use]
    pub fn has_to_send(&self) -> bool {
        !self.sent.is_empty()
    }

    /// Mounts a switch that an axis closes. Returns false without room or such an axis.
    pub fn mount(&mut self, switch: Switch) -> bool {
        self.drive.mount(switch)
    }

    /// Puts a block on the table, in place of any other.
    pub fn put(&mut self, block: ProbeBlock) {
        self.drive.put(block);
    }

    /// Takes away the block, and all switches that have been mounted by [`Simulator::mount`].
    pub fn dismount(&mut self) {
        self.drive.dismount();
    }

    /// Mounts a switch that the second motor of an axis closes. Returns false without room or such an axis.
    pub fn mount_second(&mut self, switch: Switch) -> bool {
        self.drive.mount_second(switch)
    }

    /// Puts the second motor of an axis some steps ahead of the first: the gantry is skewed.
    pub fn skew(&mut self, axis: usize, steps: i32) {
        self.drive.skew(axis, steps);
    }

    /// Returns the physical steps of second motors since power-up, with what they were ahead.
    #[must_use]
    pub const fn second_steps(&self) -> Axes<i32> {
        self.drive.second_steps()
    }

    /// Closes the contacts of inputs, or opens them again; [`Simulator::settle`] runs `inputs`.
    pub fn set_pin(&mut self, inputs: Levels, closed: bool) {
        self.drive.set_pin(inputs, closed);
    }

    /// Returns the physical steps of each axis since power-up: homing does not change them.
    #[must_use]
    pub const fn physical_steps(&self) -> Axes<i32> {
        self.drive.physical_steps()
    }

    /// Returns the same of the axes, which are not those of the motors on a `CoreXY` machine.
    #[must_use]
    pub fn physical_position(&self) -> Axes<i32> {
        self.drive.physical_position()
    }

    /// Returns the exact position at the end of all motion, of which the steps are the nearest whole ones.
    #[must_use]
    pub const fn exact_position(&self) -> &Axes<FineSteps> {
        self.drive.exact_position()
    }

    /// Returns the outputs beside the axes, with the duty that is output.
    #[must_use]
    pub const fn outputs(&self) -> &Outputs {
        self.drive.outputs()
    }

    /// Returns the coils that are energised if motors are driven by phases, bit 0 = IN1, for each axis: none while
    /// the drivers are disabled.
    #[must_use]
    pub fn coils(&self) -> Axes<u8> {
        self.drive.coils()
    }

    /// Returns the time of the next change without a byte, ticks: of a pin edge, a sample of the
    /// inputs, the end of a delay, or a tick for which the session waits.
    #[must_use]
    pub fn due(&self) -> Option<u64> {
        let drive = &self.drive;
        let received = self.received.written();
        let tick = self.tick_due.filter(|_| self.session.awaits_tick(received));
        let dues = [
            drive.due(),
            drive.sample_due(),
            drive.delay_due(),
            drive.line_sample_due(),
            tick,
        ];
        dues.into_iter().flatten().min()
    }

    /// Runs the clock of `interpret`, where the session needs one.
    fn tick(&mut self) {
        let runs = self.session.needs_clock();
        let next = self.now + u64::from(TICK_MS * TICKS_PER_MS);
        match self.tick_due {
            _ if !runs => self.tick_due = None,
            Some(due) if due > self.now => {}
            Some(_) => {
                self.tick_due = Some(next);
                self.requests.tick();
                self.is_interpret_released = true;
            }
            None => self.tick_due = Some(next),
        }
    }

    /// Runs every task that is released.
    pub fn settle(&mut self) {
        self.tick();
        loop {
            self.drive.watch(&self.requests, self.now);
            self.drive.end_delay(self.now);
            let received = self.received.split().0.count();
            self.drive.sample_line(received, &self.requests, self.now);
            if self.drive.prepare(&self.requests, self.now) {
                self.wake();
            } else if self.is_report_released {
                self.report();
            } else if self.is_interpret_released {
                self.interpret();
            } else {
                return;
            }
        }
    }

    /// Advances the clock to `time`, or to the next change before, and runs every task that is
    /// released.
    pub fn advance(&mut self, time: u64) -> Option<Edge> {
        let dues = [self.due(), self.tick_due, Some(time)];
        self.now = dues.into_iter().flatten().min().unwrap_or(time);
        let is_step_due = self.drive.due().is_some_and(|due| due <= self.now);
        let edge = is_step_due.then(|| self.drive.step()).flatten();
        self.settle();
        edge
    }

    /// Runs `interpret`.
    ///
    /// # Panics
    /// If an axis moves while the flash is written, or the machine is not idle, with spindle and laser off, while
    /// it is erased: the chip could not output steps meanwhile, nor stop anything.
    fn interpret(&mut self) {
        self.drive.follow_standing_order();
        self.session.set_late_events(self.drive.late());
        let snapshot = &self.snapshot();
        let is_at_rest = self.drive.due().is_none() && snapshot.is_at_rest;
        let outputs = self.drive.outputs();
        let is_off = outputs.spindle == Spindle::Off && outputs.duty == 0;
        let may_erase = is_off && snapshot.state == State::Idle;
        let io = SessionIo {
            session: &mut self.session,
            received: &mut self.received.split().1,
            sent: &mut self.sent.split().0,
        };
        let journal = &mut self.journal;
        let store = |change, erasing, stored: &Stored, tools: &ToolTable| {
            assert!(is_at_rest, "the flash is written at rest only");
            let erases = journal.flash().erases();
            let result = journal.write(change, erasing, stored, tools);
            assert!(
                may_erase || journal.flash().erases() == erases,
                "flash is erased at Idle only, with spindle and laser off"
            );
            result
        };
        let (mut entries, segments, platform) = self.drive.for_interpret();
        let requests = &self.requests;
        let progress = tasks::interpret(
            io,
            snapshot,
            requests,
            segments,
            &mut entries,
            store,
            platform,
        );
        self.is_interpret_released = progress == Progress::Again;
        if is_at_rest {
            self.drive.configure_mechanics(self.session.settings());
        }
    }

    /// Runs `report`.
    fn report(&mut self) {
        let snapshot = &self.snapshot();
        let io = SessionIo {
            session: &mut self.session,
            received: &mut self.received.split().1,
            sent: &mut self.sent.split().0,
        };
        let progress = tasks::report(io, snapshot, &self.requests);
        self.is_report_released = progress == Progress::Again;
    }
}
