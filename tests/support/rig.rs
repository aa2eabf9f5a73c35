//! Plays commands on the drive and records the pins.

use std::collections::VecDeque;

use leadscrew::{
    axis::Axes,
    machine::Snapshot,
    model::{Command, PathControl, Requests, State},
    path::{BlendOutput, Blender, Entry, Router, Work},
    settings::Settings,
    sim::{Drive, Edge},
    stepper::coils,
    units::TICKS_PER_SECOND,
};

use super::{Trace, receive};

/// A realtime byte at a time, ticks.
pub(crate) type Act = (u64, u8);

pub(crate) const RESET: u8 = 0x18;

/// Most virtual time without an end of the program, ticks: an hour.
const LONGEST: u64 = 3600 * TICKS_PER_SECOND as u64;

/// The drive with a stand-in for `interpret` before it and the pins behind it.
pub(crate) struct Rig {
    pub(crate) drive: Drive,
    /// How far a motor may be away from its axis, steps.
    backlash: Axes<i32>,
    pub(crate) router: Router,
    pub(crate) trace: Trace,
    pub(crate) requests: Requests,
    pub(crate) now: u64,
    sent: u32,
    /// Motions that the machine has ended before their target, as far as the position is known.
    cancelled_motions: u32,
    /// A reset or a cancelled jog has come, and the position has not been taken since.
    is_recovering: bool,
    /// Least time between two entries, ticks.
    pub(crate) feed_ticks: u64,
    /// How moves follow each other, the blended moves, and their work, each block with a line number of its own.
    pub(crate) control: PathControl,
    pub(crate) blended: Vec<BlendOutput>,
    path: Blender,
    works: VecDeque<Work>,
    blocks: u32,
    /// Start positions of the segments that have been played.
    pub(crate) segments: Vec<Begin>,
    /// Steps of all axes, in both directions.
    steps: u32,
}

/// Start position of a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Begin {
    /// On the generator's clock.
    pub(crate) ticks: u32,
    /// Steps of all axes before it.
    pub(crate) steps: u32,
}

impl Rig {
    pub(crate) fn new(settings: &Settings) -> Self {
        Self {
            drive: Drive::new(settings),
            backlash: Axes::from_fn(|axis| settings.backlash_steps(axis)),
            router: Router::new(settings),
            trace: Trace::new(settings),
            requests: Requests::new(),
            now: 0,
            sent: 0,
            cancelled_motions: 0,
            is_recovering: settings.is_homing_on(),
            feed_ticks: 0,
            control: PathControl::ExactPath,
            blended: Vec::new(),
            path: Blender::new(),
            works: VecDeque::new(),
            blocks: 0,
            segments: Vec::new(),
            steps: 0,
        }
    }

    /// The work of the next command; the last one ends what the path holds back.
    fn work(&mut self, command: &Command, is_last: bool) -> Option<Work> {
        if self.control == PathControl::ExactPath {
            while let Some(work) = self.router.work_before(command) {
                self.works.push_back(work);
            }
            self.works.extend(self.router.route(command));
            return self.works.pop_front();
        }
        self.router.blend(&mut self.path, self.control, command);
        self.drain();
        if is_last {
            self.router.flush(&mut self.path);
            self.drain();
        }
        self.works.pop_front()
    }

    fn drain(&mut self) {
        while let Some(output) = self.path.front().copied() {
            self.blended.push(output);
            while let Some(work) = self.router.work_before_blended(&output) {
                self.works.push_back(work);
            }
            if let Some(mut work) = self.router.route_blended(&output) {
                self.blocks += 1;
                if let Work::Move(block) = &mut work {
                    block.line = self.blocks;
                }
                self.works.push_back(work);
            }
            self.path.dequeue();
        }
    }

    /// Plays commands as fast as the queue takes them, to the end.
    pub(crate) fn play(settings: &Settings, commands: &[Command]) -> Trace {
        let mut rig = Self::new(settings);
        rig.run(commands, &[]);
        rig.trace
    }

