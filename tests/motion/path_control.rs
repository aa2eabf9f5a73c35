//! Path control as the step pins show it: `G61`, `G61.1`, `G64`.

use crate::support::{Machine, Recording, Trace, add_steps, cases, check_limits, fast, stream};
use leadscrew::{axis::Axes, settings::Settings, sim::Simulator};
use proptest::prelude::*;

/// Streams a program of which no line is refused.
fn play(settings: &Settings, program: &str) -> Recording {
    let recording = stream(Simulator::new(settings), program, 1_000_000);
    assert!(recording.answers.iter().all(|answer| answer == "ok"));
    Trace::of(settings, &recording.edges).check_pulses();
    recording
}

/// The trace of a program.
fn traced(settings: &Settings, program: &str) -> Trace {
    Trace::of(settings, &play(settings, program).edges)
}

/// The steps, their directions, and their times from the first edge on.
fn steps(recording: &Recording) -> Vec<(u64, u32, u8)> {
    let edges = &recording.edges;
    let first = edges.first().map_or(0, |edge| edge.ticks);
    edges
        .iter()
        .map(|edge| (edge.ticks - first, edge.raise, edge.directions))
        .collect()
}

/// A slight bend, a straight join and a right angle.
const CORNERS: &str = "G1X10F1200\nX20Y1\nX30Y2\nY12\nG2X40Y22I10\nG1Y30\n";

#[test]
fn exact_path_is_the_mode_at_power_up() {
    let plain = play(&fast(), CORNERS);
    let explicit = play(&fast(), &format!("G61\n{CORNERS}"));
    assert_eq!(steps(&plain), steps(&explicit));
}

#[test]
fn exact_stop_stands_still_at_the_end_of_every_move() {
    let settings = fast();
    let corners = [
        "G1X10F1200",
        "X20Y1",
        "X30Y2",
        "Y12",
        "G2X40Y22I10",
        "G1Y30",
    ];
    let stops = traced(&settings, &format!("G61.1\n{CORNERS}"));
    let alone = corners.join("\nG4P0\n") + "\nG4P0\n";
    let alone = traced(&settings, &alone);
    check_limits(&settings, &stops);
    assert_eq!(stops.net_steps(), alone.net_steps());
    // The same as single moves, except for the time of a pause between them.
    let moving = |trace: &Trace| {
        let raises: Vec<_> = trace.edges.iter().filter(|edge| edge.raise != 0).collect();
        raises
            .iter()
            .map(|edge| (edge.raise, edge.directions))
            .collect::<Vec<_>>()
    };
    assert_eq!(moving(&stops), moving(&alone));
    assert!(stops.motion_seconds() <= alone.motion_seconds());
    let exact = traced(&settings, CORNERS);
    // Each of the five corners takes the time of braking and speeding up again.
    let ramps_s = 5.0 * 20.0 / 500.0;
    assert!(stops.motion_seconds() > exact.motion_seconds() + 0.6 * ramps_s);
}

#[test]
fn jogs_do_not_stop_between_each_other() {
    let settings = fast();
    let jogs = "$J=X10F1200\n$J=X20F1200\n";
    let one = play(&settings, jogs);
    let stops = play(&settings, &format!("G61.1\n{jogs}"));
    assert_eq!(steps(&one), steps(&stops));
}

/// The lines that the machine has sent since the last call, in one.
fn received(machine: &mut Machine) -> String {
    machine.take_received().replace("\r\n", " ")
}

fn trace(machine: &Machine) -> Trace {
    let settings = machine.session().settings();
    Trace::of(settings, &machine.edges)
}

/// How much longer the motion of one machine takes than that of another, s.
fn slower_s(machine: &Machine, other: &Machine) -> f64 {
    trace(machine).motion_seconds() - trace(other).motion_seconds()
}

fn is_at_rest(machine: &Machine) -> bool {
    let session = machine.session();
    let snapshot = machine.snapshot();
    snapshot.is_at_rest && snapshot.finished == session.entered()
}

/// True if the machine has been within 0.1 mm of a position, in steps of [`fast`].
fn has_been_at(machine: &Machine, x: i32, y: i32) -> bool {
    let mut steps = Axes::all(0);
    machine.edges.iter().any(|edge| {
        add_steps(&mut steps, edge);
        (steps[0] - x).abs() <= 8 && (steps[1] - y).abs() <= 8
    })
}

#[test]
fn a_line_alone_is_executed_at_once() {
    for mode in ["G61", "G64", "G64P.02", "G64P.02Q.05"] {
        let mut machine = Machine::with(&fast());
        machine.send_for(format!("{mode}\nG1X10F1200\n"), 20);
        assert!(!machine.edges.is_empty(), "{mode}");
        machine.send_for("?", 1000);
        assert!(is_at_rest(&machine));
        assert_eq!(machine.xyz(), [800, 0, 0], "{mode}");
        assert!(received(&mut machine).starts_with("ok ok <Run|"), "{mode}");
    }
}

