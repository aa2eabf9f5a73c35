//! The first and last lines of programs as post-processors write them, on a homed machine with its switches on.

use leadscrew::{
    model::{Levels, State},
    sim::Closes,
};

use crate::support::Machine;

/// Steps of a millimetre.
const STEPS: i32 = 80;
/// Travel, mm.
const TRAVEL: i32 = 60;
/// `$27`, mm.
const PULL_OFF: i32 = 2;

/// Programs that begin and end as those of a post-processor do. Work zero is in the middle of the travel.
const PROGRAMS: [(&str, &str); 9] = [
    (
        "Fusion, G28",
        "%\n(1001)\n(T1 D=6. CR=0. - ZMIN=-1. - flat end mill)\nG90 G94\nG17\nG21\nG28 G91 Z0.\nG90\n\
         (2D Contour1)\nS5000 M3\nG54\nG0 X5. Y5.\nZ15.\nG1 Z-1. F500\nX10.\nG0 Z15.\nM5\nG28 G91 Z0.\nG90\n\
         G28 G91 X0. Y0.\nG90\nM30\n%\n",
    ),
    (
        "Fusion, G53",
        "(1001)\nG90 G94\nG17\nG21\nG90 G53 G0 Z0.\nM9\nT1\nS5000 M3\nG54\nG0 X5. Y5.\nZ15.\nG1 Z-1. F500\nX10.\n\
         G0 Z15.\nM9\nG53 G0 Z0.\nG53 G0 X0. Y0.\nM5\nM30\n",
    ),
    (
        "Fusion, clearance height",
        "G90 G94\nG17\nG20\nG0 Z0.6\nS5000 M3\nG54\nG0 X0.2 Y0.2\nG1 Z-0.04 F20\nX0.4\nG0 Z0.6\nM5\nM30\n",
    ),
    (
        "Vectric, mm",
        "T1\nG17\nG21\nG90\nG0Z20.320\nG0X0.000Y0.000S18000M3\nG0X5.000Y5.000Z5.080\nG1Z-1.000F500.0\nX10.000\n\
         G0Z20.320\nG0X0.000Y0.000\nM2\n",
    ),
    (
        "Vectric, inches",
        "T1\nG17\nG20\nG90\nG0Z0.8000\nG0X0.0000Y0.0000S18000M3\nG0X0.2Y0.2Z0.2\nG1Z-0.04F20.0\nG0Z0.8000\n\
         G0X0.0000Y0.0000\nM09\nM30\n",
    ),
    (
        "FreeCAD, grbl_post",
        "(Exported by FreeCAD)\n(Begin preamble)\nG17 G90\nG21\nG54\nG0 Z15.000\n( M6 T1 )\nM3 S10000\nG0 X5.000 Y5.000\n\
         G1 Z-1.000 F300.000\nG0 Z15.000\nM5\nG17 G90\nM2\n",
    ),
    (
        "FreeCAD, linuxcnc_post",
        "G17 G54 G40 G49 G80 G90\nG21\nM5\nM6 T1\nG43 H1\nM3 S10000\nG0 Z15.000\nG0 X5.000 Y5.000\n\
         G1 Z-1.000 F300.000\nG0 Z15.000\nM05\nG17 G54 G90 G80 G40\nM2\n",
    ),
    (
        "Carbide Create",
        "(STOCK/BLOCK,10.00, 10.00, 1.00,0.00, 0.00, 1.00)\nG90\nG21\n(Move to safe Z to avoid workholding)\n\
         G53G0Z-5.000\nM05\n(TOOL/MILL,3.17, 0.00, 0.00, 0.00)\nM6T102\nM03S18000\n\
         (PREPOSITION FOR RAPID PLUNGE)\nG0X0.000Y0.000\nG1Z-0.762F381.0\nX10.000Y10.000F1143.0\nZ5.000\nM05\n\
         G53G0Z-5.000\nM02\n",
    ),
    (
        "Estlcam",
        "(Project test)\nG21\nG90\nG94\nM03 S24000\nG00 Z5.0000\nG00 X5.0000 Y5.0000\nG01 Z-1.0000 F300 S24000\n\
         G01 X10.0000 F600\nG00 Z5.0000\nG00 X0.0000 Y0.0000\nM05\nM30\n",
    ),
];

