//! A client and the virtual machine, and what happens between them.

use grbl_client::{
    Client,
    client::{Command, Event},
};
use leadscrew::{
    settings::{Settings, StepRate},
    sim::Simulator,
};
use simulation::{
    SwitchPositions,
    machine::{Machine, Pin},
};

/// How often the client goes on, ms.
pub(crate) const TICK_MS: u64 = 20;

/// A machine, a client, and what the client has told.
pub(crate) struct OperatedMachine {
    pub(crate) machine: Machine,
    pub(crate) client: Client,
    pub(crate) now_ms: u64,
    pub(crate) events: Vec<Event>,
    /// Whether the probe touches, with the tool at a place: mm from where the machine was switched on.
    pub(crate) touches: Option<fn([f64; 3]) -> bool>,
}

impl OperatedMachine {
    /// A machine amid switches that has been unlocked, with a client that knows it.
    pub(crate) fn new(settings: &[&str]) -> Self {
        let defaults = Settings {
            step_rate: StepRate::Proven(200_000),
            ..Settings::default()
        };
        let mut simulator = Simulator::new(&defaults);
        SwitchPositions::of(&defaults).mount_on(&mut simulator);
        let mut operated = Self {
            machine: Machine::amid(simulator, Vec::new()),
            client: Client::default(),
            now_ms: 0,
            events: Vec::new(),
            touches: None,
        };
        operated.run(500);
        for line in ["$X"].iter().chain(settings) {
            assert_eq!(operated.ask(line).1, "ok", "{line}");
        }
        operated
    }

    /// Runs for a time, with the client.
    pub(crate) fn run(&mut self, ms: u64) {
        let end = self.now_ms + ms;
        while self.now_ms < end {
            self.client.tick(self.now_ms);
            self.exchange();
        }
    }

    /// The line for one tick.
    pub(crate) fn exchange(&mut self) {
        self.machine.send(&self.client.take_output());
        for _ in 0..TICK_MS {
            self.now_ms += 1;
            let now_s = self.now_ms as f64 / 1000.0;
            self.machine.run_until_s(now_s, &mut |_| {});
            if let Some(touches) = self.touches {
                let is_closed = touches(self.place_mm());
                self.machine.press(Pin::Probe, is_closed);
            }
        }
        let bytes: Vec<_> = { self.machine.take_bytes().into_iter() }
            .map(|(_, byte)| byte)
            .collect();
        self.client.receive(&bytes, self.now_ms);
        self.events.extend(self.client.take_events());
    }

    pub(crate) fn command(&mut self, command: Command) {
        self.client.command(command, self.now_ms);
    }

    /// Sends a line, and returns what is answered.
    pub(crate) fn ask(&mut self, text: &str) -> (Vec<String>, String) {
        self.events.clear();
        self.command(Command::Line {
            number: 7,
            text: text.into(),
        });
        for _ in 0..200 {
            self.run(TICK_MS);
            let mut events = self.events.iter();
            let answer = events.find_map(|event| match event {
                Event::Answer {
                    number: 7,
                    lines,
                    response,
                } => Some((lines.clone(), response.clone())),
                _ => None,
            });
            if let Some(answer) = answer {
                return answer;
            }
        }
        panic!("{text} is not answered")
    }

    /// Runs until the machine has reported a state, at most a minute.
    pub(crate) fn await_state(&mut self, state: &str) {
        for _ in 0..3000 {
            self.run(TICK_MS);
            if self.client.state().state == state {
                return;
            }
        }
        panic!("{:?} is not {state}", self.client.state());
    }

    /// Where the tool is, mm from where the machine was switched on.
    pub(crate) fn place_mm(&self) -> [f64; 3] {
        let steps = self.machine.simulator().physical_position();
        [0, 1, 2].map(|axis| f64::from(steps[axis]) / 250.0)
    }
}
