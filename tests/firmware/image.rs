//! The image of the firmware for a chip: the code that erases and programs flash is in RAM (the proof shows that this
//! code needs nothing in flash). Flash keeps no queues of zeros, and nothing that only the feature `reprap` asks for.

use std::{env, fs, ops::Range};

use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};

/// Addresses of the memory in which data and such code are.
const RAM: Range<u32> = 0x2000_0000..0x2010_0000;

/// Names that functions of the RepRap dialect have in their paths: those of its modules.
const REPRAP_PATHS: [&str; 1] = ["reprap"];
/// Parts of answers in that dialect (src/protocol/reprap/replies.rs, src/protocol/reprap/clock.rs).
const REPRAP_ANSWERS: [&str; 3] = ["FIRMWARE_NAME:", "; M999 to go on", "echo:busy: "];

#[test]
fn what_erases_and_programs_the_flash_is_in_ram() {
    let Some(path) = env::var_os("CHIP_FIRMWARE_ELF") else {
        return;
    };
    let bytes = fs::read(path).expect("the firmware can be read");
    let file = object::File::parse(&*bytes).expect("the firmware is an ELF file");
    for function in ["flash5erase", "flash7program"] {
        let mut places = file.symbols().filter(|symbol| {
            let name = symbol.name().expect("symbols have names");
            symbol.kind() == SymbolKind::Text && name.contains(function)
        });
        let is_in_ram = |symbol: object::Symbol<'_, '_>| RAM.contains(&(symbol.address() as u32));
        assert!(places.any(is_in_ram), "{function}");
    }
}

#[test]
fn initial_values_of_data_take_4_kib_of_the_flash_at_most() {
    let Some(path) = env::var_os("CHIP_FIRMWARE_ELF") else {
        return;
    };
    let bytes = fs::read(path).expect("the firmware can be read");
    let file = object::File::parse(&*bytes).expect("the firmware is an ELF file");
    let data = file.section_by_name(".data").expect("there is such data");
    assert!((1..=4096).contains(&data.size()), "{} bytes", data.size());
}

/// Names of functions of the `RepRap` dialect, and the answers in it that constants hold.
fn of_reprap<'a>(functions: impl Iterator<Item = &'a str>, constants: &[u8]) -> Vec<&'a str> {
    let is_of_reprap = |name: &&str| REPRAP_PATHS.iter().any(|path| name.contains(path));
    let is_held = |answer: &&str| {
        let mut parts = constants.windows(answer.len());
        parts.any(|part| part == answer.as_bytes())
    };
    let answers = REPRAP_ANSWERS.into_iter().filter(is_held);
    functions.filter(is_of_reprap).chain(answers).collect()
}

#[test]
fn nothing_of_the_reprap_dialect_is_in_firmware_without_its_feature() {
    let Some(path) = env::var_os("CHIP_FIRMWARE_ELF") else {
        return;
    };
    let bytes = fs::read(path).expect("the firmware can be read");
    let file = object::File::parse(&*bytes).expect("the firmware is an ELF file");
    let functions = { file.symbols() }.filter(|symbol| symbol.kind() == SymbolKind::Text);
    let names = functions.map(|symbol| symbol.name().expect("symbols have names"));
    let constants = file.section_by_name(".rodata").expect("there are such");
    let constants = constants.data().expect("sections can be read");
    assert_eq!(of_reprap(names, constants), [""; 0]);
}

#[test]
fn what_is_of_the_reprap_dialect_is_found() {
    let names = [
        "leadscrew::gcode::reprap::read",
        "leadscrew::protocol::reprap::commands::home",
        "leadscrew::protocol::session::Session::read_reprap",
        "leadscrew::protocol::checked_lines::CheckedLines::take",
    ];
    assert_eq!(of_reprap(names.into_iter(), b"okT:echo:bus"), names[..3]);
    let sources = [
        include_str!("../../src/protocol/reprap/replies.rs"),
        include_str!("../../src/protocol/reprap/clock.rs"),
    ]
    .concat();
    for answer in REPRAP_ANSWERS {
        // An answer that has become another one would be looked for in vain.
        assert!(sources.contains(answer), "{answer}");
        let constants = format!("ok{answer}ok");
        assert_eq!(of_reprap([].into_iter(), constants.as_bytes()), [answer]);
    }
    let modules = [
        include_str!("../../src/gcode/mod.rs"),
        include_str!("../../src/protocol/mod.rs"),
    ]
    .concat();
    for path in REPRAP_PATHS {
        assert!(modules.contains(&format!("mod {path};")), "{path}");
    }
}
