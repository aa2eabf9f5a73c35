//! A break on the serial line: it holds a motion, once, and nothing else.

use leadscrew::{
    axis::Axes,
    model::{Levels, State},
    settings::Settings,
    sim::{Closes, Simulator, Switch},
    units::{TICKS_PER_MS, TICKS_PER_SECOND},
};

use crate::terminal;

const MS: u64 = TICKS_PER_MS as u64;
const MESSAGE: &str = "[MSG:Break on the line]";

struct Machine {
    simulator: Box<Simulator>,
    told: Vec<u8>,
}

impl Machine {
    fn new(settings: &Settings) -> Self {
        let mut machine = Self {
            simulator: Box::new(Simulator::new(settings)),
            told: Vec::new(),
        };
        machine.run(TICKS_PER_SECOND.into());
        machine.told.clear();
        machine
    }

    /// A machine that has been told this, 100 ms ago.
    fn doing(line: &str) -> Self {
        let settings = Settings {
            homing: true,
            ..Settings::default()
        };
        let mut machine = Self::new(&settings);
        machine.send("$X\n");
        machine.send(line);
        machine.run(100 * MS);
        machine.answers();
        machine
    }

    fn send(&mut self, text: &str) {
        for byte in text.bytes() {
            self.simulator.receive(byte);
        }
        self.run(0);
    }

    fn run(&mut self, ticks: u64) {
        let end = self.simulator.now() + ticks;
        terminal::run(&mut self.simulator, &mut self.told, ticks);
        self.simulator.advance(end);
    }

    /// Mounts a switch for homing at 2 mm of each axis.
    fn mount_switches(&mut self) {
        for axis in 0..3 {
            let switch = Switch {
                axis,
                closes: Closes::From(500),
                input: Levels::limits(1 << axis),
            };
            assert!(self.simulator.mount(switch));
        }
    }

    /// Sends lines of which the first homes, with a break meanwhile, and waits for the end.
    fn home_through_break(&mut self, lines: &str) {
        self.mount_switches();
        self.send(lines);
        self.run(100 * MS);
        self.make_break(300);
        assert_eq!(self.state(), State::Home);
        self.run(120_000 * MS);
    }

    /// Opens the door, closes it, and presses cycle start: the spindle starts again.
    fn open_and_close_door(&mut self) {
        self.simulator.set_pin(Levels::DOOR, true);
        self.run(5000 * MS);
        self.simulator.set_pin(Levels::DOOR, false);
        self.run(100 * MS);
        self.send("~");
        self.run(50 * MS);
        assert_eq!(self.state(), State::DoorRestoring);
        self.answers();
    }

    /// Makes a break: the receiver sees a byte without a stop bit, and then nothing.
    fn make_break(&mut self, ms: u64) {
        self.simulator.pull_line(true);
        self.run(MS);
        self.simulator.receive_damaged();
        self.run((ms - 1) * MS);
        self.simulator.pull_line(false);
        self.run(100 * MS);
    }

    /// Returns the lines of the machine since the last call.
    fn answers(&mut self) -> Vec<String> {
        terminal::lines(&mut self.told)
    }

    fn state(&self) -> State {
        self.simulator.snapshot().state
    }

    fn x(&self) -> i32 {
        let Axes([x, ..]) = self.simulator.physical_steps();
        x
    }
}

#[test]
fn a_break_of_50_ms_holds_a_move_that_ends_exactly_after_cycle_start() {
    let mut machine = Machine::doing("G1X10F600\n");
    assert_eq!(machine.state(), State::Run);
    machine.make_break(50);
    machine.run(60_000 * MS);
    assert_eq!(machine.state(), State::HoldComplete);
    assert_eq!(machine.answers(), [MESSAGE]);
    let held = machine.x();
    assert!((1..2400).contains(&held), "{held}");
    machine.send("~");
    machine.run(5000 * MS);
    assert_eq!((machine.state(), machine.x()), (State::Idle, 2500));
    assert!(machine.answers().is_empty());
}

#[test]
fn a_break_that_lasts_holds_once_and_each_break_anew() {
    let mut machine = Machine::doing("G1X100F600\n");
    machine.make_break(1000);
    assert_eq!(machine.state(), State::HoldComplete);
    assert_eq!(machine.answers(), [MESSAGE]);
    machine.send("~");
    machine.run(500 * MS);
    assert_eq!(machine.state(), State::Run);
    machine.make_break(50);
    assert_eq!(machine.answers(), [MESSAGE]);
    // A break that lasts does not hold again after `~`.
    machine.simulator.pull_line(true);
    machine.run(500 * MS);
    machine.send("~");
    machine.run(500 * MS);
    assert_eq!(machine.state(), State::Run);
    assert!(machine.answers().is_empty());
}

