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
        "sda = \"C7\"",
        "sda = \"C7\"\n[with_4_axes]\neeprom.kib = \"none\"\naxes.A = { step = \"C8\", direction = \"C9\" }",
        17,
        "a whole number is wanted here",
    ),
    (
        "sda = \"C7\"",
        "sda = \"C7\"\n[with_4_axes]\neeprom = \"flash\"",
        17,
        "an EEPROM is a table, [eeprom], or \"none\"",
    ),
    (
        "sda = \"C7\"",
        "sda = \"C7\"\n[with_4_axes]\neeprom = 16",
        17,
        "an EEPROM is a table, [eeprom], or \"none\"",
    ),
    // Both in one file, for the same axes.
    (
        "crystal_mhz = 12",
        "crystal_mhz = 12\neeprom = \"none\"",
        13,
        "duplicate key",
    ),
    (
        "sda = \"C7\"",
        "sda = \"C7\"\n[with_4_axes]\neeprom = \"none\"\neeprom.kib = 16",
        18,
        "cannot extend value of type string",
    ),
    (
        "[eeprom]\nkib = 8\nscl = \"C6\"\nsda = \"C7\"",
        "[with_4_axes]\neeprom = \"none\"",
        13,
        "there is no EEPROM here that `eeprom = \"none\"` could take away, with 4 axes",
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
    assert_eq!(board.features(3), ["chip-f446", "eeprom"]);
    let memory = board.memory(3);
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
        let features = board.features(board.most_axes());
        assert_eq!(features, ["chip-f446", "eeprom", "eeprom-4"]);
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
fn with_more_axes_the_settings_may_be_in_flash_and_the_pins_are_free() {
    let text = RIGHT
        .replace("kib = 8", "kib = 4")
        .replace("kib = 64", "kib = 32")
        .replace(
            "[eeprom]",
            "A = { step = \"C8\", direction = \"C9\" }\n[eeprom]",
        )
        + "[with_5_axes]\neeprom = \"none\"\naxes.B = { step = \"C6\", direction = \"C7\" }\n";
    let board = read("flash-5", &text).expect("nothing is wrong");
    assert_eq!(board.most_axes(), 5);
    assert_eq!(board.features(4), ["chip-f446", "eeprom", "eeprom-4"]);
    assert_eq!(board.features(5), ["chip-f446"]);
    let [four, five] = [4, 5].map(|axes| board.memory(axes));
    assert_eq!((four.journal, four.code_start), (None, None));
    assert_eq!(
        five.journal.map(|pages| pages.map(|page| page.sector)),
        Some([3, 4])
    );
    assert_eq!(five.code_start, Some(0x0802_0000));
    // A number of axes that the board has no pins for is refused elsewhere, and in words.
    assert_eq!(
        (board.memory(6), board.features(6)),
        (five, board.features(5))
    );
    assert!(rust(&board, 4).contains("eeprom: EepromPins"));
    assert!(rust(&board, 5).contains("journal: [JournalPage { sector: 3"));
}

#[test]
fn flash_that_has_no_room_for_the_settings_of_more_axes_is_told_with_the_axes() {
    let text = RIGHT.replace(
        "[eeprom]",
        "A = { step = \"C8\", direction = \"C9\" }\n[eeprom]",
    ) + "[with_4_axes]\neeprom = \"none\"\n";
    let error = read("no-room-4", &text).expect_err("no room in flash");
    assert!(
        error.contains("no-room-4.toml:4: 512 KiB of flash have no two sectors"),
        "{error}"
    );
    assert!(error.ends_with(", with 4 axes"), "{error}");
}

#[test]
fn a_board_like_another_may_lack_its_eeprom_or_its_bootloader() {
    read("model", &RIGHT.replace("kib = 64", "kib = 32")).expect("nothing is wrong");
    let board = read("without-it", "like = \"model\"\neeprom = \"none\"\n");
    let board = board.expect("nothing is wrong");
    assert_eq!(board.features(3), ["chip-f446"]);
    assert!(board.memory(3).journal.is_some());
    let board = read("at-the-start", "like = \"model\"\nbootloader.kib = 0\n");
    let memory = board.expect("nothing is wrong").memory(3);
    assert_eq!(
        (memory.flash_start, memory.flash_bytes),
        (0x0800_0000, 512 * 1024)
    );
}

/// A board like another one, with what differs, and the features with five axes or the line and the words of the error.
type Like<'a> = (&'a str, Result<&'a [&'a str], &'a str>);

/// Boards like the Spider: an EEPROM of 4 KiB, with five axes settings in flash.
const LIKE_SPIDER: &[Like<'_>] = &[
    ("", Ok(&["chip-f446"])),
    (
        "[with_5_axes.eeprom]\nkib = 16\n",
        Ok(&["chip-f446", "eeprom"]),
    ),
    ("[eeprom]\nkib = 16\n", Ok(&["chip-f446"])),
    ("eeprom = \"none\"\n", Ok(&["chip-f446"])),
    (
        "[with_5_axes]\neeprom.scl = \"none\"\n",
        Err(":3: \"none\" is no pin"),
    ),
    (
        "[with_5_axes]\neeprom.sda = \"B7\"\n",
        Err("an EEPROM of less than 8 KiB has room for the settings of 4 axes"),
    ),
    (
        "eeprom = \"none\"\n[with_5_axes.eeprom]\nkib = 16\n",
        Err(":4: `eeprom.scl` is missing"),
    ),
    (
        "eeprom = \"none\"\n[with_5_axes]\neeprom = \"none\"\n",
        Err(":4: there is no EEPROM here that `eeprom = \"none\"` could take away, with 5 axes"),
    ),
];

#[test]
fn the_nearer_file_says_whether_there_is_an_eeprom() {
    let boards = Path::new(env!("CARGO_MANIFEST_DIR"));
    let spider = fs::read_to_string(boards.join("fysetc-spider.toml")).expect("it is there");
    let at_uart = spider.replace("link = \"usb\"\n", "");
    read("spider", &at_uart).expect("nothing is wrong");
    for (number, (differs, expected)) in LIKE_SPIDER.iter().enumerate() {
        let text = format!("like = \"spider\"\n{differs}");
        let features = read(&format!("like-spider-{number}"), &text).map(|board| board.features(5));
        match (features, expected) {
            (Ok(features), Ok(expected)) => assert_eq!(features, *expected, "{differs}"),
            (Err(error), Err(words)) => assert!(error.contains(words), "{differs}: {error}"),
            (found, _) => panic!("{differs}: {found:?}"),
        }
    }
}

#[test]
fn what_a_nearer_file_took_away_does_not_come_back() {
    read("model-3", &RIGHT.replace("kib = 64", "kib = 32")).expect("nothing is wrong");
    read("lacks-it", "like = \"model-3\"\neeprom = \"none\"\n").expect("nothing is wrong");
    let board = read("lacks-it, too", "like = \"lacks-it\"\n").expect("nothing is wrong");
    assert_eq!(board.features(3), ["chip-f446"]);
    let whole = "like = \"lacks-it\"\n[eeprom]\nkib = 16\nscl = \"C8\"\nsda = \"C9\"\n";
    let board = read("has-one", whole).expect("nothing is wrong");
    assert_eq!(board.features(3), ["chip-f446", "eeprom"]);
    let part = "like = \"lacks-it\"\n[eeprom]\nkib = 16\n";
    let error = read("has-half", part).expect_err("its pins are void");
    assert!(
        error.contains("has-half.toml:3: `eeprom.scl` is missing"),
        "{error}"
    );
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