/// A machine with a switch at both ends of each axis, homed, with work zero in the middle.
fn homed(homing: u8, directions: u8) -> Machine {
    let directions = i32::from(directions);
    let mut settings: Vec<String> = ["20=1", "21=1", "24=600", "25=3000", "341=4"]
        .map(str::to_owned)
        .into();
    settings.insert(0, format!("22={homing}"));
    settings.extend([format!("23={directions}"), format!("27={PULL_OFF}")]);
    for axis in 0..3 {
        settings.push(format!("{}={STEPS}", 100 + axis));
        settings.push(format!("{}=6000", 110 + axis));
        settings.push(format!("{}=500", 120 + axis));
        settings.push(format!("{}={TRAVEL}", 130 + axis));
    }
    let settings: Vec<_> = settings.iter().map(String::as_str).collect();
    let mut machine = Machine::new(&settings);
    for axis in 0..3 {
        // One switch is 5 mm away, the other a millimetre beyond the travel.
        let (upper, lower) = if directions >> axis & 1 == 0 {
            (5, 4 - TRAVEL)
        } else {
            (TRAVEL - 4, -5)
        };
        machine.mount(axis, Closes::From(upper * STEPS), Levels::limits(1 << axis));
        machine.mount(
            axis,
            Closes::DownFrom(lower * STEPS),
            Levels::limits(1 << axis),
        );
    }
    assert_eq!(machine.ask("$H"), ["ok"]);
    let zero = (0..3).map(|axis| {
        let is_above = homing == 9 && directions >> axis & 1 != 0;
        let middle = if is_above { TRAVEL / 2 } else { -TRAVEL / 2 };
        format!("{}{middle}", ["X", "Y", "Z"][axis])
    });
    let zero = format!("G10 L2 P1 {}", zero.collect::<String>());
    assert_eq!(machine.ask(&zero), ["ok"]);
    machine
}

/// What has been reported less what has been travelled, steps.
fn frame(machine: &Machine) -> [i32; 3] {
    let steps = machine.snapshot().steps;
    let travelled = machine.xyz();
    [0, 1, 2].map(|axis| steps[axis] - travelled[axis])
}

#[test]
fn the_header_of_every_common_post_processor_runs_on_a_homed_machine_with_its_switches_on() {
    for homing in [1, 9] {
        for directions in 0..8 {
            for (name, program) in PROGRAMS {
                // Below zero is outside of a travel that begins there.
                if homing == 9 && directions & 4 != 0 && program.contains("Z-5.000") {
                    continue;
                }
                let mut machine = homed(homing, directions);
                let before = frame(&machine);
                let answers = machine.answers_to(program);
                let is_good = |line: &String| line == "ok" || line.starts_with("[MSG:");
                let case = format!("{name}, $22={homing} $23={directions}: {answers:?}");
                assert!(answers.iter().all(is_good), "{case}");
                assert_eq!(machine.state(), State::Idle, "{case}");
                assert_eq!(frame(&machine), before, "{case}");
            }
        }
    }
}

/// Machine position of the axes, mm.
fn position(machine: &Machine) -> [i32; 3] {
    let steps = machine.snapshot().steps;
    [0, 1, 2].map(|axis| steps[axis] / STEPS)
}

#[test]
fn g28_without_a_stored_position_goes_home_and_z_never_down() {
    let home = PULL_OFF - TRAVEL;
    for (homing, directions, expected) in [
        (1, 0, [-PULL_OFF; 3]),
        (1, 0b011, [home, home, -PULL_OFF]),
        (9, 0b011, [0; 3]),
        // Home of Z is in the table.
        (1, 0b100, [-PULL_OFF; 3]),
        (9, 0b100, [0, 0, TRAVEL - PULL_OFF]),
    ] {
        for line in ["G28", "G30", "G91 G28 X0 Y0 Z0", "G28 G91 X0 Y0 Z0"] {
            let mut machine = homed(homing, directions);
            assert_eq!(machine.ask("G90 G0 X0 Y0 Z0"), ["ok"]);
            assert_eq!(machine.ask(line), ["ok"]);
            assert_eq!(position(&machine), expected, "{line} {homing} {directions}");
        }
    }
}

#[test]
fn g28_goes_to_what_is_stored_or_to_zero_where_nothing_is_homed() {
    let mut machine = homed(1, 0);
    assert_eq!(machine.ask("G90 G0 X0 Y0 Z0"), ["ok"]);
    assert_eq!(machine.ask("G28.1"), ["ok"]);
    assert_eq!(machine.ask("G0 X1 Y1 Z1"), ["ok"]);
    assert_eq!(machine.ask("G28"), ["ok"]);
    assert_eq!(position(&machine), [-TRAVEL / 2; 3]);
    assert_eq!(machine.ask("G30"), ["ok"]);
    assert_eq!(position(&machine), [-PULL_OFF; 3]);
    // A reset in motion leaves the position in doubt.
    assert_eq!(machine.ask("G0 X0"), ["ok"]);
    machine.send_for("G0 X1\n", 20).send_for("\x18", 500);
    machine.answers();
    assert_eq!(machine.ask("$21=0"), ["ok"]);
    assert_eq!(machine.ask("$X"), ["[MSG:Caution: Unlocked]", "ok"]);
    assert_eq!(machine.ask("G30"), ["ok"]);
    assert_eq!(position(&machine), [0; 3]);
}

