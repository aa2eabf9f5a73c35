//! Motion, feeds, order of execution, program flow.

use leadscrew::{
    axis::{AXES, X, Y, Z},
    gcode::{Distance, LineError, MotionMode, Units, interpreter::Message},
    model::{Command, Coolant, FeedRate, PathControl, Plane, Spindle, WorkCoordinates},
    settings::Settings,
    units::Nm,
};

use crate::support::{after, commands, error, line, send, um};

#[test]
fn a_move_has_target_pace_and_line_number() {
    assert_eq!(
        commands(&["N7 G1 X1.5 Y-2 F100".replace(' ', "").as_str()]),
        [Command::Line {
            target: um(1500, -2000, 0).into(),
            feed_rate: FeedRate::Feed(100.0),
            line: 7,
        }]
    );
    assert_eq!(commands(&["X1"]), [line(um(1000, 0, 0), FeedRate::Rapid)]);
    assert_eq!(
        commands(&["G93G1X1F2"]),
        [line(um(1000, 0, 0), FeedRate::InverseTime(2.0))]
    );
}

#[test]
fn a_line_without_axis_words_does_not_move() {
    for text in [
        "", "G0", "G1F100", "F100", "N5", "G53", "G21", "M1", "G92.1",
    ] {
        assert_eq!(commands(&[text]), [], "{text}");
    }
}

#[test]
fn inches_are_exact() {
    let machine = after(&["G20G1X1Y0.00001Z-39.3F10"]);
    let [x, y, z] = [X, Y, Z].map(|axis| machine.position()[axis]);
    assert_eq!([x, y, z], [Nm(25_400_000), Nm(254), Nm(-998_220_000)]);
    assert_eq!(machine.modal().feed, 254.0);
    assert_eq!(machine.modal().units, Units::Inches);
}

#[test]
fn feed_after_inverse_time_is_undefined() {
    assert_eq!(error(&["G1X1F100", "G93X2"]), LineError::FeedUndefined);
    assert_eq!(error(&["G93G1X1F100", "X2"]), LineError::FeedUndefined);
    assert_eq!(error(&["G93G1X1F100", "G94X2"]), LineError::FeedUndefined);
    let machine = after(&["G93G1X1F100", "G20G94X2F10"]);
    assert_eq!(machine.modal().feed, 254.0);
}

#[test]
fn a_feed_is_degrees_where_only_rotary_axes_move() {
    let feed = |lines: &[&str]| match commands(lines)[..] {
        [
            Command::Line {
                feed_rate: FeedRate::Feed(feed),
                ..
            }
            | Command::Arc {
                feed_rate: FeedRate::Feed(feed),
                ..
            }
            | Command::Probe {
                feed_rate: FeedRate::Feed(feed),
                ..
            },
        ] => feed,
        ref others => panic!("{lines:?}: {others:?}"),
    };
    for letter in &["A", "B", "C"][..AXES - 3] {
        let turn = |before: &str| feed(&[before, &format!("G1{letter}90")]);
        assert_eq!(turn("G21F100"), 100.0);
        assert_eq!(turn("G20F100"), 100.0);
        assert_eq!(feed(&[&format!("G20G1F100X0{letter}90")]), 100.0);
        assert_eq!(feed(&[&format!("G20G1F100X1{letter}90")]), 2540.0);
        // The value is as written, whatever unit comes after it.
        let changed = |first, second| feed(&[first, second, &format!("G1{letter}90")]);
        assert_eq!(changed("G20F100", "G21"), 100.0);
        assert_eq!(changed("G21F100", "G20"), 100.0);
        assert_eq!(changed("G20F100", "G21G1X5"), 100.0);
        assert_eq!(changed("G20F100", "G21F50"), 50.0);
        assert_eq!(feed(&["G20F100", "G21", "G1X5"]), 2540.0);
        // A full circle goes along linear axes, though it ends where it begins.
        assert_eq!(feed(&[&format!("G20G2X0I1F100{letter}90")]), 2540.0);
        assert_eq!(feed(&[&format!("G20G38.3F100{letter}90")]), 100.0);
    }
}

#[test]
fn commands_come_in_nist_order() {
    assert_eq!(
        commands(&["M2G1X1F10G4P0.0015M8M3S500"]),
        [
            Command::Spindle {
                spindle: Spindle::Clockwise,
                rpm: 500.0
            },
            Command::Coolant(Coolant {
                flood: true,
                mist: false
            }),
            Command::Dwell { milliseconds: 2 },
            line(um(1000, 0, 0), FeedRate::Feed(10.0)),
            Command::Spindle {
                spindle: Spindle::Off,
                rpm: 0.0
            },
            Command::Coolant(Coolant::default()),
        ]
    );
    assert_eq!(
        commands(&["M0X1"]),
        [line(um(1000, 0, 0), FeedRate::Rapid), Command::Pause]
    );
}

