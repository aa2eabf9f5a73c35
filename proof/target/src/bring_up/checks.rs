//! From facts to verdicts: what each fact must be, on this board, and whether it is.

mod flash;
mod serial;

use leadscrew::model::ResetCause;
use serde::Serialize;

use self::{flash::flash, serial::serial};
use super::facts::Facts;

/// The result of a check, or of a part of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Verdict {
    /// Passed.
    Passed,
    /// Failed.
    Failed,
    /// Not measurable here.
    Open,
}

/// A part of a check.
#[derive(Debug, Serialize)]
pub(super) struct Item {
    /// What is looked at.
    pub(super) name: String,
    /// The value that it must have.
    pub(super) expected: String,
    /// The measured value, or the reason for a missing one.
    pub(super) measured: String,
    /// Whether it has.
    pub(super) verdict: Verdict,
}

/// A check.
#[derive(Debug, Serialize)]
pub(super) struct Check {
    /// What it is about.
    pub(super) title: &'static str,
    /// Its parts.
    pub(super) items: Vec<Item>,
}

impl Check {
    /// Failed if a part has failed; open if every part is; otherwise passed, as far as it could be measured.
    pub(super) fn verdict(&self) -> Verdict {
        let has = |verdict| self.items.iter().any(|item| item.verdict == verdict);
        if has(Verdict::Failed) {
            Verdict::Failed
        } else if has(Verdict::Passed) {
            Verdict::Passed
        } else {
            Verdict::Open
        }
    }
}

/// The facts that a board must show, from its file and the program.
#[derive(Debug, Clone)]
pub(super) struct Expected {
    /// The number of the chip's kind.
    pub(super) chip: Option<i64>,
    pub(super) flash_kib: i64,
    pub(super) wait_states: i64,
    pub(super) core_hz: i64,
    /// Address of the vectors.
    pub(super) vectors: i64,
    /// Address of the guard of the stack.
    pub(super) guard: i64,
    /// The vectors of the firmware's tasks, each with its priority as RTIC has it.
    pub(super) priorities: Vec<(String, u8)>,
}

/// Numbers of the kinds of chips, by their features: "MCU device ID code" in RM0090, RM0383 and RM0390.
const CHIP_IDS: [(&str, i64); 5] = [
    ("f405", 0x413),
    ("f407", 0x413),
    ("f411", 0x431),
    ("f429", 0x419),
    ("f446", 0x421),
];

/// Returns the number of a kind of chip.
pub(super) fn chip_number(hal: &str) -> Option<i64> {
    let found = CHIP_IDS.iter().find(|(name, _)| *name == hal);
    found.map(|(_, number)| *number)
}

/// The requirement for measuring a fact.
#[derive(Clone, Copy)]
enum Need {
    /// The program.
    Program,
    /// A chip: the emulator lacks it.
    Chip,
    /// This computer at the board's serial line.
    Port,
    /// Both of them.
    ChipAtPort,
    /// Both of them, and a serial line whose bytes take their time.
    Rate,
    /// That, and a board whose time is this computer's.
    Clock,
}

impl Need {
    /// Returns why it cannot be measured here, if it cannot.
    fn lacks(self, facts: &Facts) -> Option<&'static str> {
        let in_emulator = match self {
            Self::Chip | Self::ChipAtPort => Some("the emulator does not have it"),
            Self::Rate | Self::Clock => Some("the emulator's serial line has no rate"),
            Self::Program | Self::Port => None,
        };
        let without_port = match self {
            Self::Port | Self::ChipAtPort | Self::Rate | Self::Clock => {
                Some("needs the serial port: --port")
            }
            Self::Program | Self::Chip => None,
        };
        let in_emulator = in_emulator.filter(|_| facts.are_emulated());
        let on_virtual_board = match self {
            Self::Clock => Some("a virtual board has a time of its own"),
            _ => None,
        };
        let on_virtual_board = on_virtual_board.filter(|_| facts.are_virtual());
        in_emulator
            .or(on_virtual_board)
            .or(without_port.filter(|_| !facts.have_port()))
    }
}

/// The parts of a check that is being made.
struct Parts<'a> {
    facts: &'a Facts,
    items: Vec<Item>,
}

