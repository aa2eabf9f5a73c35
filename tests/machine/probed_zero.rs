//! Work coordinates that a contact of the probe sets: `G38.n P`.

use leadscrew::{
    axis::{X, Z},
    model::{Levels, State},
    sim::Closes,
};

use crate::support::Machine;

const DOCUMENTS: &str = include_str!("../../docs/homing-and-probing.md");
/// Feed rates, and accelerations of Z.
const SPEEDS: [(&str, &str); 5] = [
    ("F20", "122=10"),
    ("F100", "122=10"),
    ("F100", "122=500"),
    ("F400", "122=50"),
    ("F3000", "122=2000"),
];

/// A machine with a plate whose contact closes at Z-5.
fn machine(assignments: &[&str]) -> Machine {
    let mut machine = Machine::new(&[&["112=3000", "120=500"], assignments].concat());
    machine.mount(Z, Closes::DownFrom(-1250), Levels::PROBE);
    machine
}

/// Returns a list of coordinates, and what stands behind it, of X, Y and Z alone.
fn of_xyz(values: &str) -> String {
    let (axes, result) = values.split_once(':').unwrap_or((values, ""));
    let axes: Vec<&str> = axes.split(',').take(3).collect();
    format!("{}:{result}", axes.join(","))
        .trim_end_matches(':')
        .to_owned()
}

/// Returns the line of `$#` that begins with this name, without it.
fn parameter(machine: &mut Machine, name: &str) -> String {
    let lines = machine.ask("$#");
    let start = format!("[{name}:");
    let line = lines.iter().find_map(|line| line.strip_prefix(&start));
    of_xyz(line.expect("a parameter").trim_end_matches(']'))
}

/// Whether a line reports the contact at Z-5.
fn is_contact(line: &str) -> bool {
    let values = line
        .strip_prefix("[PRB:")
        .and_then(|line| line.strip_suffix(']'));
    values.is_some_and(|values| of_xyz(values) == "0.000,0.000,-5.000:1")
}

#[test]
fn the_documented_macro_gives_the_contact_to_a_step() {
    let probing = DOCUMENTS.split_once("## Probing").unwrap().1;
    let code = probing.split("```").nth(1).unwrap();
    let code = code.strip_prefix("gcode\n").unwrap();
    for (feed, acceleration) in SPEEDS {
        let mut machine = machine(&[acceleration]);
        for line in code.replace("F100", feed).lines() {
            assert_eq!(machine.ask(line).last().unwrap(), "ok", "{line}");
        }
        let [x, y, z] = machine.xyz();
        // Z 5 is 3.5 mm above the plate.
        assert_eq!([x, y, z], [0, 0, -1250 + 875], "{feed} {acceleration}");
        assert_eq!(parameter(&mut machine, "G54"), "0.000,0.000,-6.500");
        let stored = &mut machine.cycle_power();
        stored.run_to_standstill();
        stored.lines();
        assert_eq!(parameter(stored, "G54"), "0.000,0.000,-6.500");
    }
}

#[test]
fn back_at_the_contact_any_sender_sets_zero_to_a_step() {
    for (feed, acceleration) in SPEEDS {
        for zero in ["G10 L20 P0 Z1.5", "G92 Z1.5"] {
            let mut machine = machine(&[acceleration]);
            let answers = machine.ask(&format!("G38.2 Z-25 {feed}"));
            assert!(is_contact(&answers[0]), "{answers:?}");
            assert!(machine.xyz()[2] < -1250, "it rests behind the contact");
            for line in ["G53 G0 Z-5.000", zero, "G0 Z5"] {
                assert_eq!(machine.ask(line), ["ok"], "{line}");
            }
            assert_eq!(machine.xyz()[2], -1250 + 875, "{feed} {acceleration}");
        }
    }
}

#[test]
fn a_second_slow_move_is_nearly_at_the_contact() {
    let mut machine = machine(&["122=10"]);
    for line in [
        "G38.2 Z-25 F100",
        "G91 G0 Z2",
        "G38.2 Z-5 F20",
        "G90",
        "G10 L20 P0 Z1.5",
        "G0 Z1.5",
    ] {
        assert_eq!(machine.ask(line).last().unwrap(), "ok", "{line}");
    }
    // 0.007 mm, in whole steps.
    let overrun = -1250 - machine.xyz()[2];
    assert!((1..=2).contains(&overrun), "{overrun}");
}

