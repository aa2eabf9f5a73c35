//! Probing cycles at a virtual machine with a workpiece: what they find, and what ends them.

mod operated;

use grbl_client::client::{Command, Event, Probing, Target};
use operated::OperatedMachine;

/// The workpiece is a block, seen from where the tool is at power-up: its sides, its top, and a hole through it, mm.
const SIDES: [[f64; 2]; 2] = [[-3.012, 40.0], [-4.12, 30.0]];
const TOP: f64 = -5.3;
const HOLE: [f64; 3] = [20.208, 12.304, 8.0];
/// The radius of the tool.
const RADIUS: f64 = 1.5;

/// Whether a tool that is a cylinder touches the block.
fn touches([x, y, z]: [f64; 3]) -> bool {
    if z > TOP {
        return false;
    }
    let is_within = [x, y]
        .iter()
        .zip(SIDES)
        .all(|(at, [low, high])| (low - RADIUS..=high + RADIUS).contains(at));
    let [hole_x, hole_y, radius] = HOLE;
    // As a box: cycles touch along the axes.
    let is_in_hole = (x - hole_x).abs() < radius - RADIUS && (y - hole_y).abs() < radius - RADIUS;
    is_within && !is_in_hole
}

fn probing(target: Target) -> Probing {
    Probing {
        target,
        diameter: 2.0 * RADIUS,
        plate: 0.0,
        search: 15.0,
        retract: 1.0,
        beside: 10.0,
        depth: 7.0,
        feed: 200.0,
    }
}

/// A machine that is fast enough, with the block.
fn operated() -> OperatedMachine {
    let mut operated = OperatedMachine::new(&["$110=2000", "$111=2000", "$112=2000"]);
    operated.touches = Some(touches);
    operated
}

/// Moves the tool to a place from where it was switched on.
fn go(operated: &mut OperatedMachine, [x, y, z]: [f64; 3]) {
    operated.ask(&format!("G21G90G53G0Z{z}"));
    operated.ask(&format!("G53G0X{x}Y{y}"));
    operated.run(500);
    operated.await_state("Idle");
}

/// The last note.
fn note(operated: &OperatedMachine) -> String {
    let mut notes = operated.events.iter().rev();
    let note = notes.find_map(|event| match event {
        Event::Note { text } => Some(text.clone()),
        _ => None,
    });
    note.unwrap_or_default()
}

/// Begins a cycle, and runs to its end.
fn probe(operated: &mut OperatedMachine, probing: Probing) -> String {
    operated.command(Command::Probe { probing });
    operated.run(100);
    while operated.client.state().is_probing {
        operated.run(100);
    }
    operated.run(500);
    note(operated)
}

/// The work zero of axes is at places, to a step.
fn check(operated: &OperatedMachine, zero: [Option<f64>; 3]) {
    let state = operated.client.state();
    for (axis, zero) in zero.into_iter().enumerate() {
        let found = state.machine[axis] - state.work[axis];
        let zero = zero.unwrap_or_default();
        assert!(
            (found - zero).abs() < 0.0051,
            "{axis}: {found}, not {zero}, {state:?}"
        );
    }
}

#[test]
fn the_top_is_found_below_a_plate_and_modes_are_as_before() {
    let mut operated = operated();
    operated.ask("G20G91G1F7");
    let note = probe(
        &mut operated,
        Probing {
            plate: 1.2,
            ..probing(Target::Top)
        },
    );
    assert!(note.starts_with("zero at machine Z-6.5"), "{note}");
    check(&operated, [None, None, Some(TOP - 1.2)]);
    let modes = &operated.client.state().modes;
    for word in ["G20", "G91", "G1", "F178"] {
        assert!(modes.contains(&word.to_owned()), "{word} {modes:?}");
    }
    let back = operated.place_mm()[2] - TOP;
    assert!((back - 1.0).abs() < 0.05, "{back}");
}

#[test]
fn a_fast_touch_is_left_before_the_second_one() {
    let mut operated = operated();
    let fast = Probing {
        feed: 2000.0,
        retract: 0.5,
        ..probing(Target::Top)
    };
    let note = probe(&mut operated, fast);
    assert!(note.starts_with("zero at machine Z-5.3"), "{note}");
    let back = operated.place_mm()[2] - TOP;
    assert!((back - 0.5).abs() < 0.02, "{back}");
}

