//! `CoreXY`, `$795`: homing, probing, jogs and soft limits of the axes, by motors that turn for both.

use leadscrew::{
    axis::{AXES, X, Y, Z},
    model::{Levels, State, core_xy},
    path::Work,
    settings::Settings,
    sim::Closes,
};

use crate::support::{Cell, Machine, check_limits, fast};

/// Steps per mm of every axis.
const PER_MM: i32 = 80;

fn settings() -> Settings {
    Settings {
        core_xy: true,
        homing: 1,
        homing_seek_mm_min: 2000.0,
        homing_feed_mm_min: 200.0,
        ..fast()
    }
}

/// Returns a switch of an axis, so many steps away towards the end that it homes to.
fn switch(settings: &Settings, axis: usize, away: i32) -> (Closes, i32) {
    if settings.homing_direction >> axis & 1 == 0 {
        (Closes::From(away), away - PER_MM)
    } else {
        (Closes::DownFrom(-away), PER_MM - away)
    }
}

/// Returns where homing leaves an axis, steps.
fn home(settings: &Settings, axis: usize) -> i32 {
    if settings.homing_direction >> axis & 1 == 0 {
        -PER_MM
    } else {
        -199 * PER_MM
    }
}

#[test]
fn every_axis_ends_a_pull_off_from_its_switch() {
    for homing_direction in 0..8 {
        for cycles in [
            &[0][..],
            &[1 << X, 1 << Y],
            &[1 << Y | 1 << X],
            &[1 << Y, 1 << X],
        ] {
            let settings = Settings {
                homing_direction,
                ..settings()
            };
            let mut cell = Cell::new(&settings);
            let mut ends = [0; 3];
            for (axis, away) in [(X, 1601), (Y, 1204), (Z, 800)] {
                let (closes, end) = switch(&settings, axis, away);
                ends[axis] = end;
                cell.mount(axis, closes, Levels::limits(1 << axis));
            }
            for axes in cycles {
                cell.send(Work::Home(*axes));
                cell.run_to_end();
                assert_eq!((cell.state(), cell.alarms()), (State::Idle, vec![]));
            }
            let homed = if cycles == [0] { AXES.min(3) } else { 2 };
            let physical = core_xy::steps_of(cell.physical());
            let position = core_xy::steps_of(cell.snapshot().steps);
            for axis in 0..homed {
                let off = physical[axis] - ends[axis];
                assert!(off.abs() <= 1, "{cycles:?}, axis {axis}: {off} steps");
                let off = position[axis] - home(&settings, axis);
                assert!(off.abs() <= 1, "{cycles:?}, axis {axis}: {off} steps");
            }
            cell.trace.check_pulses();
            check_limits(&settings, &cell.trace);
        }
    }
}

#[test]
fn both_motors_turn_while_one_axis_searches_its_switch() {
    let mut cell = Cell::new(&settings());
    cell.mount(X, Closes::From(1600), Levels::limits(1 << X));
    cell.send(Work::Home(1 << X));
    cell.run_until(|cell| cell.physical()[X] > 200);
    assert_eq!(cell.physical()[X], cell.physical()[Y]);
    cell.run_to_end();
    assert_eq!(cell.physical()[X], 1600 - PER_MM);
    assert_eq!(cell.physical()[X], cell.physical()[Y]);
}

/// Returns where the axes are by the steps that the motors have made, mm.
fn physical_mm(machine: &Machine) -> [f64; 2] {
    let [a, b, _] = machine.xyz().map(f64::from);
    [(a + b) / 160.0, (a - b) / 160.0]
}

fn unlocked() -> Settings {
    Settings {
        homing: 0,
        ..settings()
    }
}

#[test]
fn reports_are_of_the_axes() {
    let mut machine = Machine::with(&unlocked());
    assert_eq!(machine.ask("G1 X10 Y-2.5 Z1 F5000"), ["ok"]);
    assert_eq!(machine.report().xyz(), Some("10.000,-2.500,1.000"));
    assert_eq!(machine.xyz(), [600, 1000, 80]);
    // With another meaning of the motors, the same steps are another position.
    assert!(machine.exchange("$795=0\n").contains("ok"));
    assert_eq!(machine.report().xyz(), Some("7.500,12.500,1.000"));
    assert!(machine.exchange("$795=1\n").contains("ok"));
    assert_eq!(machine.ask("G1 X20 F5000"), ["ok"]);
    assert_eq!(machine.report().xyz(), Some("20.000,-2.500,1.000"));
    assert_eq!(physical_mm(&machine), [20.0, -2.5]);
}

