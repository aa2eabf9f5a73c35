//! Faults: a hanging task, a panic, a processor fault, a stack overflow, a stopped crystal, a falling supply.
//!
//! The instructions at the beginning of a task are replaced. The emulator has no watchdog, no crystal and no supply:
//! a count of a timer stands in for the first, and for the others the task itself pends what they would.

use std::thread;

use leadscrew::model::Levels;

use crate::{
    cases::each,
    machine::{Machine, WELCOME},
};

/// What a task does instead of its work.
#[derive(Clone, Copy)]
enum Fault {
    /// A branch to itself.
    Hang,
    /// An instruction that is none.
    Undefined,
    /// Pushes eight registers, again and again.
    Push,
    /// A panic.
    Panic,
    /// A store of a word to a register, and a branch to itself.
    Store(u32, u32),
}

/// Pends the non-maskable interrupt, as the clock security does: ICSR, `NMIPENDSET`.
const CRYSTAL_STOPS: Fault = Fault::Store(0xe000_ed04, 1 << 31);
/// Pends the interrupt of the detector of a low supply, number 1: `NVIC_ISPR0`.
const SUPPLY_FALLS: Fault = Fault::Store(0xe000_e200, 1 << 1);

/// Vectors of tasks that run while a line is executed: `step`, `serial_rx`, `segment_start`, `inputs`, `prepare`,
/// `wake`, `interpret`; and what runs when none does.
const TASKS: [&str; 8] = [
    "SysTick",
    "USART1",
    "I2C3_EV",
    "TIM1_UP_TIM10",
    "TIM1_BRK_TIM9",
    "TIM4",
    "I2C2_EV",
    IDLE,
];
/// It has begun long ago, and never ends.
const IDLE: &str = "app4idle17h";
/// Flash behind the firmware, for code and texts of the tests.
const FREE: u64 = 0x080f_0000;

/// A branch (`B.W`, encoding T4 of the ARMv7-M reference manual).
fn branch(from: u64, to: u64) -> u32 {
    let offset = (to as u32).wrapping_sub(from as u32 + 4);
    let sign = offset >> 31;
    let [j1, j2] = [offset >> 23 & 1, offset >> 22 & 1].map(|bit| 1 ^ bit ^ sign);
    let first = 0xf000 | sign << 10 | offset >> 12 & 0x3ff;
    let second = 0x9000 | j1 << 13 | j2 << 11 | offset >> 1 & 0x7ff;
    first | second << 16
}

/// The instructions for a task. Those that need more room are put behind the firmware.
fn instructions(machine: &Machine, at: u64, fault: Fault) -> u32 {
    /// Loads R0 to R3 from the words behind the code, then goes on.
    const LOAD: [u32; 2] = [0x4903_4802, 0x4b04_4a03];
    /// `BX R3`, `NOP`; `STR R1, [R0]` and a branch to itself.
    const CALL: u32 = 0xbf00_4718;
    const STORE: u32 = 0xe7fe_6001;
    let memory = &machine.memory;
    let (end, registers) = match fault {
        Fault::Hang => return 0xe7fe_e7fe,
        Fault::Undefined => return 0xde00_de00,
        Fault::Push => return 0xe7fd_b4ff,
        Fault::Panic => {
            // `panic_fmt(text: Arguments, place: &Location)`: a text without arguments is its address and twice
            // its length, plus one; a place is a text, a line and a column.
            let (text, place) = (FREE as u32 + 0x40, FREE as u32 + 0x50);
            memory.write(text.into(), u32::from_le_bytes(*b"test"));
            for (index, word) in (0..).zip([text, 4, 7, 1]) {
                memory.write(u64::from(place) + 4 * index, word);
            }
            let panic = memory.function("9panicking9panic_fmt") as u32 | 1;
            (CALL, [text, 2 * 4 + 1, place, panic])
        }
        Fault::Store(register, word) => (STORE, [register, word, 0, 0]),
    };
    let words = LOAD.into_iter().chain([end]).chain(registers);
    for (index, word) in (0..).zip(words) {
        memory.write(FREE + 4 * index, word);
    }
    branch(at, FREE)
}

