//! Axes with two motors and a switch at each: where homing leaves both, and what it does when that fails.

use leadscrew::{
    axis::{AXES, X, Y, Z},
    model::Levels,
    settings::Settings,
    sim::{Closes, Edge, Simulator, Switch},
    units::{TICKS_PER_MS, TICKS_PER_SECOND},
};
use proptest::prelude::*;

use crate::support::{cases, fast};

/// Steps per mm of every axis.
const PER_MM: i32 = 80;
/// Steps from power-up to the switches.
const AWAY: i32 = 20 * PER_MM;
/// What homing leaves between switch and axis, steps.
const PULL_OFF: i32 = PER_MM;

fn settings() -> Settings {
    Settings {
        homing: true,
        homing_seek_mm_min: 2000.0,
        homing_feed_mm_min: 200.0,
        ..fast()
    }
}

/// A machine of which some axes have two motors.
struct Gantry {
    simulator: Box<Simulator>,
    settings: Settings,
    /// What has come since the machine was asked last.
    received: String,
}

impl Gantry {
    /// Returns a machine whose second motors are some steps ahead, with switches at both ends of each gantry.
    fn new(settings: &Settings, axes: u8, ahead: i32) -> Self {
        let mut simulator = Box::new(Simulator::ganged(settings, axes));
        let others = Levels::limits(((1 << AXES) - 1) & !0b111);
        simulator.set_pin(others, settings.limit_invert);
        for axis in [X, Y, Z] {
            let mut switch = Switch {
                axis,
                closes: closes(settings, axis),
                input: Levels::limits(1 << axis),
            };
            assert!(simulator.mount(switch));
            if axes >> axis & 1 != 0 {
                switch.input = Levels::second_limits(1 << axis);
                assert!(simulator.mount_second(switch));
                simulator.skew(axis, ahead);
            }
        }
        let mut gantry = Self {
            simulator,
            settings: *settings,
            received: String::new(),
        };
        gantry.simulator.settle();
        gantry.run_while(100, |_, _| true);
        gantry
    }

    fn send(&mut self, bytes: &str) {
        self.received.clear();
        for byte in bytes.bytes() {
            self.simulator.receive(byte);
            self.simulator.settle();
        }
    }

    /// Runs for some milliseconds, while something holds of the machine and its last edge.
    fn run_while(&mut self, ms: u64, holds: impl Fn(&Simulator, Option<Edge>) -> bool) {
        let end = self.simulator.now() + ms * u64::from(TICKS_PER_MS);
        while self.simulator.now() < end {
            let edge = self.simulator.advance(end);
            while let Some(byte) = self.simulator.send() {
                self.received.push(char::from(byte));
                self.simulator.settle();
            }
            if !holds(&self.simulator, edge) {
                return;
            }
        }
    }

    /// Sends a line and waits until nothing is due; returns what has come.
    fn ask(&mut self, line: &str) -> &str {
        self.send(&format!("{line}\n"));
        self.run_while(60_000, |simulator, _| simulator.due().is_some());
        &self.received
    }

    fn report(&mut self) -> &str {
        self.send("?");
        self.run_while(10, |_, _| true);
        &self.received
    }

    /// Returns how far both motors of an axis are from their switch, away from it, steps.
    fn distances(&self, axis: usize) -> [i32; 2] {
        let sign = if is_negative(&self.settings, axis) {
            -1
        } else {
            1
        };
        let motors = [
            self.simulator.physical_steps(),
            self.simulator.second_steps(),
        ];
        motors.map(|steps| AWAY - sign * steps[axis])
    }

    /// Returns how far the second motor of an axis is ahead of the first, steps.
    fn ahead(&self, axis: usize) -> i32 {
        self.simulator.second_steps()[axis] - self.simulator.physical_steps()[axis]
    }
}

fn is_negative(settings: &Settings, axis: usize) -> bool {
    settings.homing_direction >> axis & 1 != 0
}

/// Returns where the contact at the end of an axis is closed: with `$5=1` everywhere but at the end.
fn closes(settings: &Settings, axis: usize) -> Closes {
    match (is_negative(settings, axis), settings.limit_invert) {
        (true, false) => Closes::DownFrom(-AWAY),
        (true, true) => Closes::From(1 - AWAY),
        (false, false) => Closes::From(AWAY),
        (false, true) => Closes::DownFrom(AWAY - 1),
    }
}

#[test]
fn a_gantry_skewed_by_3_mm_ends_square_within_a_step() {
    for (homing_direction, ahead) in [(0, 240), (0, -240), (0b111, 240), (0b111, -240)] {
        let settings = Settings {
            homing_direction,
            ..settings()
        };
        let mut gantry = Gantry::new(&settings, 1 << Y, ahead);
        assert_eq!(gantry.ask("$H"), "ok\r\n");
        for distance in gantry.distances(Y) {
            assert!((distance - PULL_OFF).abs() <= 1, "{distance} steps");
        }
        assert!(gantry.ahead(Y).abs() <= 1, "{} steps", gantry.ahead(Y));
        assert_eq!(gantry.distances(X)[0], PULL_OFF);
        assert_eq!(gantry.distances(Z)[0], PULL_OFF);
        let home = if homing_direction == 0 { "-1" } else { "-199" };
        let position = format!("MPos:{home}.000,{home}.000,{home}.000");
        let report = gantry.report();
        assert!(report.contains(&position), "{report}");
        // From there on both move as one.
        let before = gantry.distances(Y);
        assert_eq!(gantry.ask("G53G0Y-50"), "ok\r\n");
        let moved = gantry.distances(Y);
        assert_eq!(moved[0] - before[0], moved[1] - before[1]);
        assert_ne!(moved, before);
    }
}