#[test]
fn the_spindle_gets_a_command_when_its_state_or_its_speed_changes() {
    assert_eq!(commands(&["S100"]), []);
    assert_eq!(commands(&["M3S100", "M3S100"]), []);
    let turning = |rpm| Command::Spindle {
        spindle: Spindle::Clockwise,
        rpm,
    };
    // A spindle that turns goes on turning.
    assert_eq!(commands(&["M3S100", "S200"]), [Command::Speed(200.0)]);
    assert_eq!(commands(&["M3S100", "M3S200"]), [Command::Speed(200.0)]);
    assert_eq!(commands(&["M3", "S200"]), [turning(200.0)]);
    assert_eq!(commands(&["M3S200", "S0"]), [turning(0.0)]);
    assert_eq!(commands(&["M4S100", "M3S200"]), [turning(200.0)]);
    assert_eq!(commands(&["S200", "M3"]), [turning(200.0)]);
}

#[test]
fn program_end_restores_some_modes_and_keeps_the_others() {
    let mut machine = after(&[
        "G10L2P2X5",
        "G0G55G20G91G18M3M8F10S20T3",
        "G43.1Z1",
        "G92X1",
    ]);
    let outcome = send(&mut machine, "M30").unwrap();
    assert_eq!(outcome.message, Some(Message::ProgramEnd));
    let modal = *machine.modal();
    assert_eq!(modal.motion, MotionMode::Linear);
    assert_eq!(modal.distance, Distance::Absolute);
    assert_eq!(modal.plane, Plane::Xy);
    assert_eq!(modal.coordinates, WorkCoordinates::G54);
    assert_eq!(modal.spindle, Spindle::Off);
    assert_eq!(modal.coolant, Coolant::default());
    assert_eq!(modal.units, Units::Inches);
    assert_eq!((modal.feed, modal.speed_rpm, modal.tool), (254.0, 20.0, 3));
    assert_eq!(machine.offsets().tool[Z], Nm(Nm::PER_INCH));
    assert_ne!(machine.offsets().work, um(0, 0, 0));
}

#[test]
fn the_tool_stays_until_the_next_t_word() {
    assert_eq!(after(&["T3", "S100", "G0X1"]).modal().tool, 3);
    assert_eq!(after(&["T3", "T0"]).modal().tool, 0);
}

#[test]
fn m61_tells_the_tool_in_the_spindle_which_survives_a_reset() {
    let mut machine = after(&["T7", "M61Q2"]);
    assert_eq!((machine.loaded_tool(), machine.modal().tool), (2, 7));
    machine.reset();
    assert_eq!((machine.loaded_tool(), machine.modal().tool), (2, 0));
    assert!(!send(&mut machine, "M61Q2").unwrap().shows_tool);
    assert!(send(&mut machine, "Q255M61X1F1").unwrap().shows_tool);
    assert_eq!(machine.loaded_tool(), 255);
    assert_eq!(error(&["M61M61Q1"]), LineError::ModalGroupViolation);
}

#[test]
fn lines_wait_for_standstill_where_grbl_synchronises() {
    let machine = after(&["F100S100M3M8", "G55", "G43.1Z1"]);
    let waits = |line: &str, laser: bool| {
        let settings = Settings {
            laser,
            ..Settings::default()
        };
        let checked = machine.check(line.as_bytes(), &settings).unwrap();
        (checked.waits_for_standstill(), checked.answers_when_done())
    };
    for line in [
        "", "G0X1", "G1X1", "G28", "G55", "M3S100", "M8", "T4", "G43.1Z1", "M1", "S200", "G1X1S200",
    ] {
        assert_eq!(waits(line, false), (false, false), "{line}");
    }
    for line in [
        "G10L2P3X1",
        "G28.1",
        "G30.1",
        "G92X1",
        "G92.1",
        "G54",
        "G43.1Z2",
        "G49",
        "M4",
        "M5",
        "M9",
        "S0",
        "G1X1S0",
    ] {
        assert_eq!(waits(line, false), (true, false), "{line}");
    }
    for line in ["G4P0", "G4P1X1", "M0", "M2", "M30"] {
        assert_eq!(waits(line, false), (true, true), "{line}");
    }
    // In laser mode the power follows the motion.
    assert_eq!(waits("G1X1S200", true), (false, false));
    assert_eq!(waits("M4", true), (true, false));
}

#[test]
fn what_moves_says_so() {
    let machine = after(&["F100"]);
    for (line, moves) in [
        ("", false),
        ("G0", false),
        ("X1", true),
        ("G28", true),
        ("G2X0I1", true),
        ("G92X1", false),
        ("G10L2P1X1", false),
        ("G28.1", false),
        ("G28.1X1", true),
    ] {
        let checked = machine
            .check(line.as_bytes(), &Settings::default())
            .unwrap();
        assert_eq!(checked.moves(), moves, "{line}");
    }
}