    pub(crate) fn snapshot(&self) -> Snapshot {
        self.drive.snapshot()
    }

    /// Plays commands and acts (in order of time) until everything is done and at rest.
    pub(crate) fn run(&mut self, commands: &[Command], acts: &[Act]) {
        let mut commands = commands.iter();
        let mut acts = acts.iter().copied().peekable();
        let mut waiting = None;
        let mut feed_at = 0;
        let mut idle_runs = 0;
        loop {
            while let Some((_, byte)) = acts.next_if(|act| act.0 <= self.now) {
                self.receive(byte);
                if byte == RESET {
                    waiting = None;
                    self.works.clear();
                }
            }
            if !self.is_recovering && self.now >= feed_at {
                waiting = waiting.or_else(|| self.works.pop_front());
                while waiting.is_none() && commands.len() > 0 {
                    let command = commands.next();
                    let is_last = commands.len() == 0;
                    waiting = command.and_then(|command| self.work(command, is_last));
                }
                let is_fed = waiting.is_some_and(|work| self.enqueue(work));
                if is_fed {
                    waiting = None;
                    feed_at = self.now + self.feed_ticks;
                    idle_runs = 0;
                }
                if is_fed && self.feed_ticks == 0 {
                    continue;
                }
            }
            self.prepare();
            if self.is_recovering {
                waiting = None;
            }
            self.recover();
            let is_all_sent = waiting.is_none() && self.works.is_empty() && commands.len() == 0;
            if self.is_done() && is_all_sent && acts.peek().is_none() {
                break;
            }
            idle_runs += 1;
            let feed = (!is_all_sent && feed_at > self.now).then_some(feed_at);
            let act = acts.peek().map(|act| act.0);
            let delay = self.drive.delay_due();
            let other = feed.into_iter().chain(act).chain(delay).min();
            match (self.drive.due(), other) {
                (Some(due), other) if other.is_none_or(|other| due <= other) => {
                    idle_runs = 0;
                    self.now = due;
                    self.step();
                }
                (_, Some(other)) => {
                    idle_runs = 0;
                    self.now = self.now.max(other);
                    self.wake();
                }
                _ => self.go_on(idle_runs),
            }
            assert!(self.now < LONGEST, "the program never ends");
        }
        self.check_end();
    }

    /// Nothing is due: a hold without a resume ends here, anything else is a stall.
    fn go_on(&mut self, idle_runs: u32) {
        if matches!(
            self.snapshot().state,
            State::HoldComplete | State::DoorClosed
        ) {
            self.receive(b'~');
        }
        assert!(idle_runs < 100, "stalled: {:?}", self.snapshot());
    }

    pub(crate) fn receive(&mut self, byte: u8) {
        self.ask(byte);
        self.prepare();
    }

    /// A realtime byte comes; `prepare` has not run yet.
    fn ask(&mut self, byte: u8) {
        receive(&mut self.drive, &self.requests, byte);
        self.is_recovering |= byte == RESET;
    }

    /// These bytes come one after another, each before a run of `prepare`, which takes so many ticks.
    pub(crate) fn run_flooded(&mut self, bytes: &[u8], run_ticks: u64) {
        for byte in bytes {
            self.ask(*byte);
            self.drive.prepare(&self.requests, self.now);
            let end = self.now + run_ticks;
            while let Some(due) = self.drive.due().filter(|due| *due <= end) {
                self.now = due;
                self.step();
            }
            self.now = end;
        }
        self.run_to_standstill();
        self.prepare();
        self.recover();
    }

    fn wake(&mut self) {
        self.drive.end_delay(self.now);
    }

    /// Runs to a time, with nothing from outside.
    pub(crate) fn run_to(&mut self, time: u64) {
        self.prepare();
        while let Some(due) = self.next_due().filter(|due| *due <= time) {
            self.now = self.now.max(due);
            if self.drive.due().is_some_and(|due| due <= self.now) {
                self.step();
            }
            self.wake();
            self.prepare();
        }
        self.now = time;
    }

