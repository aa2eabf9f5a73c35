//! Ten configurations in Klipper's syntax, of the boards whose pins are known: the pins that come out are these.

use std::{
    fs,
    path::{Path, PathBuf},
};

use board_data::{Board, SignedPin, board_file};
use toml::{Table, Value};

/// A board, as tables of its pins have it: X first, those of further axes behind, `-` where there is none.
struct Known {
    file: &'static str,
    step: &'static str,
    direction: &'static str,
    /// Active low, all of them.
    enable: &'static str,
    limit: &'static str,
    probe: &'static str,
    /// The setting that inverts directions as the printer does.
    reversed: u32,
    /// Part, MHz of the crystal and KiB of the bootloader, where the firmware has the chip.
    completed: Option<(&'static str, u32, u32)>,
    /// The board of the project that has these pins.
    board: Option<&'static str>,
}

const KNOWN: [Known; 10] = [
    Known {
        file: "blackpill",
        step: "A0 A2 A4 A6",
        direction: "A1 A3 A5 A7",
        enable: "B0",
        limit: "^!B12 ^!B13 ^!B14 -",
        probe: "^!B15",
        reversed: 1 + 4 + 8,
        completed: None,
        board: None,
    },
    Known {
        file: "skr-pro",
        step: "E9 E11 E13 E14",
        direction: "F1 E8 C2 A0",
        enable: "F2 D7 C0 C3",
        limit: "^!B10 ^!E12 ^!G8 -",
        probe: "^!A1",
        reversed: 15,
        completed: Some(("F407ZG", 8, 32)),
        board: Some("btt-skr-pro-1.2"),
    },
    Known {
        file: "skr-2",
        step: "E2 D5 A15 D15 D11",
        direction: "E1 D4 A8 D14 D10",
        enable: "E3 D6 D1 C7 D13",
        limit: "^!C1 ^!C3 ^!C0 ^!C2 ^!C15",
        probe: "^!E4",
        reversed: 30,
        completed: Some(("F407VG", 8, 32)),
        board: Some("btt-skr-2"),
    },
    Known {
        file: "octopus",
        step: "F13 G0 F11 G4 F9",
        direction: "F12 G1 G3 C1 F10",
        enable: "F14 F15 G5 A0 G2",
        limit: "^!G6 ^!G9 ^!G10 ^!G11 ^!G12",
        probe: "^!B7",
        reversed: 31,
        completed: Some(("F446ZE", 12, 32)),
        board: Some("btt-octopus-1.1-f446"),
    },
    Known {
        file: "e3-rrf",
        step: "D5 D0 C6 D12",
        direction: "D4 A15 C7 D13",
        enable: "D7 D3 D14 D10",
        limit: "^C0 ^C1 ^C2 ^C3",
        probe: "C5",
        reversed: 15,
        completed: Some(("F407VG", 8, 32)),
        board: None,
    },
    Known {
        file: "robin-nano",
        step: "E3 E0 B5 D6 D15",
        direction: "E2 B9 B4 D3 A1",
        enable: "E4 E1 B8 B3 A3",
        limit: "^!A15 ^!D2 ^!C8 ^!C4 ^!E7",
        probe: "^!A5",
        reversed: 31,
        completed: Some(("F407VG", 8, 48)),
        board: None,
    },
    Known {
        file: "monster8",
        step: "C14 E5 E1 B5 D6",
        direction: "C13 E4 E0 B4 D5",
        enable: "C15 E2 B6 D7",
        limit: "^A14 ^A15 ^B13 - -",
        probe: "-",
        reversed: 31,
        completed: None,
        board: None,
    },
    Known {
        file: "spider",
        step: "E11 D8 D14 D5 E6",
        direction: "E10 B12 D13 D6 C13",
        enable: "E9 D9 D15 D4 E5",
        limit: "^!B14 - ^!A0 - -",
        probe: "^!A1",
        reversed: 31 - 8,
        completed: Some(("F446VE", 12, 32)),
        board: Some("fysetc-spider"),
    },
    Known {
        file: "flexi",
        step: "A3 C1 B8 D2 B14",
        direction: "C2 C0 C15 C12 B15",
        enable: "A14 A13",
        limit: "A5 B9 C13 B6 C14",
        probe: "~B7",
        reversed: 31,
        completed: Some(("F446RE", 25, 0)),
        board: None,
    },
    Known {
        file: "slb",
        step: "E2 E3 E4 E5 B10",
        direction: "E7 E8 E9 E10 E11",
        enable: "D4 C7 D3 C10",
        limit: "^!B5 ^!B9 ^!C13 ^!E6 ^!E14",
        probe: "^!C4",
        reversed: 31,
        completed: None,
        board: None,
    },
];

const AXES: [&str; 5] = ["X", "Y", "Z", "A", "B"];

fn root() -> &'static Path {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).parent();
    folder.expect("it is in the project")
}

