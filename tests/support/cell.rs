//! The drive with switches, probe and buttons, and what it tells.

use leadscrew::{
    axis::{AXES, Axes},
    machine::Snapshot,
    model::{Alarm, Command, Levels, Notice, Probing, Requests, State},
    path::{Entry, Router, Work},
    settings::Settings,
    sim::{Closes, Drive, Switch},
    units::{TICKS_PER_SECOND, TICKS_PER_US},
};

use super::{Trace, at, line, receive};

/// A machine with switches, without its session.
pub(crate) struct Cell {
    pub(crate) drive: Box<Drive>,
    pub(crate) trace: Trace,
    pub(crate) router: Router,
    requests: Requests,
    now: u64,
    sent: u32,
    seen: u32,
}

impl Cell {
    pub(crate) fn new(settings: &Settings) -> Self {
        let mut cell = Self {
            drive: Box::new(Drive::new(settings)),
            trace: Trace::new(settings),
            router: Router::new(settings),
            requests: Requests::new(),
            now: 0,
            sent: 0,
            seen: 0,
        };
        cell.settle();
        cell
    }

    pub(crate) fn snapshot(&self) -> Snapshot {
        self.drive.snapshot()
    }

    pub(crate) fn state(&self) -> State {
        self.drive.snapshot().state
    }

    pub(crate) fn physical(&self) -> Axes<i32> {
        self.drive.physical_steps()
    }

    pub(crate) fn seconds(&self) -> f64 {
        self.now as f64 / f64::from(TICKS_PER_SECOND)
    }

    pub(crate) fn mount(&mut self, axis: usize, closes: Closes, input: Levels) {
        let switch = Switch {
            axis,
            closes,
            input,
        };
        assert!(self.drive.mount(switch));
        self.settle();
    }

    pub(crate) fn set_pin(&mut self, inputs: Levels, closed: bool) {
        self.drive.set_pin(inputs, closed);
        self.settle();
    }

    pub(crate) fn byte(&mut self, byte: u8) {
        receive(&mut self.drive, &self.requests, byte);
        self.settle();
    }

    pub(crate) fn send(&mut self, work: Work) {
        let snapshot = self.snapshot();
        let cancellation_count = snapshot
            .reset_count
            .wrapping_add(snapshot.cancelled_motions);
        assert!(self.drive.enqueue(Entry {
            cancellation_count,
            work
        }));
        self.sent += 1;
        self.settle();
    }

    pub(crate) fn go(&mut self, mm: &[f64], mm_min: f32) {
        let work = self.router.route(&line(mm, mm_min));
        self.send(work.expect("a path"));
    }

    pub(crate) fn probe(&mut self, mm: &[f64], mm_min: f32, probing: Probing) {
        let command = Command::Probe {
            target: at(mm).into(),
            feed_rate: leadscrew::model::FeedRate::Feed(mm_min),
            probing,
            line: 0,
        };
        let work = self.router.route(&command);
        self.send(work.expect("a path"));
    }

    /// The alarms told since this was asked last.
    pub(crate) fn alarms(&mut self) -> Vec<Alarm> {
        let notices = self.notices();
        notices
            .into_iter()
            .filter_map(|notice| match notice {
                Notice::Alarm(alarm) => Some(alarm),
                _ => None,
            })
            .collect()
    }

    pub(crate) fn notices(&mut self) -> Vec<Notice> {
        let notices = self.snapshot().notices;
        std::iter::from_fn(|| notices.next(&mut self.seen)).collect()
    }

    /// Runs whatever is released.
    fn settle(&mut self) {
        for _ in 0..1000 {
            self.drive.watch(&self.requests, self.now);
            let was_stopped = self.drive.due().is_none();
            let has_run = self.drive.prepare(&self.requests, self.now);
            if was_stopped && self.drive.due().is_some() {
                self.trace.starts.push(self.now);
            }
            if !has_run {
                return;
            }
        }
        panic!("prepare never comes to an end");
    }

    /// Goes on to the next thing that is due, at most until `end`.
    pub(crate) fn advance(&mut self, end: u64) {
        let step = self.drive.due();
        let dues = [step, self.drive.sample_due(), self.drive.delay_due()];
        self.now = dues.into_iter().flatten().fold(end, u64::min).max(self.now);
        if step.is_some_and(|due| due <= self.now) {
            let line = self.drive.segments.line();
            if let Some(edge) = self.drive.step() {
                self.trace.push(edge, line);
            }
        }
        self.drive.end_delay(self.now);
        self.settle();
    }

    pub(crate) fn run_ms(&mut self, ms: u32) {
        self.run_us(1000 * ms);
    }

    pub(crate) fn run_us(&mut self, us: u32) {
        let end = self.now + u64::from(us) * u64::from(TICKS_PER_US);
        while self.now < end {
            self.advance(end);
        }
    }

    /// Runs until something holds, for at most ten minutes.
    pub(crate) fn run_until(&mut self, holds: impl Fn(&Self) -> bool) {
        let end = self.now + 600 * u64::from(TICKS_PER_SECOND);
        while !holds(self) {
            assert!(self.now < end, "never: {:?}", self.snapshot());
            self.advance(end);
        }
    }

    /// True if everything sent is done and the machine is at standstill.
    pub(crate) fn is_done(&self) -> bool {
        let snapshot = self.snapshot();
        snapshot.is_at_rest && snapshot.finished == self.sent
    }

    pub(crate) fn run_to_end(&mut self) {
        self.run_until(Self::is_done);
        assert_eq!(self.drive.due(), None);
        for axis in 0..AXES {
            assert_eq!(self.physical()[axis], self.trace.net_steps()[axis]);
        }
    }
}