#[test]
fn lines_that_are_sent_one_by_one_are_rounded_all_the_same() {
    let mut machine = Machine::with(&fast());
    machine.send_for("G64P.5\nG1X20F1200\n", 100);
    machine.send_for("G1Y20\n", 100).send_for("G1X40\n", 4000);
    assert_eq!(machine.xyz(), [3200, 1600, 0]);
    assert!(is_at_rest(&machine));
    // The first line has begun before there was another.
    assert!(has_been_at(&machine, 1600, 0) && !has_been_at(&machine, 1600, 1600));
    let mut exact = Machine::with(&fast());
    exact.send_for("G1X20F1200\n", 100);
    exact.send_for("G1Y20\n", 100).send_for("G1X40\n", 4000);
    assert!(has_been_at(&exact, 1600, 0) && has_been_at(&exact, 1600, 1600));
}

#[test]
fn what_is_held_back_does_not_slow_the_machine_down() {
    let settings = fast();
    let mut exact = Machine::with(&settings);
    exact.send_for("G1X20F3000\nX40\n", 3000);
    // The second line comes long before the end of the first, and nothing after it.
    let mut machine = Machine::with(&settings);
    machine
        .send_for("G64P.02\nG1X20F3000\n", 100)
        .send_for("X40\n", 3000);
    assert_eq!(machine.xyz(), exact.xyz());
    let slower = slower_s(&machine, &exact);
    assert!(slower.abs() < 0.002, "{slower} s");
}

/// Lines that wait until everything before them has been done.
const STANDSTILLS: [&str; 5] = ["M2\n", "G4P0\n", "M8\n", "G92X0\n", "G10L20P2X0\n"];

#[test]
fn a_line_before_a_standstill_continues_without_a_stop() {
    let settings = fast();
    let mut exact = Machine::with(&settings);
    exact.send_for("G1X20F3000\nX40\n", 3000);
    for standstill in STANDSTILLS {
        let mut machine = Machine::with(&settings);
        // Nothing else comes, nor is anything sent, after the line that waits.
        machine
            .send_for("G1X20F3000\nG64P.02\nX40\n", 100)
            .send_for(standstill, 3000);
        assert_eq!(machine.xyz(), exact.xyz(), "{standstill}");
        let slower = slower_s(&machine, &exact);
        assert!(slower.abs() < 0.002, "{standstill}: {slower} s");
    }
}

#[test]
fn a_line_without_a_step_does_not_hold_up_what_waits_for_it() {
    for standstill in STANDSTILLS {
        for before_ms in [0, 100, 1000] {
            let mut machine = Machine::with(&fast());
            machine.send_for("G1X10F1200\nG64\nX10.001\n", before_ms);
            machine.send_for(standstill, 2000);
            assert!(is_at_rest(&machine), "{standstill}");
            assert_eq!(machine.xyz(), [800, 0, 0], "{standstill}");
            let received = received(&mut machine);
            assert_eq!(
                received.matches("ok").count(),
                4,
                "{standstill}: {received}"
            );
        }
    }
}

#[test]
fn whatever_follows_a_line_comes_after_it() {
    for after in [
        "M3S100\n",
        "G4P.01\n",
        "M8\n",
        "M0\n",
        "M2\n",
        "G92X0\n",
        "G10L20P1X0\n",
        "G61\nX11\nX10\n",
        "G38.3Z-1F100\nG0Z0\n",
        "G93G1X11F60\nX10F60\n",
        "G2X10Y0I-1\n",
        "F100\nG4P0\n",
        "G28.1\n",
        "T1\nG4P0\n",
        "G0X10Y1\nY0\n",
    ] {
        let mut machine = Machine::with(&fast());
        machine.send_for(format!("G64P.05\nG1X10F1200\n{after}"), 8000);
        if after == "M0\n" {
            machine.send_for("~", 100);
        }
        assert!(is_at_rest(&machine), "{after}");
        assert_eq!(machine.xyz(), [800, 0, 0], "{after}");
        let received = received(&mut machine);
        let answers = after.matches('\n').count() + 2;
        assert_eq!(
            received.matches("ok").count(),
            answers,
            "{after}: {received}"
        );
        assert!(
            !received.contains("error") && !received.contains("ALARM"),
            "{after}: {received}"
        );
    }
}

#[test]
fn a_hold_stops_on_the_rounded_path_and_goes_on() {
    let program = "G64P.5\nG1X20F3000\nY20\nX40\nY40\nX60\n";
    let mut through = Machine::with(&fast());
    through.send_for(program, 6000);
    for hold_ms in [50, 300, 425, 440, 600, 900] {
        let mut machine = Machine::with(&fast());
        machine
            .send_for(program, hold_ms)
            .send_for("!", 500)
            .send_for("?", 500);
        assert!(received(&mut machine).contains("<Hold:0|"), "{hold_ms}");
        let held = machine.xyz();
        machine.send_for("?", 100);
        assert_eq!(machine.xyz(), held);
        machine.send_for("~", 6000);
        assert!(is_at_rest(&machine), "{hold_ms}");
        assert_eq!(machine.xyz(), [4800, 3200, 0], "{hold_ms}");
        // The same steps, at other times.
        let order = |machine: &Machine| {
            let raises = machine.edges.iter().filter(|edge| edge.raise != 0);
            raises.fold([0_u32; 2], |[x, y], edge| {
                [x + (edge.raise & 1), y + (edge.raise >> 1 & 1)]
            })
        };
        assert_eq!(order(&machine), order(&through), "{hold_ms}");
    }
}