fn printer(file: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/printers");
    folder.join(file).with_extension("cfg")
}

/// The skeleton that is made of a printer of the table.
fn skeleton(file: &str) -> String {
    board_file(&printer(file)).unwrap_or_else(|error| panic!("{error}"))
}

/// The texts of a key of the axes, `-` where an axis has none.
fn of_axes(skeleton: &Table, key: &str) -> String {
    let axes = skeleton["axes"].as_table().expect("axes are a table");
    let known = AXES.iter().filter_map(|axis| axes.get(*axis));
    let texts = known.map(|axis| axis.get(key).and_then(Value::as_str).unwrap_or("-"));
    texts.collect::<Vec<_>>().join(" ")
}

/// The pins of all enable outputs.
fn enables(skeleton: &Table) -> String {
    let common = skeleton["outputs"].get("enable").and_then(Value::as_str);
    let own = of_axes(skeleton, "enable");
    let all = own.split(' ').filter(|pin| *pin != "-").chain(common);
    let pins = all.map(|pin| pin.strip_prefix('!').expect("it is active low"));
    pins.collect::<Vec<_>>().join(" ")
}

#[test]
fn the_pins_of_ten_boards_come_out_as_their_tables_have_them() {
    for known in &KNOWN {
        let text = skeleton(known.file);
        let table: Table = text.parse().expect(known.file);
        assert_eq!(of_axes(&table, "step"), known.step, "{}", known.file);
        assert_eq!(
            of_axes(&table, "direction"),
            known.direction,
            "{}",
            known.file
        );
        assert_eq!(enables(&table), known.enable, "{}", known.file);
        assert_eq!(of_axes(&table, "limit"), known.limit, "{}", known.file);
        let probe = table["inputs"].get("probe").and_then(Value::as_str);
        assert_eq!(probe.unwrap_or("-"), known.probe, "{}", known.file);
        let reversed = format!(
            "# With $3={} directions are as in the printer.\n",
            known.reversed
        );
        assert!(text.contains(&reversed), "{text}");
    }
}

/// Adds what a skeleton asks for: by taking the comment from its lines.
fn complete(skeleton: &str, (chip, crystal_mhz, bootloader_kib): (&str, u32, u32)) -> String {
    let bootloader = format!("bootloader = {{ kib = {bootloader_kib}, file = \"firmware.bin\" }}");
    let mut lines = vec![
        ("chip", format!("chip = {chip:?}")),
        ("crystal_mhz", format!("crystal_mhz = {crystal_mhz}")),
        ("tx", "tx = \"A9\"".to_owned()),
        ("rx", "rx = \"A10\"".to_owned()),
    ];
    if bootloader_kib > 0 {
        lines.push(("bootloader", bootloader));
    }
    let mut text = skeleton.to_owned();
    for (key, new) in lines {
        let lead = format!("\n# {key} = ");
        let (before, rest) = text.split_once(&lead).expect("the skeleton asks for it");
        let (_, after) = rest.split_once('\n').expect("the line has an end");
        text = format!("{before}\n{new}\n{after}");
    }
    text
}