#[test]
fn a_corner_is_found_from_above() {
    for with_top in [true, false] {
        let mut operated = operated();
        let target = Target::CornerOutside {
            side: [1, 1],
            with_top,
        };
        let note = probe(&mut operated, probing(target));
        assert!(note.starts_with("zero at machine"), "{note}");
        check(
            &operated,
            [
                Some(SIDES[0][0]),
                Some(SIDES[1][0]),
                with_top.then_some(TOP),
            ],
        );
    }
}

#[test]
fn centres_are_found_from_within_and_from_above() {
    let mut operated = operated();
    go(&mut operated, [18.0, 14.0, 0.0]);
    go(&mut operated, [18.0, 14.0, -7.0]);
    let note = probe(&mut operated, probing(Target::Hole));
    assert!(
        note.contains("X 16.00") && note.contains("Y 16.00"),
        "{note}"
    );
    check(&operated, [Some(HOLE[0]), Some(HOLE[1]), None]);
    let at = operated.place_mm();
    assert!(
        (at[0] - HOLE[0]).abs() < 0.01,
        "it stands in the middle: {at:?}"
    );

    let mut operated = self::operated();
    go(&mut operated, [17.0, 14.0, 0.0]);
    let note = probe(
        &mut operated,
        Probing {
            beside: 28.0,
            ..probing(Target::Boss)
        },
    );
    let middle = |axis: usize| f64::midpoint(SIDES[axis][0], SIDES[axis][1]);
    assert!(note.starts_with("X 43.01"), "{note}");
    check(&operated, [Some(middle(0)), Some(middle(1)), None]);
}

#[test]
fn a_corner_is_found_from_within() {
    let mut operated = operated();
    go(&mut operated, [18.0, 14.0, 0.0]);
    go(&mut operated, [18.0, 14.0, -7.0]);
    probe(
        &mut operated,
        probing(Target::CornerInside { side: [-1, 1] }),
    );
    let [x, y, radius] = HOLE;
    check(&operated, [Some(x - radius), Some(y + radius), None]);
}

#[test]
fn a_tool_is_measured_against_the_reference() {
    let mut operated = operated();
    let note = probe(
        &mut operated,
        probing(Target::ToolLength { reference_mm: None }),
    );
    assert!(
        note.starts_with("reference tool: contact at machine Z -5.30"),
        "{note}"
    );
    go(&mut operated, [0.0, 0.0, 0.0]);
    let target = Target::ToolLength {
        reference_mm: Some(TOP - 2.0),
    };
    let note = probe(&mut operated, probing(target));
    assert!(note.starts_with("tool length 2.00"), "{note}");
    assert!(
        operated
            .ask("$#")
            .0
            .iter()
            .any(|line| line.starts_with("[TLO:2.00"))
    );
}

#[test]
fn what_is_not_as_it_should_be_ends_a_cycle_or_does_not_begin_it() {
    let mut operated = operated();
    let short = Probing {
        search: 3.0,
        ..probing(Target::Top)
    };
    let note = probe(&mut operated, short);
    assert!(note.starts_with("no contact in Z"), "{note}");
    assert!(operated.client.state().alarm.is_none());
    assert!(operated.client.state().modes.contains(&"G90".to_owned()));
    // Too near beside the block: the way down touches it.
    go(&mut operated, [0.0, 0.0, 0.0]);
    let near = Probing {
        beside: 3.5,
        ..probing(Target::CornerOutside {
            side: [1, 1],
            with_top: false,
        })
    };
    let note = probe(&mut operated, near);
    assert_eq!(note, "the probe has touched something on its way");
    check(&operated, [None; 3]);
    // It is on the block now.
    let note = probe(&mut operated, probing(Target::Top));
    assert!(note.starts_with("the probe is closed already"), "{note}");
    operated.touches = None;
    operated
        .machine
        .press(simulation::machine::Pin::Probe, false);
    operated.run(300);
    let note = probe(
        &mut operated,
        Probing {
            feed: f64::NAN,
            ..probing(Target::Top)
        },
    );
    assert_eq!(note, "the feed is NaN, and at least 1 is needed");
    operated.command(Command::Probe {
        probing: probing(Target::Top),
    });
    operated.await_state("Run");
    operated.command(Command::Stop);
    operated.run(2000);
    assert!(!operated.client.state().is_probing && operated.client.state().state == "Idle");
    let is_told =
        |event: &Event| matches!(event, Event::Note { text } if text.contains("was stopped"));
    assert!(operated.events.iter().any(is_told));
    operated.command(Command::Line {
        number: 1,
        text: "G1X5F100".into(),
    });
    operated.await_state("Run");
    let note = probe(&mut operated, probing(Target::Top));
    assert!(note.contains("has to be idle"), "{note}");
}

