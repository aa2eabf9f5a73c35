//! A break on the serial line: it holds a motion, once, and nothing else.

use leadscrew::{
    model::{Levels, Spindle, State},
    units::TICKS_PER_SECOND,
};

use crate::support::Machine;

const MESSAGE: &str = "[MSG:Break on the line]";

/// A machine that has received a line, 100 ms ago.
fn machine_at(line: &str) -> Machine {
    let mut machine = Machine::new(&["22=1"]);
    machine.send("$X\n");
    machine.send_for(line, 100);
    machine.lines();
    machine
}

/// Sends lines of which the first homes, with a break meanwhile, and waits for the end.
fn home_through_break(machine: &mut Machine, lines: &str) {
    machine.mount_limits([500; 3]);
    machine.send_for(lines, 100);
    make_break(machine, 300);
    assert_eq!(machine.state(), State::Home);
    machine.run(120_000);
}

/// Opens the door, closes it, and presses cycle start: the spindle starts again.
fn open_and_close_door(machine: &mut Machine) {
    machine.set_pin(Levels::DOOR, true);
    machine.run(5000);
    machine.set_pin(Levels::DOOR, false);
    machine.run(100);
    machine.send_for("~", 50);
    assert_eq!(machine.state(), State::DoorRestoring);
    machine.lines();
}

/// Makes a break: the receiver sees a byte without a stop bit, and then nothing.
fn make_break(machine: &mut Machine, ms: u64) {
    machine.pull_line(true);
    machine.run(1);
    machine.receive_damaged();
    machine.run(ms - 1);
    machine.pull_line(false);
    machine.run(100);
}

fn x(machine: &Machine) -> i32 {
    machine.xyz()[0]
}

#[test]
fn a_break_of_50_ms_holds_a_move_that_ends_exactly_after_cycle_start() {
    let mut machine = machine_at("G1X10F600\n");
    assert_eq!(machine.state(), State::Run);
    make_break(&mut machine, 50);
    machine.run(60_000);
    assert_eq!(machine.state(), State::HoldComplete);
    assert_eq!(machine.lines(), [MESSAGE]);
    let held = x(&machine);
    assert!((1..2400).contains(&held), "{held}");
    machine.send_for("~", 5000);
    assert_eq!((machine.state(), x(&machine)), (State::Idle, 2500));
    assert!(machine.lines().is_empty());
}

#[test]
fn a_break_that_lasts_holds_once_and_each_break_anew() {
    let mut machine = machine_at("G1X100F600\n");
    make_break(&mut machine, 1000);
    assert_eq!(machine.state(), State::HoldComplete);
    assert_eq!(machine.lines(), [MESSAGE]);
    machine.send_for("~", 500);
    assert_eq!(machine.state(), State::Run);
    make_break(&mut machine, 50);
    assert_eq!(machine.lines(), [MESSAGE]);
    // A break that lasts does not hold again after `~`.
    machine.pull_line(true);
    machine.run(500);
    machine.send_for("~", 500);
    assert_eq!(machine.state(), State::Run);
    assert!(machine.lines().is_empty());
}

#[test]
fn a_line_that_is_low_for_less_than_a_break_holds_nothing() {
    let mut machine = machine_at("G1X10F600\n");
    for _ in 0..20 {
        make_break(&mut machine, 39);
    }
    machine.run(2000);
    assert_eq!((machine.state(), x(&machine)), (State::Idle, 2500));
    assert!(machine.lines().is_empty());
}

#[test]
fn samples_that_always_find_a_low_bit_of_a_byte_hold_nothing() {
    // At these rates a byte of ten bits comes at least once in a period or two.
    for baud in [9600_u64, 115_200, 1_000_000] {
        let mut machine = machine_at("G1X10F600\n");
        machine.pull_line(true);
        let byte_ticks = u64::from(TICKS_PER_SECOND) * 10 / baud;
        let end = machine.seconds() + 0.3;
        // Spaces, which are left out of a line, are low for 8 of 10 bits.
        while machine.seconds() < end {
            machine.receive(b' ');
            machine.run_ticks(byte_ticks);
        }
        machine.pull_line(false);
        machine.run(2000);
        assert_eq!((machine.state(), x(&machine)), (State::Idle, 2500));
        assert!(machine.lines().is_empty());
    }
}