/// Reads a board's file of a name.
fn check(name: &str, text: &str) -> Result<Board, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("printers");
    fs::create_dir_all(&folder).expect("the target folder is writable");
    let file = folder.join(name).with_extension("toml");
    fs::write(&file, text).expect("the target folder is writable");
    Board::read(&file, root()).map_err(|fault| fault.to_string())
}

#[test]
fn a_completed_skeleton_is_a_board_without_a_fault() {
    for known in &KNOWN {
        let Some(facts) = known.completed else {
            continue;
        };
        let text = complete(&skeleton(known.file), facts);
        let board = check(known.file, &text).unwrap_or_else(|error| panic!("{error}\n{text}"));
        let wiring = board.wiring(board.most_axes()).expect("it has pins");
        let steps: Vec<_> = wiring.step.iter().map(ToString::to_string).collect();
        assert_eq!(steps.join(" ").replace('P', ""), known.step);
    }
}

#[test]
fn boards_of_the_project_have_the_pins_of_their_printers() {
    for known in &KNOWN {
        let (Some(name), Some(facts)) = (known.board, known.completed) else {
            continue;
        };
        let name_of_copy = format!("{}-of-the-project", known.file);
        // What is a second motor of the printer is another axis of the project's board.
        let skeleton = skeleton(known.file);
        let lines = skeleton.lines().filter(|line| !line.starts_with("Z2 ="));
        let lines: Vec<_> = lines.collect();
        let imported = check(&name_of_copy, &complete(&lines.join("\n"), facts));
        let imported = imported.unwrap_or_else(|error| panic!("{error}"));
        let own = Board::read(&Board::path(name, root()), root());
        let own = own.unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(
            imported.memory(3).flash_start,
            own.memory(3).flash_start,
            "{name}"
        );
        let [imported, own] = [&imported, &own].map(|board| board.wiring(3).expect("it has pins"));
        assert_eq!(imported.step, own.step, "{name}");
        assert_eq!(imported.direction, own.direction, "{name}");
        assert_eq!(imported.enable, own.enable, "{name}");
        assert!(!imported.inputs.is_empty());
        for (input, pin) in &imported.inputs {
            let of_own = own.inputs.iter().find(|(other, _)| other == input);
            let of_own: Option<&SignedPin> = of_own.map(|(_, pin)| pin);
            assert_eq!(Some(pin), of_own, "{name}: {}", input.key());
        }
    }
}

#[test]
fn a_pin_that_steps_too_slowly_is_told_by_the_check() {
    let text = complete(&skeleton("monster8"), ("F407VG", 8, 48));
    let error = check("monster8-completed", &text).expect_err("C14 is slow");
    assert!(error.contains("PC14 is too slow for steps"), "{error}");
}

#[test]
fn what_is_not_known_is_asked_for_and_what_is_left_over_is_told() {
    for (file, comments) in [
        (
            "skr-pro",
            &[
                "#   In \"make menuconfig\": STM32F407, 32KiB bootloader, 8 MHz crystal\n",
                "\nZ2 = { step = \"D15\", direction = \"E7\", enable = \"!A3\", limit = \"^!G5\" }  # [stepper_z1]\n",
                "#   B1: heater_pin of [extruder]\n#   D12: heater_pin of [heater_bed]\n#   C8: pin of [fan]\n",
                "#   A8: control_pin of [bltouch]\n",
                "#   C13: uart_pin of [tmc2208 stepper_x]\n",
            ][..],
        ),
        (
            "spider",
            &[
                "# Y has no switch, it is homed by tmc2209_stepper_y:virtual_endstop",
                "#   ^B13: diag_pin of [tmc2209 stepper_y]\n",
                "#   [extruder1]: head:gpio18 is no pin of this chip\n",
            ],
        ),
        (
            "flexi",
            &["\ndebug_pins = true\n", "# Y is enabled together with X.\n"],
        ),
        ("slb", &["# A is enabled together with Y.\n"]),
        ("skr-2", &["#   C13: pin of [output_pin motor_power]\n"]),
        (
            "octopus",
            &["#   A8: pin of [fan]\n#   A1: heater_pin of [heater_bed]\n"],
        ),
        ("monster8", &["\n# probe = \"?\"\n"]),
    ] {
        let text = skeleton(file);
        for comment in comments {
            assert!(text.contains(comment), "{comment}\n{text}");
        }
    }
}

