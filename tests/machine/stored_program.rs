//! The program that the firmware brings along: `$794`.

use leadscrew::{
    axis::{AXES, Axes},
    model::{Levels, State},
    settings::{Settings, assign},
    sim::{Edge, Simulator},
    units::TICKS_PER_MS,
};

/// One step is 1 mm, 250 steps a second, no ramp.
const MACHINE: &str = include_str!("../../examples/pico.settings");
/// How long the four arcs take, ms.
const ROUND_MS: u64 = 30_200;

struct Machine {
    simulator: Box<Simulator>,
    sent: String,
    steps: Axes<i32>,
    /// Steps of X and Y, in both directions.
    made: u32,
    /// Places of X and Y at which the arcs end that have been visited.
    ends: Vec<[i32; 2]>,
}

impl Machine {
    fn new(assignments: &[&str]) -> Self {
        let mut settings = Settings::default();
        let machine = MACHINE.lines().filter_map(|line| line.strip_prefix('$'));
        let without_stream = machine.filter(|line| !line.starts_with("792"));
        for assignment in without_stream.chain(assignments.iter().copied()) {
            assign(&mut settings, assignment.as_bytes()).expect(assignment);
        }
        let mut simulator = Box::new(Simulator::new(&settings));
        simulator.settle();
        let mut machine = Self {
            simulator,
            sent: String::new(),
            steps: Axes::all(0),
            made: 0,
            ends: Vec::new(),
        };
        machine.run(10);
        machine.sent.clear();
        machine
    }

    fn step(&mut self, edge: &Edge) {
        for axis in (0..AXES).filter(|axis| edge.raise >> axis & 1 != 0) {
            let is_negative = edge.directions >> axis & 1 != 0;
            self.steps[axis] += if is_negative { -1 } else { 1 };
            self.made += 1;
        }
        let place = [self.steps[0], self.steps[1]];
        let is_end = [[-400, 400], [0, 0], [400, -400]].contains(&place);
        if edge.raise != 0 && is_end && self.ends.last() != Some(&place) {
            self.ends.push(place);
        }
    }

    fn run(&mut self, ms: u64) {
        let end = self.simulator.now() + ms * u64::from(TICKS_PER_MS);
        while self.simulator.now() < end {
            while let Some(byte) = self.simulator.send() {
                self.sent.push(char::from(byte));
                self.simulator.settle();
            }
            if let Some(edge) = self.simulator.advance(end) {
                self.step(&edge);
            }
        }
    }

    fn send(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.simulator.receive(*byte);
            self.simulator.settle();
        }
    }

    fn take_sent(&mut self) -> String {
        self.run(1);
        std::mem::take(&mut self.sent)
    }

    fn state(&self) -> State {
        self.simulator.snapshot().state
    }
}

const ONE_ROUND: [[i32; 2]; 4] = [[-400, 400], [0, 0], [400, -400], [0, 0]];

#[test]
fn the_button_runs_the_program_again_and_again() {
    let mut machine = Machine::new(&["794=1"]);
    machine.simulator.set_pin(Levels::START, true);
    machine.simulator.settle();
    machine.run(20);
    machine.simulator.set_pin(Levels::START, false);
    machine.run(3 * ROUND_MS);
    assert!(machine.ends.starts_with(&[ONE_ROUND, ONE_ROUND].concat()));
    assert!(machine.ends.len() <= 12, "{:?}", machine.ends);
    assert_eq!(machine.state(), State::Run);
    let sent = machine.take_sent();
    assert!(!sent.contains("ok") && !sent.contains("error"), "{sent}");
}

#[test]
fn a_line_of_the_sender_ends_the_program_at_its_end_and_is_answered() {
    let mut machine = Machine::new(&["794=1"]);
    machine.send(b"~");
    machine.run(5000);
    machine.send(b"G1X10F15000\n");
    machine.run(ROUND_MS - 10_000);
    assert_eq!(machine.take_sent(), "", "the line waits");
    machine.run(ROUND_MS);
    assert_eq!(machine.take_sent(), "[MSG:Pgm End]\r\nok\r\n");
    assert_eq!(machine.ends, ONE_ROUND);
    assert_eq!(machine.state(), State::Idle);
    assert_eq!(machine.simulator.physical_steps()[0], 10);
}

#[test]
fn a_reset_ends_the_program_and_nothing_is_answered() {
    let mut machine = Machine::new(&["794=1"]);
    machine.send(b"~");
    machine.run(5000);
    machine.send(b"!");
    machine.run(100);
    assert_eq!(machine.state(), State::HoldComplete);
    machine.send(&[0x18]);
    machine.run(500);
    let sent = machine.take_sent();
    assert!(sent.contains("Grbl 1.1h") && !sent.contains("ok"), "{sent}");
    let made = machine.made;
    assert!(made > 1000, "{made}");
    machine.run(ROUND_MS);
    assert_eq!(machine.made, made);
    machine.send(b"G91\n");
    machine.run(100);
    assert_eq!(machine.take_sent(), "ok\r\n");
}

#[test]
fn a_hold_interrupts_the_program() {
    let mut machine = Machine::new(&["794=1"]);
    machine.send(b"~");
    machine.run(5000);
    machine.send(b"!");
    machine.run(100);
    let made = machine.made;
    machine.run(1000);
    assert_eq!((machine.state(), machine.made), (State::HoldComplete, made));
    machine.send(b"~");
    machine.run(ROUND_MS);
    assert!(machine.ends.starts_with(&ONE_ROUND), "{:?}", machine.ends);
}

#[test]
fn cycle_start_does_nothing_without_the_setting_or_beside_other_work() {
    let mut machine = Machine::new(&[]);
    machine.send(b"~");
    machine.run(1000);
    assert_eq!((machine.made, machine.take_sent()), (0, String::new()));
    let mut machine = Machine::new(&["794=1"]);
    machine.send(b"G1X100F15000\n");
    machine.run(100);
    machine.send(b"~");
    machine.run(ROUND_MS);
    assert_eq!((machine.made, machine.state()), (100, State::Idle));
    // In check mode nothing moves, so that the program would never end.
    machine.send(b"$C\n");
    machine.run(100);
    machine.send(b"~");
    machine.run(1000);
    assert_eq!(machine.state(), State::Check);
    machine.send(b"$C\n");
    machine.run(1000);
    assert!(machine.take_sent().contains("[MSG:Disabled]"));
}

#[test]
fn a_program_that_cannot_begin_here_ends_with_a_message() {
    // The first arc leaves from X0 Y0.
    let mut machine = Machine::new(&["794=1"]);
    machine.send(b"G1X3F15000\n");
    machine.run(1000);
    machine.take_sent();
    machine.send(b"~");
    machine.run(1000);
    assert_eq!(
        machine.take_sent(),
        "[MSG:The stored program cannot run here]\r\n"
    );
    assert_eq!((machine.made, machine.state()), (3, State::Idle));
    machine.send(b"G1X0\n");
    machine.run(1000);
    machine.send(b"~");
    machine.run(ROUND_MS);
    assert_eq!(machine.ends[1..5], ONE_ROUND);
}
