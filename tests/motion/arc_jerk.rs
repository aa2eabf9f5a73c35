//! Arcs under limits of jerk: as fast as chords within the junction deviation, and within the acceleration.

use std::f64::consts::{FRAC_PI_2, PI};

use crate::support::{
    Rig, arc, cases, check_limits, check_path, each, line, number, target, target_steps, with,
};
use leadscrew::{
    axis::Axes,
    model::{Command, Plane, Rotation},
    settings::Settings,
    units::TICKS_PER_MS,
};
use proptest::prelude::*;

/// Steps/mm, speed and acceleration of a mill, junction deviation of 0.01 mm.
fn mill(jerk_mm_s3: f32) -> Settings {
    Settings {
        jerk_mm_s3: Axes::all(jerk_mm_s3),
        ..with(&[320.0, 320.0, 400.0], &[5000.0], &[500.0])
    }
}

/// A distance of chords from their arc, mm: just within the junction deviation.
const DEVIATION_MM: f64 = 0.009_9;

/// A smooth contour, as lines and arcs and with chords in place of arcs.
struct Contour {
    at: [f64; 2],
    heading: f64,
    mm_min: f32,
    arcs: Vec<Command>,
    chords: Vec<Command>,
}

impl Contour {
    fn new(heading: f64, mm_min: f32) -> Self {
        Self {
            at: [0.0; 2],
            heading,
            mm_min,
            arcs: Vec::new(),
            chords: Vec::new(),
        }
    }

    fn straight(&mut self, mm: f64) {
        let (sine, cosine) = self.heading.sin_cos();
        self.at = [self.at[0] + mm * cosine, self.at[1] + mm * sine];
        self.arcs.push(line(&self.at, self.mm_min));
        self.chords.push(line(&self.at, self.mm_min));
    }

    /// An arc by an angle, to the left where that is positive.
    fn turn(&mut self, radius: f64, angle: f64) {
        let side = angle.signum();
        let offset = |heading: f64| {
            let (sine, cosine) = heading.sin_cos();
            [-side * radius * sine, side * radius * cosine]
        };
        let to_centre = offset(self.heading);
        let centre = [self.at[0] + to_centre[0], self.at[1] + to_centre[1]];
        let point = |heading: f64| {
            let to_centre = offset(heading);
            [centre[0] - to_centre[0], centre[1] - to_centre[1]]
        };
        let end = point(self.heading + angle);
        let rotation = if angle > 0.0 {
            Rotation::CounterClockwise
        } else {
            Rotation::Clockwise
        };
        self.arcs
            .push(arc(Plane::Xy, rotation, &end, to_centre, self.mm_min));
        let most = 2.0 * (1.0 - DEVIATION_MM / radius).acos();
        let count = (angle.abs() / most - 1.0e-6).ceil();
        for chord in 1..=count as u32 {
            let heading = self.heading + angle * f64::from(chord) / count;
            self.chords.push(line(&point(heading), self.mm_min));
        }
        (self.at, self.heading) = (end, self.heading + angle);
    }

    /// The times as arcs and as chords, s.
    fn seconds(&self, settings: &Settings) -> [f64; 2] {
        [&self.arcs, &self.chords].map(|commands| {
            let commands = number(commands);
            let trace = Rig::play(settings, &commands);
            trace.check_pulses();
            let end = commands.last().and_then(target).unwrap();
            assert_eq!(trace.net_steps(), target_steps(settings, &end));
            trace.whole_seconds()
        })
    }

    #[track_caller]
    fn check(&self, settings: &Settings, name: &str) {
        let [arcs, chords] = self.seconds(settings);
        let (ratio, jerk, mm_min) = (arcs / chords, settings.jerk_mm_s3[0], self.mm_min);
        println!("{name}, F{mm_min}, {jerk} mm/s³: {arcs:.3} s of {chords:.3} s, {ratio:.3}");
        assert!(
            ratio <= 1.1,
            "{name}, F{mm_min}, {jerk} mm/s³: {arcs} s of {chords} s"
        );
    }
}

/// A pocket of 40 by 30 mm, twice around.
fn pocket(radius: f64, mm_min: f32) -> Contour {
    let mut pocket = Contour::new(0.0, mm_min);
    for side in [40.0, 30.0].into_iter().cycle().take(8) {
        pocket.straight(side - 2.0 * radius);
        pocket.turn(radius, FRAC_PI_2);
    }
    pocket.straight(20.0);
    pocket
}

/// Arcs by an angle to the left and to the right, so many chords each.
fn waves(chords: u32, angle: f64, mm_min: f32) -> Contour {
    let radius = DEVIATION_MM / (1.0 - (0.5 * angle / f64::from(chords)).cos());
    let mut waves = Contour::new(0.5 * angle, mm_min);
    waves.straight(2.0);
    for number in 0..24 {
        waves.turn(radius, if number % 2 == 0 { -angle } else { angle });
    }
    waves.straight(2.0);
    waves
}

