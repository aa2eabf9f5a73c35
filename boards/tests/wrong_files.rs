//! Board files with one thing wrong each: one error, which names the line.

use std::{
    fs,
    path::{Path, PathBuf},
};

use board_data::Board;

/// A board with which nothing is wrong.
const RIGHT: &str = r#"name = "Right"
chip = "F446ZE"
crystal_mhz = 12
polled = ["axes.Z.limit"]
[serial]
tx = "A9"
rx = "A10"
[axes]
X = { step = "F13", direction = "F12", enable = "!F14", limit = "^!G6" }
Y = { step = "G0", direction = "G1", enable = "!F15", limit = "^!G9" }
Z = { step = "F11", direction = "G3", enable = "!G5", limit = "^!C9" }
A = { step = "F9", direction = "F10" }
[outputs]
pwm = "A8"
spindle = "D14"
flood = "A2"
[inputs]
probe = "^!B7"
reset = "^!F3"
[with_4_axes]
inputs.reset = "none"
[at_boot]
C13 = "high"
[labels]
F13 = "MOTOR0"
"#;

/// What is replaced by what, and the line and the words of the error. Where nothing is replaced, the line is put
/// before all others.
const WRONG: &[(&str, &str, usize, &str)] = &[
    (
        "",
        "link = \"serial\"\n",
        1,
        "the sender is at \"usb\" or at \"uart\", not at \"serial\"",
    ),
    (
        "chip = \"F446ZE\"",
        "chip = \"F466ZE\"",
        2,
        "chip \"F466ZE\" is not known",
    ),
    ("chip = \"F446ZE\"\n", "", 1, "`chip` is missing"),
    ("name = \"Right\"\n", "", 1, "`name` is missing"),
    ("\"Right\"", "\"A:1\"", 1, "ASCII without a colon"),
    (
        "crystal_mhz = 12",
        "crystal_mhz = 50",
        3,
        "a crystal has 4 to 26 MHz",
    ),
    (
        "crystal_mhz = 12",
        "crystal_mhz = \"12\"",
        3,
        "a whole number is wanted",
    ),
    (
        "crystal_mhz = 12\n",
        "",
        1,
        "`crystal_mhz` is missing: what is printed on the crystal",
    ),
    (
        "crystal_mhz = 12",
        "crystal_mhz = 12.5",
        3,
        "`crystal_mhz` cannot be a float: ",
    ),
    (
        "crystal_mhz = 12",
        "crystal_mhz = -12",
        3,
        "`crystal_mhz` cannot be -12: there are texts, whole numbers from 0 to 4294967295, ",
    ),
    (
        "crystal_mhz = 12",
        "crystal_mhz = [12]",
        3,
        "`crystal_mhz` cannot be a list of anything else: ",
    ),
    (
        "crystal_mhz = 12",
        "crystal_mhz = 12\ncristal = 8",
        4,
        "`cristal` is not known",
    ),
    ("crystal_mhz = 12", "crystal_mhz = 12 MHz", 3, ""),
    ("name = \"Right\"", "name = 5", 1, "a text is wanted"),
    (
        "tx = \"A9\"",
        "tx = \"A2\"",
        6,
        "not TX and RX of one USART: ",
    ),
    ("rx = \"A10\"\n", "", 1, "`serial.rx` is missing"),
    ("step = \"F13\"", "step = \"F16\"", 9, "is no pin"),
    ("step = \"F13\"", "step = \"K1\"", 9, "is no pin"),
    (
        "step = \"F13\"",
        "step = \"!F13\"",
        9,
        "`$2` and `$3` invert them",
    ),
    ("step = \"F13\"", "step = \"C14\"", 9, "too slow"),
    ("step = \"F13\"", "step = \"H0\"", 9, "the crystal"),
    ("step = \"F13\", ", "", 9, "`axes.X.step` is missing"),
    (
        "step = \"F13\"",
        "stap = \"F13\", step = \"F13\"",
        9,
        "`axes.X.stap` is not known; known there are step, direction, phases, enable, limit",
    ),
    (
        "step = \"F13\"",
        "step = \"I1\"",
        9,
        "this part has no pin PI1, it has A0-15, B0-15",
    ),
    (
        "direction = \"G1\"",
        "direction = \"F12\"",
        10,
        "PF12 is axes.X.direction already",
    ),
    (
        "enable = \"!F14\"",
        "enable = \"^!F14\"",
        9,
        "an output has no pull-up",
    ),
    ("limit = \"^!G6\"", "limit = \"^!A13\"", 9, "debug probe"),
    (
        "limit = \"^!G6\"",
        "limit = \"^!G7\"",
        9,
        "shares its interrupt line with inputs.probe",
    ),
    (
        "polled = [\"axes.Z.limit\"]",
        "polled = \"axes.Z.limit\"",
        4,
        "a list of texts",
    ),
    (
        "polled = [\"axes.Z.limit\"]",
        "polled = []",
        11,
        "shares its interrupt line with axes.Y.limit",
    ),
    (
        "polled = [\"axes.Z.limit\"]",
        "polled = [\"axes.Q.limit\"]",
        4,
        "`axes.Q.limit` is no input; inputs are axes.X.limit",
    ),
    (
        "pwm = \"A8\"",
        "pwm = \"D3\"",
        14,
        "no output of a timer that is free; those are PA6, PA7, PA8",
    ),
    ("pwm = \"A8\"", "pwm = \"!A8\"", 14, "the PWM has no sign"),
    ("C13 = \"high\"", "C13 = \"on\"", 23, "\"high\" or \"low\""),
    (
        "F13 = \"MOTOR0\"",
        "I13 = \"MOTOR0\"",
        25,
        "this part has no pin PI13",
    ),
    (
        "[labels]",
        "[bootloader]\nkib = 24\n[labels]",
        25,
        "begins at 24 KiB; sectors begin at 0, 16, 32, 48, 64, 128",
    ),
    (
        "[labels]",
        "[bootloader]\nkib = 64\n[labels]",
        25,
        "no two sectors for the settings",
    ),
    (
        "[labels]",
        "[bootloader]\nkib = 32\nfile = \"../firmware.bin\"\n[labels]",
        26,
        "the name of a file is wanted",
    ),
    (
        "[labels]",
        "[bootloader]\nkib = 4194304\n[labels]",
        25,
        "no sector of the flash begins at 4194304 KiB",
    ),
    (
        "[labels]",
        "[bootloader]\nkib = 4194303\n[labels]",
        25,
        "no sector of the flash begins at 4194303 KiB",
    ),
    (
        "[labels]",
        "[bootloader]\nfile = \"firmware.bin\"\n[labels]",
        25,
        "a file for a bootloader of 0 KiB",
    ),
    (
        "[labels]",
        "[bootloader]\nkib = 0\nfile = \"firmware.bin\"\n[labels]",
        26,
        "a file for a bootloader of 0 KiB",
    ),
    (
        "[labels]",
        "[bootloader]\nuf2 = 0x57755a57\n[labels]",
        25,
        "a file for a bootloader of 0 KiB",
    ),
    (
        "[labels]",
        "[bootloader]\nkib = 32\nuf2 = \"0x57755a57\"\n[labels]",
        26,
        "a whole number is wanted here",
    ),
    (
        "crystal_mhz = 12",
        "crystal_mhz = 12\ndfu = 1",
        4,
        "`true` or `false` is wanted here",
    ),
    (
        "crystal_mhz = 12",
        "crystal_mhz = 12\ndrive = true",
        4,
        "a text is wanted here",
    ),
    (
        "crystal_mhz = 12",
        "crystal_mhz = 12\nbootloader = 32",
        4,
        "a bootloader is a table, as in bootloader = { kib = 32, file = \"firmware.bin\" }",
    ),
    (
        "step = \"F13\", direction = \"F12\"",
        "step_pin = \"F13\", direction = \"F12\"",
        9,
        "`axes.X.step` is missing",
    ),
    (
        "A = { step = \"F9\"",
        "B = { step = \"F9\"",
        12,
        "`axes.A.step` is missing",
    ),
    (
        "A = { step = \"F9\"",
        "D = { step = \"F9\"",
        12,
        "axes are X, Y, Z, A, B, C",
    ),
    (
        "A = { step = \"F9\"",
        "A2 = { step = \"F9\"",
        12,
        "axes are X, Y, Z, A, B, C, second motors X2, Y2, Z2",
    ),
    (
        "A = { step = \"F9\", direction = \"F10\" }",
        "Y2 = { step = \"E2\" }",
        12,
        "`axes.Y2.direction` is missing",
    ),
    (
        "A = { step = \"F9\", direction = \"F10\" }",
        "Y2 = { step = \"E2\", direction = \"^E3\" }",
        12,
        "an output has no pull-up",
    ),
    (
        "A = { step = \"F9\", direction = \"F10\" }",
        "Y2 = { step = \"C14\", direction = \"E3\" }",
        12,
        "too slow",
    ),
    (
        "A = { step = \"F9\", direction = \"F10\" }",
        "Y2 = { step = \"E2\", direction = \"E3\", enable = \"!F15\" }",
        12,
        "PF15 is axes.Y.enable already",
    ),
    (
        "A = { step = \"F9\", direction = \"F10\" }",
        "Y2 = { step = \"E2\", direction = \"E3\", limit = \"D9\" }",
        12,
        "axes.Y2.limit (PD9) shares its interrupt line with axes.Y.limit (PG9)",
    ),
    (
        "A = { step = \"F9\", direction = \"F10\" }",
        "Y2 = { step = \"E2\", direction = \"E3\", home = \"D9\" }",
        12,
        "`axes.Y2.home` is not known; known there are step, direction, enable, limit",
    ),
    (
        "direction = \"F10\"",
        "direction = \"A8\"",
        14,
        "PA8 is axes.A.direction already, with 4 axes: what differs there can stand in [with_4_axes]",
    ),
    (
        "F13 = \"MOTOR0\"",
        "F13 = \"MOTOR0\"\nbootloader = { kib = 32 }",
        26,
        "`bootloader` belongs above the first [table]",
    ),
    (
        "[at_boot]",
        "[boot]",
        23,
        "`boot.C13` is not known; tables are serial, axes",
    ),
    (
        "limit = \"^!G6\"",
        "limit = \"!^G6\"",
        9,
        "one of ^ and ~, then !",
    ),
    (
        "rx = \"A10\"",
        "rx = \"A10\"\ndebug_pins = true",
        8,
        "`debug_pins` belongs above the first [table]",
    ),
    (
        "tx = \"A9\"\nrx = \"A10\"",
        "tx = \"A10\"\nrx = \"A9\"",
        6,
        "USART1 has TX on A9 or B6, RX on A10 or B7",
    ),
    (
        "name = \"Right\"",
        "name = \"Right\"\nlike = \"nothing\"",
        2,
        "there is no board \"nothing\"",
    ),
    (
        "step = \"F13\", direction = \"F12\"",
        "phases = [\"F13\", \"F12\", \"F10\"]",
        9,
        "`axes.X.phases` are the pins of IN1 to IN4, not 3",
    ),
    (
        "step = \"F13\", direction = \"F12\"",
        "phases = \"F13\"",
        9,
        "a list of texts is wanted",
    ),
    (
        "direction = \"F12\"",
        "phases = [\"F12\", \"F10\", \"E1\", \"E2\"]",
        9,
        "takes the place of `axes.X.step`",
    ),
    (
        "step = \"F13\", direction = \"F12\"",
        "phases = [\"F13\", \"F12\", \"F13\", \"E2\"]",
        9,
        "PF13 is axes.X.phases already",
    ),
    (
        "step = \"F13\", direction = \"F12\"",
        "phases = [\"F13\", \"F12\", \"E1\", \"E2\"]",
        10,
        "`axes.Y.phases` is missing",
    ),
];

