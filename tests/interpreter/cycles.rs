//! Canned cycles: the moves of each hole, the levels between holes, what a line may leave out.

use leadscrew::{
    axis::Axes,
    gcode::{LineError, MotionMode, interpreter::Interpreter},
    model::{Command, FeedRate, OverrideSwitches},
    units::Nm,
};

use crate::support::{after, error, send};

/// A command as a short text: `R` for rapid and `F` for feed with the coordinates in mm.
fn text(command: &Command) -> String {
    let point = |target: &Axes<Nm>| {
        let axes = ["X", "Y", "Z"].iter().zip(target.iter());
        let words: Vec<_> = axes
            .map(|(letter, nm)| format!("{letter}{}", nm.to_mm()))
            .collect();
        words.join(" ")
    };
    match command {
        Command::Line {
            target, feed_rate, ..
        } => match feed_rate {
            FeedRate::Rapid => format!("R {}", point(&target.position)),
            FeedRate::Feed(feed) => format!("F{feed} {}", point(&target.position)),
            FeedRate::InverseTime(_) | FeedRate::Jog(_) => unreachable!(),
        },
        Command::Dwell { milliseconds } => format!("dwell {milliseconds}"),
        Command::Spindle { spindle, rpm } | Command::ReverseTap { spindle, rpm } => {
            format!("{spindle:?} {rpm}")
        }
        Command::Overrides(switches) if *switches == OverrideSwitches::NONE => {
            "overrides off".into()
        }
        Command::Overrides(_) => "overrides on".into(),
        Command::Pause | Command::ToolPause => "pause".into(),
        Command::Arc { .. }
        | Command::Probe { .. }
        | Command::Power(_)
        | Command::Speed(_)
        | Command::Coolant(_) => {
            unreachable!()
        }
    }
}

/// What the last of some lines drills, after moves of the others.
fn drilled(lines: &[&str]) -> Vec<String> {
    let (last, before) = lines.split_last().unwrap();
    let mut machine = Interpreter::new();
    for line in before {
        send(&mut machine, line).unwrap_or_else(|error| panic!("{line}: {error}"));
        while machine.next_drilling_command().is_some() {}
    }
    send(&mut machine, last).unwrap();
    std::iter::from_fn(|| machine.next_drilling_command())
        .map(|command| text(&command))
        .collect()
}

const START: [&str; 2] = ["F100", "G0Z10"];

fn drilled_from_start(lines: &[&str]) -> Vec<String> {
    drilled(&[&START, lines].concat())
}

const OUT: &str = "R X5 Y6 Z10";
const BOTTOM: &str = "F100 X5 Y6 Z-3";
/// Lines at Z 10, and what follows at `R`.
const STEPS: [(&str, &[&str]); 12] = [
    ("G81X5Y6Z-3R2", &[BOTTOM, OUT]),
    ("G82X5Y6Z-3R2P0.5", &[BOTTOM, "dwell 500", OUT]),
    (
        "G83X5Y6Z-3R2Q2",
        &[
            "F100 X5 Y6 Z0",
            "R X5 Y6 Z2",
            "R X5 Y6 Z0.254",
            "F100 X5 Y6 Z-2",
            "R X5 Y6 Z2",
            "R X5 Y6 Z-1.746",
            BOTTOM,
            OUT,
        ],
    ),
    ("G83X5Y6Z-3R2Q9P0.5", &[BOTTOM, "dwell 500", OUT]),
    ("G73X5Y6Z-3R2Q9P1", &[BOTTOM, "dwell 1000", OUT]),
    (
        "G73X5Y6Z-3R2Q2",
        &[
            "F100 X5 Y6 Z0",
            "R X5 Y6 Z0.254",
            "F100 X5 Y6 Z-2",
            "R X5 Y6 Z-1.746",
            BOTTOM,
            OUT,
        ],
    ),
    ("G85X5Y6Z-3R2", &[BOTTOM, "F100 X5 Y6 Z2", OUT]),
    (
        "M3S900G86X5Y6Z-3R2P1",
        &[BOTTOM, "dwell 1000", "Off 0", OUT, "Clockwise 900"],
    ),
    (
        "M4S900G88X5Y6Z-3R2P1",
        &[
            BOTTOM,
            "dwell 1000",
            "Off 0",
            "pause",
            "CounterClockwise 900",
        ],
    ),
    ("G89X5Y6Z-3R2P1", &[BOTTOM, "dwell 1000", "F100 X5 Y6 Z10"]),
    (
        "M3S900G84X5Y6Z-3R2",
        &[
            "overrides off",
            BOTTOM,
            "Off 0",
            "dwell 10",
            "CounterClockwise 900",
            "F100 X5 Y6 Z10",
            "Off 0",
            "dwell 10",
            "Clockwise 900",
            "overrides on",
        ],
    ),
    (
        "M4S900G74X5Y6Z-3R2P0.1",
        &[
            "overrides off",
            BOTTOM,
            "Off 0",
            "dwell 10",
            "Clockwise 900",
            "dwell 100",
            "F100 X5 Y6 Z10",
            "Off 0",
            "dwell 10",
            "CounterClockwise 900",
            "overrides on",
        ],
    ),
];

