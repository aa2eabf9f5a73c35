//! The plugin in QEMU: short instruction sequences whose cost is known by hand.

mod support;

use std::{fs, path::Path};

use serde_json::{Value, json};

/// Own cycles and instructions of each function of `sequences/program.rs`, per run of the program.
///
/// The last three cycles of most are `BX LR`: 1, and 2 for the pipeline.
const EXPECTED: [(&str, u64, u64); 35] = [
    ("arithmetic", 11 + 3, 12),
    ("divide", 2 + 7 + 7 + 3, 5),
    ("load_alone", 2 + 1 + 2 + 1 + 2 + 3, 6),
    ("load_chain", 2 + 1 + 1 + 1 + 3, 5),
    ("load_dependent", 1 + 2 + 2 + 1 + 3, 5),
    ("load_after_skipped", 1 + 1 + 2 + 3, 5),
    ("stores", 1 + 1 + 1 + 1 + 2 + 2 + 3, 7),
    ("multiples", 4 + 4 + 1 + 3 + 3 + 3, 6),
    ("doubles", 3 + 3 + 3, 3),
    ("exclusives", 2 + 2 + 1 + 3, 4),
    ("branch_taken", 3 + 3 + 3, 3),
    ("branch_not_taken", 1 + 1 + 1 + 1 + 3, 5),
    ("compare_and_branch", 1 + 3 + 3, 3),
    ("loop_of_three", 1 + 3 + 3 + 3 + 1 + 3, 8),
    ("table_branch", 1 + 4 + 3, 3),
    ("if_then_folded", 1 + 1 + 3, 4),
    ("if_then_unfolded", 1 + 1 + 1 + 1 + 3, 5),
    ("skipped", 1 + 4 + 3, 7),
    ("specials", 2 + 2 + 2 + 3, 4),
    ("barriers", 3 + 3 + 3 + 3, 4),
    ("calls", 3 + 3 + 2 + 3 + 5, 5),
    ("pops", 2 + 4, 2),
    ("tail", 3, 1),
    ("tail_target", 3, 1),
    ("float_simple", 8 + 3, 9),
    ("float_accumulate", 4 * 3 + 3, 5),
    ("float_divide", 1 + 14 + 14 + 3, 4),
    ("float_memory", 2 + 2 + 3 + 5 + 5 + 3, 6),
    ("float_transfer", 1 + 1 + 2 + 2 + 3, 5),
    ("empty", 5 * 3, 5),
    ("interrupt_once", 2 + 1 + 1 + 3 + 3 + 1 + 3, 7),
    (
        "interrupt_nested",
        1 + 2 + 1 + 1 + 2 + 1 + 1 + 3 + 3 + 1 + 3,
        11,
    ),
    (
        "interrupt_chained",
        1 + 2 + 1 + 1 + 2 + 1 + 1 + 3 + 3 + 1 + 3,
        11,
    ),
    // Once with nothing to do, twice with SysTick to pend.
    (
        "PendSV",
        (3 + 3) + 2 * (1 + 1 + 2 + 1 + 1 + 3 + 3 + 1 + 3),
        2 + 2 * 9,
    ),
    ("SysTick", 2 * (3 + 3 + 5), 2 * 3),
];

/// Exception entry and exit.
const EXCEPTION: u64 = 12 + 12;

#[test]
fn every_class_is_charged_as_the_table_says() {
    let Some(report) = run() else { return };
    for (name, cycles, instructions) in EXPECTED {
        let function = named(&report["functions"], name);
        assert_eq!(function["cycles"], cycles, "{name}");
        assert_eq!(function["instructions"], instructions, "{name}");
    }
    assert_eq!(report["unknown"], json!([]));
    assert_eq!(report["unexplained"], 0);
}

#[test]
fn calls_include_what_they_call() {
    let Some(report) = run() else { return };
    for (name, cycles) in [("calls", 16 + 2 * 3), ("tail", 3 + 3)] {
        assert_eq!(named(&report["functions"], name)["calls_cycles"], cycles);
    }
}

#[test]
fn preemption_is_charged_to_the_preemptor() {
    let Some(report) = run() else { return };
    let once = 3 + 3 + EXCEPTION;
    let pending = 16 + EXCEPTION;
    let systick = 3 + 3 + 5 + 3 + EXCEPTION;
    for (task, key, expected) in [
        ("PendSV", "activations", 3),
        ("PendSV", "cycles", once + 2 * pending),
        ("PendSV", "min_cycles", once),
        ("PendSV", "max_cycles", pending),
        // Only the nested SysTick lies within PendSV; the chained one follows it.
        ("PendSV", "max_span_cycles", pending + systick),
        ("PendSV", "span_cycles", once + 2 * pending + systick),
        ("PendSV", "peripheral_writes", 2),
        ("SysTick", "activations", 2),
        ("SysTick", "cycles", 2 * systick),
        ("SysTick", "instructions", 2 * 4),
    ] {
        assert_eq!(named(&report["tasks"], task)[key], expected, "{task} {key}");
    }
    let systicks = &named(&report["tasks"], "SysTick")["histogram"];
    assert_eq!(*systicks, json!([[systick, 2]]));
}

/// The one of a list that is called `name`.
fn named<'a>(list: &'a Value, name: &str) -> &'a Value {
    let mut list = list.as_array().expect("it is a list").iter();
    let found = list.find(|one| one["name"] == name);
    found.unwrap_or_else(|| panic!("{name} is not in the report"))
}

/// The report of one run; `None`, and a word why, when a tool is missing.
fn run() -> Option<Value> {
    let directory = support::scratch();
    let elf = directory.join("sequences.elf");
    let out = directory.join("sequences.json");
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/sequences");
    support::compile(&sources.join("program.rs"), &sources.join("link.x"), &elf)?;
    let plugin = format!(
        "{},elf={},out={}",
        support::plugin().display(),
        elf.display(),
        out.display()
    );
    support::emulate(&elf, &plugin, 120)?;
    let text = fs::read_to_string(out).expect("the plugin writes its report when QEMU exits");
    Some(serde_json::from_str(&text).expect("the report is JSON"))
}