/// A board whose motors are driven by phases, with which nothing is wrong.
const PHASES: &str = r#"name = "Phases"
chip = "F446ZE"
crystal_mhz = 12
[serial]
tx = "A9"
rx = "A10"
[axes]
X = { phases = ["E0", "E1", "E2", "E3"] }
Y = { phases = ["E4", "E5", "E6", "E7"] }
Z = { phases = ["E8", "E9", "E10", "F1"], limit = "^!C9" }
"#;

fn root() -> &'static Path {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    folder.parent().expect("it is in the project")
}

/// Writes a file of a name, and reads it as a board.
fn read(name: &str, text: &str) -> Result<Board, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("wrong_files");
    fs::create_dir_all(&folder).expect("the target folder is writable");
    let file: PathBuf = folder.join(name).with_extension("toml");
    fs::write(&file, text).expect("the target folder is writable");
    Board::read(&file, root()).map_err(|fault| fault.to_string())
}

#[test]
fn steps_and_directions_on_seven_ports_are_refused_by_name() {
    let text = RIGHT
        .replace("direction = \"F12\"", "direction = \"A3\"")
        .replace("direction = \"G1\"", "direction = \"B8\"")
        .replace("step = \"F11\"", "step = \"C1\"")
        .replace("step = \"F9\"", "step = \"D2\"")
        .replace("direction = \"F10\"", "direction = \"E2\"");
    let error = read("seven-ports", &text).unwrap_err();
    assert!(
        error.contains(
            "steps and directions are on 7 ports, A B C D E F G: put them on 6 at most, with 4 axes"
        ),
        "{error}"
    );
}

