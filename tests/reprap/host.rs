//! A machine that speaks RepRap, at the end of a serial line.

use leadscrew::{
    axis::AXES,
    model::State,
    settings::{Settings, assign},
    sim::{Simulator, StepStatistics},
    units::TICKS_PER_MS,
};

pub(crate) const STEPS_PER_MM: i32 = 80;

/// The machine, and what it has sent.
pub(crate) struct Host {
    pub(crate) simulator: Simulator,
    pub(crate) statistics: StepStatistics,
    output: Vec<u8>,
}

/// The settings of a small machine with these besides.
pub(crate) fn settings(more: &[&str]) -> Settings {
    let mut settings = Settings::default();
    for axis in 0..AXES {
        for assignment in [
            format!("10{axis}={STEPS_PER_MM}"),
            format!("11{axis}=6000"),
            format!("12{axis}=500"),
        ] {
            assign(&mut settings, assignment.as_bytes()).expect(&assignment);
        }
    }
    for assignment in more {
        assign(&mut settings, assignment.as_bytes()).expect(assignment);
    }
    settings
}

/// A line with its number and its checksum.
pub(crate) fn numbered(number: i32, words: &str) -> String {
    let line = format!("N{number} {words}");
    let sum = line.bytes().fold(0, |sum, byte| sum ^ byte);
    format!("{line}*{sum}")
}

impl Host {
    /// A machine that has greeted.
    pub(crate) fn new() -> Self {
        Self::with(&[])
    }

    pub(crate) fn with(more: &[&str]) -> Self {
        let all: Vec<&str> = ["780=1"].into_iter().chain(more.iter().copied()).collect();
        Self::of(&settings(&all))
    }

    pub(crate) fn of(settings: &Settings) -> Self {
        let mut host = Self {
            simulator: Simulator::new(settings),
            statistics: StepStatistics::new(),
            output: Vec::new(),
        };
        host.rest();
        let greeting = host.lines();
        assert!(
            greeting
                .iter()
                .any(|line| line == "start" || line.starts_with("Grbl"))
        );
        host
    }

    /// Runs to a time, ms from now.
    pub(crate) fn run_ms(&mut self, ms: u32) {
        let end = self.simulator.now() + u64::from(ms * TICKS_PER_MS);
        self.simulator.settle();
        self.collect();
        while self.simulator.now() < end {
            self.advance(end);
            self.collect();
        }
    }

    /// Runs until nothing happens any more by itself.
    pub(crate) fn rest(&mut self) {
        self.simulator.settle();
        self.collect();
        while let Some(due) = self.simulator.due() {
            self.advance(due);
            self.collect();
        }
    }

    fn advance(&mut self, time: u64) {
        if let Some(edge) = self.simulator.advance(time) {
            self.statistics.add(&edge);
        }
    }

    fn collect(&mut self) {
        loop {
            let before = self.output.len();
            while let Some(byte) = self.simulator.send() {
                self.output.push(byte);
            }
            self.simulator.settle();
            if self.output.len() == before {
                return;
            }
        }
    }

    pub(crate) fn receive(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.simulator.receive(byte);
            self.simulator.settle();
            self.collect();
        }
    }

    /// What has been sent since the last call.
    pub(crate) fn lines(&mut self) -> Vec<String> {
        let text = String::from_utf8(self.output.drain(..).collect()).expect("ASCII");
        assert!(text.is_empty() || text.ends_with("\r\n"), "{text:?}");
        text.split_terminator("\r\n").map(str::to_owned).collect()
    }

    /// Sends a line, runs to the end, and returns the answer.
    pub(crate) fn ask(&mut self, line: &str) -> Vec<String> {
        self.receive(line.as_bytes());
        self.receive(b"\n");
        self.rest();
        self.lines()
    }

    /// Sends numbered lines, each of which must be accepted.
    pub(crate) fn run(&mut self, first: i32, lines: &[&str]) {
        for (number, words) in (first..).zip(lines) {
            assert_eq!(self.ask(&numbered(number, words)), ["ok"], "{words}");
        }
    }

    pub(crate) fn state(&self) -> State {
        self.simulator.snapshot().state
    }

    /// Where X and Y are, steps.
    pub(crate) fn xy(&self) -> [i32; 2] {
        let steps = self.simulator.physical_steps();
        [steps[0], steps[1]]
    }
}

/// The first line of an answer.
pub(crate) fn first(host: &mut Host, line: &str) -> String {
    let mut answer = host.ask(line);
    assert_eq!(answer.pop().as_deref(), Some("ok"), "{line}: {answer:?}");
    answer.into_iter().next().unwrap_or_default()
}

/// Where X and Y are, mm.
pub(crate) fn place(host: &mut Host) -> [i32; 2] {
    host.xy().map(|steps| steps / STEPS_PER_MM)
}

/// Time of a line from its receipt to standstill, s.
pub(crate) fn seconds(host: &mut Host, line: &str) -> f64 {
    let start = host.simulator.now();
    host.ask(line);
    (host.simulator.now() - start) as f64 / f64::from(leadscrew::units::TICKS_PER_SECOND)
}
