//! `CoreXY`, `$795`: homing, probing, jogs and soft limits of the axes, by motors that turn for both.

use leadscrew::{
    axis::{AXES, Axes, X, Y, Z},
    model::{Levels, State, core_xy},
    path::Work,
    settings::Settings,
    sim::{Closes, Simulator, Switch},
    units::TICKS_PER_MS,
};

use crate::support::{Cell, check_limits, fast};

/// Steps per mm of every axis.
const PER_MM: i32 = 80;

fn settings() -> Settings {
    Settings {
        core_xy: true,
        homing: true,
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

/// The machine with its session.
struct Machine(Box<Simulator>);

impl Machine {
    fn new(settings: &Settings) -> Self {
        let mut machine = Self(Box::new(Simulator::new(settings)));
        machine.run(100);
        machine
    }

    /// Sends bytes, waits at most some milliseconds while something is due, and returns what has come.
    fn ask_for(&mut self, bytes: &str, ms: u64) -> String {
        for byte in bytes.bytes() {
            self.0.receive(byte);
            self.0.settle();
        }
        self.run(ms)
    }

    fn run(&mut self, ms: u64) -> String {
        let end = self.0.now() + ms * u64::from(TICKS_PER_MS);
        let mut received = String::new();
        self.0.settle();
        while self.0.now() < end {
            while let Some(byte) = self.0.send() {
                received.push(char::from(byte));
                self.0.settle();
            }
            if self.0.due().is_none() {
                break;
            }
            self.0.advance(end);
        }
        received
    }

    fn ask(&mut self, line: &str) -> String {
        self.ask_for(&format!("{line}\n"), 600_000)
    }

    /// Returns X, Y and Z of `MPos` of a status report.
    fn position(&mut self) -> String {
        let report = self.ask_for("?", 1);
        let position = report.split("MPos:").nth(1).expect("a position");
        let axes: Vec<_> = position.split(['|', ',']).take(3).collect();
        axes.join(",")
    }

    /// Returns where the axes are by the steps that the motors have made, mm.
    fn physical_mm(&self) -> [f64; 2] {
        let motors: Axes<i32> = self.0.physical_steps();
        let (a, b) = (f64::from(motors[X]), f64::from(motors[Y]));
        [(a + b) / 160.0, (a - b) / 160.0]
    }
}

fn unlocked() -> Settings {
    Settings {
        homing: false,
        ..settings()
    }
}

#[test]
fn reports_are_of_the_axes() {
    let mut machine = Machine::new(&unlocked());
    assert_eq!(machine.ask("G1 X10 Y-2.5 Z1 F5000"), "ok\r\n");
    assert_eq!(machine.position(), "10.000,-2.500,1.000");
    let steps = machine.0.physical_steps();
    assert_eq!([steps[X], steps[Y], steps[Z]], [600, 1000, 80]);
    // With another meaning of the motors, the same steps are another position.
    assert!(machine.ask("$795=0").contains("ok"));
    assert_eq!(machine.position(), "7.500,12.500,1.000");
    assert!(machine.ask("$795=1").contains("ok"));
    assert_eq!(machine.ask("G1 X20 F5000"), "ok\r\n");
    assert_eq!(machine.position(), "20.000,-2.500,1.000");
    assert_eq!(machine.physical_mm(), [20.0, -2.5]);
}

#[test]
fn a_probe_is_found_where_the_axes_are() {
    let mut machine = Machine::new(&unlocked());
    let switch = Switch {
        axis: X,
        closes: Closes::From(5 * PER_MM),
        input: Levels::PROBE,
    };
    assert!(machine.0.mount(switch));
    assert_eq!(machine.ask("G1 Y3 F5000"), "ok\r\n");
    let answer = machine.ask("G38.2 X20 Y4 F100");
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
    let mut machine = Machine::new(&unlocked());
    machine.ask_for("$J=G91 X50 Y20 F3000\n", 400);
    machine.ask_for("\u{85}", 0);
    machine.0.receive(0x85);
    machine.run(5000);
    let [x, y] = machine.physical_mm();
    assert!(x > 5.0 && x < 45.0, "{x}");
    let position = machine.position();
    let shown: Vec<f64> = position.split(',').flat_map(str::parse).collect();
    assert!(
        (shown[X] - x).abs() < 0.002 && (shown[Y] - y).abs() < 0.002,
        "{position}, {x}, {y}"
    );
    assert_eq!(machine.ask("G91 G1 X-1 Y-1 F1000"), "ok\r\n");
    let [after_x, after_y] = machine.physical_mm();
    assert!((after_x - x + 1.0).abs() <= 1.01 / 80.0 && (after_y - y + 1.0).abs() <= 1.01 / 80.0);
}

#[test]
fn soft_limits_are_those_of_the_axes() {
    let settings = Settings {
        soft_limits: true,
        homing_marks: 0b111,
        ..settings()
    };
    let mut machine = Machine::new(&settings);
    assert!(machine.ask("$H").contains("ok"));
    assert_eq!(machine.position(), "0.000,0.000,0.000");
    // 300 mm of belt for motor A, and none for motor B.
    assert_eq!(machine.ask("G1 X-150 Y-150 F5000"), "ok\r\n");
    assert_eq!(machine.position(), "-150.000,-150.000,0.000");
    assert!(machine.ask("$J=G90 X-100 Y-201 F5000").contains("error:15"));
    assert!(machine.ask("G1 X-201 Y-100").contains("ALARM:2"));
}

#[test]
fn arcs_in_every_plane_end_where_the_program_says() {
    let mut machine = Machine::new(&unlocked());
    for line in [
        "G1 X10 Y0 Z0 F3000",
        "G2 X0 Y-10 I-10 J0",
        "G18 G3 X5 Z5 I0 K5",
        "G19 G2 Y-4 Z11 J6 K0 X7",
        "G17 G3 X7 Y-4 I2 J1 Z3",
    ] {
        assert_eq!(machine.ask(line), "ok\r\n", "{line}");
    }
    assert_eq!(machine.position(), "7.000,-4.000,3.000");
    assert_eq!(machine.physical_mm(), [7.0, -4.0]);
}

#[test]
fn both_belts_have_the_resolution_of_x() {
    let mut machine = Machine::new(&Settings {
        core_xy: false,
        ..unlocked()
    });
    let resolutions = |machine: &mut Machine| {
        let all = machine.ask("$$");
        let of = |number: &str| {
            let mut lines = all.lines();
            let line = lines.find_map(|line| line.strip_prefix(number));
            line.expect("a setting").to_owned()
        };
        [of("$100="), of("$101="), of("$102=")]
    };
    assert!(machine.ask("$101=40").contains("ok"));
    assert_eq!(resolutions(&mut machine), ["80.000", "40.000", "80.000"]);
    assert!(machine.ask("$795=1").contains("ok"));
    assert_eq!(resolutions(&mut machine), ["80.000", "80.000", "80.000"]);
    let refused = machine.ask("$101=40");
    assert!(refused.contains("error:"), "{refused}");
    assert!(machine.ask("$101=80").contains("ok"));
    assert!(machine.ask("$100=50").contains("ok"));
    assert_eq!(resolutions(&mut machine), ["50.000", "50.000", "80.000"]);
    // With X's resolution, Y's motor would have to turn too fast.
    assert!(machine.ask("$111=60000").contains("ok"));
    let refused = machine.ask("$100=200");
    assert!(refused.contains("error:"), "{refused}");
    assert_eq!(resolutions(&mut machine), ["50.000", "50.000", "80.000"]);
}