#[test]
fn a_break_at_idle_and_while_homing_does_nothing_as_nothing_else_does() {
    let mut machine = machine_at("G0X1\n");
    machine.run(2000);
    assert_eq!(machine.state(), State::Idle);
    machine.lines();
    make_break(&mut machine, 300);
    assert_eq!(machine.state(), State::Idle);
    assert!(machine.lines().is_empty());
    // Nor later, when something moves.
    machine.send_for("\nG1X2F100\n", 200);
    assert_eq!(machine.state(), State::Run);
    assert_eq!(machine.lines(), ["error:210", "ok"]);

    let mut machine = machine_at("$H\n");
    assert_eq!(machine.state(), State::Home);
    make_break(&mut machine, 50);
    assert_eq!(machine.state(), State::Home);
    assert!(machine.lines().is_empty());
}

#[test]
fn what_was_begun_before_a_break_is_not_the_beginning_of_the_line_after_it() {
    let mut machine = machine_at("G1X1F6000\n");
    machine.run(5000);
    for begun in ["G1X5", "$J=G91F6000X5", "$100=8"] {
        machine.send(begun);
        make_break(&mut machine, 50);
        assert_eq!(machine.ask("0F3000"), ["error:210"], "{begun}");
        assert_eq!(machine.ask("G4P0.01"), ["ok"], "{begun}");
        assert_eq!(
            (machine.state(), x(&machine)),
            (State::Idle, 250),
            "{begun}"
        );
    }
}

#[test]
fn a_break_ends_a_jog_and_holds_a_dwell() {
    let mut machine = machine_at("$J=G91X100F600\n");
    assert_eq!(machine.state(), State::Jog);
    make_break(&mut machine, 50);
    machine.run(1000);
    assert_eq!(machine.state(), State::Idle);
    assert_eq!(machine.lines(), [MESSAGE]);

    let mut machine = machine_at("G4P5\n");
    make_break(&mut machine, 50);
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(machine.lines().contains(&MESSAGE.to_owned()));
}

#[test]
fn a_break_while_the_spindle_is_restored_after_the_door_stops_it_again() {
    let mut machine = machine_at("M3S1000G1X10F600\n");
    open_and_close_door(&mut machine);
    assert_eq!(machine.outputs().spindle, Spindle::Clockwise);
    make_break(&mut machine, 300);
    machine.run(10_000);
    assert_eq!(machine.state(), State::DoorClosed);
    assert_eq!(machine.outputs().spindle, Spindle::Off);
    assert!(machine.lines().contains(&MESSAGE.to_owned()));
    machine.send_for("~", 9000);
    assert_eq!((machine.state(), x(&machine)), (State::Idle, 2500));
}

#[test]
fn a_break_after_the_door_in_a_pause_holds_the_lines_that_wait_after_it() {
    let mut machine = machine_at("M3S1000\nG1X1F6000\nM0\nG1X2\nG1X3\n");
    machine.run(5000);
    assert_eq!(machine.state(), State::HoldComplete);
    open_and_close_door(&mut machine);
    make_break(&mut machine, 300);
    machine.run(60_000);
    assert_eq!((machine.state(), x(&machine)), (State::DoorClosed, 250));
    assert!(machine.lines().contains(&MESSAGE.to_owned()));
    machine.send_for("~", 9000);
    assert_eq!((machine.state(), x(&machine)), (State::Idle, 750));
}

#[test]
fn a_break_while_homing_holds_the_lines_that_wait_after_it() {
    for waiting in ["", "G53G1X-5F6000\n"] {
        let mut machine = machine_at("");
        home_through_break(&mut machine, &format!("$H\n{waiting}"));
        let is_held = !waiting.is_empty();
        let state = if is_held {
            State::HoldComplete
        } else {
            State::Idle
        };
        let lines = machine.lines();
        assert_eq!(machine.state(), state, "{lines:?}");
        assert_eq!(lines.contains(&MESSAGE.to_owned()), is_held, "{lines:?}");
        let homed = x(&machine);
        machine.send_for("~", 10_000);
        assert_eq!(machine.state(), State::Idle);
        assert_eq!(x(&machine) < homed, is_held);
    }
}

