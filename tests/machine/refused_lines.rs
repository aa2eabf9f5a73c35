//! Lines behind a refused one, `$796`.

use leadscrew::model::State;

use crate::support::Machine;

/// Steps of a millimetre.
const STEPS: i32 = 250;
const MESSAGE: &str = "[MSG:A line was refused: '~' goes on without it]";

fn machine_with(assignments: &[&str]) -> Machine {
    Machine::new(&[&["796=1", "110=6000", "120=500"], assignments].concat())
}

#[test]
fn lines_behind_a_refused_one_wait_for_cycle_start() {
    let program = "G21 G90 F600\nG1 Z-1\nG1 X5\nG0 Z#5\nG0 X50\nM2\n";
    let mut machine = machine_with(&[]);
    let answers = machine.answers_to(program);
    assert_eq!(answers, ["ok", "ok", "ok", "error:2", MESSAGE]);
    assert_eq!(machine.state(), State::HoldComplete);
    // What had been accepted is done.
    assert_eq!(machine.xyz(), [5 * STEPS, 0, -STEPS]);
    assert_eq!(machine.answers_to("~"), ["ok", "[MSG:Pgm End]", "ok"]);
    assert_eq!(machine.xyz(), [50 * STEPS, 0, -STEPS]);
    assert_eq!(machine.state(), State::Idle);
    // As in Grbl without the setting.
    let mut machine = Machine::new(&["110=6000", "120=500"]);
    let answers = machine.answers_to(program);
    assert_eq!(
        answers,
        ["ok", "ok", "ok", "error:2", "ok", "[MSG:Pgm End]", "ok"]
    );
    assert_eq!(machine.xyz(), [50 * STEPS, 0, -STEPS]);
}

#[test]
fn a_sender_that_stops_at_the_first_error_finds_the_machine_idle() {
    let mut machine = machine_with(&[]);
    machine.send("G1 X5 F600\n");
    machine.run(50);
    machine.send("G0 Z#5\n");
    assert_eq!(machine.answers(), ["ok", "error:2"]);
    assert_eq!(machine.state(), State::Idle);
    assert_eq!(machine.xyz(), [5 * STEPS, 0, 0]);
    // Neither questions nor lines without words are of a program.
    for line in ["$G", "$$", "$I", "", "(comment)", "$110=5000", "$110=abc"] {
        machine.ask(line);
        assert_eq!(machine.state(), State::Idle, "{line}");
    }
    // A sender that goes on line by line is held, at rest too.
    assert_eq!(machine.ask("G0 X9"), [MESSAGE]);
    assert_eq!(machine.state(), State::HoldComplete);
    assert_eq!(machine.xyz(), [5 * STEPS, 0, 0]);
    assert_eq!(machine.answers_to("~"), ["ok"]);
    assert_eq!(machine.xyz(), [9 * STEPS, 0, 0]);
    // Once.
    assert_eq!(machine.ask("G0 X10"), ["ok"]);
    assert_eq!(machine.xyz(), [10 * STEPS, 0, 0]);
}

#[test]
fn a_reset_a_jog_homing_and_unlocking_end_the_program_that_would_be_held() {
    for line in ["\x18", "$J=G91 X1 F600\n", "$H\n", "$X\n"] {
        let mut machine = machine_with(&["22=1", "788=7"]);
        machine.ask("$H");
        assert_eq!(machine.ask("G0 Z#5"), ["error:2"]);
        machine.answers_to(line);
        assert_eq!(machine.ask("G91 G0 X-1"), ["ok"], "{line:?}");
        assert_eq!(machine.state(), State::Idle, "{line:?}");
    }
    // In the hold, too.
    let mut machine = machine_with(&[]);
    assert_eq!(machine.answers_to("G0 Z#5\nG0 X1\n"), ["error:2", MESSAGE]);
    machine.answers_to("\x18");
    assert_eq!(machine.state(), State::Idle);
    assert_eq!(machine.ask("G0 Y1"), ["ok"]);
    assert_eq!(machine.xyz(), [0, STEPS, 0]);
}

#[test]
fn statements_jogs_and_lines_that_are_only_checked_hold_nothing() {
    let mut machine = machine_with(&[]);
    for line in ["$110=abc", "$J=G91 X1", "$J=G91 X#5 F100", "$nonsense"] {
        let answers = machine.ask(line);
        assert!(answers[0].starts_with("error:"), "{line} {answers:?}");
        assert_eq!(machine.ask("G91 G0 X1"), ["ok"], "{line}");
    }
    assert_eq!(machine.ask("$C"), ["[MSG:Enabled]", "ok"]);
    assert_eq!(machine.answers_to("G0 Z#5\nG0 X1\n"), ["error:2", "ok"]);
    assert_eq!(machine.state(), State::Check);
    machine.ask("$C");
    assert_eq!(machine.ask("G91 G0 X1"), ["ok"]);
}

#[test]
fn a_line_that_is_asked_for_again_holds_nothing() {
    let mut machine = machine_with(&["780=2"]);
    let answers = machine.ask("N1 G1X12*1");
    assert_eq!(answers.last().unwrap(), "error:200");
    assert_eq!(machine.ask("G91 G0 X1"), ["ok"]);
    // A refused one does in this dialect, too.
    assert_eq!(machine.answers_to("G0 Z#5\nG0 X1\n"), ["error:2", MESSAGE]);
    assert_eq!(machine.state(), State::HoldComplete);
}

#[test]
fn a_line_that_has_lost_bytes_is_held_for_once_in_motion_and_at_rest() {
    for is_moving in [true, false] {
        let mut machine = machine_with(&[]);
        if is_moving {
            machine.send("G1 X5 F600\n");
            machine.run(100);
        }
        machine.send("G0 Z");
        machine.receive_damaged();
        machine.send("\nG0 X9\n");
        let answers = machine.answers();
        assert!(answers.contains(&"error:210".to_owned()), "{answers:?}");
        assert_eq!(answers.contains(&MESSAGE.to_owned()), !is_moving);
        assert_eq!(machine.state(), State::HoldComplete);
        machine.answers_to("~");
        assert_eq!(machine.state(), State::Idle);
        assert_eq!(machine.xyz(), [9 * STEPS, 0, 0]);
    }
}