impl Parts<'_> {
    /// Adds a part: `measure` returns what was measured and whether it is right, none if a fact is missing.
    fn add(
        &mut self,
        name: impl Into<String>,
        need: Need,
        expected: impl Into<String>,
        measure: impl FnOnce(&Facts) -> Option<(String, bool)>,
    ) {
        let (measured, verdict) = if let Some(reason) = need.lacks(self.facts) {
            (reason.into(), Verdict::Open)
        } else {
            match measure(self.facts) {
                Some((measured, true)) => (measured, Verdict::Passed),
                Some((measured, false)) => (measured, Verdict::Failed),
                None => ("the program has not said it".into(), Verdict::Failed),
            }
        };
        self.items.push(Item {
            name: name.into(),
            expected: expected.into(),
            measured,
            verdict,
        });
    }

    /// Adds a fact that must be a number, shown in hexadecimal, in the bits of a mask.
    fn add_bits(&mut self, name: &str, need: Need, fact: &str, mask: i64, expected: i64) {
        self.add(name, need, format!("{expected:#x}"), |facts| {
            let bits = facts.get(fact)? & mask;
            Some((format!("{bits:#x}"), bits == expected))
        });
    }

    /// Adds a fact that must be a number.
    fn add_number(&mut self, name: impl Into<String>, need: Need, fact: &str, expected: i64) {
        self.add(name, need, expected.to_string(), |facts| {
            let number = facts.get(fact)?;
            Some((number.to_string(), number == expected))
        });
    }

    /// Adds a number that must be as large as another one, which is more than none.
    fn add_all(&mut self, name: impl Into<String>, need: Need, fact: &str, of: &str) {
        let all = self.facts.get(of);
        let expected = all.map_or_else(|| "all".into(), |all| all.to_string());
        self.add(name, need, expected, |facts| {
            let number = facts.get(fact)?;
            Some((number.to_string(), Some(number) == all && number > 0))
        });
    }
}