#[test]
fn a_file_without_a_fault_is_read() {
    let board = read("right", RIGHT).expect("nothing is wrong");
    assert_eq!(board.most_axes(), 4);
    let three = board.wiring(3).expect("three axes");
    assert_eq!((three.inputs.len(), three.enable.len()), (5, 3));
    assert_eq!(board.wiring(4).expect("four axes").inputs.len(), 4);
    assert_eq!(three.polled().len(), 1);
    assert!(board.wiring(5).is_none());
}

#[test]
fn motors_driven_by_phases_have_coils_and_nothing_else() {
    let board = read("phases", PHASES).expect("nothing is wrong");
    let wiring = board.wiring(3).expect("three axes");
    assert_eq!((wiring.axes(), wiring.phases.len()), (3, 3));
    assert_eq!(wiring.step_ports(), [4, 5]);
    assert_eq!(board.features(3), ["chip-f446", "phases"]);
    let right = read("steps", RIGHT).expect("nothing is wrong");
    assert_eq!(right.features(3), ["chip-f446"]);
    for (name, more, words) in [
        (
            "enabled",
            "[outputs]\nenable = \"!D1\"\n",
            "nothing to enable",
        ),
        (
            "more",
            "A = { limit = \"D1\" }\n",
            "`axes.A.phases` is missing",
        ),
        (
            "mixed",
            "A = { step = \"D1\" }\n",
            "`axes.A.phases` is missing",
        ),
    ] {
        let error = read(name, &format!("{PHASES}{more}")).expect_err(more);
        assert!(error.contains(words), "{error}");
    }
    let emulated = format!("qemu = \"netduinoplus2\"\n{PHASES}");
    let error = read("emulated", &emulated).expect_err("an emulator without phases");
    assert!(error.contains("emulated.toml:1: the emulator"), "{error}");
}