#[test]
fn a_line_that_is_low_for_less_than_a_break_holds_nothing() {
    let mut machine = Machine::doing("G1X10F600\n");
    for _ in 0..20 {
        machine.make_break(39);
    }
    machine.run(2000 * MS);
    assert_eq!((machine.state(), machine.x()), (State::Idle, 2500));
    assert!(machine.answers().is_empty());
}

#[test]
fn looks_that_always_find_a_low_bit_of_a_byte_hold_nothing() {
    // At these rates a byte of ten bits comes at least once in a period or two.
    for baud in [9600_u64, 115_200, 1_000_000] {
        let mut machine = Machine::doing("G1X10F600\n");
        machine.simulator.pull_line(true);
        let byte_ticks = u64::from(TICKS_PER_SECOND) * 10 / baud;
        let end = machine.simulator.now() + 300 * MS;
        // Spaces, which are left out of a line, are low for 8 of 10 bits.
        while machine.simulator.now() < end {
            machine.simulator.receive(b' ');
            machine.run(byte_ticks);
        }
        machine.simulator.pull_line(false);
        machine.run(2000 * MS);
        assert_eq!((machine.state(), machine.x()), (State::Idle, 2500));
        assert!(machine.answers().is_empty());
    }
}

#[test]
fn a_break_at_idle_and_while_homing_does_nothing_as_nothing_else_does() {
    let mut machine = Machine::doing("G0X1\n");
    machine.run(2000 * MS);
    assert_eq!(machine.state(), State::Idle);
    machine.answers();
    machine.make_break(300);
    assert_eq!(machine.state(), State::Idle);
    assert!(machine.answers().is_empty());
    // Nor later, when something moves.
    machine.send("\nG1X2F100\n");
    machine.run(200 * MS);
    assert_eq!(machine.state(), State::Run);
    assert_eq!(machine.answers(), ["error:210", "ok"]);

    let mut machine = Machine::doing("$H\n");
    assert_eq!(machine.state(), State::Home);
    machine.make_break(50);
    assert_eq!(machine.state(), State::Home);
    assert!(machine.answers().is_empty());
}

#[test]
fn a_break_ends_a_jog_and_holds_a_dwell() {
    let mut machine = Machine::doing("$J=G91X100F600\n");
    assert_eq!(machine.state(), State::Jog);
    machine.make_break(50);
    machine.run(1000 * MS);
    assert_eq!(machine.state(), State::Idle);
    assert_eq!(machine.answers(), [MESSAGE]);

    let mut machine = Machine::doing("G4P5\n");
    machine.make_break(50);
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(machine.answers().contains(&MESSAGE.to_owned()));
}

#[test]
fn a_break_while_the_spindle_is_restored_after_the_door_holds_the_motion_that_follows() {
    let mut machine = Machine::doing("M3S1000G1X10F600\n");
    machine.open_and_close_door();
    machine.make_break(300);
    assert_eq!(machine.state(), State::DoorRestoring);
    machine.run(10_000 * MS);
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(machine.answers().contains(&MESSAGE.to_owned()));
    machine.send("~");
    machine.run(5000 * MS);
    assert_eq!((machine.state(), machine.x()), (State::Idle, 2500));
}

#[test]
fn a_break_while_the_door_is_dropped_holds_the_lines_that_wait_behind_a_pause() {
    let mut machine = Machine::doing("M3S1000\nG1X1F6000\nM0\nG1X2\nG1X3\n");
    machine.run(5000 * MS);
    assert_eq!(machine.state(), State::HoldComplete);
    machine.open_and_close_door();
    machine.make_break(300);
    machine.run(60_000 * MS);
    assert_eq!((machine.state(), machine.x()), (State::HoldComplete, 250));
    assert!(machine.answers().contains(&MESSAGE.to_owned()));
    machine.send("~");
    machine.run(5000 * MS);
    assert_eq!((machine.state(), machine.x()), (State::Idle, 750));
}

#[test]
fn a_break_while_homing_holds_the_lines_that_wait_behind_it() {
    for waiting in ["", "G53G1X-5F6000\n"] {
        let mut machine = Machine::doing("");
        machine.home_through_break(&format!("$H\n{waiting}"));
        let is_held = !waiting.is_empty();
        let state = if is_held {
            State::HoldComplete
        } else {
            State::Idle
        };
        let told = machine.answers();
        assert_eq!(machine.state(), state, "{told:?}");
        assert_eq!(told.contains(&MESSAGE.to_owned()), is_held, "{told:?}");
        let homed = machine.x();
        machine.send("~");
        machine.run(10_000 * MS);
        assert_eq!(machine.state(), State::Idle);
        assert_eq!(machine.x() < homed, is_held);
    }
}

