//! Canned cycles on the whole simulated machine: whatever happens at any stage of a hole, position and
//! modes stay true.

use leadscrew::model::{Levels, Spindle};

use super::{
    bench::Bench,
    machine::{assert_true, execute},
    stages::Disturbed,
    support::Machine,
};

/// Lines that drill.
const CYCLES: [&str; 5] = [
    "G98G83X-20Y-10Z-9R-4Q2F3000L2",
    "G99G73X-20Y-10Z-9R-4Q2F3000",
    "G84X-20Y-10Z-9R-4F3000",
    "G86X-20Y-10Z-9R-4P0.05F3000",
    "G88X-20Y-10Z-9R-4P0.05F3000",
];

/// A line that drills.
fn disturbed<'a>(line: &'a &'a str) -> Disturbed<'a> {
    Disturbed {
        setup: &["$21=1", "G21G90", "M3S500", "G0X-5Y-5Z-2"],
        lines: std::slice::from_ref(line),
        stages: [30, 120],
    }
}

/// Nothing of a cycle is left over, for a pause at a change of the tool neither.
fn assert_drills_nothing(machine: &mut Machine, what: &str) {
    let before = machine.physical_steps();
    for line in ["T7M6", "G4P0.01"] {
        execute(machine, line);
        machine.run_to_standstill();
        assert_eq!(machine.physical_steps(), before, "{what}: {line}");
    }
}

#[test]
fn a_hold_a_door_and_overrides_at_any_stage_change_nothing_but_the_time() {
    for line in &CYCLES {
        disturbed(line).assert_undisturbed(|machine, what| {
            let modal = machine.session().interpreter().modal();
            assert_eq!(modal.spindle, Spindle::Clockwise, "{what}");
            let spindle = machine.outputs().spindle;
            assert!(spindle != Spindle::Off, "{what}");
        });
    }
}

#[test]
fn a_reset_at_any_stage_keeps_the_position_and_ends_the_cycle() {
    for line in &CYCLES {
        disturbed(line).at_each_stage(|mut machine, stage| {
            let what = format!("{line}: reset at {stage}");
            machine.answers_to("\x18");
            execute(&mut machine, "$X");
            let modes = execute(&mut machine, "$G").join(" ");
            assert!(modes.contains("[GC:G0 "), "{what}: {modes}");
            assert_true(&machine, &what);
            assert_drills_nothing(&mut machine, &what);
            assert_eq!(machine.outputs().spindle, Spindle::Off, "{what}");
        });
    }
}

#[test]
fn a_limit_switch_at_any_stage_ends_the_cycle() {
    for line in &CYCLES {
        disturbed(line).at_each_stage(|mut machine, stage| {
            let what = format!("{line}: limit at {stage}");
            machine.set_pin(Levels::limits(1), true);
            machine.run_to_standstill();
            let lines = machine.lines();
            assert!(lines.contains(&"ALARM:1".to_owned()), "{what}: {lines:?}");
            machine.set_pin(Levels::limits(1), false);
            machine.answers_to("\x18");
            execute(&mut machine, "$X");
            assert_true(&machine, &what);
            assert_drills_nothing(&mut machine, &what);
            assert_eq!(machine.outputs().spindle, Spindle::Off, "{what}");
        });
    }
}

#[test]
fn a_laser_is_dark_in_all_of_a_cycle_and_burns_again_after_it() {
    for code in [3, 4] {
        for line in &CYCLES {
            let spindle = format!("M{code}S500");
            let turned = line.replace("G84", if code == 3 { "G84" } else { "G74" });
            let mut machine = Disturbed {
                setup: &["$32=1", "G21G90", &spindle, "G0X-5Y-5Z-2"],
                ..disturbed(line)
            }
            .ready();
            machine.send(format!("{turned}\n").as_bytes());
            for _ in 0..2 {
                while machine.advance() {
                    assert_eq!(machine.outputs().duty, 0, "{turned}");
                }
                // Where the line pauses.
                machine.send(b"~");
            }
            assert_eq!(machine.lines(), ["ok"], "{turned}");
            machine.send(b"G1Z-12F300\n");
            let mut burnt = 0;
            while machine.advance() {
                burnt = burnt.max(machine.outputs().duty);
            }
            assert!(burnt > 0, "{turned}");
        }
    }
}