#[test]
fn every_cycle_has_its_steps() {
    for (line, steps) in STEPS {
        let expected = [&["R X5 Y6 Z10", "R X5 Y6 Z2"], steps].concat();
        assert_eq!(drilled_from_start(&[line]), expected, "{line}");
    }
}

#[test]
fn holes_are_joined_at_the_clear_level() {
    // G98: the level at which the first line began, whatever came in between.
    let lines = ["G98G81X1Z-1R2", "G99X2", "G98X3"];
    assert_eq!(drilled_from_start(&lines[..1])[0], "R X1 Y0 Z10");
    assert_eq!(
        drilled_from_start(&lines[..2]),
        ["R X2 Y0 Z10", "R X2 Y0 Z2", "F100 X2 Y0 Z-1", "R X2 Y0 Z2"]
    );
    assert_eq!(
        drilled_from_start(&lines),
        ["R X3 Y0 Z10", "R X3 Y0 Z2", "F100 X3 Y0 Z-1", "R X3 Y0 Z10"]
    );
    // A start below R is left straight up, before anything else, and R is the clear level then.
    assert_eq!(
        drilled(&["F100", "G0Z1", "G98G81X1Z-1R4"]),
        ["R X0 Y0 Z4", "R X1 Y0 Z4", "F100 X1 Y0 Z-1", "R X1 Y0 Z4"]
    );
    // Another motion mode in between begins anew.
    assert_eq!(
        drilled_from_start(&["G81X1Z-1R2", "G80", "G0Z5", "G81X2Z-1R2"])
            .last()
            .unwrap(),
        "R X2 Y0 Z5"
    );
}

#[test]
fn a_line_repeats_its_hole_by_increments() {
    assert_eq!(
        drilled(&["F100", "G0X1Y2Z10", "G91G99G81X4Y3Z-5R-4L2"]),
        [
            "R X5 Y5 Z10",
            "R X5 Y5 Z6",
            "F100 X5 Y5 Z1",
            "R X5 Y5 Z6",
            "R X9 Y8 Z6",
            "F100 X9 Y8 Z1",
            "R X9 Y8 Z6",
        ]
    );
    // Absolute: the same hole again. L does not stay.
    let lines = ["G99G81X1Z-1R2L2", "X3"];
    assert_eq!(drilled_from_start(&lines[..1]).len(), 6);
    assert_eq!(drilled_from_start(&lines).len(), 3);
}

/// The depths to which a program feeds, line by line.
fn bottoms(lines: &[&str]) -> Vec<String> {
    let fed = (1..=lines.len()).flat_map(|count| drilled_from_start(&lines[..count]));
    let fed = fed.filter(|step| step.starts_with('F'));
    fed.map(|step| step[step.find('Z').unwrap()..].to_owned())
        .collect()
}

#[test]
fn incremental_holes_have_their_levels_from_where_the_cycles_began() {
    for retract in ["G98", "G99"] {
        let first = format!("{retract}G91G81X1Z-3R-9");
        assert_eq!(bottoms(&[&first, "X1", "X1L2"]), ["Z-2"; 4], "{retract}");
        // `R` and the depth may change, and the cycle.
        assert_eq!(
            bottoms(&[&first, "X1R-8", "X1Z-5", "G82X1R-8Z-5P0", "G81X1R-9Z-3"]),
            ["Z-2", "Z-1", "Z-3", "Z-3", "Z-2"],
            "{retract}"
        );
        // The level is that before the first hole, also where that was under G90.
        let absolute = format!("{retract}G81X1Z-2R1");
        assert_eq!(
            bottoms(&[&absolute, "G91X1Z-3R-9", "X1", "G90X9Z-4R0"]),
            ["Z-2", "Z-2", "Z-2", "Z-4"],
            "{retract}"
        );
    }
    // Cycles that begin anew begin where the tool is then.
    assert_eq!(
        bottoms(&["G91G99G81X1Z-3R-9", "G80", "G81X1Z-1R0"]),
        ["Z-2", "Z0"]
    );
}