#[test]
fn what_waits_behind_a_jog_that_is_being_ended_is_held() {
    let mut machine = Machine::doing("$J=X-20F500\n");
    machine.run(2000 * MS);
    machine.simulator.receive(0x85);
    machine.run(10 * MS);
    assert_eq!(machine.state(), State::Jog);
    machine.send("M3S1000\nG1X0F500\n");
    machine.make_break(300);
    machine.run(60_000 * MS);
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(machine.x() < 0, "{}", machine.x());
    assert_eq!(machine.simulator.outputs().duty, 0);
    machine.send("~");
    machine.run(60_000 * MS);
    assert_eq!((machine.state(), machine.x()), (State::Idle, 0));
}

#[test]
fn jogs_that_wait_are_held() {
    let mut machine = Machine::doing("");
    for _ in 0..10 {
        machine.send(&"$J=G91X0.1F300\n".repeat(20));
        machine.run(50 * MS);
    }
    assert_eq!(machine.state(), State::Jog);
    machine.answers();
    machine.make_break(300);
    machine.run(60_000 * MS);
    assert!(machine.simulator.received_free() < 500);
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(machine.x() < 20 * 250, "{}", machine.x());
    let told = machine.answers();
    let breaks = told.iter().filter(|line| *line == MESSAGE);
    assert_eq!(breaks.count(), 1, "{told:?}");
}

#[test]
fn a_startup_line_behind_homing_is_held() {
    let mut machine = Machine::doing("$N0=G53G1X-20F500\n");
    machine.run(60_000 * MS);
    machine.home_through_break("$H\n");
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(machine.x() > 0, "{}", machine.x());
}

#[test]
fn a_line_that_has_waited_for_the_operator_is_held_behind_the_door() {
    let mut machine = Machine::doing("M3S1000G1X1F500\n");
    machine.run(5000 * MS);
    for line in ["M6T2\n", "~", "M8\n", "G1X20\n"] {
        machine.send(line);
        machine.run(500 * MS);
    }
    // The spindle was on before the change.
    assert!(
        machine
            .answers()
            .contains(&"[MSG:Spindle is off]".to_owned())
    );
    assert_eq!(machine.state(), State::HoldComplete);
    machine.open_and_close_door();
    machine.make_break(300);
    machine.run(60_000 * MS);
    assert_eq!((machine.state(), machine.x()), (State::HoldComplete, 250));
    assert_eq!(machine.simulator.outputs().duty, 0);
}

#[test]
fn a_jog_behind_homing_in_a_change_of_the_tool_is_held() {
    let mut machine = Machine::doing("M6T2\n");
    machine.simulator.receive(0xa3);
    machine.run(100 * MS);
    assert_eq!(machine.state(), State::Tool);
    machine.home_through_break("$H\n$J=G53X-20F500\n");
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(machine.x() > 0, "{}", machine.x());
}

#[test]
fn a_reset_ends_a_break_that_has_held_nothing_yet() {
    let mut machine = Machine::doing("M3S1000\nG1X1F500\nM0\nG1X20\n");
    machine.run(5000 * MS);
    machine.open_and_close_door();
    machine.make_break(300);
    machine.simulator.receive(0x18);
    machine.run(1000 * MS);
    machine.send("G1X2F500\n");
    machine.run(5000 * MS);
    assert_eq!((machine.state(), machine.x()), (State::Idle, 500));
    assert!(!machine.answers().contains(&MESSAGE.to_owned()));
}

#[test]
fn a_break_in_an_alarm_holds_the_move_that_waits_behind_its_unlocking() {
    let mut machine = Machine::doing("G1X100F6000\n");
    machine.run(300 * MS);
    machine.simulator.receive(0x18);
    machine.run(MS);
    machine.send("$X\nG1X0F600\n");
    assert_eq!(machine.state(), State::Alarm);
    // The drivers wait longer after a motion that was cut off than a break lasts.
    machine.make_break(50);
    machine.run(5000 * MS);
    assert_eq!(machine.state(), State::HoldComplete);
    let held = machine.x();
    let told = machine.answers();
    assert!(told.contains(&MESSAGE.to_owned()), "{told:?}");
    machine.send("~");
    machine.run(60_000 * MS);
    assert_eq!(machine.state(), State::Idle);
    assert!(machine.x() < held);
}

#[test]
fn a_break_in_an_alarm_ends_with_the_lines_that_wait_and_holds_none_that_comes_later() {
    let mut machine = Machine::doing("G1X100F6000\n");
    machine.simulator.receive(0x18);
    machine.run(MS);
    machine.send("G1X0F600\n");
    machine.make_break(50);
    machine.run(1000 * MS);
    machine.send("\n$X\nG1X1F600\n");
    machine.run(60_000 * MS);
    assert_eq!(machine.state(), State::Idle);
    assert!(!machine.answers().contains(&MESSAGE.to_owned()));
}