#[test]
fn g53_ends_before_the_switch_of_a_homed_axis_and_nothing_else_does() {
    const MESSAGE: &str = "[MSG:G53 ends at the pull-off, before the switch]";
    for (line, z, message) in [
        ("G53 G0 Z0", -PULL_OFF, Some(MESSAGE)),
        ("G53 G0 Z-1", -PULL_OFF, Some(MESSAGE)),
        ("G91 G53 G0 Z0", -PULL_OFF, Some(MESSAGE)),
        ("G20 G53 G1 Z-0.03 F20", -PULL_OFF, Some(MESSAGE)),
        ("$J=G53 Z0 F500", -PULL_OFF, Some(MESSAGE)),
        ("G53 G0 Z-2", -2, None),
        ("G53 G0 Z-3", -3, None),
        // There is no switch at the far end, as far as the settings tell.
        ("G53 G0 Z-60", -60, None),
    ] {
        let mut machine = homed(1, 0);
        assert_eq!(machine.ask("G90 G0 X0 Y0 Z1"), ["ok"]);
        let expected: Vec<_> = message.into_iter().chain(["ok"]).collect();
        assert_eq!(machine.ask(line), expected, "{line}");
        assert_eq!(machine.state(), State::Idle, "{line}");
        assert_eq!(position(&machine)[2], z, "{line}");
        if message.is_some() {
            // Once in a program.
            assert_eq!(machine.ask(line), ["ok"], "{line}");
            assert_eq!(machine.ask("M2"), ["[MSG:Pgm End]", "ok"]);
            assert_eq!(machine.ask("G53 G0 Z0"), [MESSAGE, "ok"], "{line}");
        }
    }
    // A move in work coordinates goes where it says, and one beyond the travel is refused.
    for line in ["G90 G0 Z30", "G53 G0 Z0.001"] {
        let mut machine = homed(1, 0);
        let answers = machine.ask(line);
        let alarm = if line.starts_with("G90") { 1 } else { 2 };
        assert!(
            answers.contains(&format!("ALARM:{alarm}")),
            "{line} {answers:?}"
        );
    }
    // Without hard limits, and on a machine that is not homed, there is nothing to keep from.
    let mut machine = homed(1, 0);
    assert_eq!(machine.ask("$21=0"), ["ok"]);
    assert_eq!(machine.ask("G53 G0 Z-1"), ["ok"]);
    assert_eq!(position(&machine)[2], -1);
}

#[test]
fn soft_limits_begin_where_an_axis_is_homed_at_zero() {
    for (directions, inside, outside) in [
        (0, ["X0", "X-58"], ["X0.001", "X-58.001"]),
        (1, ["X0", "X58"], ["X-0.001", "X58.001"]),
    ] {
        let mut machine = homed(9, directions);
        assert_eq!(position(&machine), [0; 3]);
        for word in inside {
            let answers = machine.ask(&format!("G53 G0 {word}"));
            assert_eq!(answers, ["ok"], "{word}");
        }
        for word in outside {
            let mut machine = homed(9, directions);
            let answers = machine.ask(&format!("G53 G0 {word}"));
            assert_eq!(answers[0], "ALARM:2", "{word}");
        }
    }
    // As grblHAL: without hard limits all of `$130` counts from there.
    let mut machine = homed(9, 0);
    assert_eq!(machine.ask("$21=0"), ["ok"]);
    assert_eq!(machine.ask("G53 G0 X-60"), ["ok"]);
}

#[test]
fn bits_of_homing_that_are_not_there_are_refused() {
    let mut machine = Machine::new(&[]);
    let listed = |machine: &mut Machine| {
        let lines = machine.ask("$$");
        lines.into_iter().find(|line| line.starts_with("$22="))
    };
    for (value, answer, shown) in [
        (1, "ok", 1),
        (9, "ok", 9),
        (8, "error:52", 9),
        (3, "error:52", 9),
        (11, "error:52", 9),
        (255, "error:52", 9),
        (0, "ok", 0),
        (2, "error:52", 0),
    ] {
        assert_eq!(machine.ask(&format!("$22={value}")), [answer], "{value}");
        assert_eq!(listed(&mut machine), Some(format!("$22={shown}")));
    }
}