/// Wrong configurations, and the line and the words of the error.
const WRONG: [(&str, usize, &str); 15] = [
    (
        "[stepper_x]\nstep_pin PA1\n",
        2,
        "neither [section] nor key: value",
    ),
    ("step_pin: PA1\n", 1, "`step_pin` is in no section"),
    (
        "[stepper_x\nstep_pin: PA1\n",
        1,
        "the bracket is not closed",
    ),
    (
        "[printer]\nkinematics: cartesian\n",
        1,
        "there is no [stepper_x]",
    ),
    (
        "[stepper_x]\n\ndir_pin: PA1\n",
        1,
        "[stepper_x] has no step_pin",
    ),
    (
        "[stepper_x]\nstep_pin: PA1\n",
        1,
        "[stepper_x] has no dir_pin",
    ),
    (
        "[stepper_x]\nstep_pin: P1.17\ndir_pin: PA0\n",
        2,
        "\"P1.17\" is neither a pin of an STM32",
    ),
    (
        "[stepper_x]\nstep_pin: PA16\ndir_pin: PA0\n",
        2,
        "\"PA16\" is neither",
    ),
    (
        "[stepper_x]\nstep_pin: !^PA1\ndir_pin: PA0\n",
        2,
        "one of ^ and ~, then !",
    ),
    (
        "[stepper_x]\nstep_pin: z:PA1\ndir_pin: PA0\n",
        1,
        "X has its motor at another chip, z:PA1",
    ),
    (
        "[board_pins]\naliases: a=PA1,\n  b\n[stepper_x]\n",
        3,
        "\"b\" is no alias",
    ),
    (
        "[board_pins]\naliases: a=PA1,\n  b=ar5\n[stepper_x]\nstep_pin: b\ndir_pin: a\n",
        3,
        "\"ar5\" is neither",
    ),
    (
        "[board_pins]\naliases: a=<GND>\n[stepper_x]\nstep_pin: PA1\ndir_pin: a\n",
        5,
        "a is no pin but reserved: <GND>",
    ),
    ("[printer]\n[include nothing.cfg]\n", 2, "cannot read"),
    ("[include wrong-14.cfg]\n", 1, "includes itself"),
];

#[test]
fn each_wrong_configuration_gives_one_error_with_its_line() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("wrong_printers");
    fs::create_dir_all(&folder).expect("the target folder is writable");
    for (number, (text, line, words)) in WRONG.iter().enumerate() {
        let name = format!("wrong-{number}.cfg");
        fs::write(folder.join(&name), text).expect("the target folder is writable");
        let error = board_file(&folder.join(&name)).expect_err(text).to_string();
        assert!(
            error.contains(&format!("{name}:{line}: ")),
            "{text}: {error}"
        );
        assert!(error.contains(words), "{text}: {error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
}

#[test]
fn an_error_in_an_included_file_names_that_file() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("included_printers");
    fs::create_dir_all(folder.join("parts")).expect("the target folder is writable");
    let whole = folder.join("printer.cfg");
    fs::write(&whole, "[include parts/*.cfg]\n").expect("the target folder is writable");
    fs::write(
        folder.join("parts/x.cfg"),
        "[stepper_x]\nstep_pin: no\ndir_pin: PA1\n",
    )
    .expect("the target folder is writable");
    let error = board_file(&whole)
        .expect_err("the pin is wrong")
        .to_string();
    assert!(error.contains("x.cfg:2: \"no\" is neither"), "{error}");
}