#[test]
fn an_axis_may_have_a_second_motor_with_a_switch_of_its_own() {
    let second = r#"Y2 = { step = "E2", direction = "!E3", enable = "!D4", limit = "^!G13" }"#;
    let text = RIGHT.replace("[outputs]", &format!("{second}\n[outputs]"));
    let board = read("second", &text).expect("a second motor");
    for axes in [3, 4] {
        let wiring = board.wiring(axes).expect("pins");
        assert_eq!(wiring.axes(), axes);
        let [motor] = wiring.second[..] else {
            panic!("{:?}", wiring.second);
        };
        assert_eq!((motor.axis, motor.step.to_string()), (1, "PE2".into()));
        assert!(motor.direction.is_active_low);
        assert_eq!(wiring.enable.len(), 4);
        assert_eq!(wiring.inputs[3].0.key(), "axes.Y2.limit");
        assert!(wiring.step_ports().contains(&motor.step.port));
    }
    assert!(board.features(3).contains(&"second-motors".into()));
    let plain = read("plain", RIGHT).expect("nothing wrong");
    assert!(!plain.features(3).contains(&"second-motors".into()));
    let phases = PHASES.replace("[axes]", &format!("[axes]\n{second}"));
    let error = read("both", &phases).expect_err("phases and a second motor");
    assert!(
        error.ends_with("an axis with `phases` has one motor"),
        "{error}"
    );
}

