//! `E` as an axis: linear along the path, exact in sum, without travel.

use crate::{
    machine::{STEPS_PER_MM, reprap_with, xy},
    support::Machine,
};

/// A, in steps for each mm.
const E_STEPS: f64 = 80.0;

/// A machine on which E drives A.
fn extruding(more: &[&str]) -> Machine {
    let mut all = vec!["781=4", "113=6000", "123=1000"];
    all.extend_from_slice(more);
    reprap_with(&all)
}

/// Executes a line, and calls a function at each step of X, Y or Z with all positions in steps.
fn watch(machine: &mut Machine, line: &str, mut each: impl FnMut([f64; 4])) {
    machine.send(line);
    machine.send(b"\n");
    let position = |machine: &Machine| {
        let steps = machine.physical_steps();
        [steps[0], steps[1], steps[2], steps[3]].map(f64::from)
    };
    let mut before = position(machine);
    while machine.advance() {
        let now = position(machine);
        if now[..3] != before[..3] {
            // At the instant of a step an axis is half-way between two.
            each(std::array::from_fn(|axis| {
                f64::midpoint(now[axis], before[axis])
            }));
        }
        before = now;
    }
    assert_eq!(machine.answers().pop().as_deref(), Some("ok"), "{line}");
}

#[test]
fn e_is_linear_along_lines_arcs_and_helices() {
    let mut machine = extruding(&[]);
    machine.ask("G1 F3000");
    let per_mm = f64::from(STEPS_PER_MM);
    let mut steps = 0;
    // At a step of X, E is where its share of the path is, within half a step and one of time.
    watch(&mut machine, "G1 X20 E3", |[x, _, _, e]| {
        let due = x / per_mm / 20.0 * 3.0 * E_STEPS;
        assert!((e - due).abs() <= 1.0, "{x}: {e} of {due}");
        steps += 1;
    });
    assert!(steps > 1000);
    for (line, from, by) in [
        ("G3 X0 Y20 I-20 J0 E5", 3.0, 2.0),
        ("G2 X20 Y0 Z4 I0 J-20 E9", 5.0, 4.0),
    ] {
        let is_back = line.starts_with("G2");
        watch(&mut machine, line, |[x, y, _, e]| {
            let share = y.atan2(x) / std::f64::consts::FRAC_PI_2;
            let share = if is_back { 1.0 - share } else { share };
            let due = (from + share * by) * E_STEPS;
            assert!((e - due).abs() <= 1.2, "{line} {x} {y}: {e} of {due}");
        });
        let end = f64::from(machine.physical_steps()[3]);
        assert_eq!(end, (from + by) * E_STEPS, "{line}");
    }
}

#[test]
fn retract_alone() {
    let mut machine = extruding(&["20=0"]);
    let start = machine.now();
    machine.ask("G1 E-5 F300");
    let ticks = (machine.now() - start) as f64;
    let seconds = ticks / f64::from(leadscrew::units::TICKS_PER_SECOND);
    assert!((1.0..1.1).contains(&seconds), "F is along E: {seconds}");
    assert_eq!(f64::from(machine.physical_steps()[3]), -5.0 * E_STEPS);
    assert_eq!(xy(&machine), [0, 0]);
}

#[test]
fn relative_e_sums_exactly() {
    let mut machine = extruding(&[]);
    machine.ask("M83");
    machine.ask("G1 F6000");
    for index in 0..300 {
        let x = if index % 2 == 0 { "1" } else { "0" };
        machine.ask(&format!("G1 X{x} E0.001234"));
    }
    let position = machine.ask("M114").remove(0);
    assert!(position.contains(" E:0.370 "), "{position}");
    let steps = f64::from(machine.physical_steps()[3]);
    assert_eq!(steps, (300.0 * 0.001_234 * E_STEPS).round());
    // G91 counts X and E; M82 counts E alone.
    machine.ask("G92 E0");
    machine.ask("G91");
    machine.ask("M82");
    machine.ask("G1 X1 E1");
    machine.ask("G1 X1 E1.5");
    assert_eq!(xy(&machine)[0], 2 * STEPS_PER_MM);
    let more = f64::from(machine.physical_steps()[3]) - steps;
    assert!((more - 1.5 * E_STEPS).abs() <= 1.0, "{more}");
}

#[test]
fn e_has_no_travel_and_is_not_homed() {
    let mut machine = extruding(&[
        "22=1", "20=1", "788=7", "130=100", "131=100", "132=100", "133=1",
    ]);
    assert_eq!(machine.ask("G28"), ["ok"]);
    assert_eq!(machine.ask("G1 X50 E50 F6000"), ["ok"]);
    assert_eq!(f64::from(machine.physical_steps()[3]), 50.0 * E_STEPS);
    assert_eq!(machine.ask("G92 E0"), ["ok"]);
    assert_eq!(machine.ask("M221 S50"), ["ok"]);
    assert_eq!(machine.ask("G1 E10"), ["ok"]);
    assert_eq!(f64::from(machine.physical_steps()[3]), 55.0 * E_STEPS);
    assert_eq!(machine.ask("G1 A3"), ["echo:A: no such axis", "ok"]);
}

#[test]
fn a_refused_line_leaves_e_where_it_was() {
    for refused in ["G92 E4 X", "G2 X5 E4", "M83 G2 X5 E4"] {
        let mut machine = extruding(&[]);
        machine.ask("G1 F3000 E1");
        assert_ne!(machine.ask(refused), ["ok"], "{refused}");
        assert_eq!(machine.ask("M110 N0"), ["ok"]);
        machine.ask("G1 E2");
        let position = f64::from(machine.physical_steps()[3]);
        assert_eq!(position, 2.0 * E_STEPS, "{refused}");
    }
}
