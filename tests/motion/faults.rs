//! Step events that run out in motion, and clocks that wrap.

use crate::support::{RESET, TICKS_PER_S, add_steps, each, line, receive, with};
use leadscrew::{
    axis::Axes,
    model::{Requests, State},
    path::{Entry, Router, Work},
    settings::{Settings, StepRate},
    sim::Drive,
};

/// The drive on a clock of its own; `prepare` runs only when it is told to.
struct ManualDrive {
    drive: Drive,
    router: Router,
    requests: Requests,
    now: u64,
    sent: u32,
    resets: u32,
    steps: Axes<i32>,
}

impl ManualDrive {
    fn new(settings: &Settings) -> Self {
        Self {
            drive: Drive::new(settings),
            router: Router::new(settings),
            requests: Requests::new(),
            now: 0,
            sent: 0,
            resets: 0,
            steps: Axes::all(0),
        }
    }

    fn send(&mut self, work: Work) {
        let cancellation_count = self.resets;
        assert!(self.drive.enqueue(Entry {
            cancellation_count,
            work
        }));
        self.sent += 1;
    }

    fn go(&mut self, mm: &[f64]) {
        let work = self.router.route(&line(mm, 60_000.0)).expect("it moves");
        self.send(work);
    }

    fn prepare(&mut self) {
        while self.drive.prepare(&self.requests, self.now) {}
    }

    fn step(&mut self) -> bool {
        let Some(edge) = self.drive.step() else {
            return false;
        };
        self.now = edge.ticks;
        add_steps(&mut self.steps, &edge);
        self.drive.due().is_some()
    }

    /// Plays everything, with `prepare` in time.
    fn play(&mut self) {
        self.prepare();
        while self.drive.due().is_some() {
            self.step();
            self.prepare();
        }
        let snapshot = self.drive.snapshot();
        assert!(snapshot.is_at_rest, "{snapshot:?}");
        assert_eq!(snapshot.steps, self.steps);
        assert_eq!(snapshot.finished, self.sent);
        assert_eq!(self.drive.due(), None);
    }

    fn reset(&mut self) {
        receive(&mut self.drive, &self.requests, RESET);
        self.resets += 1;
    }
}

/// Starves the step interrupt after some events, then checks that nothing but a reset helps.
fn starve(settings: &Settings, events: usize) {
    let mut machine = ManualDrive::new(settings);
    for x in [20.0, -20.0, 30.0, 10.0, 5.0] {
        machine.go(&[x, x * 0.7, -x * 0.3]);
    }
    machine.prepare();
    for _ in 0..events {
        assert!(machine.step());
        machine.prepare();
    }
    // From here on `prepare` is too late.
    while machine.step() {}
    machine.go(&[11.0, 0.0, 0.0]);
    machine.play();
    assert!(machine.drive.snapshot().has_underrun);
    assert_eq!(machine.drive.snapshot().state, State::Alarm);
    let stopped = machine.steps;
    machine.send(Work::Unlock);
    machine.go(&[1.0, 0.0, 0.0]);
    machine.send(Work::Dwell(10));
    machine.play();
    assert_eq!(machine.steps, stopped);
    assert_eq!(machine.drive.snapshot().state, State::Alarm);
    machine.reset();
    machine.play();
    assert!(!machine.drive.snapshot().has_underrun);
    let position = machine.router.set_steps(machine.drive.snapshot().steps);
    machine.send(Work::Unlock);
    machine.go(&[position[0].to_mm_f64() + 1.0, 2.0, 3.0]);
    machine.play();
    assert_eq!(machine.drive.snapshot().state, State::Idle);
    let end = settings.steps_per_mm[1]
        .steps_at(leadscrew::units::Nm(2_000_000))
        .0
        .0;
    assert_eq!(machine.steps[1], end);
}

#[test]
fn nothing_is_executed_after_events_ran_out_until_a_reset() {
    let slow = with(&[80.0, 100.0, 400.0], &[5000.0], &[500.0]);
    let quick = Settings {
        step_pulse_us: 3,
        ..with(&[2000.0], &[3600.0], &[100_000.0])
    };
    for settings in [&slow, &quick] {
        for events in [0, 1, 2, 3, 10, 100, 1001, 5000, 9999] {
            starve(settings, events);
        }
    }
}

