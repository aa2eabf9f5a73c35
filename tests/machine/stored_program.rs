//! The program that the firmware brings along: `$794`.

use leadscrew::{
    axis::Axes,
    model::{Levels, State},
};

use crate::support::{Machine, add_steps, assigned};

/// One step is 1 mm, 250 steps a second, no ramp.
const MACHINE: &str = include_str!("../../examples/pico.settings");
/// How long the four arcs take, ms.
const ROUND_MS: u64 = 30_200;

fn with_program(assignments: &[&str]) -> Machine {
    let settings = MACHINE.lines().filter_map(|line| line.strip_prefix('$'));
    let without_stream = settings.filter(|line| !line.starts_with("792"));
    Machine::with(&assigned(without_stream.chain(assignments.iter().copied())))
}

/// Steps of X and Y, in both directions.
fn made(machine: &Machine) -> u32 {
    let edges = machine.edges.iter();
    edges.map(|edge| edge.raise.count_ones()).sum()
}

/// Positions of X and Y at which the arcs end that have been visited.
fn ends(machine: &Machine) -> Vec<[i32; 2]> {
    let mut steps = Axes::all(0);
    let mut ends = Vec::new();
    for edge in machine.edges.iter().filter(|edge| edge.raise != 0) {
        add_steps(&mut steps, edge);
        let position = [steps[0], steps[1]];
        let is_end = [[-400, 400], [0, 0], [400, -400]].contains(&position);
        if is_end && ends.last() != Some(&position) {
            ends.push(position);
        }
    }
    ends
}

const ONE_ROUND: [[i32; 2]; 4] = [[-400, 400], [0, 0], [400, -400], [0, 0]];

#[test]
fn the_button_runs_the_program_again_and_again() {
    let mut machine = with_program(&["794=1"]);
    machine.set_pin(Levels::START, true);
    machine.run(20);
    machine.set_pin(Levels::START, false);
    machine.run(3 * ROUND_MS);
    let ends = ends(&machine);
    assert!(ends.starts_with(&[ONE_ROUND, ONE_ROUND].concat()));
    assert!(ends.len() <= 12, "{ends:?}");
    assert_eq!(machine.state(), State::Run);
    let received = machine.take_received();
    assert!(
        !received.contains("ok") && !received.contains("error"),
        "{received}"
    );
}

#[test]
fn a_line_of_the_sender_ends_the_program_at_its_end_and_is_answered() {
    let mut machine = with_program(&["794=1"]);
    machine.send_for(b"~", 5000);
    machine.send_for(b"G1X10F15000\n", ROUND_MS - 10_000);
    assert_eq!(machine.take_received(), "", "the line waits");
    machine.run(ROUND_MS);
    assert_eq!(machine.take_received(), "[MSG:Pgm End]\r\nok\r\n");
    assert_eq!(ends(&machine), ONE_ROUND);
    assert_eq!(machine.state(), State::Idle);
    assert_eq!(machine.physical_steps()[0], 10);
}

#[test]
fn a_reset_ends_the_program_and_nothing_is_answered() {
    let mut machine = with_program(&["794=1"]);
    machine.send_for(b"~", 5000);
    machine.send_for(b"!", 100);
    assert_eq!(machine.state(), State::HoldComplete);
    machine.send_for([0x18], 500);
    let received = machine.take_received();
    assert!(
        received.contains("Grbl 1.1h") && !received.contains("ok"),
        "{received}"
    );
    let before = made(&machine);
    assert!(before > 1000, "{before}");
    machine.run(ROUND_MS);
    assert_eq!(made(&machine), before);
    machine.send_for(b"G91\n", 100);
    assert_eq!(machine.take_received(), "ok\r\n");
}

#[test]
fn a_hold_interrupts_the_program() {
    let mut machine = with_program(&["794=1"]);
    machine.send_for(b"~", 5000);
    machine.send_for(b"!", 100);
    let before = made(&machine);
    machine.run(1000);
    assert_eq!(machine.state(), State::HoldComplete);
    assert_eq!(made(&machine), before);
    machine.send_for(b"~", ROUND_MS);
    let ends = ends(&machine);
    assert!(ends.starts_with(&ONE_ROUND), "{ends:?}");
}

#[test]
fn cycle_start_does_nothing_without_the_setting_or_during_other_work() {
    let mut machine = with_program(&[]);
    machine.send_for(b"~", 1000);
    assert_eq!(
        (made(&machine), machine.take_received()),
        (0, String::new())
    );
    let mut machine = with_program(&["794=1"]);
    machine.send_for(b"G1X100F15000\n", 100);
    machine.send_for(b"~", ROUND_MS);
    assert_eq!((made(&machine), machine.state()), (100, State::Idle));
    // In check mode nothing moves, so that the program would never end.
    machine.send_for(b"$C\n", 100);
    machine.send_for(b"~", 1000);
    assert_eq!(machine.state(), State::Check);
    machine.send_for(b"$C\n", 1000);
    assert!(machine.take_received().contains("[MSG:Disabled]"));
}

#[test]
fn a_program_that_cannot_begin_here_ends_with_a_message() {
    // The first arc leaves from X0 Y0.
    let mut machine = with_program(&["794=1"]);
    machine.send_for(b"G1X3F15000\n", 1000);
    machine.take_received();
    machine.send_for(b"~", 1000);
    assert_eq!(
        machine.take_received(),
        "[MSG:The stored program cannot run here]\r\n"
    );
    assert_eq!((made(&machine), machine.state()), (3, State::Idle));
    machine.send_for(b"G1X0\n", 1000);
    machine.send_for(b"~", ROUND_MS);
    assert_eq!(ends(&machine)[1..5], ONE_ROUND);
}
