//! Contacts of the probe in moves that are no probing moves, `$798`.

use leadscrew::{
    axis::Z,
    model::{Levels, Spindle, State},
    sim::Closes,
};

use crate::support::Machine;

/// Steps of a millimetre.
const STEPS: i32 = 250;
/// Where the contact closes.
const CONTACT: i32 = -5 * STEPS;
const STOPPED: [&str; 3] = [
    "ALARM:13",
    "[MSG:Probe contact outside of a probing move]",
    "[MSG:Reset to continue]",
];

/// A machine at Z 0 above a plate at Z-5, whose probe has worked.
fn machine(assignments: &[&str]) -> Machine {
    let mut machine = unproven(assignments);
    assert_eq!(machine.ask("G38.2 Z-9 F600").last().unwrap(), "ok");
    assert_eq!(machine.ask("G0 Z0"), ["ok"]);
    machine
}

/// The same, whose probe has made no contact yet.
fn unproven(assignments: &[&str]) -> Machine {
    let usual = ["110=6000", "112=3000", "120=500", "122=500"];
    let mut machine = Machine::new(&[&usual, assignments].concat());
    machine.mount(Z, Closes::DownFrom(CONTACT), Levels::PROBE);
    machine
}

/// Closes the contact by hand, for a while.
fn touch(machine: &mut Machine) {
    machine.set_pin(Levels::PROBE, true);
    machine.run(50);
    machine.set_pin(Levels::PROBE, false);
    machine.run(50);
}

/// Steps behind the contact.
fn overrun(machine: &Machine) -> i32 {
    CONTACT - machine.xyz()[2]
}

#[test]
fn a_contact_in_another_move_slows_the_machine_down_and_keeps_its_position() {
    for (line, max_overrun) in [
        ("G0 Z-20", 700),
        ("G1 Z-20 F600", 40),
        ("G1 Z-4 F600\nG1 Z-20", 40),
        ("G1 X5 Z-20 F600", 40),
        ("$J=G90 Z-20 F1000", 90),
        ("G18 G3 X0 Z-20 R10 F600", 40),
        ("G81 X0 Z-20 R-1 F600", 40),
    ] {
        let mut machine = machine(&[]);
        machine.ask("M3 S500 M8");
        // Another line waits behind it.
        let next = if line.starts_with('$') {
            "$J=X50 F1000"
        } else {
            "G0 X50"
        };
        machine.send(format!("{line}\n{next}\n"));
        let answers = machine.answers();
        let answers: Vec<_> = answers.iter().filter(|line| *line != "ok").collect();
        assert_eq!(answers, STOPPED, "{line}");
        assert_eq!(machine.state(), State::Alarm, "{line}");
        assert!(
            (1..=max_overrun).contains(&overrun(&machine)),
            "{line}: {}",
            overrun(&machine)
        );
        let outputs = machine.outputs();
        assert_eq!(
            (outputs.spindle, outputs.coolant.flood),
            (Spindle::Off, false)
        );
        let place = machine.xyz();
        machine.exchange("\x18");
        assert_eq!(machine.state(), State::Alarm, "{line}");
        machine.ask("$X");
        // On the contact it may go where it will.
        assert_eq!(machine.ask("G91 G0 Z-0.1"), ["ok"]);
        assert_eq!(machine.ask("G90 G0 X0 Z0"), ["ok"]);
        assert_eq!(machine.xyz(), [0, 0, 0], "{line} {place:?}");
    }
}

#[test]
fn homing_is_not_lost_and_the_drivers_stay_on() {
    let mut machine = unproven(&["1=255", "22=1", "24=300", "25=1500"]);
    machine.mount_limits([STEPS; 3]);
    assert_eq!(machine.ask("$H"), ["ok"]);
    let home = machine.xyz();
    assert_eq!(machine.ask("G38.2 Z-9 F600").last().unwrap(), "ok");
    assert_eq!(machine.ask("G0 Z-2"), ["ok"]);
    assert_eq!(machine.ask("G0 Z-20")[1..], STOPPED);
    machine.run(1000);
    assert!(machine.outputs().drivers);
    // A second reset, and one while the machine slows down, lose nothing either.
    machine.exchange("\x18");
    machine.ask("$X");
    assert_eq!(machine.ask("G0 Z-2"), ["ok"]);
    machine.send("G0 Z-20\n");
    machine.run_until(|machine| machine.state() == State::Alarm);
    assert!(!machine.is_at_rest());
    machine.exchange("\x18");
    machine.ask("$X");
    // G30 of a homed machine whose point was never stored.
    assert_eq!(machine.ask("G30"), ["ok"]);
    assert_eq!(machine.xyz(), home);
}