#[test]
fn each_hole_of_a_line_is_pecked() {
    for cycle in ["G83", "G73"] {
        let depths = |holes: usize| {
            let line = format!("{cycle}X5Z-5R-8Q2L{holes}");
            bottoms(&["G91", &line])
        };
        assert_eq!(depths(1), ["Z0", "Z-2", "Z-3"], "{cycle}");
        assert_eq!(depths(3).concat(), depths(1).concat().repeat(3), "{cycle}");
    }
}

#[test]
fn every_plane_has_its_depth() {
    assert_eq!(
        drilled(&["F100", "G18", "G0X1Y10Z3", "G99G81X5Z6Y-4R2"]),
        ["R X5 Y10 Z6", "R X5 Y2 Z6", "F100 X5 Y-4 Z6", "R X5 Y2 Z6"]
    );
    assert_eq!(
        drilled(&["F100", "G19", "G0X10Y1Z3", "G99G81Y5Z6X-4R2"]),
        ["R X10 Y5 Z6", "R X2 Y5 Z6", "F100 X-4 Y5 Z6", "R X2 Y5 Z6"]
    );
}

#[test]
fn rotation_and_offsets_apply_to_the_whole_cycle() {
    assert_eq!(
        drilled(&[
            "F100",
            "G10L2P1X10R90",
            "G43.1Z5",
            "G0X0Y0Z10",
            "G99G81X2Z-1R1"
        ]),
        [
            "R X10 Y2 Z15",
            "R X10 Y2 Z6",
            "F100 X10 Y2 Z4",
            "R X10 Y2 Z6"
        ]
    );
}

#[test]
fn inches_are_inches_for_every_word() {
    assert_eq!(
        drilled(&["G20F10", "G0Z1", "G99G73X1Z-1R0Q0.6"]),
        [
            "R X25.4 Y0 Z25.4",
            "R X25.4 Y0 Z0",
            "F254 X25.4 Y0 Z-15.24",
            "R X25.4 Y0 Z-14.986",
            "F254 X25.4 Y0 Z-25.4",
            "R X25.4 Y0 Z0",
        ]
    );
}

#[test]
fn the_position_afterwards_is_that_of_the_last_move() {
    for line in [
        "G81X5Z-3R2",
        "G88M3X5Z-3R2P0",
        "G91G81X2Z-3R-1L3",
        "G99G83X5Z-3R2Q1",
    ] {
        let mut machine = after(&START);
        send(&mut machine, line).unwrap();
        let last = std::iter::from_fn(|| machine.next_drilling_command())
            .filter_map(|command| match command {
                Command::Line { target, .. } => Some(target.position),
                _ => None,
            })
            .last();
        assert_eq!(last, Some(machine.position()), "{line}");
        assert_eq!(machine.next_drilling_command(), None);
    }
}

#[test]
fn a_cycle_stays_until_another_motion_mode() {
    let drills = |lines: &[&str]| !drilled_from_start(lines).is_empty();
    let first = "G81X1Z-1R2";
    for line in ["X2", "Y2", "Z-2", "R3", "G81"] {
        assert!(drills(&[first, line]), "{line}");
    }
    for line in ["F200", "S100", "M8", "G4P0", "G10L2P1R0", "G91", "N5"] {
        assert!(!drills(&[first, line]), "{line}");
    }
    let machine = after(&["F100", first]);
    assert!(matches!(machine.modal().motion, MotionMode::Cycle(cycle) if cycle.word() == "G81"));
    let ended = after(&["F100", first, "G1X9", "Y3"]);
    assert_eq!(ended.modal().motion, MotionMode::Linear);
    assert_eq!(
        error(&["F100", first, "G80", "X3"]),
        LineError::UnusedAxisWords
    );
}