    fn next_due(&self) -> Option<u64> {
        let dues = [self.drive.due(), self.drive.delay_due()];
        dues.into_iter().flatten().min()
    }

    /// Runs until the machine is at rest, or waits for cycle start.
    pub(crate) fn run_to_standstill(&mut self) {
        while self.drive.due().is_some() {
            self.run_to(self.drive.due().unwrap_or(self.now));
        }
    }

    pub(crate) fn enqueue(&mut self, work: Work) -> bool {
        let cancellation_count = self
            .requests
            .reset_count()
            .wrapping_add(self.cancelled_motions);
        let is_sent = self.drive.enqueue(Entry {
            cancellation_count,
            work,
        });
        self.sent += u32::from(is_sent);
        is_sent
    }

    pub(crate) fn prepare(&mut self) {
        let was_stopped = self.drive.due().is_none();
        let runs = (0..10_000).take_while(|_| self.drive.prepare(&self.requests, self.now));
        assert!(runs.count() < 10_000, "prepare never comes to an end");
        if was_stopped && self.drive.due().is_some() {
            self.trace.starts.push(self.now);
        }
        let snapshot = self.snapshot();
        self.is_recovering |= snapshot.cancelled_motions != self.cancelled_motions;
        if !self.is_recovering {
            assert_ne!(snapshot.state, State::Alarm, "starved");
        }
        assert_eq!(self.drive.late(), 0, "late");
    }

    fn step(&mut self) {
        let line = self.drive.segments.line();
        let steps = self.steps;
        if let Some(edge) = self.drive.step() {
            self.steps += edge.raise.count_ones();
            self.trace.push(edge, line);
            // Motors driven by phases would stand where the steps are, whatever has stopped them before: four
            // full steps are a turn of the field.
            if edge.raise != 0 {
                let net = self.trace.net_steps();
                let phases = net.map(|steps| coils(2 * steps.rem_euclid(4) as usize));
                assert!(self.drive.coils() == phases, "phases of {net:?} steps");
            }
        }
        // The first event of a segment begins it.
        let ticks = self.drive.segments.played_start_ticks();
        if self
            .segments
            .last()
            .is_none_or(|begin| begin.ticks != ticks)
        {
            self.segments.push(Begin { ticks, steps });
        }
    }

    /// After a reset: takes the position when the machine is at rest.
    fn recover(&mut self) {
        let snapshot = self.snapshot();
        let is_over = snapshot.is_at_rest
            && snapshot.finished == self.sent
            && snapshot.reset_count == self.requests.reset_count();
        if !self.is_recovering || !is_over {
            return;
        }
        self.check_position(&snapshot);
        self.router.set_steps(snapshot.steps);
        self.trace.resets.push(self.trace.edges.len());
        self.cancelled_motions = snapshot.cancelled_motions;
        if snapshot.state == State::Alarm {
            assert!(self.enqueue(Work::Unlock));
        }
        while self.drive.prepare(&self.requests, self.now) {}
        self.is_recovering = false;
        assert_ne!(self.snapshot().state, State::Alarm, "unlock");
    }

    fn is_done(&self) -> bool {
        let snapshot = self.snapshot();
        snapshot.is_at_rest && snapshot.finished == self.sent && !self.is_recovering
    }

    fn check_end(&self) {
        let snapshot = self.snapshot();
        self.check_position(&snapshot);
        assert_eq!(self.drive.due(), None);
    }

    /// The motors have made the steps to where the axes are, but for those within the backlash.
    fn check_position(&self, snapshot: &Snapshot) {
        let made = self.trace.net_steps();
        let away = made.zip(snapshot.steps, |made, reported| (made - reported).abs());
        let mut pairs = away.iter().zip(&self.backlash);
        let is_right = pairs.all(|(away, backlash)| away <= backlash);
        assert!(is_right, "reported {:?} for {made:?}", snapshot.steps);
    }
}
