//! The whole simulated machine at the end of a serial line, and an operator.

use leadscrew::{
    axis::{AXES, Axes},
    model::State,
    settings::{Settings, assign},
    sim::Simulator,
};

const TRAVEL_MM: i32 = 100;
const STEPS_PER_MM: i32 = 5;

pub(crate) struct Machine {
    pub(crate) simulator: Simulator,
    output: Vec<u8>,
}

impl Machine {
    /// 100 mm of travel from the place where it stands, which it takes for home, and soft limits.
    pub(crate) fn new() -> Self {
        let mut settings = Settings::default();
        for axis in 0..AXES {
            for assignment in [
                format!("10{axis}={STEPS_PER_MM}"),
                format!("11{axis}=6000"),
                format!("12{axis}=500"),
                format!("13{axis}={TRAVEL_MM}"),
            ] {
                assign(&mut settings, assignment.as_bytes()).expect(&assignment);
            }
        }
        let all = (1 << AXES) - 1;
        for assignment in ["22=1", "20=1", &format!("788={all}")] {
            assign(&mut settings, assignment.as_bytes()).expect(assignment);
        }
        let mut machine = Self {
            simulator: Simulator::new(&settings),
            output: Vec::new(),
        };
        machine.rest();
        machine.output.clear();
        let homed = machine.execute("$H", None);
        assert_eq!(homed.last().map(String::as_str), Some("ok"), "{homed:?}");
        machine
    }

    /// Runs for one change, whatever it is. Returns false when nothing more is to come.
    pub(crate) fn advance(&mut self) -> bool {
        let due = self.simulator.due();
        if let Some(due) = due
            && self.simulator.advance(due).is_some()
        {
            self.assert_inside();
        }
        while let Some(byte) = self.simulator.send() {
            self.output.push(byte);
        }
        self.simulator.settle();
        due.is_some() || self.simulator.has_to_send()
    }

    pub(crate) fn assert_inside(&self) {
        let steps: Axes<i32> = self.simulator.physical_steps();
        for (axis, &steps) in steps.iter().enumerate() {
            assert!(
                (-TRAVEL_MM * STEPS_PER_MM..=0).contains(&steps),
                "axis {axis} is at step {steps}"
            );
        }
    }

    /// The machine is where the interpreter believes it to be.
    pub(crate) fn assert_true(&self, what: &str) {
        let session = self.simulator.session();
        let scales = session.settings().steps_per_mm;
        let programmed = scales.zip(session.interpreter().position(), |resolution, nm| {
            resolution.steps_as_grbl(nm, nm.to_mm()).0.0
        });
        let steps = self.simulator.physical_steps();
        assert_eq!(programmed, steps, "{what}");
        assert_eq!(self.simulator.snapshot().steps, steps, "{what}");
        assert_eq!(self.simulator.late(), 0, "{what}");
    }

    /// Runs until nothing happens any more.
    pub(crate) fn rest(&mut self) {
        for turn in 0.. {
            assert!(turn < 300_000, "{:?}", self.simulator.snapshot());
            if !self.advance() {
                return;
            }
        }
    }

    /// The lines that came since the last call and are whole.
    pub(crate) fn lines(&mut self) -> Vec<String> {
        let end = self
            .output
            .iter()
            .rposition(|&byte| byte == b'\n')
            .map_or(0, |at| at + 1);
        let whole: Vec<u8> = self.output.drain(..end).collect();
        String::from_utf8_lossy(&whole)
            .lines()
            .map(str::to_owned)
            .collect()
    }

    /// The answers that came since the last call.
    pub(crate) fn answers(&mut self) -> Vec<String> {
        let lines = self.lines();
        lines.into_iter().filter(|line| is_answer(line)).collect()
    }

    pub(crate) fn receive(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.simulator.receive(byte);
            self.simulator.settle();
            while let Some(byte) = self.simulator.send() {
                self.output.push(byte);
            }
        }
    }

    /// Sends a line, and does what an operator would until it is answered. Returns what came.
    pub(crate) fn execute(&mut self, line: &str, between: Option<u8>) -> Vec<String> {
        let half = line.len() / 2;
        self.receive(&line.as_bytes()[..half]);
        self.receive(between.as_slice());
        self.receive(&line.as_bytes()[half..]);
        self.receive(b"\n");
        let mut lines = Vec::new();
        for turn in 0.. {
            assert!(
                turn < 300_000,
                "{line}: {:?} {lines:?}",
                self.simulator.snapshot()
            );
            lines.extend(self.lines());
            if lines.iter().any(|line| is_answer(line)) {
                return lines;
            }
            if !self.advance() && self.output.is_empty() {
                match self.simulator.snapshot().state {
                    // A pause, a hold, a door that is closed again, a tool change.
                    State::HoldComplete | State::DoorClosed => self.receive(b"~"),
                    // A line that leaves the travel. One that has come to a machine asleep is dropped.
                    State::Alarm | State::Sleep => {
                        lines.extend(self.reset());
                        return lines;
                    }
                    state => panic!("{line}: no answer in {state:?}: {lines:?}"),
                }
            }
        }
        unreachable!()
    }

    /// Resets at rest: that answers the line.
    pub(crate) fn reset(&mut self) -> Vec<String> {
        self.receive(b"\x18");
        self.rest();
        self.lines()
    }
}

pub(crate) fn is_answer(line: &str) -> bool {
    line == "ok" || line.starts_with("error:")
}