#[test]
fn a_probe_is_found_where_the_axes_are() {
    let mut machine = Machine::with(&unlocked());
    machine.mount(X, Closes::From(5 * PER_MM), Levels::PROBE);
    assert_eq!(machine.ask("G1 Y3 F5000"), ["ok"]);
    let answer = machine.exchange("G38.2 X20 Y4 F100\n");
    let x: f64 = answer
        .split("PRB:")
        .nth(1)
        .and_then(|rest| rest.split(',').next()?.parse().ok())
        .expect("a position");
    assert!((x - 5.0).abs() < 0.01, "{answer}");
    assert!(answer.contains(":1]"), "{answer}");
}

#[test]
fn a_cancelled_jog_leaves_the_axes_where_the_motors_stand() {
    let mut machine = Machine::with(&unlocked());
    machine.send_for("$J=G91 X50 Y20 F3000\n", 400);
    machine.send_for([0x85], 5000);
    assert_eq!(machine.lines(), ["ok"]);
    let [x, y] = physical_mm(&machine);
    assert!(x > 5.0 && x < 45.0, "{x}");
    let shown = machine.report().machine_position().expect("it is shown");
    assert!(
        (shown[X] - x).abs() < 0.002 && (shown[Y] - y).abs() < 0.002,
        "{shown:?}, {x}, {y}"
    );
    assert_eq!(machine.ask("G91 G1 X-1 Y-1 F1000"), ["ok"]);
    let [after_x, after_y] = physical_mm(&machine);
    assert!((after_x - x + 1.0).abs() <= 1.01 / 80.0 && (after_y - y + 1.0).abs() <= 1.01 / 80.0);
}

#[test]
fn soft_limits_are_those_of_the_axes() {
    let settings = Settings {
        soft_limits: true,
        homing_marks: 0b111,
        ..settings()
    };
    let mut machine = Machine::with(&settings);
    assert!(machine.exchange("$H\n").contains("ok"));
    assert_eq!(machine.report().xyz(), Some("0.000,0.000,0.000"));
    // 300 mm of belt for motor A, and none for motor B.
    assert_eq!(machine.ask("G1 X-150 Y-150 F5000"), ["ok"]);
    assert_eq!(machine.report().xyz(), Some("-150.000,-150.000,0.000"));
    assert!(
        machine
            .exchange("$J=G90 X-100 Y-201 F5000\n")
            .contains("error:15")
    );
    assert!(machine.exchange("G1 X-201 Y-100\n").contains("ALARM:2"));
}

#[test]
fn arcs_in_every_plane_end_where_the_program_says() {
    let mut machine = Machine::with(&unlocked());
    for line in [
        "G1 X10 Y0 Z0 F3000",
        "G2 X0 Y-10 I-10 J0",
        "G18 G3 X5 Z5 I0 K5",
        "G19 G2 Y-4 Z11 J6 K0 X7",
        "G17 G3 X7 Y-4 I2 J1 Z3",
    ] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
    }
    assert_eq!(machine.report().xyz(), Some("7.000,-4.000,3.000"));
    assert_eq!(physical_mm(&machine), [7.0, -4.0]);
}

#[test]
fn both_belts_have_the_resolution_of_x() {
    let mut machine = Machine::with(&Settings {
        core_xy: false,
        ..unlocked()
    });
    let resolutions = |machine: &mut Machine| {
        let all = machine.ask("$$");
        let of = |number: &str| {
            let line = all.iter().find_map(|line| line.strip_prefix(number));
            line.expect("a setting").to_owned()
        };
        [of("$100="), of("$101="), of("$102=")]
    };
    assert!(machine.exchange("$101=40\n").contains("ok"));
    assert_eq!(resolutions(&mut machine), ["80.000", "40.000", "80.000"]);
    assert!(machine.exchange("$795=1\n").contains("ok"));
    assert_eq!(resolutions(&mut machine), ["80.000", "80.000", "80.000"]);
    let refused = machine.exchange("$101=40\n");
    assert!(refused.contains("error:"), "{refused}");
    assert!(machine.exchange("$101=80\n").contains("ok"));
    assert!(machine.exchange("$100=50\n").contains("ok"));
    assert_eq!(resolutions(&mut machine), ["50.000", "50.000", "80.000"]);
    // With X's resolution, Y's motor would have to turn too fast.
    assert!(machine.exchange("$111=60000\n").contains("ok"));
    let refused = machine.exchange("$100=200\n");
    assert!(refused.contains("error:"), "{refused}");
    assert_eq!(resolutions(&mut machine), ["50.000", "50.000", "80.000"]);
}
