//! A terminal at the virtual machine: lets time pass, and takes what the machine says.

use std::mem::take;

use leadscrew::sim::Simulator;

/// Lets time pass, ticks, and takes what is said meanwhile.
pub(crate) fn run(simulator: &mut Simulator, said: &mut Vec<u8>, ticks: u64) {
    let end = simulator.now() + ticks;
    simulator.settle();
    loop {
        while let Some(byte) = simulator.send() {
            said.push(byte);
            simulator.settle();
        }
        match simulator.due() {
            Some(due) if due <= end => drop(simulator.advance(due)),
            _ => break,
        }
    }
}

/// Returns the lines that have been said since the last call.
pub(crate) fn lines(said: &mut Vec<u8>) -> Vec<String> {
    let text = String::from_utf8(take(said)).unwrap();
    text.lines().map(str::to_owned).collect()
}