#[test]
fn a_hold_while_nothing_moves_keeps_a_line_until_the_start() {
    let mut machine = Machine::with(&fast());
    machine
        .send_for("G64P.5\n", 10)
        .send_for("!", 10)
        .send_for("G1X10F1200\n", 500);
    assert_eq!(machine.xyz(), [0; 3]);
    machine.send_for("~", 1500);
    assert_eq!(machine.xyz(), [800, 0, 0]);
    assert!(is_at_rest(&machine));
}

#[test]
fn a_reset_forgets_what_is_held_back() {
    for reset_ms in [5, 100, 400, 800] {
        let mut machine = Machine::with(&fast());
        machine.send_for("G64P.5\nG1X20F1200\nY20\nX40\n", reset_ms);
        machine.send_for("\u{18}", 500).send_for("$X\n", 10);
        assert!(is_at_rest(&machine), "{reset_ms}");
        let stopped = machine.xyz();
        machine.send_for("?", 2000);
        assert_eq!(machine.xyz(), stopped, "{reset_ms}");
        // G64 is gone, and the position is right.
        received(&mut machine);
        machine.send_for("$G\nG1X1Y1F1200\n", 4000);
        assert!(!received(&mut machine).contains("G64"));
        assert_eq!(machine.xyz(), [80, 80, 0], "{reset_ms}");
    }
}

#[test]
fn the_end_of_a_program_tells_how_far_the_path_was_left() {
    let program = "G1X20F3000\nX40Y10\nX60\nM2\n";
    for (mode, least, most) in [("G64P.05", 0.049, 0.05), ("G64P.02", 0.019, 0.02)] {
        let messages = play(&fast(), &format!("{mode}\n{program}")).messages;
        let deviation = messages.iter().find_map(|(text, ..)| {
            let text = text.strip_prefix("[MSG:Path deviation: ")?;
            text.strip_suffix(" mm]")?.parse::<f64>().ok()
        });
        let deviation = deviation.unwrap_or_else(|| panic!("{messages:?}"));
        assert!((least..=most).contains(&deviation), "{deviation}");
    }
    let messages = play(&fast(), program).messages;
    assert!(
        !messages.iter().any(|(text, ..)| text.contains("deviation")),
        "{messages:?}"
    );
}

/// Lines of a program, each with the sender's action after the line: a pause, and a byte.
fn lines() -> impl Strategy<Value = Vec<([i32; 3], u64, u8)>> {
    let place = prop_oneof![4 => -300..300_i32, 1 => Just(0), 2 => -5..5_i32];
    let wait_ms = prop_oneof![3 => Just(0_u64), 1 => 0..200_u64];
    // Holds and starts, overrides of feed and rapids, a question.
    let byte = prop::sample::select(b"!~~?\x90\x91\x92\x93\x94\x95\x96\x97".to_vec());
    prop::collection::vec((prop::array::uniform3(place), wait_ms, byte), 1..40)
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn no_order_of_events_loses_a_step_of_what_is_rounded(
        lines in lines(),
        tolerance in prop::sample::select(vec!["", "P0.02", "P0.1Q0", "P0.5Q0.2"]),
        jerk in prop::sample::select(vec![0.0, 0.0, 10_000.0, 200_000.0]),
    ) {
        let settings = Settings { jerk_mm_s3: Axes::all(jerk), ..fast() };
        let mut machine = Machine::with(&settings);
        machine.send_for(format!("G64{tolerance}\nF3000\n"), 1);
        for (number, (place, wait_ms, byte)) in lines.iter().enumerate() {
            let word = if number % 5 == 4 { "G0" } else { "G1" };
            let [x, y, z] = place.map(|steps| f64::from(steps) / 100.0);
            // The receive buffer holds some 128 bytes.
            while number + 2 - machine.received.matches("ok").count() > 3 {
                machine.send_for("~", 20);
            }
            machine.send_for(format!("{word}X{x}Y{y}Z{z}\n"), *wait_ms);
            machine.send_for([*byte], 0);
        }
        machine.send_for(b"~\x90\x95", 100);
        // At rest for so long, nothing may be held back any more.
        let mut standstills = 0;
        for _ in 0..600 {
            machine.send_for("~", 100);
            standstills = if is_at_rest(&machine) { standstills + 1 } else { 0 };
            if standstills == 3 {
                break;
            }
        }
        prop_assert_eq!(standstills, 3);
        prop_assert!(!machine.received.contains("error"), "{}", machine.received);
        let (place, ..) = lines[lines.len() - 1];
        let steps = place.map(|hundredths| (f64::from(hundredths) * 0.8).round() as i32);
        prop_assert_eq!(machine.xyz(), steps);
        trace(&machine).check_pulses();
    }
}