#[test]
fn a_line_that_leaves_the_travel_drills_nothing() {
    for line in [
        "G91G81X-20Z-5R-1L5F3000",
        "G81X-10Z-101R-4F3000",
        "G81X-10Z-9R1F3000",
    ] {
        let mut machine = disturbed(&line).ready();
        assert_eq!(execute(&mut machine, "G81X-6Z-9R-4F3000"), ["ok"]);
        machine.run_to_standstill();
        let before = machine.physical_steps();
        let output = execute(&mut machine, line);
        assert!(output.contains(&"ALARM:2".to_owned()), "{line}: {output:?}");
        assert_eq!(machine.physical_steps(), before, "{line}");
        execute(&mut machine, "$X");
        assert_drills_nothing(&mut machine, line);
    }
}

#[test]
fn the_word_that_a_cycle_lacks_is_reported() {
    let mut bench = Bench::new();
    bench.ask("$C");
    assert_eq!(bench.ask("F100 M3 S100"), ["ok"]);
    for (line, letter) in [
        ("G81", "R"),
        ("G81 X1 Z-1", "R"),
        ("G81 X1 R1", "Z"),
        ("G18 G81 X1 R1", "Y"),
        ("G19 G81 Y1 Z1 R1", "X"),
        ("G83 X1 Z-1 R1", "Q"),
        ("G73 Z-1 R1", "Q"),
        ("G82 Z-1 R1", "P"),
        ("X1 (the plain words before) Y2 G86 Z-1 R1", "P"),
        ("G84 Z-1", "R"),
    ] {
        let message = format!("[MSG:{letter} is missing]");
        assert_eq!(bench.ask(line), [&message, "error:28"], "{line}");
    }
    // What other lines lack is said by what they are.
    for line in ["G4", "M61", "G41.1", "G10 L2 X1"] {
        assert_eq!(bench.ask(line), ["error:28"], "{line}");
    }
    assert_eq!(bench.ask("G83 X1 Z-1 R1 Q1"), ["ok"]);
    assert_eq!(bench.ask("X2"), ["ok"]);
    assert_eq!(bench.ask("G82 P0"), ["[MSG:R is missing]", "error:28"]);
    // Of a line in the same cycle but another plane.
    assert_eq!(bench.ask("G18 X2 R1"), ["[MSG:Y is missing]", "error:28"]);
    assert_eq!(bench.ask("G4"), ["error:28"]);
}

#[test]
fn a_refused_arc_with_absolute_centres_says_so() {
    let mut bench = Bench::new();
    bench.ask("$C");
    bench.ask("G0 X20 Y10 F100");
    let hint = ["[MSG:I J K fit as absolute: G90.1]", "error:33"];
    assert_eq!(bench.ask("G2 X30 Y10 I25 J10"), hint);
    assert_eq!(bench.ask("X30 (the plain words before) G3 I25 J10"), hint);
    // Neither way, and what is wrong otherwise.
    for (line, error) in [
        ("G2 X30 Y10 I26 J10", "error:33"),
        ("G2 X30 Y10 I25 J10 Q1", "error:20"),
        ("G91 G38.2 X0", "error:33"),
    ] {
        assert_eq!(bench.ask(line), [error], "{line}");
    }
    assert_eq!(bench.ask("G90.1 G2 X30 Y10 I25 J10"), ["ok"]);
    assert_eq!(bench.ask("G2 X20 Y10 I5 J0"), ["error:33"]);
}

#[test]
fn a_dwell_of_more_than_a_minute_is_announced_where_it_begins_or_changes() {
    let mut bench = Bench::new();
    bench.ask("$C");
    assert_eq!(bench.ask("F100"), ["ok"]);
    assert_eq!(bench.ask("G82 X1 Z-1 R1 P60"), ["ok"]);
    let announced = ["[MSG:Dwell of 789 s]", "ok"];
    assert_eq!(bench.ask("X2 P789"), announced);
    assert_eq!(bench.ask("X3"), ["ok"]);
    assert_eq!(bench.ask("G80"), ["ok"]);
    assert_eq!(bench.ask("G82 X4 Z-1 R1 P789"), announced);
    // Beyond 49 days.
    assert_eq!(bench.ask("X5 P9999999"), ["error:39"]);
}
