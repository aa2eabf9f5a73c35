//! Machines that speak RepRap, and what a host sends to them.

use leadscrew::sim::Simulator;

use crate::support::{Machine, assigned, on_every_axis};

pub(crate) const STEPS_PER_MM: i32 = 80;

/// A small machine with these settings besides, which has greeted.
pub(crate) fn machine_with(more: &[&str]) -> Machine {
    let mut all = on_every_axis(&[(100, STEPS_PER_MM), (110, 6000), (120, 500)]);
    all.extend(more.iter().map(|&assignment| assignment.to_owned()));
    let mut machine = Machine::of(Simulator::new(&assigned(all)));
    let greeting = machine.answers();
    let mut lines = greeting.iter();
    assert!(lines.any(|line| line == "start" || line.starts_with("Grbl")));
    machine
}

/// The same with the RepRap dialect.
pub(crate) fn reprap_with(more: &[&str]) -> Machine {
    machine_with(&[&["780=1"], more].concat())
}

pub(crate) fn reprap() -> Machine {
    reprap_with(&[])
}

/// A line with its number and its checksum.
pub(crate) fn numbered(number: i32, words: &str) -> String {
    let line = format!("N{number} {words}");
    let sum = line.bytes().fold(0, |sum, byte| sum ^ byte);
    format!("{line}*{sum}")
}

/// Sends numbered lines, each of which must be accepted.
pub(crate) fn send_numbered(machine: &mut Machine, first: i32, lines: &[&str]) {
    for (number, words) in (first..).zip(lines) {
        assert_eq!(machine.ask(&numbered(number, words)), ["ok"], "{words}");
    }
}

/// Sends a line that is accepted, and returns the first line of its answer.
pub(crate) fn first(machine: &mut Machine, line: &str) -> String {
    let mut answer = machine.ask(line);
    assert_eq!(answer.pop().as_deref(), Some("ok"), "{line}: {answer:?}");
    answer.into_iter().next().unwrap_or_default()
}

/// Position of X and Y, steps.
pub(crate) fn xy(machine: &Machine) -> [i32; 2] {
    let [x, y, _] = machine.xyz();
    [x, y]
}

/// Position of X and Y, mm.
pub(crate) fn xy_mm(machine: &Machine) -> [i32; 2] {
    xy(machine).map(|steps| steps / STEPS_PER_MM)
}

/// Time of a line from its receipt to standstill, s.
pub(crate) fn seconds(machine: &mut Machine, line: &str) -> f64 {
    let start = machine.seconds();
    machine.ask(line);
    machine.seconds() - start
}