#[test]
fn what_waits_after_a_jog_that_is_being_ended_is_held() {
    let mut machine = machine_at("$J=X-20F500\n");
    machine.run(2000);
    machine.send_for([0x85], 10);
    assert_eq!(machine.state(), State::Jog);
    machine.send("M3S1000\nG1X0F500\n");
    make_break(&mut machine, 300);
    machine.run(60_000);
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(x(&machine) < 0, "{}", x(&machine));
    assert_eq!(machine.outputs().duty, 0);
    machine.send_for("~", 60_000);
    assert_eq!((machine.state(), x(&machine)), (State::Idle, 0));
}

#[test]
fn jogs_that_wait_are_held() {
    let mut machine = machine_at("");
    for _ in 0..10 {
        machine.send("$J=G91X0.1F300\n".repeat(20));
        machine.run(50);
    }
    assert_eq!(machine.state(), State::Jog);
    machine.lines();
    make_break(&mut machine, 300);
    machine.run(60_000);
    assert!(machine.received_free() < 500);
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(x(&machine) < 20 * 250, "{}", x(&machine));
    let lines = machine.lines();
    let breaks = lines.iter().filter(|line| *line == MESSAGE);
    assert_eq!(breaks.count(), 1, "{lines:?}");
}

#[test]
fn a_startup_line_after_homing_is_held() {
    let mut machine = machine_at("$N0=G53G1X-20F500\n");
    machine.run(60_000);
    home_through_break(&mut machine, "$H\n");
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(x(&machine) > 0, "{}", x(&machine));
}

#[test]
fn a_line_that_has_waited_for_the_operator_is_held_after_the_door() {
    let mut machine = machine_at("M3S1000G1X1F500\n");
    machine.run(5000);
    for line in ["M6T2\n", "~", "M8\n", "G1X20\n"] {
        machine.send(line);
        machine.run(500);
    }
    // The spindle was on before the change.
    assert!(
        machine
            .answers()
            .contains(&"[MSG:Spindle is off]".to_owned())
    );
    assert_eq!(machine.state(), State::HoldComplete);
    open_and_close_door(&mut machine);
    make_break(&mut machine, 300);
    machine.run(60_000);
    assert_eq!((machine.state(), x(&machine)), (State::DoorClosed, 250));
    assert_eq!(machine.outputs().duty, 0);
}

#[test]
fn a_jog_after_homing_in_a_change_of_the_tool_is_held() {
    let mut machine = machine_at("M6T2\n");
    machine.send_for([0xa3], 100);
    assert_eq!(machine.state(), State::Tool);
    home_through_break(&mut machine, "$H\n$J=G53X-20F500\n");
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(x(&machine) > 0, "{}", x(&machine));
}

#[test]
fn a_reset_ends_a_break_that_has_held_nothing_yet() {
    let mut machine = machine_at("");
    machine.mount_limits([500; 3]);
    machine.send_for("$H\n", 100);
    make_break(&mut machine, 300);
    assert_eq!(machine.state(), State::Home);
    machine.send_for([0x18], 1000);
    machine.send_for("$X\n", 100);
    machine.send_for("G53G1X2F500\n", 5000);
    assert_eq!((machine.state(), x(&machine)), (State::Idle, 500));
    assert!(!machine.lines().contains(&MESSAGE.to_owned()));
}

#[test]
fn a_break_in_an_alarm_holds_the_move_that_waits_after_its_unlocking() {
    let mut machine = machine_at("G1X100F6000\n");
    machine.run(200);
    machine.send_for([0x18], 1);
    machine.send("$X\nG1X0F600\n");
    assert_eq!(machine.state(), State::Alarm);
    // The drivers wait longer after a motion that was cut off than a break lasts.
    make_break(&mut machine, 50);
    machine.run(5000);
    assert_eq!(machine.state(), State::HoldComplete);
    let held = x(&machine);
    let received = machine.lines();
    assert!(received.contains(&MESSAGE.to_owned()), "{received:?}");
    machine.send_for("~", 60_000);
    assert_eq!(machine.state(), State::Idle);
    assert!(x(&machine) < held);
}

#[test]
fn a_break_in_an_alarm_ends_with_the_lines_that_wait_and_holds_none_that_comes_later() {
    let mut machine = machine_at("G1X100F6000\n");
    machine.send_for([0x18], 1);
    machine.send("G1X0F600\n");
    make_break(&mut machine, 50);
    machine.run(1000);
    machine.send_for("\n$X\nG1X1F600\n", 60_000);
    assert_eq!(machine.state(), State::Idle);
    assert!(!machine.lines().contains(&MESSAGE.to_owned()));
}