/// Lets a task of a machine that moves, or is idle, with its spindle on do something else, until the machine has been reset.
/// Returns what it has told since.
fn restart(task: &str, fault: Fault) -> Option<(Machine, Vec<String>)> {
    let mut machine = Machine::boot()?;
    machine.make_fast();
    for line in ["M3 S1000", "M8"] {
        assert_eq!(machine.ask(line), ["ok"]);
    }
    if task != IDLE {
        assert_eq!(machine.ask("G1 X100 F60"), ["ok"]);
    }
    assert_eq!(machine.memory.faults(), 0);
    assert_ne!(machine.memory.switched().bits & 0b101, 0);
    let at = match task {
        IDLE => machine.memory.place_in(IDLE),
        _ => machine.memory.function(task),
    };
    let word = instructions(&machine, at, fault);
    let [before] = machine.memory.read(at);
    let reset = machine.memory.function("Reset");
    let contacts = machine.memory.contacts;
    let mut stopped = machine.memory.stop();
    stopped.write(at, word);
    stopped.write(contacts, Levels::PROBE.0.into());
    machine.send(b"?");
    stopped.run_to(reset);
    // Or the restarted machine would have the same fault again.
    stopped.write(at, before);
    drop(stopped);
    assert_eq!(machine.memory.faults(), 1);
    machine.memory.close(Levels::NONE);
    let lines = machine.receive_until(|line| line.contains("to unlock"));
    Some((machine, lines))
}

/// Checks a machine that has been restarted.
fn check(mut machine: Machine, lines: &[String], cause: &str) {
    let end = [
        "ALARM:200".to_owned(),
        format!("[MSG:Restarted: {cause}]"),
        WELCOME.to_owned(),
        "[MSG:'$H'|'$X' to unlock]".to_owned(),
    ];
    assert!(lines.ends_with(&end), "{lines:?}");
    let switched = machine.memory.switched();
    assert_eq!((switched.bits, switched.highest_duty), (0, 0));
    assert_eq!(machine.ask("G0 X1"), ["error:9"]);
    assert_eq!(machine.ask("M3 S1000"), ["error:9"]);
    machine.unlock();
    assert_eq!(machine.ask("G0 X1"), ["ok"]);
    machine.wait_for_idle();
    // The fault has been told.
    machine.memory.reset_chip();
    assert_eq!(machine.receive(), WELCOME);
}

#[test]
fn a_task_that_hangs_is_ended_by_the_watchdog() {
    thread::scope(|scope| {
        for task in TASKS.into_iter().step_by(each(4)) {
            scope.spawn(move || {
                if let Some((machine, lines)) = restart(task, Fault::Hang) {
                    check(machine, &lines, "watchdog");
                }
            });
        }
    });
}

#[test]
fn a_fault_is_reported_before_and_after_the_reset() {
    for (task, fault, cause, place) in [
        ("TIM1_BRK_TIM9", Fault::Undefined, "processor fault", ""),
        ("TIM4", Fault::Push, "processor fault", ""),
        ("I2C2_EV", Fault::Panic, "panic", " at test:7"),
        ("TIM1_BRK_TIM9", SUPPLY_FALLS, "supply too low", ""),
    ] {
        let Some((machine, lines)) = restart(task, fault) else {
            return;
        };
        let fault = format!("[MSG:Fault: {cause}{place}]");
        assert!(lines.contains(&fault), "{lines:?}");
        check(machine, &lines, cause);
    }
}

#[test]
fn a_crystal_that_stops_is_reported_after_the_reset() {
    if let Some((machine, lines)) = restart("SysTick", CRYSTAL_STOPS) {
        // Before it, the bits would be too long.
        assert!(
            !lines.iter().any(|line| line.contains("Fault")),
            "{lines:?}"
        );
        check(machine, &lines, "crystal stopped");
    }
}
