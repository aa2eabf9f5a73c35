//! What the proof assumes of the processor, as the running firmware has set it up: vectors, priorities, enables, the guard
//! below the stack, and how registers are saved.
//!
//! ARMv7-M reference manual: B3.2 (system control), B3.4 (NVIC), B3.5 (MPU).

use std::{collections::BTreeMap, fs, path::Path};

use serde_json::Value;

use crate::machine::Machine;

/// Words of the vector table: the processor's and those of RM0090, table 62.
const VECTORS: usize = 16 + 82;
/// The first vector of the NVIC.
const FIRST_INTERRUPT: usize = 16;
/// The first vector of the processor whose priority can be set.
const FIRST_SYSTEM: usize = 4;

const NVIC_ISER: u64 = 0xe000_e100;
const NVIC_IPR: u64 = 0xe000_e400;
const VTOR: u64 = 0xe000_ed08;
const SHPR1: u64 = 0xe000_ed18;
const MPU_CTRL: u64 = 0xe000_ed94;
const FPCCR: u64 = 0xe000_ef34;

/// What the proof says of priorities.
struct Assumed {
    /// The vectors of tasks, with their priorities as the processor has them.
    tasks: BTreeMap<String, u8>,
    /// Vectors that belong to no task and whose time is exempt.
    exempt: Vec<String>,
}

fn file(name: &str) -> String {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join(name);
    fs::read_to_string(path).expect("it is a file of this project")
}

/// What stands between quotation marks.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.split('"').skip(1).step_by(2)
}

impl Assumed {
    /// From the proof's numbers, and from what it is given.
    fn read() -> Self {
        let proof: Value = serde_json::from_str(&file("docs/schedule.json")).expect("it is JSON");
        let mut of_tasks = BTreeMap::new();
        let mut tasks = BTreeMap::new();
        for row in proof["tasks"].as_array().expect("the proof has tasks") {
            let word = |key: &str| row[key].as_str().expect("it has a name").to_owned();
            let priority = row["priority"].as_u64().expect("it has a priority") as u8;
            let priority = (16 - priority) << 4;
            let name = word("name");
            let task = name.split(':').next().unwrap_or_default().to_owned();
            of_tasks.insert(task, priority);
            tasks.insert(word("vector"), priority);
        }
        let given = file("schedule.toml");
        let (mut exempt, mut table) = (Vec::new(), "");
        for line in given.lines() {
            let (key, value) = line.split_once(" = ").unwrap_or_default();
            match key {
                _ if line.starts_with('[') => table = line.trim_matches(['[', ']']),
                "vectors" => {
                    let task = table.strip_prefix("task.").expect("tasks have vectors");
                    let vectors = quoted(value).map(|it| (it.to_owned(), of_tasks[task]));
                    tasks.extend(vectors);
                }
                "function" if table == "exempt" => {
                    exempt.extend(quoted(value).map(str::to_owned));
                }
                _ => {}
            }
        }
        Self { tasks, exempt }
    }
}

#[test]
fn the_running_firmware_has_the_vectors_and_priorities_that_the_proof_assumes() {
    let Some(machine) = Machine::boot() else {
        return;
    };
    let (memory, assumed) = (&machine.memory, Assumed::read());
    let symbol = |name: &str| memory.symbol(name);
    let [_, table, reset_control, sleep, configuration] = memory.read(VTOR - 4);
    assert_eq!(Some(u64::from(table)), symbol("__vector_table"), "VTOR");
    assert_eq!(
        reset_control & 0x700,
        0,
        "PRIGROUP: all bits of a priority preempt"
    );
    assert_eq!(sleep & 1 << 1, 0, "SLEEPONEXIT: `idle` would not run");
    assert_eq!(configuration, 0x200, "CCR: STKALIGN alone");

    let vectors: [u32; VECTORS] = memory.read(table.into());
    let enables: [u32; 3] = memory.read(NVIC_ISER);
    let priorities: [u32; VECTORS / 4] = memory.read(NVIC_IPR);
    let system: [u32; 3] = memory.read(SHPR1);
    let default = symbol("DefaultHandler").expect("there is one");
    let slots_of = |name: &str| {
        let handler = symbol(name).filter(|handler| *handler != default);
        let slots = vectors.iter().enumerate().skip(1);
        slots
            .filter(move |(_, vector)| Some(u64::from(**vector & !1)) == handler)
            .map(|(slot, _)| slot)
    };
    let mut expected = BTreeMap::new();
    for (name, priority) in &assumed.tasks {
        expected.extend(slots_of(name).map(|slot| (slot, *priority)));
    }
    // `SysTick`, and at least the vectors of six tasks in the NVIC.
    assert!(expected.len() >= 7, "{expected:?}");
    let exempt: Vec<_> = assumed
        .exempt
        .iter()
        .flat_map(|name| slots_of(name))
        .collect();
    let byte = |words: &[u32], index: usize| words[index / 4].to_le_bytes()[index % 4];
    for slot in FIRST_SYSTEM..FIRST_INTERRUPT {
        let found = byte(&system, slot - FIRST_SYSTEM);
        let wanted = expected.get(&slot).copied().unwrap_or(0);
        assert_eq!(found, wanted, "priority of vector {slot}");
    }
    for slot in FIRST_INTERRUPT..VECTORS {
        let number = slot - FIRST_INTERRUPT;
        let is_enabled = enables[number / 32] >> (number % 32) & 1 == 1;
        let found = byte(&priorities, number);
        match expected.get(&slot) {
            Some(wanted) if is_enabled => {
                assert_eq!(found, *wanted, "priority of vector {slot}");
            }
            Some(_) => panic!("the vector {slot} of a task is not enabled"),
            None => assert!(
                !is_enabled || exempt.contains(&slot),
                "vector {slot} is enabled and belongs to no task"
            ),
        }
    }
}

#[test]
fn the_running_firmware_has_the_guard_and_saves_registers_as_the_proof_assumes() {
    let Some(machine) = Machine::boot() else {
        return;
    };
    let memory = &machine.memory;
    let guard_bytes = memory.symbol("_constant_GUARD_BYTES");
    let guard_bytes = guard_bytes.expect("src/board/proof_constants.rs defines it");
    let statics_end = memory.symbol("__sheap").expect("the linker script has it");
    let guard = statics_end.next_multiple_of(guard_bytes);
    // Regions that are not selected are not to be seen in QEMU. That nobody else writes these registers is in the proof.
    let [control, number, base, attributes] = memory.read(MPU_CTRL);
    assert_eq!(control, 0b101, "the MPU is on, but not in a hard fault");
    assert_eq!(number, 0);
    assert_eq!(u64::from(base & !0x1f), guard, "where the guard is");
    let size_field = (guard_bytes.ilog2() - 1) << 1;
    let no_access = 1 << 28 | size_field | 1;
    assert_eq!(attributes, no_access, "nobody reads, writes or executes it");
    let [saving] = memory.read(FPCCR);
    assert_eq!(
        saving >> 30,
        0b11,
        "ASPEN, LSPEN: registers of the FPU are saved when they are needed"
    );
}