#[test]
fn a_second_motor_takes_the_driver_of_an_axis_that_the_board_gives_up() {
    let taken = r#"Y2 = { step = "F9", direction = "F10" }"#;
    let text = RIGHT.replace("[outputs]", &format!("{taken}\n[outputs]"));
    let error = read("taken", &text).expect_err("two functions of a pin");
    assert!(error.contains("is axes.A.step already"), "{error}");
    let text = text.replace("A = { step = \"F9\"", "A = { step = \"none\"");
    let board = read("given_up", &text).expect("three axes");
    assert_eq!(board.most_axes(), 3);
    assert_eq!(
        board.wiring(3).expect("pins").second[0].step.to_string(),
        "PF9"
    );
}

#[test]
fn a_machine_has_eleven_inputs_at_most() {
    let more = r#"hold = "G1"
start = "F2"
door = "E4"
[axes.X2]
step = "E0"
direction = "E7"
limit = "D5"
[axes.Y2]
step = "E2"
direction = "E3"
limit = "D8"
[axes.Z2]
step = "E8"
direction = "E11"
limit = "D11"
[with_4_axes]
axes.A.limit = "D14"
"#;
    let most = RIGHT
        .replace("direction = \"G1\"", "direction = \"G2\"")
        .replace("flood = \"A2\"\n", "")
        .replace("[with_4_axes]\ninputs.reset = \"none\"\n", more)
        .replace("spindle = \"D14\"\n", "");
    let error = read("twelve", &most).expect_err("12 inputs with four axes");
    assert!(error.contains("one input more than the 11"), "{error}");
    let eleven = most.replace("reset = \"^!F3\"\n", "");
    let board = read("eleven", &eleven).expect("11 inputs");
    assert_eq!(board.wiring(4).expect("pins").inputs.len(), 11);
}

#[test]
fn a_sender_at_the_usb_socket_takes_its_pins() {
    let usb = format!("link = \"usb\"\n{RIGHT}");
    let board = read("usb", &usb).expect("nothing is wrong");
    assert!(board.has_usb() && board.features(3).contains(&"usb".to_owned()));
    let at_uart = usb.replace("usb", "uart");
    let board = read("uart", &at_uart).expect("nothing is wrong");
    assert!(!board.has_usb() && !board.features(3).contains(&"usb".to_owned()));
    for pin in ["A11", "A12"] {
        let taken = usb.replace("spindle = \"D14\"", &format!("spindle = \"{pin}\""));
        let error = read("taken", &taken).expect_err("a pin has two functions");
        assert!(
            error.contains(&format!("P{pin} is link already")),
            "{error}"
        );
    }
    let emulated = format!("qemu = \"netduinoplus2\"\n{usb}");
    let error = read("emulated", &emulated).expect_err("the emulator has no USB");
    assert!(error.contains("the emulator has no USB"), "{error}");
}