/// Judges everything.
pub(super) fn judge(facts: &Facts, expected: &Expected) -> Vec<Check> {
    type Make = fn(&mut Parts<'_>, &Expected);
    let checks: [(&'static str, Make); 5] = [
        ("Chip", chip),
        ("Step timer", step_timer),
        ("Serial", serial),
        ("Flash", flash),
        ("Faults", faults),
    ];
    let checks = checks.into_iter().map(|(title, make)| {
        let mut parts = Parts {
            facts,
            items: Vec::new(),
        };
        make(&mut parts, expected);
        Check {
            title,
            items: parts.items,
        }
    });
    checks.collect()
}

/// All bits of a word.
const WORD: i64 = 0xffff_ffff;

/// The chip is the one of the board's file, and its start-up is what the firmware counts on.
fn chip(parts: &mut Parts<'_>, expected: &Expected) {
    if let Some(chip) = expected.chip {
        parts.add_bits("chip", Need::Chip, "chip", 0xfff, chip);
    }
    parts.add_number("flash, KiB", Need::Chip, "flash_kib", expected.flash_kib);
    let is_written = |number: &str| number.bytes().any(|digit| digit != number.as_bytes()[0]);
    parts.add("unique number", Need::Chip, "written", |facts| {
        let number = facts.unique_number()?;
        let is_right = is_written(&number);
        Some((number, is_right))
    });
    parts.add_number("crystal runs", Need::Chip, "crystal", 1);
    // The detector's threshold: src/board/supply.rs.
    parts.add_number("supply above 2.9 V", Need::Chip, "supply", 1);
    // Instruction and data cache, no prefetch: RM0090 3.9.
    let access = 0x600 | expected.wait_states;
    let words = [
        ("access to the flash", Need::Chip, "flash.access", access),
        ("vectors", Need::Program, "vectors", expected.vectors),
        // 4 KiB without access, and every other address as without it.
        (
            "size of the guard",
            Need::Program,
            "guard.size",
            0x1000_0017,
        ),
        (
            "control of the guard",
            Need::Program,
            "guard.control",
            0b101,
        ),
        // As after a reset, which the firmware leaves: the stack is aligned for interrupts; neither an access
        // that is not aligned nor a division by zero is a fault. ARMv7-M reference manual B3.2.8.
        ("alignment and traps", Need::Program, "control", 0x200),
    ];
    for (name, need, fact, word) in words {
        parts.add_bits(name, need, fact, WORD, word);
    }
    for (vector, priority) in &expected.priorities {
        let fact = format!("priority.{vector}");
        let (name, word) = (format!("priority of {vector}"), nvic_priority(*priority));
        parts.add_bits(&name, Need::Program, &fact, WORD, word);
    }
    // The lowest five bits are the number of the region: ARMv7-M reference manual B3.5.8.
    let (guard, region) = (expected.guard, 0x1f);
    parts.add_bits(
        "guard of the stack",
        Need::Program,
        "guard.start",
        WORD & !region,
        guard,
    );
    // Implementer, architecture and part, without variant and revision: ARMv7-M reference manual B3.2.3.
    let (part, cortex_m4) = (0xff0f_fff0, 0x410f_c240);
    parts.add_bits("processor", Need::Program, "processor", part, cortex_m4);
    for (name, need, fact, bits) in BITS {
        parts.add_bits(name, need, fact, bits, bits);
    }
    serial::divider(parts);
}

/// Returns a priority of RTIC as the chips have it: in the upper four bits of a byte, 0 is the highest.
const fn nvic_priority(priority: u8) -> i64 {
    (16 - priority as i64) << 4
}

/// Bits that must all be set.
const BITS: [(&str, Need, &str, i64); 3] = [
    // Without it the watchdog runs before the firmware does: RM0090 3.9, WDG_SW.
    (
        "watchdog started by software",
        Need::Chip,
        "flash.options",
        1 << 5,
    ),
    ("floating point", Need::Program, "fpu.access", 0xf << 20),
    (
        "its registers saved late",
        Need::Program,
        "fpu.control",
        0b11 << 30,
    ),
];

/// What a time between events may be off, cycles, where two reads of registers may have a miss of the flash's
/// cache between them; in the emulator, where the clock counts nanoseconds, a cycle at each end.
const CHIP_CYCLES: i64 = 24;
const EMULATED_CYCLES: i64 = 2;

/// Returns the allowed error of all times together: no more than that of a single time, so that a
/// timer with an error of one cycle in each time is found. The emulator's timer loses part of a
/// nanosecond each time it begins anew; the model of a virtual board a cycle at most, so that no such timer is found
/// there.
fn allowed_in_all(facts: &Facts, pushed: i64) -> i64 {
    if facts.are_emulated() {
        EMULATED_CYCLES + pushed / 4
    } else if facts.are_virtual() {
        CHIP_CYCLES + pushed
    } else {
        CHIP_CYCLES
    }
}

/// How the program waits for the end of a script, and of which ones.
const WAITS: [(&str, Need, &[&str]); 3] = [
    ("running", Need::Program, &SCRIPTS),
    (FLOODED, Need::Program, &["shortest", "random"]),
    ("sleeping", Need::Chip, &SCRIPTS),
];
const SCRIPTS: [&str; 4] = ["shortest", "longest", "alternating", "random"];
/// The wait in which the sender's interrupt runs as often as it can.
const FLOODED: &str = "flooded";

/// Every event comes, and when it should.
fn step_timer(parts: &mut Parts<'_>, _: &Expected) {
    let allowed = if parts.facts.are_emulated() {
        EMULATED_CYCLES
    } else {
        CHIP_CYCLES
    };
    for (waiting, need, scripts) in WAITS {
        for script in scripts {
            let subject = format!("step.{script}.{waiting}");
            let fact = |what: &str| format!("{subject}.{what}");
            let name = |what: &str| format!("{script}, {waiting}: {what}");
            parts.add_all(name("events"), need, &fact("played"), &fact("pushed"));
            parts.add_number(name("late"), need, &fact("late"), 0);
            let all = parts.facts.get(&fact("pushed")).unwrap_or_default();
            let in_all = allowed_in_all(parts.facts, all);
            let expected = format!("at most {allowed} cycles off, {in_all} in all");
            parts.add(name("times"), need, expected, |facts| {
                let numbers = ["least", "most", "total"].map(|what| facts.get(&fact(what)));
                let [Some(least), Some(most), Some(total)] = numbers else {
                    return None;
                };
                let is_right = [least, most]
                    .map(i64::abs)
                    .iter()
                    .all(|off| *off <= allowed)
                    && total.abs() <= in_all;
                Some((format!("{least} to {most}, {total} in all"), is_right))
            });
            if waiting == FLOODED {
                let expected = "as often as events, at least";
                parts.add(name("serial interrupts"), need, expected, |facts| {
                    let served = facts.get(&fact("served"))?;
                    let is_right = served > 0 && served >= facts.get(&fact("pushed"))?;
                    Some((served.to_string(), is_right))
                });
            }
        }
    }
    halts(parts);
    appends(parts, allowed);
    reloads(parts);
}

/// A halted motion stays in place, and continues from there.
fn halts(parts: &mut Parts<'_>) {
    parts.add_all(
        "halts: events",
        Need::Program,
        "step.halts.played",
        "step.halts.pushed",
    );
    parts.add("halts in the middle", Need::Program, "some", |facts| {
        let halted = facts.get("step.halts.halted")?;
        Some((halted.to_string(), halted > 0))
    });
    parts.add_number(
        "events after a halt",
        Need::Program,
        "step.halts.after_halt",
        0,
    );
}

/// Adds a part of the numbers of both outcomes of a race, each of which must be met.
fn add_both(parts: &mut Parts<'_>, name: &str, first: (&str, &str), second: (&str, &str)) {
    let expected = format!("some {}, some {}", first.0, second.0);
    parts.add(name, Need::Program, expected, |facts| {
        let [is_first, is_second] = [facts.get(first.1)?, facts.get(second.1)?];
        let measured = format!("{is_first} {}, {is_second} {}", first.0, second.0);
        Some((measured, is_first > 0 && is_second > 0))
    });
}

/// An event that is appended after the last comes in its time or after another start, never at another time.
fn appends(parts: &mut Parts<'_>, allowed: i64) {
    parts.add_all(
        "late appends: events",
        Need::Program,
        "step.appends.played",
        "step.appends.pushed",
    );
    add_both(
        parts,
        "late appends",
        ("in time", "step.appends.in_time"),
        ("after the stop", "step.appends.too_late"),
    );
    parts.add_number("late appends: late", Need::Program, "step.appends.late", 0);
    let expected = format!("at most {allowed} cycles off");
    parts.add("late appends: times", Need::Program, expected, |facts| {
        let [least, most] =
            ["least", "most"].map(|what| facts.get(&format!("step.appends.{what}")));
        let (least, most) = (least?, most?);
        let is_right = -allowed <= least && most <= allowed;
        Some((format!("{least} to {most}"), is_right))
    });
}

/// The counter begins with the reload value of that instant, whenever another one is written.
fn reloads(parts: &mut Parts<'_>) {
    add_both(
        parts,
        "reload values around the wrap",
        ("new", "step.reloads.new"),
        ("old", "step.reloads.old"),
    );
    parts.add_number(
        "reload values: wrong ones",
        Need::Program,
        "step.reloads.wrong",
        0,
    );
    let expected = format!("at most {CHIP_CYCLES} cycles off");
    parts.add("reload values: counts", Need::Program, expected, |facts| {
        let off = facts.get("step.reloads.off")?;
        Some((format!("{off}"), (0..=CHIP_CYCLES).contains(&off)))
    });
}

/// Faults: the name in the facts, the reset cause that must be found, and the requirement.
const FAULTS: [(&str, &str, ResetCause, Need); 6] = [
    (
        "undefined",
        "instruction that is none",
        ResetCause::Processor,
        Need::Program,
    ),
    (
        "stack",
        "stack too deep",
        ResetCause::Processor,
        Need::Program,
    ),
    ("panic", "panic", ResetCause::Panic, Need::Program),
    (
        "clock",
        "exception of the crystal",
        ResetCause::Clock,
        Need::Program,
    ),
    (
        "interrupt",
        "interrupt without a task",
        ResetCause::Interrupt,
        Need::Program,
    ),
    ("watchdog", "hang", ResetCause::Watchdog, Need::Chip),
];

/// Longest time from a fault to outputs that are off, cycles: 0.3 ms, in which the stack grows to its end.
const MOST_CYCLES_TO_OFF: i64 = 50_000;

/// Each fault switches the outputs off, resets the chip, and is reported before and after the reset.
fn faults(parts: &mut Parts<'_>, _: &Expected) {
    for (fault, name, cause, need) in FAULTS {
        let fact = |what: &str| format!("fault.{fault}.{what}");
        let name = |what: &str| format!("{name}: {what}");
        if parts.facts.get(&fact("unguarded")).is_some() {
            parts.add(name("made"), need, "a stack with its guard", |_| {
                let measured = "not made: the guard of the stack is not as it must be";
                Some((measured.into(), false))
            });
            continue;
        }
        parts.add(name("cause after the reset"), need, cause.text(), |facts| {
            let number = facts.get(&fact("cause"))?;
            let mut causes = ResetCause::ALL.into_iter();
            let found = causes.find(|cause| *cause as i64 == number);
            let text = found.map_or("no reset", ResetCause::text);
            Some((text.into(), found == Some(cause)))
        });
        if fault == "watchdog" {
            continue;
        }
        let expected = format!("at most {MOST_CYCLES_TO_OFF} cycles");
        parts.add(name("time to outputs off"), need, expected, |facts| {
            let cycles = facts.get(&fact("cycles_to_off"))?;
            let is_right = (1..=MOST_CYCLES_TO_OFF).contains(&cycles);
            Some((format!("{cycles} cycles"), is_right))
        });
        parts.add(name("outputs left on"), Need::Chip, "0, of some", |facts| {
            let [before, after] = ["on_before", "on_after"].map(|what| facts.get(&fact(what)));
            let (before, after) = (before?, after?);
            Some((format!("{after}, of {before}"), after == 0 && before > 0))
        });
        // A handler that does not come to its end.
        let by_watchdog = fact("by_watchdog");
        parts.add_number(name("resets by the watchdog"), Need::Chip, &by_watchdog, 0);
    }
    parts.add_number(
        "processor faults told to the sender",
        Need::Port,
        "told.processor",
        2,
    );
    parts.add_number("panics told to the sender", Need::Port, "told.panic", 1);
    parts.add_number(
        "interrupts told to the sender",
        Need::Port,
        "told.interrupt",
        1,
    );
}

#[cfg(test)]
mod tests;