#[test]
fn what_a_cycle_lacks_is_reported() {
    use LineError::{
        AxisCommandConflict, CycleNeedsFeedPerMinute, FeedUndefined, InvalidTarget,
        MachineCoordinatesMotion, MissingWord, ModalGroupViolation, NegativeValue, NotInteger,
        NotPositive, RetractBelowBottom, SpindleOff, ValueOutOfRange,
    };
    for (line, why) in [
        ("G81X5Z-1", MissingWord),
        ("G81X5R1", MissingWord),
        ("G83X5Z-1R1", MissingWord),
        ("G82X5Z-1R1", MissingWord),
        ("G83X5Z-1R1Q0", NotPositive),
        ("G83X5Z-1R1Q-1", NotPositive),
        ("G82X5Z-1R1P-1", NegativeValue),
        ("G81X5Z-1R1L0", NotPositive),
        ("G81X5Z-1R1L-1", NotPositive),
        ("G81X5Z-1R1L1.5", NotInteger),
        ("G81X5Z-1R1L256", ValueOutOfRange),
        ("G81X5Z-6R-7", RetractBelowBottom),
        ("G86X5Z-1R1P1", SpindleOff),
        ("G84X5Z-1R1", SpindleOff),
        ("G74X5Z-1R1", SpindleOff),
        ("M4S1G84X5Z-1R1", SpindleOff),
        ("M3S1G74X5Z-1R1", SpindleOff),
        ("G93G81X5Z-1R1F10", CycleNeedsFeedPerMinute),
        ("G53G81X5Z-1R1", MachineCoordinatesMotion),
        ("G28G81X5Z-1R1", AxisCommandConflict),
        ("G80G81X5Z-1R1", ModalGroupViolation),
        ("G1G81X5Z-1R1", AxisCommandConflict),
        ("G91G81X9000000Z-1R1L255", InvalidTarget),
    ] {
        assert_eq!(error(&["F100", line]), why, "{line}");
    }
    assert_eq!(error(&["G81X5Z-1R1"]), FeedUndefined);
    // The words of one cycle are not those of another.
    assert_eq!(error(&["F100", "G81X5Z-1R1", "G85X6"]), MissingWord);
}

#[test]
fn moves_in_the_plane_are_not_below_r_nor_below_the_level_between_holes() {
    use proptest::prelude::*;
    let cycles = vec![
        "G73Q0.7", "G81", "G82P0", "G83Q1.1", "G85", "G86P0", "G88P0", "G89P0", "G84",
    ];
    let hole = (
        prop::sample::select(cycles),
        (-9_i32..9, -9_i32..9, 0_i32..9, 0_u32..5),
        any::<[bool; 3]>(),
    );
    proptest!(crate::cases(100), |(holes in prop::collection::vec(hole, 1..8), level in -5..15)| {
        let mut machine = after(&["F100", "M3S100", &format!("G0Z{level}")]);
        let (mut is_continued, mut is_in_cycles) = (false, false);
        let mut initial_level = Nm(0);
        for (cycle, (x, r, deep, repeats), [is_incremental, is_g99, ends]) in holes {
            let distance = if is_incremental { "G91" } else { "G90" };
            let retract = if is_g99 { "G99" } else { "G98" };
            let bottom = if is_incremental { -deep } else { r - deep };
            let line = format!("{distance}{retract}{cycle}X{x}Y{x}Z{bottom}R{r}L{}", repeats + 1);
            let start = machine.position();
            let r = Nm::from_mm_f64(f64::from(r));
            if !is_in_cycles {
                initial_level = start[2];
            }
            let retract_level = if is_incremental { initial_level + r } else { r };
            // The tool may rise on the way to the next hole, from where it was between holes.
            let lowest = if is_continued { retract_level.min(start[2]) } else { retract_level };
            send(&mut machine, &line).unwrap();
            let corners: Vec<_> = machine.drilling_corners().collect();
            let mut position = start;
            while let Some(command) = machine.next_drilling_command() {
                let Command::Line { target, .. } = command else { continue };
                let target = target.position;
                if target[0] != position[0] || target[1] != position[1] {
                    prop_assert!(target[2] >= position[2], "{}: {:?}", line, target);
                    prop_assert!(target[2] >= retract_level, "{}: {:?}", line, target);
                    prop_assert!(position[2] >= lowest, "{}: {:?}", line, position);
                }
                for axis in 0..3 {
                    let all = corners.iter().map(|corner| corner[axis]);
                    let least = all.clone().min().unwrap().min(start[axis]);
                    prop_assert!((least..=all.max().unwrap().max(start[axis])).contains(&target[axis]));
                }
                position = target;
            }
            prop_assert_eq!(position, machine.position());
            is_continued = cycle != "G88P0" && !ends;
            is_in_cycles = !ends;
            if ends {
                send(&mut machine, "G80").unwrap();
            }
        }
    });
}
