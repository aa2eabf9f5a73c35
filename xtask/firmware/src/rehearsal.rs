//! What is flashed starts: a firmware on a model of its chip's registers (`tests/boot`), from a reset and from the
//! states in which bootloaders leave a chip.

use std::{
    collections::BTreeMap,
    io,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
};

use crate::boards::{Board, compile};
use anyhow::{Context, Result, bail, ensure};
use common::{cargo, install};
use object::{Object, ObjectSection};

/// Vectors of the processor, before those of the chip's interrupts.
const PROCESSOR_VECTORS: u64 = 16;
/// Interrupts that have handlers for the emulator alone, TIM2 and TIM3: `src/board/emulation.rs`.
const STAND_INS: [&str; 2] = ["28", "29"];

/// What a chip is found in, and the options of the model.
type State = (&'static str, Vec<String>);

/// Starts the firmware of a board from each state, or from few, with a Python of [`python`], and returns what it has been
/// started from.
pub fn rehearse(board: &Board, elf: &Path, python: &Path, is_short: bool) -> Result<String> {
    let python = || {
        let mut command = Command::new(python);
        // Nothing is left beside the sources.
        command.arg("-B");
        command
    };
    test_model(python())?;
    let facts = facts(board, interrupts(&compile::read(elf)?)?)?;
    let states = states(board.crystal_mhz, &chip(&board.chip.hal)?, is_short);
    let mut found: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    // All at once: each is a process of a second or two.
    let started: io::Result<Vec<_>> = { states.iter() }
        .map(|(_, options)| {
            let mut rehearsal = python();
            rehearsal.arg(scripts().join("rehearse.py")).arg(elf);
            rehearsal.stdout(Stdio::piped()).stderr(Stdio::piped());
            rehearsal.args(&facts).args(options).spawn()
        })
        .collect();
    for ((name, _), rehearsal) in states.iter().zip(started?) {
        for fault in faults(&rehearsal.wait_with_output()?) {
            found.entry(fault).or_default().push(name);
        }
    }
    ensure!(
        found.is_empty(),
        "{} does not start as it should\n{}",
        board.name,
        fault_list(&found, states.len())
    );
    Ok(format!("from {} states of the chip", states.len()))
}

/// Has the model and the rehearsal itself tested.
fn test_model(mut python: Command) -> Result<()> {
    python.args(["-m", "unittest", "discover", "--start-directory"]);
    let output = python.arg(scripts()).output()?;
    let message = String::from_utf8_lossy(&output.stderr);
    ensure!(
        output.status.success(),
        "the model of the chip is wrong\n{}",
        message.trim_end()
    );
    // Before version 3.12, Python is content with that.
    ensure!(
        !message.contains("Ran 0 tests"),
        "the model of the chip has no tests"
    );
    Ok(())
}

/// Each fault with the states in which it is found.
fn fault_list(found: &BTreeMap<String, Vec<&str>>, all: usize) -> String {
    let lines = found.iter().map(|(fault, states)| {
        let states = if states.len() == all {
            "every state".into()
        } else {
            states.join(", ")
        };
        format!("{fault} ({states})")
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// The rehearsal's folder.
fn scripts() -> PathBuf {
    cargo::root().join("tests/boot")
}

/// A Python that has the processor, or the reason why none can be had on this computer.
pub fn python() -> Result<Result<PathBuf, String>> {
    let home = cargo::target_dir_for(3).join("boot/python");
    match install::python(&home, &scripts().join("requirements.txt"), "Unicorn") {
        Err(error) if error.is::<install::Unavailable>() => {
            let lines = format!("{error:#}");
            let words: Vec<_> = lines.split_whitespace().collect();
            Ok(Err(words.join(" ")))
        }
        found => found.map(Ok),
    }
}

/// The faults that a run has found, or else the last line with which Python ended it.
fn faults(output: &Output) -> Vec<String> {
    let lines = |bytes| -> Vec<String> {
        let text = String::from_utf8_lossy(bytes);
        text.lines().map(str::to_owned).collect()
    };
    if output.status.success() {
        return Vec::new();
    }
    let faults = lines(&output.stdout);
    if faults.is_empty() {
        let last = lines(&output.stderr).pop();
        return vec![last.unwrap_or_else(|| format!("it has failed ({})", output.status))];
    }
    faults
}

/// The state of a reset, and what all bootloaders together leave.
const RESET_STATE: &str = "a reset";
const ALL_BOOTLOADER_STATES: &str = "all of these";
/// What the firmware must refuse.
const OTHER_CHIP: &str = "another chip";
const DAMAGED_IMAGE: &str = "a damaged image";
/// The states that matter most.
const MAIN_STATES: [&str; 4] = [
    RESET_STATE,
    ALL_BOOTLOADER_STATES,
    OTHER_CHIP,
    DAMAGED_IMAGE,
];

/// The states, each alone and some together, or those that matter most.
fn states(crystal_mhz: u32, chip: &Chip, is_short: bool) -> Vec<State> {
    let other_mhz = if crystal_mhz == 12 { 8 } else { 12 };
    let all = "--dfu --prigroup 5 --systick --irqs --lse";
    [
        (RESET_STATE, String::new()),
        ("the loader in ROM", "--dfu".into()),
        ("PRIGROUP 3", "--prigroup 3".into()),
        ("PRIGROUP 5", "--prigroup 5".into()),
        ("SysTick running", "--systick".into()),
        ("all interrupts enabled", "--irqs".into()),
        ("LSE running", "--lse".into()),
        (ALL_BOOTLOADER_STATES, all.into()),
        ("no crystal", "--hse 0".into()),
        (OTHER_CHIP, format!("--chip {:#x} --refuses", chip.other)),
        (
            "the chip in its place",
            format!("--chip {:#x}", chip.in_its_place),
        ),
        ("a chip that says nothing", "--chip 0".into()),
        (DAMAGED_IMAGE, "--damaged --refuses".into()),
        ("another crystal", format!("--hse {other_mhz}")),
    ]
    .into_iter()
    .filter(|(name, _)| !is_short || MAIN_STATES.contains(name))
    .map(|(name, options)| {
        let words = options.split_whitespace().map(str::to_owned);
        (name, words.collect())
    })
    .collect()
}

/// What the model has to know of a board and its firmware.
fn facts(board: &Board, interrupts: u32) -> Result<Vec<String>> {
    let memory = board.memory(cargo::axes().into());
    let numbers = [
        ("program", memory.flash_start),
        ("flash-kib", board.part.flash_kib),
        ("ram-kib", memory.ram_bytes / 1024),
        ("crystal-mhz", board.crystal_mhz),
        ("core-mhz", board.chip.clocks.core_mhz),
        ("chip", chip(&board.chip.hal)?.own),
        ("interrupts", interrupts),
    ];
    let mut facts: Vec<_> = numbers
        .map(|(name, number)| format!("--{name}={number:#x}"))
        .into();
    if uses_backup_domain(board) {
        facts.push("--uses-c13".into());
    }
    let wiring = board.wiring(cargo::axes().into());
    if let Some((_, pwm)) = wiring.and_then(|wiring| wiring.pwm) {
        facts.push(format!("--pwm={:#x}", pwm.base()));
    }
    if board.qemu.is_some() {
        facts.push("--stand-ins".into());
        facts.extend(STAND_INS.map(str::to_owned));
    }
    Ok(facts)
}

/// `DEV_ID` of chips: in the manuals, the chapter on debug support.
struct Chip {
    /// That of the board's file.
    own: u32,
    /// The one with which boards of the same name are sold, too, or else itself.
    in_its_place: u32,
    /// One for which the firmware is not.
    other: u32,
}

fn chip(hal: &str) -> Result<Chip> {
    let [own, in_its_place, other] = match hal {
        "f405" | "f407" => [0x413, 0x419, 0x421],
        "f429" => [0x419, 0x413, 0x421],
        "f411" => [0x431, 0x431, 0x413],
        "f446" => [0x421, 0x421, 0x413],
        unknown => bail!("the number of the chip {unknown} is not known"),
    };
    Ok(Chip {
        own,
        in_its_place,
        other,
    })
}

/// Returns whether the board has something at C13 to C15, which LSE would keep.
fn uses_backup_domain(board: &Board) -> bool {
    board.wiring(cargo::axes().into()).is_some_and(|wiring| {
        let inputs = wiring.inputs.iter().map(|(_, signed)| signed.pin);
        let mut pins = inputs.chain(wiring.weak_outputs());
        pins.any(|pin| pin.letter() == 'C' && pin.number >= 13)
    })
}

/// How many interrupts have a vector in an image.
fn interrupts(image: &[u8]) -> Result<u32> {
    let file = object::File::parse(image).context("this is no ELF file")?;
    let table = file.section_by_name(".vector_table");
    let vectors = table.context("the image has no vectors")?.size() / 4;
    let interrupts = vectors.checked_sub(PROCESSOR_VECTORS);
    Ok(interrupts.context("the image has too few vectors")? as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_chip_and_its_backup_domain_are_known() {
        for board in crate::boards::all().unwrap() {
            let chip = chip(&board.chip.hal).unwrap();
            assert!(chip.own != chip.other && chip.in_its_place != chip.other);
        }
    }

    #[test]
    fn the_model_receives_the_pins_that_lse_would_keep() {
        let mut passed = Vec::new();
        for board in crate::boards::all().unwrap() {
            // The column of three axes.
            let table = crate::boards::pins::table(&board).unwrap();
            let mut cells = table.lines().filter_map(|line| line.split('|').nth(2));
            let uses =
                cells.any(|cell| ["PC13", "PC14", "PC15"].iter().any(|it| cell.contains(it)));
            let facts = facts(&board, 82).unwrap();
            let is_passed = facts.contains(&"--uses-c13".into());
            assert_eq!(is_passed, uses, "{}", board.name);
            passed.push(is_passed);
        }
        assert!(passed.contains(&true) && passed.contains(&false));
    }

    #[test]
    fn the_states_that_matter_most_are_of_all() {
        let names = |is_short| -> Vec<_> {
            let states = states(8, &chip("f405").unwrap(), is_short);
            states.into_iter().map(|(name, _)| name).collect()
        };
        assert_eq!(names(false).len(), 14);
        assert_eq!(names(true), MAIN_STATES);
    }

    #[test]
    fn the_other_crystal_is_never_that_of_the_board() {
        for crystal_mhz in [8, 12, 25] {
            let states = states(crystal_mhz, &chip("f405").unwrap(), false);
            let (_, options) = states.last().unwrap();
            assert_eq!(options[0], "--hse");
            assert_ne!(options[1], crystal_mhz.to_string());
        }
    }

    #[test]
    #[cfg(unix)]
    fn a_run_that_fails_has_a_fault_whatever_it_says() {
        let run = |script: &str| Command::new("sh").args(["-c", script]).output().unwrap();
        for (script, expected) in [
            ("echo 168 MHz", &[][..]),
            ("echo a; echo b; exit 1", &["a", "b"]),
            ("echo x >&2; echo Error >&2; exit 1", &["Error"]),
        ] {
            assert_eq!(faults(&run(script)), expected, "{script}");
        }
        assert_eq!(faults(&run("exit 1")).len(), 1);
    }

    #[test]
    fn a_fault_is_reported_with_its_states() {
        let found = BTreeMap::from([("a".into(), vec!["x"]), ("b".into(), vec!["x", "y"])]);
        assert_eq!(fault_list(&found, 2), "a (x)\nb (every state)");
    }

    #[test]
    fn a_program_that_is_no_firmware_is_refused() {
        assert!(interrupts(b"no ELF file").is_err());
    }
}
