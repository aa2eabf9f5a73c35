//! What post-processors write besides motion, read as their authors meant it.

use leadscrew::{
    gcode::{Flow, LineError, MotionMode, RetractMode, interpreter::LineCommands},
    model::{Command, FeedRate, OverrideSwitches, PathControl},
    units::Nm,
};

use crate::support::{after, commands, error, line, send, um};

#[test]
fn marks_and_numbers_of_programs_do_nothing() {
    for mark in ["%", "O1234", "O0", ":100"] {
        let mut machine = after(&["G1X1F100"]);
        let before = machine.clone();
        assert_eq!(
            send(&mut machine, mark).unwrap().commands.len(),
            0,
            "{mark}"
        );
        assert_eq!(machine, before, "{mark}");
    }
    for (text, number) in [
        ("O", 2),
        ("O100SUB", 20),
        ("O1.5", 20),
        ("O-1", 20),
        ("%1", 1),
        (":", 1),
        ("O100G0", 20),
        ("M98P100", 20),
        ("M99", 20),
        ("#1=5", 1),
        ("G0X[1+2]", 2),
    ] {
        assert_eq!(error(&[text]).number(), number, "{text}");
    }
}

#[test]
fn g80_beside_a_motion_mode_is_a_safe_start() {
    for (text, motion) in [
        ("G0G49G40G17G80G50G90", MotionMode::Rapid),
        ("G80G1", MotionMode::Linear),
        ("G80", MotionMode::Cancelled),
    ] {
        assert_eq!(after(&["G1F100", text]).modal().motion, motion, "{text}");
    }
    for text in [
        "G0G80X1",
        "X1G80G0",
        "G80G38.2Z-1F10",
        "G38.2G80Z-1F10",
        "G80G80",
    ] {
        assert_eq!(error(&[text]), LineError::ModalGroupViolation, "{text}");
    }
    for text in ["G80X1", "X1"] {
        assert_eq!(error(&["G80", text]), LineError::UnusedAxisWords, "{text}");
    }
}

#[test]
fn axis_words_after_g80_belong_to_the_command_that_uses_them() {
    let machine = after(&["G80", "G10L2P1X1", "G92Y2", "G43.1Z3", "G28X5"]);
    let offset = machine.work_offset(&machine.position());
    assert_eq!(offset, um(1000, -2000, 3000));
    assert_eq!(machine.modal().motion, MotionMode::Cancelled);
}

#[test]
fn the_axis_words_of_g28_and_g30_are_theirs_whatever_motion_mode_stands_beside() {
    let expected = [
        line(um(5000, 0, 10_000), FeedRate::Rapid),
        line(um(5000, 0, 0), FeedRate::Rapid),
    ];
    for text in [
        "G91G28Z5G0",
        "G0G91G28Z5",
        "G28G91Z5",
        "G1G91G28Z5",
        "Z5G30G0G91",
    ] {
        assert_eq!(commands(&["G0X5Z5", text]), expected, "{text}");
    }
    assert_eq!(after(&["G28G1Z5"]).modal().motion, MotionMode::Linear);
    for text in ["G2G28X1", "G28G38.2Z1F1", "G0G92X1", "G10L2P1X1G0"] {
        assert_eq!(error(&[text]), LineError::AxisCommandConflict, "{text}");
    }
}

#[test]
fn g49_stands_beside_a_move() {
    let machine = after(&["G43.1Z3", "G0G49Z5"]);
    assert_eq!(machine.position(), um(0, 0, 5000));
}

#[test]
fn modes_of_other_machines_are_taken_where_they_change_nothing() {
    let machine = after(&["G50", "G97S1000M3", "G99"]);
    assert_eq!(machine.modal().retract, RetractMode::ReferencePlane);
    assert_eq!(
        after(&["G99", "G98"]).modal().retract,
        RetractMode::InitialLevel
    );
    for text in ["G96S100", "G51", "G95"] {
        assert_eq!(error(&[text]), LineError::Unsupported, "{text}");
    }
    assert_eq!(error(&["G98G99"]), LineError::ModalGroupViolation);
}

#[test]
fn programs_switch_overrides() {
    let only_spindle = OverrideSwitches {
        feed: false,
        spindle: true,
    };
    for (lines, expected) in [
        (&["M49"][..], OverrideSwitches::NONE),
        (&["M49", "M48"], OverrideSwitches::ALL),
        (&["M50P0"], only_spindle),
        (&["M49", "M51"], only_spindle),
        (&["M49", "M51P1"], only_spindle),
        (&["M50P0", "M50P1"], OverrideSwitches::ALL),
        (&["M53P0"], OverrideSwitches::ALL),
        (&["M49", "M2"], OverrideSwitches::ALL),
    ] {
        assert_eq!(after(lines).modal().overrides, expected, "{lines:?}");
    }
    assert_eq!(
        commands(&["M49"]),
        [Command::Overrides(OverrideSwitches::NONE)]
    );
    assert_eq!(commands(&["M48"]), []);
    assert_eq!(error(&["M48M49"]), LineError::ModalGroupViolation);
    assert_eq!(error(&["M49P1"]), LineError::UnusedWords);
}

#[test]
fn m1_pauses_where_optional_stops_are_switched_on() {
    let mut machine = after(&[]);
    assert_eq!(send(&mut machine, "M1").unwrap().commands.to_vec(), []);
    machine.set_optional_stop(true);
    assert_eq!(
        send(&mut machine, "M1").unwrap().commands.to_vec(),
        [Command::Pause]
    );
    assert_eq!(Flow::default(), Flow::Run);
}

#[test]
fn g64_without_a_tolerance_keeps_to_the_setting_and_merges_nothing() {
    let path = |text: &str| after(&[text]).modal().path;
    let continuous = |tolerance_nm, merging_nm| PathControl::Continuous {
        tolerance_nm,
        merging_nm,
    };
    let default_nm = 50_000;
    assert_eq!(path("G64"), continuous(default_nm, 0));
    assert_eq!(path("G64P0"), continuous(default_nm, 0));
    assert_eq!(path("G64Q0.01"), continuous(default_nm, 10_000));
    assert_eq!(path("G64P0.2"), continuous(200_000, 200_000));
    assert_eq!(path("G20G64P0.001"), continuous(25_400, 25_400));
    let mut settings = leadscrew::settings::Settings::default();
    leadscrew::settings::assign(&mut settings, b"785=0").unwrap();
    let mut machine = after(&[]);
    let checked = machine.check(b"G64", &settings).unwrap();
    machine.commit(&checked, &mut LineCommands::default());
    assert_eq!(machine.modal().path, continuous(0, 0));
    assert_eq!(Nm::PER_MM, 1_000_000);
}