#[test]
fn path_control_is_modal_and_its_distances_are_in_the_units_of_the_line() {
    let path = |lines: &[&str]| after(lines).modal().path;
    let continuous = |tolerance_nm, merging_nm| PathControl::Continuous {
        tolerance_nm,
        merging_nm,
    };
    assert_eq!(path(&[]), PathControl::ExactPath);
    assert_eq!(path(&["G61.1", "G0X1"]), PathControl::ExactStop);
    assert_eq!(path(&["G61.1", "G61"]), PathControl::ExactPath);
    assert_eq!(path(&["G64"]), continuous(50_000, 0));
    assert_eq!(path(&["G64P0.02", "G0X1"]), continuous(20_000, 20_000));
    assert_eq!(path(&["G64P0.02Q.005"]), continuous(20_000, 5_000));
    assert_eq!(path(&["Q0P0.02G64"]), continuous(20_000, 0));
    assert_eq!(path(&["G20G64P0.001Q0.002"]), continuous(25_400, 50_800));
    assert_eq!(path(&["G64P0.02", "G64"]), continuous(50_000, 0));
    assert_eq!(path(&["G64P0.02", "M2"]), continuous(20_000, 20_000));
}

#[test]
fn a_p_word_belongs_to_every_command_of_its_line_that_takes_one() {
    let continuous = PathControl::Continuous {
        tolerance_nm: 2_000_000,
        merging_nm: 2_000_000,
    };
    let turns = |line: &str| {
        assert_eq!(after(&[line]).modal().path, continuous, "{line}");
        match commands(&[line])[..] {
            [Command::Arc { circle, .. }] => circle.turns,
            ref others => panic!("{line}: {others:?}"),
        }
    };
    assert_eq!(turns("G64P2G2X0I1F10"), 2);
    assert_eq!(turns("G3X0I1P2F10G64"), 2);
    let dwell = Command::Dwell { milliseconds: 2000 };
    for line in ["G64G4P2", "G4P2G64"] {
        assert_eq!(after(&[line]).modal().path, continuous, "{line}");
        assert_eq!(commands(&[line]), [dwell], "{line}");
    }
    let origin = after(&["G64G10L2P2X1"]);
    assert_eq!(origin.modal().path, continuous);
    assert_eq!(origin.offsets().origins.coordinates.0[1], um(1000, 0, 0));
}

#[test]
fn path_control_is_refused_where_it_makes_no_sense() {
    for (line, number) in [
        ("G64P-1", LineError::NegativeValue),
        ("G64Q-1", LineError::NegativeValue),
        ("G64P5000", LineError::ValueOutOfRange),
        ("G64.1", LineError::NotInteger),
        ("G61.2", LineError::Unsupported),
        ("G61G64", LineError::ModalGroupViolation),
        ("G61.1G61", LineError::ModalGroupViolation),
        ("G61P1", LineError::UnusedWords),
        ("G61.1Q1", LineError::Unsupported),
        ("Q1X1X1", LineError::Unsupported),
        ("Q1", LineError::Unsupported),
        ("G64Q1G4", LineError::MissingWord),
        ("G64G2X0I1F10P1.5", LineError::NotInteger),
        ("G64G0X1P1L2", LineError::UnusedWords),
    ] {
        assert_eq!(error(&[line]), number, "{line}");
    }
}

#[test]
fn every_digit_of_a_number_counts() {
    for text in ["X00000001.5", "X0000000001.500", "X1.5000000000"] {
        assert_eq!(
            commands(&[text]),
            [line(um(1500, 0, 0), FeedRate::Rapid)],
            "{text}"
        );
    }
    let far = commands(&["X123456.789"]);
    assert_eq!(far, [line(um(123_456_789, 0, 0), FeedRate::Rapid)]);
}

#[test]
fn a_dwell_is_programmed_in_milliseconds() {
    for (text, milliseconds) in [("G4P0.001", 1), ("G4P.05", 50), ("G4P4000", 4_000_000)] {
        assert_eq!(
            commands(&[text]),
            [Command::Dwell { milliseconds }],
            "{text}"
        );
    }
    assert_eq!(error(&["G4P4294968"]), LineError::ValueOutOfRange);
}

#[test]
fn a_feed_after_inverse_time_is_in_the_units_of_its_line() {
    for (lines, feed) in [
        (["G20G93", "G94G1X1F10"], 254.0),
        (["G93", "G94G1X1F10"], 10.0),
    ] {
        assert_eq!(after(&lines).modal().feed, feed, "{lines:?}");
    }
}
