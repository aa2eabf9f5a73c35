//! Boards whose settings are in an EEPROM.

use std::{
    fs,
    path::{Path, PathBuf},
};

use board_data::{Board, rust};

/// A board with which nothing is wrong, and a bootloader that leaves no room for settings in flash.
const RIGHT: &str = r#"name = "Right"
chip = "F446RE"
crystal_mhz = 12
bootloader = { kib = 64 }
[serial]
tx = "A9"
rx = "A10"
[axes]
X = { step = "B0", direction = "B1" }
Y = { step = "B2", direction = "B12" }
Z = { step = "B13", direction = "B14" }
[eeprom]
kib = 8
scl = "C6"
sda = "C7"
"#;

/// What is replaced by what, and the line and the words of the error.
const WRONG: &[(&str, &str, usize, &str)] = &[
    ("kib = 8", "kib = 2", 13, "an EEPROM of 4 to 64 KiB"),
    ("kib = 8", "kib = 128", 13, "an EEPROM of 4 to 64 KiB"),
    (
        "kib = 8\n",
        "",
        13,
        "`eeprom.kib` is missing: what the EEPROM holds",
    ),
    ("scl = \"C6\"\n", "", 13, "`eeprom.scl` is missing"),
    ("sda = \"C7\"\n", "", 13, "`eeprom.sda` is missing"),
    ("scl = \"C6\"", "scl = \"^C6\"", 14, "they are pulled up"),
    (
        "scl = \"C6\"",
        "scl = \"A9\"",
        14,
        "PA9 is serial.tx already",
    ),
    (
        "sda = \"C7\"",
        "sda = \"C6\"",
        15,
        "PC6 is eeprom.scl already",
    ),
    (
        "sda = \"C7\"",
        "sda = \"C7\"\naddress = 80",
        16,
        "`eeprom.address` is not known; known there are kib, scl, sda",
    ),
    (
        "crystal_mhz = 12",
        "crystal_mhz = 12\nqemu = \"netduinoplus2\"",
        4,
        "the emulator has no EEPROM",
    ),
];

/// Writes a file of a name, and reads it as a board.
fn read(name: &str, text: &str) -> Result<Board, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("eeprom");
    fs::create_dir_all(&folder).expect("the target folder is writable");
    let file: PathBuf = folder.join(name).with_extension("toml");
    fs::write(&file, text).expect("the target folder is writable");
    let root = root.expect("it is in the project");
    Board::read(&file, root).map_err(|fault| fault.to_string())
}

#[test]
fn an_eeprom_leaves_the_whole_flash_to_the_program() {
    let board = read("right", RIGHT).expect("nothing is wrong");
    assert_eq!(board.features(), ["chip-f446", "eeprom"]);
    let memory = board.memory;
    assert_eq!((memory.journal, memory.code_start), (None, None));
    assert_eq!(memory.flash_start, 0x0801_0000);
    assert_eq!(memory.flash_bytes, (512 - 64) * 1024);
    let wiring = board.wiring(3).expect("three axes");
    assert!(wiring.ports().contains(&2), "the clock of port C must run");
    let source = rust(&board, 3);
    assert!(
        source.contains("eeprom: EepromPins { clock: Pin::new('C', 6), data: Pin::new('C', 7) },")
    );
    assert!(!source.contains("journal"));
}

#[test]
fn a_small_eeprom_has_half_the_tools_and_four_axes() {
    let small = RIGHT.replace("kib = 8", "kib = 4");
    let four = small.replace(
        "[eeprom]",
        "A = { step = \"C8\", direction = \"C9\" }\n[eeprom]",
    );
    for (name, text) in [("small", &small), ("small-4", &four)] {
        let board = read(name, text).expect("nothing is wrong");
        assert_eq!(board.features(), ["chip-f446", "eeprom", "eeprom-4"]);
    }
    let five = four.replace(
        "[eeprom]",
        "B = { step = \"C10\", direction = \"C11\" }\n[eeprom]",
    );
    let error = read("small-5", &five).expect_err("five axes");
    let words = "small-5.toml:15: an EEPROM of less than 8 KiB has room for the settings of 4 axes";
    assert!(error.contains(words), "{error}");
    read("large-5", &five.replace("kib = 4", "kib = 8")).expect("nothing is wrong");
}

#[test]
fn without_an_eeprom_such_a_board_has_no_room_for_settings() {
    let (without, _) = RIGHT.split_once("[eeprom]").expect("it has one");
    let error = read("without", without).expect_err("no room");
    assert!(error.contains("without.toml:4: "), "{error}");
    assert!(error.contains("an EEPROM on the board has them"), "{error}");
}

#[test]
fn each_wrong_eeprom_gives_one_error_with_its_line() {
    for (number, (old, new, line, words)) in WRONG.iter().enumerate() {
        assert!(RIGHT.contains(old), "{old}");
        let name = format!("wrong-{number}");
        let error = read(&name, &RIGHT.replacen(old, new, 1)).expect_err(new);
        assert!(
            error.contains(&format!("{name}.toml:{line}: ")),
            "{new}: {error}"
        );
        assert!(error.contains(words), "{new}: {error}");
    }
}
