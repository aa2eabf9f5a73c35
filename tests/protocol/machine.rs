//! The whole machine with an operator, who does what it takes to have each line answered.

use leadscrew::{axis::AXES, model::State, sim::Simulator};

use crate::support::{Machine, assigned, on_every_axis};

const TRAVEL_MM: i32 = 100;
const STEPS_PER_MM: i32 = 5;

/// A machine with 100 mm of travel from the place where it stands, which it takes for home, and soft limits.
pub(crate) fn limited() -> Machine {
    let mut all = on_every_axis(&[
        (100, STEPS_PER_MM),
        (110, 6000),
        (120, 500),
        (130, TRAVEL_MM),
    ]);
    let homed = format!("788={}", (1 << AXES) - 1);
    all.extend(["22=1".to_owned(), "20=1".to_owned(), homed]);
    let mut machine = Machine::with(&assigned(all));
    machine.check = assert_inside;
    assert_eq!(machine.ask("$H").last().map(String::as_str), Some("ok"));
    machine
}

/// No axis is outside the travel.
fn assert_inside(simulator: &Simulator) {
    for (axis, &steps) in simulator.physical_steps().iter().enumerate() {
        assert!(
            (-TRAVEL_MM * STEPS_PER_MM..=0).contains(&steps),
            "axis {axis} is at step {steps}"
        );
    }
}

/// The machine is where the interpreter believes it to be.
pub(crate) fn assert_true(machine: &Machine, what: &str) {
    let session = machine.session();
    let scales = session.settings().steps_per_mm;
    let programmed = scales.zip(session.interpreter().position(), |resolution, nm| {
        resolution.steps_as_grbl(nm, nm.to_mm()).0.0
    });
    let steps = machine.physical_steps();
    assert_eq!(programmed, steps, "{what}");
    assert_eq!(machine.snapshot().steps, steps, "{what}");
    assert_eq!(machine.late(), 0, "{what}");
}

/// Sends a line, and does what an operator would until it is answered. Returns what has been received.
pub(crate) fn execute(machine: &mut Machine, line: &str) -> Vec<String> {
    execute_with(machine, line, None)
}

/// The same with a realtime byte in the middle of the line.
pub(crate) fn execute_with(machine: &mut Machine, line: &str, realtime: Option<u8>) -> Vec<String> {
    let (first, second) = line.split_at(line.len() / 2);
    machine.send(first);
    machine.send(realtime.as_slice());
    machine.send(format!("{second}\n"));
    let mut lines = Vec::new();
    for turn in 0.. {
        assert!(turn < 300_000, "{line}: {:?} {lines:?}", machine.state());
        lines.extend(machine.lines());
        if lines.iter().any(|line| is_answer(line)) {
            return lines;
        }
        if !machine.advance() && machine.received.is_empty() {
            match machine.state() {
                // A pause, a hold, a door that is closed again, a tool change.
                State::HoldComplete | State::DoorClosed => machine.send("~"),
                // A line that leaves the travel. One that has come to a machine asleep is dropped.
                State::Alarm | State::Sleep => {
                    lines.extend(machine.answers_to("\x18"));
                    return lines;
                }
                state => panic!("{line}: no answer in {state:?}: {lines:?}"),
            }
        }
    }
    unreachable!()
}

pub(crate) fn is_answer(line: &str) -> bool {
    line == "ok" || line.starts_with("error:")
}
