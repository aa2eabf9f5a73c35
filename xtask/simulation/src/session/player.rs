//! A machine, and the one who plays the steps of an exchange to it.

use anyhow::Result;
use leadscrew::{
    axis::AXES,
    sim::{Simulator, Switch},
    units::TICKS_PER_SECOND,
};

use super::{
    Session,
    step::{Act, Step},
    track::{Sample, Track},
};
use crate::{
    machine::{Event, Machine},
    proven,
    sender::Response,
};

/// How long the machine runs between an answer and the next step, s.
const AFTER_ANSWER_S: f64 = 0.005;
/// How long it runs after a realtime byte or raw bytes, s.
const AFTER_BYTES_S: f64 = 0.02;
/// How often standstill is looked for, s, and how long bytes may be on their way.
const POLL_S: f64 = 0.01;
/// How long the machine has for its welcome, s.
const POWER_UP_S: f64 = 0.2;
/// How often the machine is looked at, s.
const SAMPLE_S: f64 = 0.001;
/// The machine's clock gets no nearer to the end of a wait, s.
const HALF_TICK_S: f64 = 0.5 / TICKS_PER_SECOND as f64;

/// How long the answer to a line is waited for, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patience {
    /// While nothing moves.
    pub at_rest_s: f64,
    /// At all.
    pub longest_s: f64,
}

impl Patience {
    /// As long in motion as at rest.
    pub const fn of(seconds: f64) -> Self {
        Self {
            at_rest_s: seconds,
            longest_s: seconds,
        }
    }
}

/// A machine and the lines it has sent.
pub struct Player {
    /// The machine.
    pub machine: Machine,
    /// When the first step began, from power-up.
    start_s: f64,
    /// Complete lines that have not been taken, with their times from the first step.
    lines: Vec<(f64, String)>,
    /// The beginning of the next.
    line: Vec<u8>,
    /// Number of answers so far.
    answers: usize,
    track: Track,
}

impl Player {
    /// Switches a machine on and lets it say so.
    ///
    /// # Errors
    /// The session's settings or switches make no sense.
    pub fn new(session: &Session) -> Result<Self> {
        let simulator = if session.virgin_eeprom {
            Simulator::first_boot(proven::committed())
        } else {
            Simulator::new(&session.settings()?)
        };
        Ok(Self::with(simulator, session.switches()?))
    }

    /// Lets a machine that has just been switched on, amid switches, say so.
    pub fn with(simulator: Simulator, switches: Vec<Switch>) -> Self {
        let mut player = Self {
            machine: Machine::amid(simulator, switches),
            start_s: 0.0,
            lines: Vec::new(),
            line: Vec::new(),
            answers: 0,
            track: Track::default(),
        };
        player.start_s = POWER_UP_S;
        player.run_for(POWER_UP_S);
        player
    }

    /// Time from the first step, s.
    pub fn now_s(&self) -> f64 {
        self.machine.now_s() - self.start_s
    }

    /// What the machine did.
    pub fn into_track(self) -> Track {
        self.track
    }

    /// What the outputs and the switches did, from the first step, s.
    pub fn signals(&self) -> Vec<Event> {
        let events = self.machine.signals().iter();
        events
            .map(|Event(time, name, value)| {
                Event(rounded(time - self.start_s), name.clone(), *value)
            })
            .collect()
    }

    /// Runs, and collects what arrives.
    pub fn run_for(&mut self, seconds: f64) {
        let end = self.machine.now_s() + seconds;
        loop {
            let left = end - self.machine.now_s();
            if left < HALF_TICK_S {
                return;
            }
            self.machine.run_for(left.min(SAMPLE_S));
            self.sample();
            self.collect();
        }
    }

    fn sample(&mut self) {
        let snapshot = self.machine.snapshot();
        let mut steps = [0; AXES];
        steps.copy_from_slice(&snapshot.steps.0);
        self.track.push(Sample {
            time_s: self.machine.now_s() - self.start_s,
            state: snapshot.state,
            steps,
            feed_mm_min: snapshot.feed_mm_min,
            spindle_rpm: snapshot.spindle_rpm,
        });
    }

    fn collect(&mut self) {
        for (time, byte) in self.machine.take_bytes() {
            let time = time - self.start_s;
            match byte {
                b'\n' => {
                    let text = String::from_utf8_lossy(&self.line).into_owned();
                    self.answers += usize::from(Response::parse(&text).is_some());
                    self.lines.push((time, text));
                    self.line.clear();
                }
                b'\r' => {}
                byte => self.line.push(byte),
            }
        }
    }

    /// The lines since the last call.
    pub fn take_lines(&mut self) -> Vec<(f64, String)> {
        std::mem::take(&mut self.lines)
    }

    /// Waits until the step is due.
    pub fn wait_for(&mut self, step: &Step) {
        self.run_for(step.t.unwrap_or(0.0) - self.now_s());
    }

    /// Plays a step that is due.
    pub fn play(&mut self, step: &Step, act: &Act, patience: Patience) {
        let mut after = 0.0;
        match act {
            Act::Boot => {}
            Act::Line { text, waits } => {
                self.machine.send(text.as_bytes());
                self.machine.send(b"\n");
                if *waits {
                    self.wait_for_answer(patience);
                    after = AFTER_ANSWER_S;
                }
            }
            Act::Bytes(bytes) => {
                self.machine.send(bytes);
                after = AFTER_BYTES_S;
            }
            Act::Wait(seconds) => self.run_for(*seconds),
            Act::Idle(seconds) => self.wait_for_standstill(*seconds),
            Act::Pin { pin, closed } => {
                self.machine.press(*pin, *closed);
                after = POLL_S;
            }
        }
        self.run_for(step.after.unwrap_or(after));
    }

    /// Runs until an answer comes.
    pub fn wait_for_answer(&mut self, patience: Patience) {
        let before = self.answers;
        let start = self.machine.now_s();
        while self.answers == before {
            let waited = self.machine.now_s() - start;
            let is_at_rest = || self.machine.stands_still();
            if waited >= patience.longest_s || (waited >= patience.at_rest_s && is_at_rest()) {
                return;
            }
            self.run_for(0.000_1);
        }
    }

    /// Runs until nothing moves any more, so many seconds at most.
    pub fn wait_for_standstill(&mut self, most_s: f64) {
        let end = self.machine.now_s() + most_s;
        self.run_for(POLL_S.min(most_s) * 3.0);
        while !self.machine.stands_still() && self.machine.now_s() < end {
            self.run_for(POLL_S);
        }
    }
}

/// Times are written with a tenth of a millisecond.
pub fn rounded(seconds: f64) -> f64 {
    (seconds * 1e4).round() / 1e4
}
