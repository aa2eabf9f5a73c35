//! The image of the firmware: what runs while the flash is busy needs nothing that is in flash, no queues of zeros are
//! kept there, and nothing of what only the feature `reprap` asks for.
//!
//! Instructions: ARMv7-M reference manual, A5 and A7.

use std::{env, fs, ops::Range};

use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};

/// Addresses of the flash.
const FLASH: Range<u32> = 0x0800_0000..0x0820_0000;
/// Addresses of the memory in which data and such code are.
const RAM: Range<u32> = 0x2000_0000..0x2010_0000;

/// Names that functions of the RepRap dialect have in their paths: those of its modules.
const REPRAP_PATHS: [&str; 2] = ["reprap", "host_commands"];
/// Parts of answers in that dialect (src/protocol/replies.rs, src/protocol/session/host.rs).
const REPRAP_ANSWERS: [&str; 3] = ["FIRMWARE_NAME:", "; M999 to go on", "echo:busy: "];

/// Sign-extends the lowest bits of a word.
fn signed(word: u32, bits: u32) -> i32 {
    (word << (32 - bits)).cast_signed() >> (32 - bits)
}

/// What an instruction needs outside of its function, if anything; with the half-words that it has.
fn need(at: u32, first: u16, second: u16, function: &Range<u32>) -> (Option<String>, u32) {
    let [one, two] = [first, second].map(u32::from);
    let leaves = |offset: i32, what: &str| {
        let target = at.wrapping_add(4).wrapping_add_signed(offset);
        (!function.contains(&target)).then(|| format!("{at:#x}: {what} to {target:#x}"))
    };
    if one >> 11 < 0b11101 {
        // BLX to what a register holds.
        let is_call = one & 0xff87 == 0x4780;
        return (is_call.then(|| format!("{at:#x}: a call by a register")), 1);
    }
    let is_branch = one & 0xf800 == 0xf000;
    let found = if is_branch && two & 0x9000 == 0x9000 {
        // BL and B.W, encoding T4.
        let sign = one >> 10 & 1;
        let [j1, j2] = [two >> 13 & 1, two >> 11 & 1].map(|bit| 1 ^ bit ^ sign);
        let high = sign << 24 | j1 << 23 | j2 << 22 | (one & 0x3ff) << 12;
        let what = if two & 0x4000 == 0 {
            "a branch"
        } else {
            "a call"
        };
        leaves(signed(high | (two & 0x7ff) << 1, 25), what)
    } else if is_branch && two & 0xd000 == 0x8000 && one & 0x380 != 0x380 {
        // B.W with a condition.
        let high = (one >> 10 & 1) << 20 | (two >> 11 & 1) << 19 | (two >> 13 & 1) << 18;
        leaves(
            signed(high | (one & 0x3f) << 12 | (two & 0x7ff) << 1, 21),
            "a branch",
        )
    } else if one & 0xfbf0 == 0xf2c0 {
        // MOVT.
        let half = (one & 0xf) << 12 | (one >> 10 & 1) << 11 | (two >> 12 & 7) << 8 | two & 0xff;
        let is_flash = FLASH.contains(&(half << 16));
        is_flash.then(|| format!("{at:#x}: an address in flash"))
    } else {
        None
    };
    (found, 2)
}

/// Where the constant is that an instruction loads, if it does.
fn constant(at: u32, first: u16, second: u16) -> Option<u32> {
    let [one, two] = [first, second].map(u32::from);
    let base = (at + 4) & !3;
    match one {
        _ if one & 0xf800 == 0x4800 => Some(base + 4 * (one & 0xff)),
        0xf8df => Some(base + (two & 0xfff)),
        0xf85f => Some(base - (two & 0xfff)),
        _ => None,
    }
}

/// What the code of a function needs that is not in it.
fn needs(start: u32, code: &[u8]) -> Vec<String> {
    let function = start..start + code.len() as u32;
    let (pairs, _) = code.as_chunks::<2>();
    let halves: Vec<_> = pairs.iter().map(|pair| u16::from_le_bytes(*pair)).collect();
    let mut found = Vec::new();
    let mut index = 0;
    while let Some(&first) = halves.get(index) {
        let second = halves.get(index + 1).copied().unwrap_or_default();
        let at = start + 2 * index as u32;
        let (need, length) = need(at, first, second, &function);
        found.extend(need);
        if let Some(place) = constant(at, first, second) {
            let bytes = (place.checked_sub(start))
                .and_then(|from| code.get(from as usize..)?.first_chunk());
            match bytes.map(|bytes| u32::from_le_bytes(*bytes)) {
                Some(word) if !FLASH.contains(&word) => {}
                Some(word) => found.push(format!("the constant {word:#x}")),
                None => found.push(format!("{at:#x}: a constant at {place:#x}")),
            }
        }
        index += length as usize;
    }
    found
}

