//! Hard limits: everything stops at once, and what was output is known.

use crate::support::{self, Cell, cases, fast};
use leadscrew::{
    axis::{Axes, X},
    model::{Alarm, Levels, Notice, State},
    path::Work,
    settings::Settings,
    sim::Closes,
};
use proptest::prelude::*;

fn machine() -> Settings {
    Settings {
        hard_limits: true,
        ..fast()
    }
}

#[test]
fn a_switch_stops_the_machine_and_only_a_reset_frees_it() {
    let mut cell = Cell::new(&machine());
    cell.mount(X, Closes::From(400), Levels::limits(1));
    cell.go(&[20.0, 10.0], 3000.0);
    cell.run_until(|cell| cell.state() == State::Alarm);
    assert_eq!(cell.notices(), [Notice::Alarm(Alarm::HardLimit)]);
    let snapshot = cell.snapshot();
    assert!(snapshot.is_critical);
    cell.run_to_end();
    assert_eq!(cell.snapshot().steps, cell.physical());
    // 1 ms of the filter at 45 mm/s.
    let beyond = cell.physical()[X] - 400;
    assert!((0..=4).contains(&beyond), "{beyond}");
    cell.trace.check_pulses();
    // The switch stays closed: no new fault, neither when the machine is moved off it.
    cell.byte(0x18);
    cell.run_ms(10);
    cell.send(Work::Unlock);
    assert_eq!(cell.state(), State::Idle);
    assert!(!cell.snapshot().is_critical);
    cell.router.set_steps(cell.snapshot().steps);
    cell.go(&[0.0, 0.0], 3000.0);
    cell.run_to_end();
    assert_eq!(cell.physical(), Axes::all(0));
    assert_eq!(cell.alarms(), []);
}

#[test]
fn a_switch_stops_a_machine_that_a_reset_slows_down() {
    let settings = Settings {
        acceleration_mm_s2: Axes::all(50.0),
        ..machine()
    };
    let mut cell = Cell::new(&settings);
    cell.mount(X, Closes::From(2000), Levels::limits(1));
    cell.go(&[100.0], 3000.0);
    cell.run_until(|cell| cell.physical()[X] >= 1900);
    cell.byte(0x18);
    assert!(cell.snapshot().reset_in_motion);
    cell.run_to_end();
    let beyond = cell.physical()[X] - 2000;
    assert!((0..=4).contains(&beyond), "{beyond}");
    assert_eq!(cell.alarms(), [Alarm::HardLimit]);
    assert!(cell.snapshot().is_critical);
    assert_eq!(cell.state(), State::Alarm);
    assert_eq!(cell.snapshot().steps, cell.physical());
    cell.trace.check_pulses();
}

#[test]
fn a_switch_closes_at_rest_too() {
    let mut cell = Cell::new(&machine());
    cell.set_pin(Levels::limits(2), true);
    cell.run_ms(1);
    assert_eq!(cell.alarms(), [Alarm::HardLimit]);
    assert_eq!(cell.state(), State::Alarm);
    // In alarm, another one is no news.
    cell.set_pin(Levels::limits(1), true);
    cell.run_ms(1);
    assert_eq!(cell.alarms(), []);
}

#[test]
fn noise_stops_nothing() {
    let mut cell = Cell::new(&machine());
    cell.go(&[5.0], 3000.0);
    for _ in 0..50 {
        cell.run_ms(1);
        cell.set_pin(Levels::LIMITS, true);
        cell.run_us(250);
        cell.set_pin(Levels::LIMITS, false);
    }
    cell.run_to_end();
    assert_eq!(cell.alarms(), []);
    assert_eq!(cell.physical()[X], 400);
}

#[test]
fn without_the_setting_a_switch_is_only_shown() {
    let mut cell = Cell::new(&fast());
    cell.mount(X, Closes::From(40), Levels::limits(1));
    cell.go(&[5.0], 3000.0);
    cell.run_to_end();
    assert_eq!(cell.state(), State::Idle);
    assert!(cell.snapshot().inputs.has(Levels::limits(1)));
}

#[test]
fn inverted_switches_stop_when_they_open() {
    let settings = Settings {
        limit_invert: true,
        ..fast()
    };
    let mut cell = Cell::new(&settings);
    cell.set_pin(Levels::LIMITS, true);
    cell.run_ms(1);
    cell.send(Work::Configure(Settings {
        hard_limits: true,
        ..settings
    }));
    cell.go(&[5.0], 600.0);
    cell.run_ms(100);
    assert_eq!(cell.state(), State::Run);
    cell.set_pin(Levels::limits(4), false);
    cell.run_ms(1);
    assert_eq!(cell.alarms(), [Alarm::HardLimit]);
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn the_position_after_a_cancelled_motion_is_what_the_pins_did(
        points in prop::collection::vec(prop::array::uniform3(-10.0_f64..10.0), 1..6),
        feed in 10.0_f32..5000.0,
        at_us in 0_u32..2_000_000,
        pulse_us in 3_u8..60,
    ) {
        let settings = Settings { step_pulse_us: pulse_us, ..machine() };
        let mut cell = Cell::new(&settings);
        for point in &points {
            if let Some(work) = cell.router.route(&support::line(point, feed)) {
                cell.send(work);
            }
        }
        cell.run_us(at_us);
        cell.set_pin(Levels::limits(2), true);
        cell.run_until(|cell| cell.state() == State::Alarm);
        cell.run_to_end();
        prop_assert_eq!(cell.alarms(), [Alarm::HardLimit]);
        prop_assert_eq!(cell.snapshot().steps, cell.physical());
        cell.trace.check_pulses();
        // And it goes on from there.
        cell.set_pin(Levels::limits(2), false);
        cell.byte(0x18);
        cell.run_ms(10);
        cell.send(Work::Unlock);
        cell.router.set_steps(cell.snapshot().steps);
        cell.go(&[11.0, 11.0, 11.0], 3000.0);
        cell.run_to_end();
        prop_assert_eq!(cell.physical().0[..3].to_vec(), vec![880; 3]);
        cell.trace.check_pulses();
    }
}
