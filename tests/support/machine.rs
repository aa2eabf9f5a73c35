//! The whole machine with its serial line: input of a sender and an operator, output bytes and steps.

use std::{
    mem::take,
    ops::{Deref, DerefMut},
};

use grbl_client::Report;
use leadscrew::{
    axis::AXES,
    model::{Levels, State},
    settings::{Settings, StepRate, assign},
    sim::{Closes, Edge, Simulator, Switch},
    units::{TICKS_PER_MS, TICKS_PER_SECOND},
};

/// A millisecond, ticks.
pub(crate) const MS: u64 = TICKS_PER_MS as u64;
/// Longest time for which a machine is in motion, in these tests.
const LONGEST_MS: u64 = 30 * 60 * 1000;

/// What a report shows behind the speeds, as it is written.
pub(crate) fn fields_after_speeds(report: &Report) -> String {
    let names: Vec<_> = report
        .fields
        .iter()
        .take(2)
        .map(|(name, _)| &**name)
        .collect();
    assert_eq!(names, ["MPos", "FS"]);
    let fields = report.fields.iter().skip(2);
    let fields = fields.map(|(name, value)| format!("{name}:{value}"));
    fields.collect::<Vec<_>>().join("|")
}

/// The default settings with these assignments: `110=6000`.
pub(crate) fn assigned<T: AsRef<str>>(assignments: impl IntoIterator<Item = T>) -> Settings {
    let mut settings = Settings::default();
    for assignment in assignments {
        let assignment = assignment.as_ref();
        assign(&mut settings, assignment.as_bytes()).expect(assignment);
    }
    settings
}

/// Assignments for every axis, from the numbers of X.
pub(crate) fn on_every_axis(of_x: &[(usize, i32)]) -> Vec<String> {
    let of_axis = |axis| {
        of_x.iter()
            .map(move |(number, value)| (number + axis, value))
    };
    let all = (0..AXES).flat_map(of_axis);
    all.map(|(number, value)| format!("{number}={value}"))
        .collect()
}

/// The virtual machine and its sender.
pub(crate) struct Machine {
    simulator: Box<Simulator>,
    /// What the sender has received and nobody has taken yet.
    pub(crate) received: String,
    /// Lines that have been sent, by their ends.
    pub(crate) sent_lines: usize,
    /// Every change of the step pins.
    pub(crate) edges: Vec<Edge>,
    /// Checks the machine after each of them.
    pub(crate) check: fn(&Simulator),
    /// Time of a byte on the line, ticks; 0: bytes take no time.
    byte_ticks: u64,
    /// Time from which the line to the sender is free.
    free_from: u64,
}

impl Deref for Machine {
    type Target = Simulator;

    fn deref(&self) -> &Simulator {
        &self.simulator
    }
}

impl DerefMut for Machine {
    fn deref_mut(&mut self) -> &mut Simulator {
        &mut self.simulator
    }
}

impl Machine {
    /// Switched on with these assignments; the welcome has been read.
    pub(crate) fn new(assignments: &[&str]) -> Self {
        Self::with(&assigned(assignments))
    }

    /// Switched on with these settings; the welcome has been read.
    pub(crate) fn with(settings: &Settings) -> Self {
        let mut machine = Self::of(Simulator::new(settings));
        machine.run_to_standstill();
        machine.received.clear();
        machine
    }

    /// A simulator of which nothing has been read.
    pub(crate) fn of(simulator: Simulator) -> Self {
        Self {
            simulator: Box::new(simulator),
            received: String::new(),
            sent_lines: 0,
            edges: Vec::new(),
            check: |_| (),
            byte_ticks: 0,
            free_from: 0,
        }
    }

    /// The simulator as it is.
    pub(crate) fn into_simulator(self) -> Simulator {
        *self.simulator
    }

    /// Bytes take their time on the line, from now on.
    pub(crate) fn set_baud(&mut self, baud: u32) {
        self.byte_ticks = u64::from(TICKS_PER_SECOND) * 10 / u64::from(baud);
    }

    /// Without power, and with it again: nothing has been read.
    pub(crate) fn cycle_power(self) -> Self {
        let flash = self.into_simulator().into_flash();
        Self::of(Simulator::power_up(flash, StepRate::Unproven))
    }

    fn collect(&mut self) {
        self.simulator.settle();
        while self.simulator.now() >= self.free_from
            && let Some(byte) = self.simulator.send()
        {
            self.received.push(char::from(byte));
            self.free_from = self.simulator.now() + self.byte_ticks;
            self.simulator.settle();
        }
    }

    /// Goes on to the next change, `end` at the latest.
    pub(crate) fn advance_to(&mut self, end: u64) {
        let has_to_send = self.simulator.has_to_send();
        let end = if has_to_send {
            end.min(self.free_from)
        } else {
            end
        };
        if let Some(edge) = self.simulator.advance(end) {
            self.edges.push(edge);
            (self.check)(&self.simulator);
        }
        self.collect();
    }

    /// Goes on to the next change. Returns false if none is to come.
    pub(crate) fn advance(&mut self) -> bool {
        let has_to_send = self.simulator.has_to_send();
        let sent = has_to_send.then_some(self.free_from);
        let Some(next) = self.simulator.due().into_iter().chain(sent).min() else {
            return false;
        };
        self.advance_to(next);
        true
    }