#[test]
fn code_in_ram_calls_and_reads_nothing_in_flash() {
    let Some(path) = env::var_os("FIRMWARE_ELF") else {
        return;
    };
    let bytes = fs::read(path).expect("the firmware can be read");
    let file = object::File::parse(&*bytes).expect("the firmware is an ELF file");
    let mut names = Vec::new();
    for symbol in file.symbols() {
        let start = (symbol.address() & !1) as u32;
        if symbol.kind() != SymbolKind::Text || !RAM.contains(&start) || symbol.size() == 0 {
            continue;
        }
        let section = symbol.section_index().expect("code is in a section");
        let section = file.section_by_index(section).expect("it is there");
        let code = section.data_range(start.into(), symbol.size());
        let code = code
            .expect("sections can be read")
            .expect("the code is in its section");
        let name = symbol.name().expect("symbols have names");
        assert_eq!(needs(start, code), [""; 0], "{name}");
        names.push(name.to_owned());
    }
    for function in ["erase", "program"] {
        assert!(
            names.iter().any(|name| name.contains(function)),
            "{function} is not in RAM: {names:?}"
        );
    }
}

#[test]
fn initial_values_of_data_take_4_kib_of_the_flash_at_most() {
    let Some(path) = env::var_os("FIRMWARE_ELF") else {
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
    let Some(path) = env::var_os("FIRMWARE_ELF") else {
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
        "leadscrew::protocol::session::host_commands::home",
        "leadscrew::protocol::session::Session::read_reprap",
        "leadscrew::protocol::session::host_lines::take_raw",
    ];
    assert_eq!(of_reprap(names.into_iter(), b"okT:echo:bus"), names[..3]);
    let sources = [
        include_str!("../../src/protocol/replies.rs"),
        include_str!("../../src/protocol/session/host.rs"),
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
        include_str!("../../src/protocol/session.rs"),
    ]
    .concat();
    for path in REPRAP_PATHS {
        assert!(modules.contains(&format!("mod {path};")), "{path}");
    }
}

#[test]
fn code_that_needs_the_flash_is_found() {
    for (code, expected) in [
        // BL and B.W to 0x0800_0000 are beyond their reach: to what is before and behind the function.
        (&[0xf7ff, 0xfffc][..], Some("a call to 0x20000ffc")),
        (&[0xf000, 0xb800], Some("a branch to 0x20001004")),
        (&[0xf43f, 0xaffc], Some("a branch to 0x20000ffc")),
        (&[0x4798], Some("a call by a register")),
        (&[0xf6c0, 0x0100], Some("an address in flash")),
        (
            &[0x4800, 0xbf00, 0x1234, 0x0801],
            Some("the constant 0x8011234"),
        ),
        (
            &[0xf8df, 0x0000, 0x1234, 0x0801],
            Some("the constant 0x8011234"),
        ),
        (&[0x4801, 0xbf00], Some("a constant at 0x20001008")),
        (&[0x4800, 0xbf00, 0x1234, 0x2001], None),
        // MOVW R8, #0x1004.
        (&[0xf241, 0x0804], None),
        // NOP, a branch to itself, MOVT #0x2000, DSB, BX LR.
        (&[0xbf00, 0xe7fe], None),
        (&[0xf2c2, 0x0100], None),
        (&[0xf3bf, 0x8f4f, 0x4770], None),
    ] {
        let bytes: Vec<_> = code
            .iter()
            .flat_map(|half: &u16| half.to_le_bytes())
            .collect();
        let found = needs(0x2000_1000, &bytes);
        match expected {
            Some(text) => assert!(found.len() == 1 && found[0].ends_with(text), "{found:?}"),
            None => assert!(found.is_empty(), "{found:?}"),
        }
    }
}
