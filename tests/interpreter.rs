//! What lines do: offsets, units, arcs, program flow, and what a refused line leaves alone.

#![cfg(not(target_os = "none"))]

use leadscrew::{
    axis::{AXES, Axes, X, Y, Z},
    gcode::{Distance, LineError, Modal, Motion, Units, WorkCoordinates},
    interpreter::{Interpreter, Message, Outcome},
    planner::{Circle, Command, Coolant, Pace, Plane, Rotation, Spindle},
    settings::Settings,
    units::Nm,
};
use proptest::prelude::*;

const MM: i64 = Nm::PER_MM;

/// Sends one line.
fn send(machine: &mut Interpreter, line: &str) -> Result<Outcome, LineError> {
    let checked = machine.check(line.as_bytes(), &Settings::default())?;
    Ok(machine.commit(&checked))
}

/// The machine after lines that are all accepted.
fn after(lines: &[&str]) -> Interpreter {
    let mut machine = Interpreter::new();
    for line in lines {
        send(&mut machine, line).unwrap_or_else(|error| panic!("{line}: {error}"));
    }
    machine
}

/// The commands of the last of some lines.
fn commands(lines: &[&str]) -> Vec<Command> {
    let (last, before) = lines.split_last().unwrap();
    let mut machine = after(before);
    send(&mut machine, last).unwrap().commands.to_vec()
}

/// The error of the last of some lines.
fn error(lines: &[&str]) -> LineError {
    let (last, before) = lines.split_last().unwrap();
    let mut machine = after(before);
    let unchanged = machine.clone();
    let error = send(&mut machine, last).unwrap_err();
    assert_eq!(machine, unchanged, "{last}");
    error
}

/// A position in thousandths of a mm; axes beyond the third at 0.
fn um(x: i64, y: i64, z: i64) -> Axes<Nm> {
    Axes::from_fn(|axis| Nm([x, y, z].get(axis).copied().unwrap_or(0) * 1000))
}

fn line(target: Axes<Nm>, pace: Pace) -> Command {
    Command::Line {
        target: target.into(),
        pace,
        line: 0,
    }
}

fn circle_of(command: &Command) -> Circle {
    match command {
        Command::Arc { circle, .. } => *circle,
        other => panic!("{other:?} is no arc"),
    }
}

