//! A session, and a machine that does as it is told.

use heapless::spsc::Queue;
use leadscrew::{
    axis::AXES,
    machine::{Snapshot, State},
    planner::{Entry, Work},
    protocol::{
        Progress, Session,
        realtime::{self, Release, Requests},
    },
    settings::Settings,
};

pub(crate) const WELCOME: [&str; 2] = ["", "Grbl 1.1h ['$' for help]"];
pub(crate) const UNLOCK: &str = "[MSG:'$H'|'$X' to unlock]";

/// A session with its queues and a machine that finishes each entry at once, unless it withholds.
pub(crate) struct Bench {
    pub(crate) session: Session,
    pub(crate) requests: Requests,
    pub(crate) received: Queue<u8, 1024>,
    pub(crate) sent: Queue<u8, 512>,
    pub(crate) entries: Queue<Entry, 4>,
    pub(crate) machine: Snapshot,
    /// Waiting for cycle start after `M0`.
    is_paused: bool,
    /// The machine takes no entries: as if all places for blocks were in use.
    pub(crate) withholds: bool,
    /// The sender reads nothing.
    pub(crate) is_deaf: bool,
    output: Vec<u8>,
    pub(crate) done: Vec<Work>,
}

impl Bench {
    /// Switched on, the welcome read.
    pub(crate) fn new() -> Self {
        let mut bench = Self::booting(Settings::default());
        assert_eq!(bench.serve(), WELCOME);
        bench
    }

    pub(crate) fn booting(settings: Settings) -> Self {
        let state = if settings.homing {
            State::Alarm
        } else {
            State::Idle
        };
        Self {
            session: Session::new(settings),
            requests: Requests::new(),
            received: Queue::new(),
            sent: Queue::new(),
            entries: Queue::new(),
            machine: Snapshot {
                state,
                blocks_free: 100,
                is_at_rest: true,
                ..Snapshot::default()
            },
            is_paused: false,
            withholds: false,
            is_deaf: false,
            output: Vec::new(),
            done: Vec::new(),
        }
    }

    /// What `prepare` does.
    fn prepare(&mut self) {
        let machine = &mut self.machine;
        if machine.epoch != self.requests.epoch() {
            machine.epoch = self.requests.epoch();
            machine.reset_in_motion = matches!(machine.state, State::Run | State::HoldSlowing);
            machine.state = match machine.state {
                State::Run | State::HoldSlowing | State::Alarm => State::Alarm,
                _ => State::Idle,
            };
            machine.is_at_rest = true;
            machine.finished = machine
                .finished
                .wrapping_add(u32::from(std::mem::take(&mut self.is_paused)));
        }
        if self.requests.take_hold() && matches!(machine.state, State::Idle | State::Run) {
            machine.state = State::HoldComplete;
        }
        if self.requests.take_start() && machine.state == State::HoldComplete {
            machine.state = State::Idle;
            machine.finished = machine
                .finished
                .wrapping_add(u32::from(std::mem::take(&mut self.is_paused)));
        }
        while machine.state != State::HoldComplete && !self.withholds {
            let Some(entry) = self.entries.dequeue() else {
                break;
            };
            machine.finished = machine.finished.wrapping_add(1);
            if entry.epoch == machine.epoch {
                match entry.work {
                    Work::Unlock => machine.state = State::Idle,
                    Work::Pause => {
                        machine.state = State::HoldComplete;
                        machine.finished = machine.finished.wrapping_sub(1);
                        self.is_paused = true;
                    }
                    _ => {}
                }
                self.done.push(entry.work);
            }
        }
    }

    /// Runs every task until all wait.
    pub(crate) fn settle(&mut self) {
        for _ in 0..100_000 {
            self.prepare();
            let (mut sent, mut read) = self.sent.split();
            let (_, mut received) = self.received.split();
            let (mut entries, _) = self.entries.split();
            let progress = self.session.run(
                &self.machine,
                &self.requests,
                &mut received,
                &mut sent,
                &mut entries,
            );
            let mut has_read = false;
            while !self.is_deaf {
                let Some(byte) = read.dequeue() else { break };
                self.output.push(byte);
                has_read = true;
            }
            let is_held = self.withholds || self.machine.state == State::HoldComplete;
            let has_entries = !self.entries.is_empty() && !is_held;
            if progress == Progress::Waiting && !has_read && !has_entries {
                return;
            }
        }
        panic!("the session never waits");
    }

    /// Hands over bytes, each as the receive interrupt would; false when one found no room.
    pub(crate) fn receive(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if self.received.is_full() {
                self.settle();
            }
            let (mut line, _) = self.received.split();
            if realtime::receive(byte, &self.requests, &mut line) == Release::Report {
                let free = self.received.capacity() - self.received.len();
                let (mut sent, _) = self.sent.split();
                self.session
                    .report(&self.machine, &self.requests, free, &mut sent);
            }
        }
    }

    /// The lines that have been sent since the last call.
    pub(crate) fn serve(&mut self) -> Vec<String> {
        self.settle();
        let text = String::from_utf8(std::mem::take(&mut self.output)).expect("ASCII");
        assert!(text.is_empty() || text.ends_with("\r\n"), "{text:?}");
        let lines = text.strip_suffix("\r\n").unwrap_or(&text);
        if text.is_empty() {
            Vec::new()
        } else {
            lines.split("\r\n").map(of_three_axes).collect()
        }
    }

    /// The answer to bytes.
    pub(crate) fn answer(&mut self, text: &str) -> Vec<String> {
        self.receive(text.as_bytes());
        self.serve()
    }

    /// The answer to one line.
    pub(crate) fn ask(&mut self, line: &str) -> Vec<String> {
        self.answer(&format!("{line}\n"))
    }
}

/// A line without the coordinates of A, B and C, which stay 0 here.
fn of_three_axes(line: &str) -> String {
    let is_number = |c: char| c.is_ascii_digit() || matches!(c, '.' | ',' | '-');
    let fields = line.split_inclusive(|c| !is_number(c)).map(|field| {
        let values: Vec<_> = field.split(',').collect();
        let end = field.trim_start_matches(is_number);
        if values.len() == AXES && values.iter().all(|value| value.contains('.')) {
            let (first, _) = values.split_at(3);
            first.join(",").trim_end_matches(end).to_owned() + end
        } else {
            field.to_owned()
        }
    });
    fields.collect()
}

/// The answers among the lines.
pub(crate) fn answers(lines: &[String]) -> Vec<&str> {
    lines
        .iter()
        .map(String::as_str)
        .filter(|line| *line == "ok" || line.starts_with("error:"))
        .collect()
}