#[test]
fn a_starved_dwell_ends_and_locks() {
    let mut machine = ManualDrive::new(&Settings::default());
    machine.send(Work::Dwell(1000));
    machine.prepare();
    while machine.step() {}
    machine.play();
    assert!(machine.drive.snapshot().has_underrun);
}

#[test]
fn no_clock_that_wraps_is_noticed() {
    let settings = with(&[80.0, 100.0, 400.0], &[5000.0], &[500.0]);
    // The clock of 84 MHz wraps after 51.13 s: moves begin, run and end around three of them.
    let mut machine = ManualDrive::new(&settings);
    let wrap = u64::from(u32::MAX) + 1;
    let mut wraps = 0;
    let mut side = 1.0;
    while wraps < 3 {
        let before = machine.now;
        let left = wrap - before % wrap;
        let ms = left / (TICKS_PER_S as u64 / 1000);
        match ms {
            0..3 => machine.send(Work::Dwell(1)),
            3..60 => {}
            _ => machine.send(Work::Dwell((ms - 50).min(20_000) as u32)),
        }
        machine.go(&[side, side * 0.3]);
        side = -side;
        machine.play();
        let took = machine.now - before;
        assert!(took < 21 * TICKS_PER_S as u64, "{took}");
        wraps += machine.now / wrap - before / wrap;
    }
    assert_eq!(machine.drive.late(), 0);
}

#[test]
fn an_hour_of_standstill_and_moves_keeps_its_steps() {
    // Slow axes, so that an hour has few steps; the clock wraps 70 times.
    let settings = with(&[1.0, 0.5, 2.0], &[300.0, 200.0, 90.0], &[20.0]);
    let mut machine = ManualDrive::new(&settings);
    let hour = 3600 * TICKS_PER_S as u64;
    let end = hour / each(4) as u64;
    let mut side = 3.0;
    while machine.now < end {
        machine.send(Work::Dwell(100_003));
        machine.go(&[side, -side, side * 0.25]);
        machine.go(&[-side * 2.0, side, -side]);
        side = -side;
        machine.play();
    }
    assert_eq!(machine.drive.snapshot().state, State::Idle);
}

#[test]
fn the_densest_motion_is_prepared_in_time_from_one_segment_to_the_next() {
    for acceleration in [20_000.0, 1.0e6, 1.0e7] {
        let settings = Settings {
            step_pulse_us: 0,
            step_rate: StepRate::Proven(500_000),
            ..with(&[1000.0, 970.0, 1010.0], &[1.0e6], &[acceleration])
        };
        let mut machine = ManualDrive::new(&settings);
        for k in (1..40).step_by(each(5)) {
            let far = f64::from(k * 17 % 40);
            machine.go(&[far, far * 0.97 - 1.0, 3.0 - far * 0.9]);
            machine.play();
            // Rest, and two moves that meet in a corner.
            machine.go(&[far + 1.0, 0.0, 0.0]);
            machine.go(&[0.0, far + 1.0, 1.0]);
            machine.play();
            assert_eq!(machine.drive.snapshot().state, State::Idle);
        }
    }
}

#[test]
fn all_axes_at_once_make_no_more_steps_than_are_proven() {
    let settings = Settings {
        step_pulse_us: 3,
        ..with(&[1000.0], &[1.0e6], &[20_000.0])
    };
    let mut machine = ManualDrive::new(&settings);
    machine.go(&[200.0; 6]);
    machine.play();
    let seconds = machine.now as f64 / TICKS_PER_S;
    let steps: i32 = machine.steps.iter().sum();
    let rate = f64::from(steps) / seconds;
    assert!((149_000.0..150_000.0).contains(&rate), "{rate} steps/s");
}

#[test]
fn a_homing_cycle_whose_events_ran_out_ends() {
    let settings = Settings {
        homing: 1,
        ..with(&[80.0], &[5000.0], &[500.0])
    };
    let mut machine = ManualDrive::new(&settings);
    machine.send(Work::Home(0));
    machine.prepare();
    for _ in 0..100 {
        assert!(machine.step());
        machine.prepare();
    }
    while machine.step() {}
    let stopped = machine.steps;
    machine.play();
    assert!(machine.drive.snapshot().has_underrun);
    machine.reset();
    machine.play();
    assert_eq!(machine.drive.snapshot().state, State::Alarm);
    assert_eq!(machine.steps, stopped, "nothing is searched any more");
}
