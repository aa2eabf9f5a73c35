//! A compensated contour on the whole simulated machine: whatever happens at any stage of it, position and
//! modes stay true.

use leadscrew::{
    axis::{X, Z},
    model::{Levels, State},
    units::Nm,
};

use super::{
    machine::{assert_true, execute, limited},
    stages::Disturbed,
    support::{MS, Machine},
};

/// An entry, corners of both kinds, a depth move, arcs and the way out.
const CONTOUR: [&str; 10] = [
    "G41.1D4",
    "G1X-20Y-8F3000",
    "Y-15",
    "Z-4",
    "X-12",
    "G2X-9Y-18J-3",
    "G1Y-25",
    "X-15Y-30",
    "G40",
    "G0X-5Y-5",
];

/// The contour on a machine with hard limits.
const DISTURBED: Disturbed<'_> = Disturbed {
    setup: &["G21G90", "$21=1", "G0X-5Y-5Z-2"],
    lines: &CONTOUR,
    stages: [60, 200],
};

/// What remains of a contour moves nothing: the machine goes on from where it stands.
fn assert_gone(machine: &mut Machine, what: &str) {
    let modes = execute(machine, "$G").join(" ");
    assert!(!modes.contains(" G41"), "{what}: {modes}");
    let before = machine.physical_steps();
    execute(machine, "G4P0.01");
    machine.run_to_standstill();
    assert_true(machine, what);
    assert_eq!(machine.physical_steps(), before, "{what}");
    assert_eq!(execute(machine, "G91G0Z-1"), ["ok"], "{what}");
    machine.run_to_standstill();
    assert_true(machine, what);
    let mut moved = before;
    moved[Z] -= 5;
    assert_eq!(machine.physical_steps(), moved, "{what}");
}

#[test]
fn a_hold_a_door_and_overrides_at_any_stage_change_nothing_but_the_time() {
    DISTURBED.assert_undisturbed(|_, _| {});
}

#[test]
fn a_reset_at_any_stage_keeps_the_position_and_ends_the_contour() {
    DISTURBED.at_each_stage(|mut machine, stage| {
        machine.answers_to("\x18");
        execute(&mut machine, "$X");
        assert_gone(&mut machine, &format!("reset at {stage}"));
    });
}

#[test]
fn a_limit_switch_at_any_stage_ends_the_contour() {
    DISTURBED.at_each_stage(|mut machine, stage| {
        machine.set_pin(Levels::limits(1), true);
        machine.run_to_standstill();
        let what = format!("limit at {stage}");
        let lines = machine.lines();
        assert!(lines.contains(&"ALARM:1".to_owned()), "{what}: {lines:?}");
        machine.set_pin(Levels::limits(1), false);
        machine.answers_to("\x18");
        execute(&mut machine, "$X");
        assert_gone(&mut machine, &what);
    });
}

#[test]
fn the_travel_is_that_of_the_cutter_and_not_of_the_contour() {
    // The contour leaves the travel at X0, and the cutter stays inside.
    let mut machine = DISTURBED.ready();
    for line in [
        "G0X-15Y-30",
        "G41.1D6",
        "G1X1Y-20F3000",
        "Y-10",
        "G40",
        "G0X-5Y-5",
    ] {
        assert_eq!(execute(&mut machine, line), ["ok"], "{line}");
    }
    machine.run_to_standstill();
    assert_true(&machine, "inside");
    // The contour stays inside, and the cutter would leave at its far corner.
    let mut machine = DISTURBED.ready();
    for line in ["G42.1D6", "G1X-20Y-20F3000", "X-1"] {
        assert_eq!(execute(&mut machine, line), ["ok"], "{line}");
    }
    let lines = execute(&mut machine, "Y-1");
    assert!(lines.contains(&"ALARM:2".to_owned()), "{lines:?}");
    execute(&mut machine, "$X");
    assert_gone(&mut machine, "outside");
}

#[test]
fn a_sender_that_leaves_the_machine_standing_in_a_contour_gets_one_message_after_a_second() {
    let mut undisturbed = DISTURBED.sent();
    undisturbed.run_to_standstill();
    let end = undisturbed.physical_steps();
    // Nobody has left a machine that gets line after line.
    assert_eq!(undisturbed.lines(), ["ok"; CONTOUR.len()]);
    let mut machine = DISTURBED.ready();
    for (index, line) in CONTOUR.iter().enumerate() {
        // Answered although nothing follows: who waits for each answer never stands still for good.
        assert_eq!(execute(&mut machine, line), ["ok"], "{line}");
        let mut standstill_began = machine.now();
        let mut messages = Vec::new();
        while machine.advance() {
            let now = machine.now();
            if !machine.snapshot().is_at_rest {
                standstill_began = now;
            }
            let lines = machine.lines();
            if !lines.is_empty() {
                let elapsed_ms = (now - standstill_began) / MS;
                assert!(
                    (1000..1100).contains(&elapsed_ms),
                    "{line}: {elapsed_ms} ms"
                );
                assert_eq!(machine.state(), State::Idle, "{line}");
            }
            messages.extend(lines);
        }
        // A new move waits behind all lines but the first, the move of Z, and the way out.
        let expected: &[&str] = match index {
            0 | 3 | 8 | 9 => &[],
            _ => &["[MSG:Compensation waits for the next move]"],
        };
        assert_eq!(messages, expected, "{line}");
    }
    assert_eq!(machine.physical_steps(), end);
    assert_true(&machine, "the end");
}

/// Repeats lines that end before a motion: the program and the path go on from the same place each time.
fn stay_together(lines: &[&str]) {
    let mut machine = limited();
    execute(&mut machine, "G91F3000");
    for turn in 1..=40 {
        for line in lines {
            let answers = execute(&mut machine, line);
            assert_eq!(answers.last().map(String::as_str), Some("ok"), "{line}");
        }
        machine.run_to_standstill();
        assert_true(&machine, &format!("turn {turn} of {lines:?}"));
        let position = machine.session().interpreter().position();
        assert_eq!(position[X], Nm(-turn * 260_000), "{lines:?}");
    }
}

#[test]
fn an_alarm_before_a_probing_move_leaves_program_and_path_together() {
    stay_together(&["G1X-0.26", "G38.4Z-1", "$X"]);
}

#[test]
fn unlocking_in_compensation_leaves_program_and_path_together() {
    stay_together(&["G1X-0.26", "G41.1D1.5G1Y-3", "$X"]);
}