    /// Runs for some milliseconds.
    pub(crate) fn run(&mut self, ms: u64) {
        self.run_ticks(ms * MS);
    }

    pub(crate) fn run_ticks(&mut self, ticks: u64) {
        let end = self.simulator.now() + ticks;
        self.collect();
        while self.simulator.now() < end {
            self.advance_to(end);
        }
    }

    /// Runs until something is true at the end of a millisecond.
    pub(crate) fn run_until(&mut self, is_true: impl Fn(&Self) -> bool) {
        for _ in 0..LONGEST_MS {
            if is_true(self) {
                return;
            }
            self.run(1);
        }
        panic!("never: {:?}, {}", self.state(), self.received);
    }

    /// Runs until nothing happens any more by itself.
    pub(crate) fn run_to_standstill(&mut self) {
        let end = self.simulator.now() + LONGEST_MS * MS;
        self.collect();
        while self.advance() {
            assert!(self.simulator.now() < end, "never: {:?}", self.state());
        }
    }

    /// Sends bytes: lines and realtime commands.
    pub(crate) fn send(&mut self, bytes: impl AsRef<[u8]>) {
        for &byte in bytes.as_ref() {
            self.run_ticks(self.byte_ticks);
            self.simulator.receive(byte);
            self.sent_lines += usize::from(byte == b'\n');
            self.collect();
        }
    }

    /// Sends bytes, and runs for some milliseconds.
    pub(crate) fn send_for(&mut self, bytes: impl AsRef<[u8]>, ms: u64) -> &mut Self {
        self.send(bytes);
        self.run(ms);
        self
    }

    /// Sends bytes, runs to rest, and takes what has been received.
    pub(crate) fn exchange(&mut self, bytes: impl AsRef<[u8]>) -> String {
        self.send(bytes);
        self.run_to_standstill();
        self.take_received()
    }

    /// Sends a line, runs to rest, and takes the lines that have been received.
    pub(crate) fn ask(&mut self, line: &str) -> Vec<String> {
        self.answers_to(format!("{line}\n"))
    }

    /// The same with any bytes.
    pub(crate) fn answers_to(&mut self, bytes: impl AsRef<[u8]>) -> Vec<String> {
        self.send(bytes);
        self.answers()
    }

    /// Runs to rest, and takes the lines that have been received.
    pub(crate) fn answers(&mut self) -> Vec<String> {
        self.run_to_standstill();
        let lines = self.lines();
        assert_eq!(self.received, "", "a line without an end");
        lines
    }

    /// Takes what has been received.
    pub(crate) fn take_received(&mut self) -> String {
        take(&mut self.received)
    }

    /// Takes the lines that have been received with their ends.
    pub(crate) fn lines(&mut self) -> Vec<String> {
        let end = self.received.rfind("\r\n").map_or(0, |place| place + 2);
        let lines: String = self.received.drain(..end).collect();
        let lines = lines.split_terminator("\r\n");
        lines.map(str::to_owned).collect()
    }

    /// Asks for a status report, and takes it from what is received.
    pub(crate) fn report(&mut self) -> Report {
        self.timed_report().0
    }

    /// The same, with how long its first byte took, ms.
    pub(crate) fn timed_report(&mut self) -> (Report, f64) {
        let start = self.simulator.now();
        let before = self.received.len();
        let end = start + 50 * MS;
        self.simulator.receive(b'?');
        self.collect();
        let mut find = |text: &str| {
            loop {
                if let Some(place) = self.received[before..].find(text) {
                    return (before + place, self.simulator.now() - start);
                }
                assert!(self.simulator.now() < end, "no report within 50 ms");
                self.advance_to(end);
            }
        };
        let (first, latency) = find("<");
        let (last, _) = find(">\r\n");
        let line: String = self.received.drain(first..last + 3).collect();
        let report = Report::read(line.trim_end()).expect("a report");
        (report, latency as f64 / MS as f64)
    }

    pub(crate) fn state(&self) -> State {
        self.simulator.snapshot().state
    }

    pub(crate) fn is_at_rest(&self) -> bool {
        self.simulator.snapshot().is_at_rest
    }

    /// Steps of X, Y and Z since power-up.
    pub(crate) fn xyz(&self) -> [i32; 3] {
        let steps = self.simulator.physical_steps();
        [steps[0], steps[1], steps[2]]
    }

    /// Time since power-up, s.
    pub(crate) fn seconds(&self) -> f64 {
        self.simulator.now() as f64 / f64::from(TICKS_PER_SECOND)
    }

    /// Mounts a switch that an axis closes.
    pub(crate) fn mount(&mut self, axis: usize, closes: Closes, input: Levels) {
        let switch = Switch {
            axis,
            closes,
            input,
        };
        assert!(self.simulator.mount(switch), "no room for a switch");
        self.collect();
    }

    /// Mounts limit switches at these steps of X, Y and Z.
    pub(crate) fn mount_limits(&mut self, steps: [i32; 3]) {
        for (axis, steps) in steps.into_iter().enumerate() {
            self.mount(axis, Closes::From(steps), Levels::limits(1 << axis));
        }
    }

    /// Closes the contacts of inputs, or opens them again.
    pub(crate) fn set_pin(&mut self, inputs: Levels, closed: bool) {
        self.simulator.set_pin(inputs, closed);
        self.collect();
    }
}