const JERKS: [f32; 3] = [5_000.0, 10_000.0, 50_000.0];

#[test]
fn corners_of_a_pocket_take_no_longer_as_arcs_than_as_chords() {
    let radii = [6.0, 3.0, 1.0, 0.5];
    for (nth, jerk) in JERKS.into_iter().enumerate() {
        for (radius, mm_min) in radii
            .into_iter()
            .flat_map(|radius| [3000.0, 1500.0, 5000.0].map(|mm_min| (radius, mm_min)))
            .skip(nth)
            .step_by(each(3))
        {
            let name = format!("pocket r {radius}");
            pocket(radius, mm_min).check(&mill(jerk), &name);
        }
    }
}

#[test]
fn an_s_curve_takes_no_longer_as_arcs_than_as_chords() {
    for (nth, jerk) in JERKS.into_iter().enumerate() {
        // Radii of 0.13 to 3.7 mm.
        for (chords, angle, mm_min) in [
            (8, PI, 1500.0),
            (4, PI, 1500.0),
            (16, PI, 3000.0),
            (20, 1.5 * PI, 3000.0),
            (12, PI, 600.0),
            (6, FRAC_PI_2, 1500.0),
            (12, PI, 1500.0),
        ]
        .into_iter()
        .skip(nth)
        .step_by(each(3))
        {
            let name = format!("{chords} chords");
            waves(chords, angle, mm_min).check(&mill(jerk), &name);
        }
    }
}

#[test]
fn arcs_as_fast_as_chords_keep_path_and_acceleration() {
    for (jerk, contour) in [
        (5_000.0, waves(8, PI, 3000.0)),
        (50_000.0, waves(16, PI, 3000.0)),
        (5_000.0, pocket(1.0, 3000.0)),
        (10_000.0, pocket(6.0, 5000.0)),
    ] {
        let settings = mill(jerk);
        let commands = number(&contour.arcs);
        let trace = Rig::play(&settings, &commands);
        trace.check_pulses();
        check_path(&settings, &commands, &trace, 0.0);
        check_limits(&settings, &trace);
    }
}

#[test]
fn a_line_between_arcs_is_long_enough_to_brake_for_the_smaller_one() {
    let settings = mill(50_000.0);
    for hundredths in (100..240_u32).step_by(each(2)) {
        let mut contour = Contour::new(0.3, 3000.0);
        contour.straight(20.0);
        contour.turn(3.53, 1.2);
        contour.straight(0.01 * f64::from(hundredths));
        contour.turn(0.465, 3.3);
        contour.straight(5.0);
        let commands = number(&contour.arcs);
        check_limits(&settings, &Rig::play(&settings, &commands));
    }
}

/// Moves of a smooth contour: a length, mm, a radius, mm, and an angle.
fn moves() -> impl Strategy<Value = Vec<(f64, f64, f64)>> {
    let radius = prop_oneof![0.05..0.5_f64, 0.5..5.0_f64, 5.0..30.0_f64];
    let length = prop_oneof![Just(0.0), 0.05..1.0_f64, 1.0..20.0_f64];
    let angle = prop_oneof![0.05..1.0_f64, 1.0..6.2_f64, -1.0..-0.05_f64, -6.2..-1.0_f64];
    prop::collection::vec((length, radius, angle), 2..10)
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn smooth_contours_keep_path_and_acceleration(
        moves in moves(),
        heading in 0.0..6.2_f64,
        mm_min in prop_oneof![300.0..2000.0_f32, 2000.0..8000.0_f32],
        accelerations in prop::array::uniform3(100.0..2000.0_f32),
        ramp_s in 0.002..0.13_f32,
        acts in prop::collection::vec(
            (0..3000_u64, prop::sample::select(vec![b'!', b'~', b'~', 0x90, 0x91, 0x92, 0x92])),
            0..8,
        ),
    ) {
        let settings = Settings {
            jerk_mm_s3: Axes::from_fn(|axis| accelerations[axis.min(2)] / ramp_s),
            ..with(&[320.0], &[6000.0], &accelerations)
        };
        let mut contour = Contour::new(heading, mm_min);
        for (mm, radius, angle) in moves {
            if mm > 0.0 {
                contour.straight(mm);
            }
            contour.turn(radius, angle);
        }
        let commands = number(&contour.arcs);
        let mut acts: Vec<_> = acts.iter().map(|(ms, byte)| (ms * u64::from(TICKS_PER_MS), *byte)).collect();
        acts.sort_unstable();
        acts.push((4000 * u64::from(TICKS_PER_MS), b'~'));
        let mut rig = Rig::new(&settings);
        rig.run(&commands, &acts);
        rig.trace.check_pulses();
        check_path(&settings, &commands, &rig.trace, 0.0);
        check_limits(&settings, &rig.trace);
    }
}