#[test]
fn each_wrong_file_gives_one_error_with_its_line() {
    for (number, (old, new, line, words)) in WRONG.iter().enumerate() {
        assert!(RIGHT.contains(old), "{old}");
        let name = format!("wrong-{number}");
        let error = read(&name, &RIGHT.replacen(old, new, 1)).expect_err(new);
        assert!(
            error.contains(&format!("{name}.toml:{line}: ")),
            "{new}: {error}"
        );
        assert!(error.contains(words), "{new}: {error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
}

#[test]
fn a_board_like_another_one_takes_what_it_does_not_say() {
    read("model", RIGHT).expect("nothing is wrong");
    let like = "like = \"model\"\nname = \"Sister\"\noutputs.flood = \"A3\"\n";
    let sister = read("sister", like).expect("nothing is wrong");
    assert_eq!(sister.part_name, "F446ZE");
    let flood = sister.wiring(3).and_then(|wiring| wiring.flood);
    assert_eq!(
        flood.map(|signed| signed.pin.to_string()),
        Some("PA3".into())
    );
    let error = read("self", "like = \"self\"\n").expect_err("it is like itself");
    assert!(
        error.contains("self.toml:1: a board cannot be like itself"),
        "{error}"
    );
}

#[test]
fn each_board_of_the_project_is_read() {
    let boards = Board::all(root()).expect("nothing is wrong");
    assert!(boards.len() >= 2);
}

#[test]
fn settings_lie_where_no_program_does() {
    let with = |chip: &str, kib: u32| {
        let text = format!(
            "{}\n[bootloader]\nkib = {kib}\n",
            RIGHT.replace("F446ZE", chip)
        );
        read(&format!("memory-{chip}-{kib}"), &text)
            .expect("nothing is wrong")
            .memory(3)
    };
    let whole = with("F446ZE", 0);
    assert_eq!(
        whole.journal.map(|pages| pages.map(|page| page.sector)),
        Some([1, 2])
    );
    assert_eq!(
        (whole.flash_start, whole.code_start),
        (0x0800_0000, Some(0x0800_c000))
    );
    let behind = with("F446ZE", 32);
    assert_eq!(
        behind.journal.map(|pages| pages.map(|page| page.address)),
        Some([0x0800_c000, 0x0801_0000])
    );
    assert_eq!(
        (behind.flash_start, behind.code_start),
        (0x0800_8000, Some(0x0802_0000))
    );
    assert_eq!(behind.flash_bytes, (512 - 32) * 1024);
}

#[test]
fn a_bootloader_leaves_room_for_a_program_before_the_settings() {
    let eeprom = "[eeprom]\nkib = 16\nscl = \"B8\"\nsda = \"B9\"\n";
    for (chip, kib, eeprom, left) in [
        ("F407ZG", 512, "", Ok(256)),
        ("F407ZG", 640, "", Err(128)),
        ("F407ZG", 768, "", Err(0)),
        ("F407ZG", 896, "", Err(0)),
        ("F407ZG", 768, eeprom, Ok(256)),
        ("F407ZG", 896, eeprom, Err(128)),
        ("F446ZE", 256, eeprom, Ok(256)),
        ("F446ZE", 384, eeprom, Err(128)),
    ] {
        let right = RIGHT.replace("F446ZE", chip);
        let text = format!("{right}\n{eeprom}[bootloader]\nkib = {kib}\n");
        let name = format!("left-{chip}-{kib}-{}", eeprom.len());
        match (read(&name, &text), left) {
            (Ok(board), Ok(left)) => assert_eq!(board.memory(3).flash_bytes, left * 1024),
            (Err(error), Err(left)) => {
                let words = format!(
                    ": a bootloader of {kib} KiB leaves {left} KiB of {} for the program",
                    if chip == "F407ZG" { "1024" } else { "512" }
                );
                let line = text.lines().count();
                let place = format!("{name}.toml:{line}{words}");
                assert!(error.contains(&place), "{error}");
            }
            (found, _) => panic!("{name}: {found:?}"),
        }
    }
}

#[test]
fn without_the_bootloader_of_another_board_there_is_no_file_for_it() {
    let with = "bootloader = { kib = 32, file = \"firmware.bin\" }\n";
    let board = read("with-loader", &format!("{with}{RIGHT}")).expect("nothing is wrong");
    assert_eq!(board.bootloader_file.as_deref(), Some("firmware.bin"));
    for (name, like, more, file) in [
        ("no-loader", "with-loader", "bootloader.kib = 0", None),
        ("no-loader-either", "no-loader", "", None),
        (
            "small-loader",
            "with-loader",
            "bootloader.kib = 16",
            Some("firmware.bin"),
        ),
        (
            "other-file",
            "with-loader",
            "bootloader.file = \"other.bin\"",
            Some("other.bin"),
        ),
    ] {
        let board = read(name, &format!("like = \"{like}\"\n{more}\n")).expect(name);
        assert_eq!(board.bootloader_file.as_deref(), file, "{name}");
        assert_eq!(board.bootloader_kib == 0, file.is_none(), "{name}");
    }
    let uf2 = "bootloader = { kib = 32, uf2 = 0x57755a57 }\n";
    let board = read("uf2-loader", &format!("{uf2}{RIGHT}")).expect("nothing is wrong");
    assert_eq!(board.uf2_family, Some(0x5775_5a57));
    let board = read(
        "no-uf2-loader",
        "like = \"uf2-loader\"\nbootloader.kib = 0\n",
    );
    assert_eq!(board.expect("nothing is wrong").uf2_family, None);
    let text = "like = \"no-loader\"\nbootloader.file = \"firmware.bin\"\n";
    let error = read("file-only", text).expect_err("a file for nothing");
    assert!(error.contains("file-only.toml:2: a file for"), "{error}");
}

/// Boards of the project, and KiB of each sector with their settings, with the most axes that they have.
const SETTINGS_KIB: [(&str, [u32; 2]); 6] = [
    ("blackpill-f411", [16, 16]),
    ("nucleo-f446re", [16, 16]),
    ("netduino-plus-2", [16, 16]),
    ("fysetc-spider", [16, 64]),
    ("btt-skr-2", [128, 128]),
    ("btt-octopus-1.1-f429", [128, 128]),
];

#[test]
fn a_sector_has_the_size_of_the_chips() {
    for (name, expected) in SETTINGS_KIB {
        let board = Board::read(&Board::path(name, root()), root()).expect("nothing is wrong");
        let memory = board.memory(board.most_axes());
        let pages = memory.journal.expect("settings in flash");
        assert_eq!(
            pages.map(|page| page.bytes),
            expected.map(|kib| kib * 1024),
            "{name}"
        );
        // The second one follows the first one.
        assert_eq!(
            pages[0].address + pages[0].bytes,
            pages[1].address,
            "{name}"
        );
        assert_eq!(memory.last.bytes, 128 * 1024, "{name}");
    }
}

#[test]
fn the_last_sector_without_settings_is_one_that_a_program_may_have() {
    for board in Board::all(root()).expect("nothing is wrong") {
        for axes in 3..=board.most_axes() {
            let (memory, name) = (board.memory(axes), &board.name);
            let sectors = memory.journal.as_slice().as_flattened();
            assert!(!sectors.contains(&memory.last), "{name}");
            assert!(memory.is_flash(memory.last.address.into()), "{name}");
            // The sectors of all chips are of 128 KiB from here on; the program has all that are before it.
            assert!(memory.last.sector > 6, "{name}");
            assert!(memory.last.address >= 0x0806_0000, "{name}");
        }
    }
}

#[test]
fn a_chip_is_known_by_what_is_printed_on_it() {
    for printed in ["F446ZET6", "STM32F446ZET6", "STM32F446ZE"] {
        let text = RIGHT.replace("F446ZE", printed);
        let board = read("printed", &text).expect("nothing is wrong");
        assert_eq!(board.part_name, "F446ZE");
    }
}

#[test]
fn the_file_of_the_document_is_read() {
    let document = fs::read_to_string(root().join("docs/boards.md")).expect("it is there");
    let (_, rest) = document.split_once("```toml\n").expect("it has a file");
    let (text, _) = rest.split_once("```").expect("the file has an end");
    let board = read("document", text).expect("nothing is wrong");
    assert_eq!(board.title, "My board");
    assert_eq!(board.wiring(3).map(|wiring| wiring.inputs.len()), Some(8));
}
