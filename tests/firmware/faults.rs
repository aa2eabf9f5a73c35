//! Faults: a task that hangs, a fault of the processor, a stack that is too deep.
//!
//! The instructions at the beginning of a task are replaced. The emulator has no watchdog: a count of its timer
//! stands in for it, which cannot interrupt `step`.

use std::{thread, time::Duration};

use crate::machine::Machine;

/// A branch to itself.
const HANG: [u16; 2] = [0xe7fe, 0xe7fe];
/// An instruction that is none.
const UNDEFINED: [u16; 2] = [0xde00, 0xde00];
/// Pushes eight registers, again and again.
const PUSH: [u16; 2] = [0xb4ff, 0xe7fd];

/// Vectors of tasks that run while a line is executed: `serial_rx`, `wake`, `interpret`, `prepare`,
/// `segment_start`.
const TASKS: [&str; 5] = ["USART1", "TIM4", "I2C2_EV", "TIM1_BRK_TIM9", "I2C3_EV"];

/// Puts instructions into a task of a machine that moves with its spindle on, until the machine has been reset.
/// Returns what it has told since.
fn restart(task: &str, instructions: [u16; 2]) -> Option<(Machine, Vec<String>)> {
    let mut machine = Machine::boot()?;
    machine.make_fast();
    for line in ["M3 S1000", "M8", "G1 X100 F600"] {
        assert_eq!(machine.ask(line), ["ok"]);
    }
    assert_eq!(machine.memory.faults(), 0);
    assert_ne!(machine.memory.switched().bits & 0b101, 0);
    let before = machine.memory.patch(task, instructions);
    machine.send(b"?");
    while machine.memory.faults() == 0 {
        thread::sleep(Duration::from_millis(50));
    }
    machine.memory.patch(task, before);
    let mut told = vec![machine.receive()];
    while told.last().is_none_or(|line| !line.contains("to unlock")) {
        told.push(machine.receive());
    }
    Some((machine, told))
}

/// Checks a machine that has been restarted.
fn check(mut machine: Machine, told: &[String], cause: &str) {
    let end = [
        "ALARM:200".to_owned(),
        format!("[MSG:Restarted: {cause}]"),
        "Grbl 1.1h ['$' for help]".to_owned(),
        "[MSG:'$H'|'$X' to unlock]".to_owned(),
    ];
    assert!(told.ends_with(&end), "{told:?}");
    let switched = machine.memory.switched();
    assert_eq!((switched.bits, switched.highest_duty), (0, 0));
    assert_eq!(machine.ask("G0 X1"), ["error:9"]);
    assert_eq!(machine.ask("M3 S1000"), ["error:9"]);
    machine.unlock();
    assert_eq!(machine.ask("G0 X1"), ["ok"]);
    machine.wait_for_idle();
}

#[test]
fn a_task_that_hangs_is_ended_by_the_watchdog() {
    thread::scope(|scope| {
        for task in TASKS {
            scope.spawn(move || {
                if let Some((machine, told)) = restart(task, HANG) {
                    check(machine, &told, "watchdog");
                }
            });
        }
    });
}

#[test]
fn a_fault_of_the_processor_is_told_before_and_after_the_reset() {
    for (task, instructions) in [("TIM1_BRK_TIM9", UNDEFINED), ("TIM4", PUSH)] {
        let Some((machine, told)) = restart(task, instructions) else {
            return;
        };
        assert!(
            told.contains(&"[MSG:Fault: processor fault]".to_owned()),
            "{told:?}"
        );
        check(machine, &told, "processor fault");
    }
}