#[test]
fn a_move_has_target_pace_and_line_number() {
    assert_eq!(
        commands(&["N7 G1 X1.5 Y-2 F100".replace(' ', "").as_str()]),
        [Command::Line {
            target: um(1500, -2000, 0).into(),
            pace: Pace::Feed(100.0),
            line: 7,
        }]
    );
    assert_eq!(commands(&["X1"]), [line(um(1000, 0, 0), Pace::Rapid)]);
    assert_eq!(
        commands(&["G93G1X1F2"]),
        [line(um(1000, 0, 0), Pace::InverseTime(2.0))]
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
fn machine_coordinates_ignore_every_offset_and_incremental_distance() {
    let lines = ["G10L2P1X10", "G92Y5", "G43.1Z3", "G91", "G53G0X1Y2Z3"];
    assert_eq!(commands(&lines), [line(um(1000, 2000, 3000), Pace::Rapid)]);
}

#[test]
fn offsets_add_up() {
    let machine = after(&["G10L2P2X10", "G55", "G92Y-5", "G43.1Z3", "G0X1Y0Z2"]);
    assert_eq!(machine.work_offset(), um(10_000, 5_000, 3_000));
    assert_eq!(machine.position(), um(11_000, 5_000, 5_000));
    assert_eq!(machine.offsets().tool_length, Nm(3 * MM));
}

#[test]
fn a_reset_keeps_stored_offsets_and_the_position() {
    let lines = [
        "G10L2P1X1",
        "G91G20F5S6T7M3M8",
        "G43.1Z1",
        "G92X0",
        "G28.1",
        "G0X1",
    ];
    let mut machine = after(&lines);
    let position = machine.position();
    let stored = *machine.offsets();
    machine.reset();
    assert_eq!(*machine.modal(), Modal::default());
    assert_eq!(machine.position(), position);
    assert_eq!(machine.offsets().coordinates, stored.coordinates);
    assert_eq!(machine.offsets().g28, stored.g28);
    assert_eq!(machine.offsets().work, um(0, 0, 0));
    assert_eq!(machine.offsets().tool_length, Nm(0));
}

#[test]
fn g28_goes_by_way_of_the_target_and_moves_the_named_axes_only() {
    let lines = ["G0X1Y2Z3", "G28.1", "G0X10Y20Z30"];
    let all = commands(&[&lines[..], &["G28"]].concat());
    assert_eq!(all, [line(um(1000, 2000, 3000), Pace::Rapid)]);
    let named = commands(&[&lines[..], &["G91G28Z5"]].concat());
    let by_way_of = line(um(10_000, 20_000, 35_000), Pace::Rapid);
    let end = line(um(10_000, 20_000, 3_000), Pace::Rapid);
    assert_eq!(named, [by_way_of, end]);
}

#[test]
fn g28_1_stores_the_position_before_the_move_of_its_line() {
    let machine = after(&["G0X1", "G28.1X3", "G30.1"]);
    assert_eq!(machine.offsets().g28, um(1000, 0, 0));
    assert_eq!(machine.offsets().g30, um(3000, 0, 0));
    assert_eq!(machine.position(), um(3000, 0, 0));
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
            line(um(1000, 0, 0), Pace::Feed(10.0)),
            Command::Spindle {
                spindle: Spindle::Off,
                rpm: 0.0
            },
            Command::Coolant(Coolant::default()),
        ]
    );
    assert_eq!(
        commands(&["M0X1"]),
        [line(um(1000, 0, 0), Pace::Rapid), Command::Pause]
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
    assert_eq!(commands(&["M3S100", "S200"]), [turning(200.0)]);
    assert_eq!(commands(&["S200", "M3"]), [turning(200.0)]);
}

#[test]
fn program_end_restores_some_modes_and_keeps_the_rest() {
    let mut machine = after(&[
        "G10L2P2X5",
        "G0G55G20G91G18M3M8F10S20T3",
        "G43.1Z1",
        "G92X1",
    ]);
    let outcome = send(&mut machine, "M30").unwrap();
    assert_eq!(outcome.message, Some(Message::ProgramEnd));
    let modal = *machine.modal();
    assert_eq!(modal.motion, Motion::Linear);
    assert_eq!(modal.distance, Distance::Absolute);
    assert_eq!(modal.plane, Plane::Xy);
    assert_eq!(modal.coordinates, WorkCoordinates::G54);
    assert_eq!(modal.spindle, Spindle::Off);
    assert_eq!(modal.coolant, Coolant::default());
    assert_eq!(modal.units, Units::Inches);
    assert_eq!((modal.feed, modal.speed_rpm, modal.tool), (254.0, 20.0, 3));
    assert_eq!(machine.offsets().tool_length, Nm(Nm::PER_INCH));
    assert_ne!(machine.offsets().work, um(0, 0, 0));
}

#[test]
fn the_tool_stays_until_the_next_t_word() {
    assert_eq!(after(&["T3", "S100", "G0X1"]).modal().tool, 3);
    assert_eq!(after(&["T3", "T0"]).modal().tool, 0);
}

#[test]
fn lines_wait_for_rest_where_grbl_synchronises() {
    let machine = after(&["F100S100M3M8", "G55", "G43.1Z1"]);
    let waits = |line: &str, laser: bool| {
        let settings = Settings {
            laser,
            ..Settings::default()
        };
        let checked = machine.check(line.as_bytes(), &settings).unwrap();
        (checked.waits_for_rest(), checked.answers_when_done())
    };
    for line in [
        "", "G0X1", "G1X1", "G28", "G55", "M3S100", "M8", "T4", "G43.1Z1", "M1",
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
        "S200",
        "G1X1S200",
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
fn mist_needs_an_output() {
    assert_eq!(error(&["M7"]), LineError::Unsupported);
}

#[test]
fn a_probe_move_is_refused_after_all_its_checks() {
    for (line, error_of_line) in [
        ("G38.2", LineError::FeedUndefined),
        ("G38.2F10", LineError::NoAxisWords),
        ("G38.2Z0F10", LineError::InvalidTarget),
        ("G38.2Z-1F10P1", LineError::UnusedWords),
        ("G38.2Z-1F10", LineError::Unsupported),
    ] {
        assert_eq!(error(&[line]), error_of_line, "{line}");
    }
}

#[test]
fn what_an_axis_cannot_count_is_no_target() {
    // 250 steps/mm and a quarter of 2^31 steps.
    for text in [
        "X2147484",
        "X-2147484",
        "X99999999999999999999",
        "G20Z-90000000000000000",
        "G10L2P1X3000000",
        "G10L20P1X-3000000",
        "G92X3000000",
        "G43.1Z-3000000",
        "G2X1I3000000F1",
        "G2X1R3000000F1",
        "G2X0I-99999999999999999999F1",
    ] {
        assert_eq!(error(&[text]), LineError::InvalidTarget, "{text}");
    }
    assert!(send(&mut Interpreter::new(), "X2147483Y-2147483").is_ok());
    let far = ["G0X2000000", "G91", "X200000"];
    assert_eq!(error(&far), LineError::InvalidTarget);
    let offset = ["G10L2P1X2000000", "X200000"];
    assert_eq!(error(&offset), LineError::InvalidTarget);
}

#[test]
fn numbers_out_of_range_are_errors() {
    for (line, number) in [
        ("N10000001", 27),
        ("N99999999999999999999999", 27),
        ("T256", 38),
        ("T255.5", 38),
        ("T99999999999999999999999", 38),
        ("T-1", 4),
        ("G4P99999999", 39),
        ("G10L2P99999999999999999999X1", 29),
        ("G99999999999999999999", 20),
        ("M99999999999999999999", 23),
        ("G59.1", 23),
        ("G59.3", 23),
    ] {
        assert_eq!(error(&[line]).number(), number, "{line}");
    }
}

#[test]
fn a_full_circle_is_one_turn_back_to_the_start_in_every_plane() {
    for (plane, offset, along) in [
        (Plane::Xy, "I5", X),
        (Plane::Zx, "K5", Z),
        (Plane::Yz, "J5", Y),
    ] {
        let select = match plane {
            Plane::Xy => "G17",
            Plane::Zx => "G18",
            Plane::Yz => "G19",
        };
        for (command, rotation) in [
            ("G2", Rotation::Clockwise),
            ("G3", Rotation::CounterClockwise),
        ] {
            let text = format!("{select}{command}X0Y0Z0{offset}F10");
            let made = commands(&[&text]);
            let circle = circle_of(&made[0]);
            let mut centre = Axes::all(Nm(0));
            let (first, second, _) = plane.axes();
            centre[first] = circle.centre[0];
            centre[second] = circle.centre[1];
            assert_eq!(centre[along], Nm(5 * MM), "{text}");
            assert_eq!((circle.plane, circle.rotation), (plane, rotation), "{text}");
            assert_eq!(circle.turns, 1);
        }
    }
    // Grbl wants an axis word of the plane, even for a full circle.
    assert_eq!(error(&["G2I5F10"]), LineError::NoAxisWords);
    assert_eq!(error(&["G2Z1I5F10"]), LineError::NoAxisWordsInPlane);
}

#[test]
fn an_arc_without_a_radius_is_a_straight_move() {
    for text in [
        "G2X0Y0I0J0F10",
        "G2X0Y0Z-5I0J0F10",
        "G2X.004I0F10",
        "G2X.004I.004F10",
    ] {
        let made = commands(&[text]);
        assert!(
            matches!(made[..], [Command::Line { .. }]),
            "{text}: {made:?}"
        );
    }
}

#[test]
fn turns_are_whole_and_at_least_one() {
    let turns = |text: &str| circle_of(&commands(&[text])[0]).turns;
    assert_eq!(turns("G2X0I1F10"), 1);
    assert_eq!(turns("G2X0I1P1F10"), 1);
    assert_eq!(turns("G3X1R5Z-3P12F10"), 12);
    assert_eq!(error(&["G2X0I1P1.5F10"]), LineError::NotInteger);
    assert_eq!(error(&["G2X0I1P0F10"]), LineError::ValueOutOfRange);
    assert_eq!(error(&["G2X0I1P65536F10"]), LineError::ValueOutOfRange);
    assert_eq!(error(&["G1X0P1F10"]), LineError::UnusedWords);
}

#[test]
fn arcs_continue_only_with_a_new_centre() {
    assert_eq!(error(&["G2X10I5F10", "X20"]), LineError::NoOffsetsInPlane);
    assert_eq!(commands(&["G2X10I5F10", "X20I5"]).len(), 1);
}

#[test]
fn radius_and_offsets_exclude_each_other() {
    assert_eq!(error(&["G2X10R5I5F10"]), LineError::UnusedWords);
}

/// The angle of an arc in its own sense of rotation, 0 to 2 pi.
fn angle(circle: Circle, chord: [f64; 2]) -> f64 {
    let [i, j] = circle.centre.map(Nm::to_mm_f64);
    let (start, end) = ([-i, -j], [chord[0] - i, chord[1] - j]);
    let cross = start[0] * end[1] - start[1] * end[0];
    let dot = start[0] * end[0] + start[1] * end[1];
    let angle = cross.atan2(dot);
    let angle = match circle.rotation {
        Rotation::Clockwise => -angle,
        Rotation::CounterClockwise => angle,
    };
    angle.rem_euclid(std::f64::consts::TAU)
}

/// A coordinate as a program writes it.
fn decimal(nm: i64) -> String {
    let sign = if nm < 0 { "-" } else { "" };
    format!("{sign}{}.{:06}", nm.abs() / MM, nm.abs() % MM)
}

proptest! {
    #[test]
    fn increments_add_up_exactly(
        step in -20_000_000..20_000_000_i64,
        count in 1..400_i64,
        start in -1_000_000_000_000..1_000_000_000_000_i64,
    ) {
        let mut machine = after(&[&format!("G0X{}", decimal(start)), "G91"]);
        let text = format!("X{}", decimal(step));
        for _ in 0..count {
            send(&mut machine, &text).unwrap();
        }
        prop_assert_eq!(machine.position()[X], Nm(start + count * step));
    }

    #[test]
    fn setting_an_offset_makes_the_work_position_what_was_asked(
        position in -1_000_000_000..1_000_000_000_i64,
        wanted in -1_000_000_000..1_000_000_000_i64,
        length in -1_000_000_000..1_000_000_000_i64,
        system in 1..=6,
    ) {
        let before = [
            "G92Z1.5".to_owned(),
            "G10L2P3Z-7".to_owned(),
            format!("G43.1Z{}", decimal(length)),
            format!("G53G0Z{}", decimal(position)),
            format!("G{}", 53 + system),
        ];
        let before: Vec<&str> = before.iter().map(String::as_str).collect();
        for setting in ["G92", "G10L20P0", &format!("G10L20P{system}")] {
            let mut machine = after(&before);
            send(&mut machine, &format!("{setting}Z{}", decimal(wanted))).unwrap();
            let work = machine.position()[Z] - machine.work_offset()[Z];
            prop_assert_eq!(work, Nm(wanted), "{}", setting);
            prop_assert_eq!(machine.position()[Z], Nm(position));
        }
    }

    #[test]
    fn both_ends_of_a_radius_arc_are_on_its_circle(
        x in -500_000_000..500_000_000_i64,
        y in -500_000_000..500_000_000_i64,
        excess in 1.0..20.0_f64,
        is_long: bool,
        is_clockwise: bool,
    ) {
        prop_assume!(x != 0 || y != 0);
        let chord = [x, y].map(|nm| Nm(nm).to_mm_f64());
        let radius = chord[0].hypot(chord[1]) / 2.0 * excess + 1.0e-6;
        let sign = if is_long { "-" } else { "" };
        let command = if is_clockwise { "G2" } else { "G3" };
        let text = format!("{command}X{}Y{}R{sign}{radius:.6}F10", decimal(x), decimal(y));
        let circle = circle_of(&commands(&[&text])[0]);
        let [i, j] = circle.centre.map(Nm::to_mm_f64);
        let ends = [i.hypot(j), (chord[0] - i).hypot(chord[1] - j)];
        for end in ends {
            // Near a half circle the centre reacts strongly to the rounding of R to 1 nm.
            prop_assert!((end - radius).abs() <= 2.0e-6, "{} is not {}", end, radius);
        }
        let angle = angle(circle, chord);
        let is_near_half = (angle - std::f64::consts::PI).abs() < 1.0e-3;
        prop_assert!(is_near_half || (angle > std::f64::consts::PI) == is_long, "{}", angle);
    }

    #[test]
    fn a_tiny_radius_arc_is_never_a_full_circle(
        x in -3000..3000_i64,
        y in -3000..3000_i64,
        radius in 2_000_000..2_000_000_000_i64,
        is_clockwise: bool,
    ) {
        prop_assume!(x != 0 || y != 0);
        let command = if is_clockwise { "G2" } else { "G3" };
        let text = format!(
            "{command}X{}Y{}R{}F10", decimal(x), decimal(y), decimal(radius)
        );
        let circle = circle_of(&commands(&[&text])[0]);
        let angle = angle(circle, [x, y].map(|nm| Nm(nm).to_mm_f64()));
        prop_assert!(angle < 0.01, "{} turns by {}", text, angle);
    }

    #[test]
    fn random_bytes_never_panic(line in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut machine = after(&["F100"]);
        if let Ok(checked) = machine.check(&line, &Settings::default()) {
            machine.commit(&checked);
        }
    }

    #[test]
    fn a_refused_line_changes_nothing_and_an_accepted_one_stays_in_reach(
        lines in prop::collection::vec("([GMTFSNPRLXYZIJK](0|1|2|3|4|10|17|20|28|28\\.1|38\\.2|43\\.1|49|54|59|80|90|91|92|92\\.1|93|94|-?[0-9]{1,10}\\.?[0-9]{0,8})){0,6}", 1..20),
    ) {
        let farthest = Settings::default().farthest();
        let mut machine = Interpreter::new();
        for line in lines {
            let before = machine.clone();
            match send(&mut machine, &line) {
                Err(_) => prop_assert_eq!(&machine, &before),
                Ok(outcome) => {
                    for command in &outcome.commands {
                        if let Command::Line { target, .. } | Command::Arc { target, .. } = command {
                            for axis in 0..AXES {
                                prop_assert!(target.position[axis].0.abs() <= farthest[axis].0);
                            }
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn axes_beyond_the_third_are_degrees() {
    let letters = &["A", "B", "C"][..AXES - 3];
    for (index, letter) in letters.iter().enumerate() {
        let machine = after(&[&format!("G20G1X1{letter}-90.5F10")]);
        assert_eq!(machine.position()[X], Nm(Nm::PER_INCH));
        assert_eq!(machine.position()[3 + index], Nm(-90_500_000));
        assert_eq!(
            error(&[&format!("{letter}1{letter}2")]),
            LineError::RepeatedWord
        );
        let stored = after(&[&format!("G10L2P1{letter}7"), &format!("G0{letter}1")]);
        assert_eq!(stored.position()[3 + index], Nm(8_000_000));
    }
    for letter in &["A", "B", "C"][AXES - 3..] {
        assert_eq!(error(&[&format!("{letter}1")]), LineError::Unsupported);
    }
}