#[test]
fn a_contact_gets_its_value_with_every_offset_in_effect() {
    /// Lines before; the probing move; the line that goes to the contact.
    const CASES: [(&[&str], &str, &str); 8] = [
        (&["G92 X3 Z7"], "G38.2 Z-30 F100 P1.5", "G0 Z1.5"),
        (&["G43.1 Z12"], "G38.2 Z-30 F100 P1.5", "G0 Z1.5"),
        (&["G43.1 Z12", "G92 Z4"], "G38.3 Z-30 F100 P0", "G0 Z0"),
        (&["G20"], "G38.2 Z-1 F4 P0.1", "G0 Z0.1"),
        (&["G91"], "G38.2 Z-9 F100 P2", "G90 G0 Z2"),
        (&["G10 L2 P2 X1 Y2 Z3"], "G55 G38.2 Z-30 F100 P1", "G0 Z1"),
        (
            &["G10 L2 P1 X5 Y6 R30", "G92 X2"],
            "G38.2 Z-30 F100 P1.5",
            "G0 Z1.5",
        ),
        (&["G90 G10 L2 P1 Z1"], "G38.2 Z-30 F100 P1.5", "G0 Z1.5"),
    ];
    for (before, probing, back) in CASES {
        let mut machine = machine(&[]);
        for line in before {
            assert_eq!(machine.ask(line), ["ok"], "{line}");
        }
        let name = if probing.contains("G55") {
            "G55"
        } else {
            "G54"
        };
        let x_and_y = |text: &str| text.rsplit_once(',').unwrap().0.to_owned();
        let origin = x_and_y(&parameter(&mut machine, name));
        let offset = parameter(&mut machine, "G92");
        assert_eq!(machine.ask(probing).last().unwrap(), "ok", "{probing}");
        assert_eq!(machine.ask(back), ["ok"], "{before:?}");
        assert_eq!(machine.xyz(), [0, 0, -1250], "{before:?}");
        assert_eq!(x_and_y(&parameter(&mut machine, name)), origin);
        assert_eq!(parameter(&mut machine, "G92"), offset);
    }
}

#[test]
fn a_contact_that_opens_gets_its_value() {
    for code in ["G38.4", "G38.5"] {
        let mut machine = machine(&[]);
        machine.ask("G0 Z-6");
        let answers = machine.ask(&format!("{code} Z0 F600 P10"));
        assert_eq!(answers.last().unwrap(), "ok");
        let probed = parameter(&mut machine, "PRB");
        let contact: f64 = probed.split([',', ':']).nth(2).unwrap().parse().unwrap();
        let origin = format!("0.000,0.000,{:.3}", contact - 10.0);
        assert_eq!(parameter(&mut machine, "G54"), origin);
        assert!((-5.0..-4.98).contains(&contact), "{contact}");
    }
}

#[test]
fn an_axis_of_a_rotated_system_gets_its_value_and_the_other_keeps_its_own() {
    let mut machine = Machine::new(&["110=3000", "111=3000", "120=500", "121=500"]);
    machine.mount(X, Closes::From(500), Levels::PROBE);
    for line in ["G10 L2 P1 X0 Y0 R30", "G0 Y1", "G38.2 X10 F300 P7"] {
        assert_eq!(machine.ask(line).last().unwrap(), "ok", "{line}");
    }
    let contact = parameter(&mut machine, "PRB");
    assert_eq!(machine.ask("G0 X7 Y1"), ["ok"]);
    let report = machine.report();
    let there: Vec<f64> = contact
        .split([',', ':'])
        .take(2)
        .map(|number| number.parse().unwrap())
        .collect();
    let position = report.machine_position().expect("a position");
    for axis in 0..2 {
        // The contact lies within a step of the line.
        assert!(
            (position[axis] - there[axis]).abs() <= 0.0081,
            "{position:?} {there:?}"
        );
    }
}

#[test]
fn a_miss_sets_no_zero() {
    for (probing, answer) in [
        ("G38.3 Z-2 F600 P1", "ok"),
        ("G38.2 Z-2 F600 P1", "ok"),
        ("G38.5 Z-2 F600 P1", "ok"),
        ("G38.2 Z-9 X1 F600 P1", "error:36"),
        ("G38.2 Z-9 F600 P-1", "error:4"),
        ("G38.2 F600 P1", "error:26"),
        ("G38.2 Z-9 F600 P99999999", "error:33"),
        ("G38.2 Z-9 P1", "error:22"),
    ] {
        let mut machine = machine(&[]);
        let answers = machine.ask(probing);
        assert_eq!(answers.last().unwrap(), answer, "{probing}");
        assert_eq!(parameter(&mut machine, "G54"), "0.000,0.000,0.000");
    }
    // A reset on the way, and check mode.
    let mut machine = machine(&[]);
    machine.send("G38.2 Z-9 F600 P1\n");
    machine.run(100);
    machine.exchange("\x18");
    machine.ask("$X");
    assert_eq!(machine.state(), State::Idle);
    assert_eq!(parameter(&mut machine, "G54"), "0.000,0.000,0.000");
    machine.ask("$C");
    assert_eq!(machine.ask("G38.2 Z-9 F600 P1"), ["ok"]);
    machine.ask("$C");
    assert_eq!(parameter(&mut machine, "G54"), "0.000,0.000,0.000");
}

#[test]
fn a_p_of_another_command_is_not_for_the_probe() {
    for line in ["G64 P0.01 G38.2 Z-9 F600", "M51 P1 G38.2 Z-9 F600"] {
        let mut machine = machine(&[]);
        let answers = machine.ask(line);
        assert!(is_contact(&answers[0]), "{line}: {answers:?}");
        assert_eq!(parameter(&mut machine, "G54"), "0.000,0.000,0.000");
    }
}