#[test]
fn a_contact_at_the_end_of_a_move_ends_nothing() {
    for acceleration in ["122=10", "122=500", "122=3000"] {
        let mut machine = machine(&[acceleration]);
        // To the contact, to the step, and from it.
        for line in [
            "G1 Z-5 F600",
            "G0 Z0",
            "G0 Z-5",
            "G0 Z-4",
            "$J=G90 Z-5 F2000",
        ] {
            assert_eq!(machine.ask(line), ["ok"], "{line}");
            assert_eq!(machine.state(), State::Idle, "{line}");
        }
        assert_eq!(machine.xyz(), [0, 0, CONTACT]);
    }
}

#[test]
fn a_contact_at_rest_or_while_dwelling_ends_nothing() {
    let mut machine = machine(&[]);
    touch(&mut machine);
    assert_eq!(machine.state(), State::Idle);
    machine.send("G4 P0.5\nG0 X1\n");
    machine.run(100);
    touch(&mut machine);
    machine.run_to_standstill();
    assert_eq!(machine.answers(), ["ok", "ok"]);
    assert_eq!(machine.xyz(), [STEPS, 0, 0]);
    // A move that waits for the spindle.
    machine.ask("$394=1");
    machine.send("M3 S500\nG0 X2\n");
    machine.run(100);
    touch(&mut machine);
    machine.run_to_standstill();
    assert_eq!(machine.xyz(), [2 * STEPS, 0, 0]);
    assert_eq!(machine.state(), State::Idle);
}

#[test]
fn a_machine_without_the_setting_or_a_probe_that_has_worked_goes_on() {
    let mut machine = machine(&["798=0"]);
    assert_eq!(machine.ask("G0 Z-20"), ["ok"]);
    assert_eq!(machine.xyz(), [0, 0, -20 * STEPS]);
    let mut machine = unproven(&[]);
    assert_eq!(machine.ask("G0 Z-20"), ["ok"]);
    // A probing move that missed proves nothing.
    machine.ask("G0 Z0");
    assert_eq!(machine.ask("G38.3 Z-1 F600").last().unwrap(), "ok");
    assert_eq!(machine.ask("G0 Z-20"), ["ok"]);
    assert_eq!(machine.state(), State::Idle);
}

#[test]
fn a_contact_that_chatters_when_it_is_left_ends_nothing_and_the_next_move_counts() {
    let mut machine = Machine::new(&["110=6000", "112=300", "120=500", "122=50"]);
    machine.send("G38.2 Z-9 F100\n");
    machine.run(500);
    machine.set_pin(Levels::PROBE, true);
    assert_eq!(machine.answers().last().unwrap(), "ok");
    machine.send("G0 Z0\nG0 X50\n");
    for closed in [false, true, false, true, false] {
        machine.run(5);
        machine.set_pin(Levels::PROBE, closed);
    }
    machine.run_until(|machine| machine.xyz()[0] > STEPS);
    assert_eq!(machine.state(), State::Run);
    machine.set_pin(Levels::PROBE, true);
    assert_eq!(machine.answers()[2..], STOPPED);
    assert_eq!(machine.xyz()[2], 0);
}

#[test]
fn a_contact_while_backlash_is_taken_up_stops_and_one_that_is_left_so_does_not() {
    for is_left in [false, true] {
        let mut machine = Machine::new(&["112=300", "122=500", "162=1"]);
        machine.send("G38.2 Z-9 F100\n");
        machine.run(500);
        machine.set_pin(Levels::PROBE, true);
        assert_eq!(machine.answers().last().unwrap(), "ok");
        if !is_left {
            machine.set_pin(Levels::PROBE, false);
            machine.run(100);
        }
        machine.send("G0 Z5\n");
        // It takes 0.2 s.
        machine.run(if is_left { 300 } else { 100 });
        for closed in [false, true] {
            machine.set_pin(Levels::PROBE, closed);
            machine.run(5);
        }
        let answers = machine.answers();
        if is_left {
            assert_eq!(answers, ["ok"]);
        } else {
            assert_eq!(answers[1..], STOPPED);
        }
    }
}