#[test]
fn a_square_gantry_is_homed_as_fast_as_an_axis_with_one_motor() {
    let seconds = |axes| {
        let mut gantry = Gantry::new(&settings(), axes, 0);
        let begin = gantry.simulator.now();
        assert_eq!(gantry.ask("$H"), "ok\r\n");
        (gantry.simulator.now() - begin) as f64 / f64::from(TICKS_PER_SECOND)
    };
    assert_eq!(seconds(0b11), seconds(0));
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn gantries_end_square_however_they_are_skewed(
        ahead in -9 * PER_MM..9 * PER_MM,
        homing_direction in 0_u8..8,
        axes in 1_u8..8,
        seek_mm_min in 200.0_f32..3000.0,
        limit_invert: bool,
    ) {
        let settings = Settings {
            homing_direction,
            homing_seek_mm_min: seek_mm_min,
            limit_invert,
            ..settings()
        };
        let mut gantry = Gantry::new(&settings, axes, ahead);
        prop_assert_eq!(gantry.ask("$H"), "ok\r\n");
        for axis in [X, Y, Z] {
            let [first, second] = gantry.distances(axis);
            prop_assert!((first - PULL_OFF).abs() <= 1, "axis {}: {}", axis, first);
            if axes >> axis & 1 != 0 {
                prop_assert!((second - PULL_OFF).abs() <= 1, "axis {}: {}", axis, second);
            }
        }
    }
}

/// Homes a gantry until one of its motors moves alone, the second with the sign of `ahead`.
fn begin_squaring(ahead: i32) -> Gantry {
    let mut gantry = Gantry::new(&settings(), 1 << Y, ahead);
    gantry.send("$H\n");
    gantry.run_while(60_000, |simulator, _| {
        simulator.second_steps()[Y] - simulator.physical_steps()[Y] == ahead
    });
    assert_ne!(gantry.ahead(Y), ahead, "it has never moved one alone");
    gantry
}

/// After a cycle that has failed, both motors move as one.
fn check_both_follow(gantry: &mut Gantry) {
    let ahead = gantry.ahead(Y);
    let before = gantry.distances(Y);
    assert!(gantry.ask("$X").ends_with("ok\r\n"), "{}", gantry.received);
    assert_eq!(gantry.ask("$J=G91Y-5F1000"), "ok\r\n");
    assert_eq!(gantry.distances(Y)[0], before[0] + 5 * PER_MM);
    assert_eq!(gantry.ahead(Y), ahead);
}

#[test]
fn a_gantry_that_is_skewed_too_much_is_alarm_10() {
    // A twentieth of the travel of 200 mm.
    for ahead in [-10, 10] {
        let within = ahead * PER_MM - ahead.signum();
        assert_eq!(Gantry::new(&settings(), 1 << Y, within).ask("$H"), "ok\r\n");
        let mut gantry = Gantry::new(&settings(), 1 << Y, ahead * PER_MM + ahead.signum());
        let answer = gantry.ask("$H");
        assert!(answer.contains("ALARM:10"), "{answer}");
        check_both_follow(&mut gantry);
    }
}

#[test]
fn a_reset_while_one_motor_moves_alone_leaves_none_of_them_out() {
    for ahead in [-400, 400] {
        let mut gantry = begin_squaring(ahead);
        gantry.run_while(20, |_, _| true);
        gantry.send("\x18");
        gantry.run_while(2000, |_, _| true);
        assert!(gantry.received.contains("ALARM:6"), "{}", gantry.received);
        assert_ne!(gantry.ahead(Y), ahead);
        check_both_follow(&mut gantry);
        assert_eq!(gantry.ask("$J=G91X-5F1000"), "ok\r\n");
        assert_eq!(gantry.ask("$H"), "ok\r\n");
        assert!(gantry.ahead(Y).abs() <= 1, "{} steps", gantry.ahead(Y));
    }
}

#[test]
fn the_switch_of_a_second_motor_is_one_of_its_axis() {
    let settings = Settings {
        hard_limits: true,
        ..settings()
    };
    let mut gantry = Gantry::new(&settings, 1 << Y, 0);
    assert_eq!(gantry.ask("$H"), "ok\r\n");
    gantry
        .simulator
        .set_pin(Levels::second_limits(1 << Y), true);
    gantry.simulator.settle();
    gantry.run_while(10, |_, _| true);
    assert!(
        gantry.received.contains("ALARM:1\r\n"),
        "{}",
        gantry.received
    );
    let report = gantry.report();
    assert!(report.contains("|Pn:Y|"), "{report}");
    assert!(
        gantry.ask("\x18$H").contains("error:203"),
        "{}",
        gantry.received
    );
}