#[test]
fn a_line_that_a_cycle_keeps_out_is_answered_by_nothing() {
    let mut operated = touching();
    operated.command(Command::Line {
        number: 77,
        text: "$G".into(),
    });
    operated.run(100);
    let is_answer = |event: &Event| matches!(event, Event::Answer { number: 77, response, .. } if response.is_empty());
    assert!(operated.events.iter().any(is_answer));
}

/// A machine amid the first touch of a cycle, with modes of its own.
fn touching() -> OperatedMachine {
    let mut operated = operated();
    operated.ask("G20G90G1F7");
    operated.run(500);
    operated.command(Command::Probe {
        probing: probing(Target::Top),
    });
    operated.await_state("Run");
    operated
}

#[test]
fn the_modes_from_before_a_cycle_are_in_force_after_an_alarm_before_any_other_line() {
    let mut operated = touching();
    operated.await_state("Jog");
    // The probe stays closed: the second touch cannot begin.
    operated.touches = Some(|_| true);
    operated.await_state("Alarm");
    assert!(!operated.client.state().is_probing);
    operated.touches = None;
    operated
        .machine
        .press(simulation::machine::Pin::Probe, false);
    operated.events.clear();
    for (number, text) in [(1, "$X"), (2, "X0.1")] {
        operated.command(Command::Line {
            number,
            text: text.into(),
        });
    }
    operated.run(3000);
    // An inch is an inch, and absolute.
    assert!(
        (operated.place_mm()[0] - 2.54).abs() < 0.005,
        "{:?}",
        operated.place_mm()
    );
    let modes = &operated.client.state().modes;
    for word in ["G20", "G90", "G1", "F178"] {
        assert!(modes.contains(&word.to_owned()), "{word} {modes:?}");
    }
}

#[test]
fn a_cycle_that_a_reset_or_a_lost_line_ends_has_the_modes_in_force_told() {
    let mut operated = touching();
    operated.command(Command::Realtime { byte: 0x18 });
    operated.await_state("Alarm");
    operated.run(1000);
    let text = note(&operated);
    assert!(
        text.starts_with("the probing cycle did not come to its end: in force is G0 G54"),
        "{text}"
    );
    let mut operated = touching();
    operated.client.lose_line();
    operated.run(8000);
    let text = note(&operated);
    assert!(
        text.starts_with("the probing cycle did not come to its end: in force is G38.3"),
        "{text}"
    );
}

#[test]
fn a_turning_spindle_is_probed_with_by_nobody() {
    let mut operated = operated();
    operated.ask("M3S1000");
    operated.run(1500);
    let note = probe(&mut operated, probing(Target::Top));
    assert_eq!(note, "the spindle turns: stop it first");
}

#[test]
fn a_retract_stays_where_the_touch_began() {
    let mut operated = operated();
    go(&mut operated, [HOLE[0], HOLE[1], 0.0]);
    go(&mut operated, [HOLE[0], HOLE[1], -7.0]);
    let wide = Probing {
        retract: 9.0,
        ..probing(Target::Hole)
    };
    // The hole is 13 mm wide for the tool: behind 9 mm from the left is the right wall.
    let note = probe(&mut operated, wide);
    assert!(note.contains("X 16.00"), "{note}");
}

#[test]
fn inverse_time_is_no_feed_of_a_cycle() {
    let mut operated = operated();
    operated.ask("G93");
    let note = probe(&mut operated, probing(Target::Top));
    assert!(note.starts_with("zero at machine Z-5.3"), "{note}");
    assert!(operated.client.state().modes.contains(&"G93".to_owned()));
}

#[test]
fn the_motion_is_known_before() {
    let places = probing(Target::CornerOutside {
        side: [1, -1],
        with_top: false,
    })
    .places();
    assert_eq!(places.first(), Some(&[0.0; 3]));
    assert!(places.contains(&[5.0, 0.0, -7.0]), "{places:?}");
    assert!(places.contains(&[0.0, 10.0, -7.0]), "{places:?}");
    assert_eq!(places.last(), Some(&[0.0; 3]));
}
