//! Arcs under `$790=1`: exactly the steps of the rule, each when the path has come to it.

use leadscrew::{
    axis::Axes,
    model::{Circle, Command, FeedRate, Plane, Rotation},
    settings::Settings,
    stepper::{IntegerArc, StepRule, UnitStep},
    units::{MicroDegrees, TICKS_PER_SECOND},
};
use proptest::prelude::*;

use crate::{
    integer_arcs::{around, axis_and_sign, in_order, radius, steps_to},
    support::{Act, Rig, Step, Trace, at, cases, fast, line, with},
};

const ROTATIONS: [Rotation; 2] = [Rotation::CounterClockwise, Rotation::Clockwise];
const RULE: StepRule = StepRule::Sign;

/// An arc about the origin.
#[derive(Debug, Clone, Copy)]
struct Arc {
    start: [i32; 2],
    end: [i32; 2],
    rotation: Rotation,
    turns: u16,
}

impl Arc {
    fn steps(self) -> IntegerArc {
        IntegerArc::new(self.start, self.end, self.rotation, self.turns, RULE).unwrap()
    }

    /// The same as a command; a step is 1 mm, and Z goes to `z` on the way.
    fn command(self, z: f64, mm_min: f32) -> Command {
        let [x, y] = self.end.map(f64::from);
        Command::Arc {
            target: at(&[x, y, z]).into(),
            circle: Circle {
                plane: Plane::Xy,
                centre: self.start.map(|steps| at(&[-f64::from(steps)])[0]),
                rotation: self.rotation,
                turns: self.turns,
                tilt: MicroDegrees::ZERO,
            },
            feed_rate: FeedRate::Feed(mm_min),
            line: 7,
        }
    }

    /// A line to the start, and the arc.
    fn commands(self, z: f64, mm_min: f32) -> [Command; 2] {
        let [x, y] = self.start.map(f64::from);
        [line(&[x, y, 0.0], 15_000.0), self.command(z, mm_min)]
    }
}

/// A step is a millimetre.
fn settings(acceleration: f32) -> Settings {
    Settings {
        arc_rule: 1,
        ..with(&[1.0], &[15_000.0], &[acceleration])
    }
}

/// The steps of X and Y with their axis, of the arc alone, in their order.
fn steps_of(trace: &Trace) -> Vec<(usize, Step)> {
    let of = |axis| {
        let steps = trace.steps(axis).into_iter();
        steps
            .filter(|step| step.line == 7)
            .map(move |step| (axis, step))
    };
    let mut steps: Vec<_> = of(0).chain(of(1)).collect();
    steps.sort_by_key(|(_, step)| step.ticks);
    let no_two = steps.windows(2).all(|two| two[0].1.ticks < two[1].1.ticks);
    assert!(no_two, "two steps at once");
    steps
}

fn expected(arc: Arc) -> Vec<(usize, i32)> {
    arc.steps().map(axis_and_sign).collect()
}

#[test]
fn a_full_circle_makes_the_steps_of_the_sign_rule() {
    for whole in (2..=24).chain([50, 100, 200]) {
        for rotation in ROTATIONS {
            for start in [[whole, 0], [0, whole], [-whole, 0], [0, -whole]] {
                let arc = Arc {
                    start,
                    end: start,
                    rotation,
                    turns: 1,
                };
                let trace = Rig::play(&settings(10_000.0), &arc.commands(0.0, 15_000.0));
                trace.check_pulses();
                assert_eq!(in_order(&trace, steps_to(start)), expected(arc), "{arc:?}");
            }
        }
    }
}

fn any_arc() -> impl Strategy<Value = Arc> {
    (
        2..=60_i32,
        any::<prop::sample::Index>(),
        any::<prop::sample::Index>(),
        prop::sample::select(&ROTATIONS[..]),
        1..=3_u16,
    )
        .prop_map(|(whole, start, end, rotation, turns)| {
            let all = around(whole);
            let pick = |index: prop::sample::Index| all[index.index(all.len())];
            Arc {
                start: pick(start),
                end: pick(end),
                rotation,
                turns,
            }
        })
}

proptest! {
    #![proptest_config(cases(96))]

    /// Whatever the ramps, the overrides and the holds are.
    #[test]
    fn arcs_make_the_steps_of_the_sign_also_with_holds_and_overrides(
        arc in any_arc(),
        acceleration in prop::sample::select(&[50.0_f32, 500.0, 20_000.0, 1.0e6][..]),
        jerk in prop::sample::select(&[0.0_f32, 1.0e5][..]),
        mm_min in 60.0..15_000.0_f32,
        z in prop::sample::select(&[0.0, 3.0, -40.0][..]),
        acts in prop::collection::vec(
            (0..4_000_000_000_u64, prop::sample::select(&b"!~\x90\x91\x92"[..])),
            0..8,
        ),
    ) {
        let mut settings = settings(acceleration);
        settings.jerk_mm_s3 = Axes::all(jerk);
        let mut acts: Vec<Act> = acts;
        acts.sort_unstable();
        let mut rig = Rig::new(&settings);
        rig.run(&arc.commands(z, mm_min), &acts);
        rig.trace.check_pulses();
        prop_assert_eq!(in_order(&rig.trace, steps_to(arc.start)), expected(arc));
        prop_assert_eq!(rig.trace.net_steps()[2], z as i32);
    }

    /// The rig checks that the machine knows where it is.
    #[test]
    fn a_reset_on_an_arc_leaves_a_known_position(
        arc in any_arc(),
        reset in 0..2_000_000_000_u64,
    ) {
        let mut rig = Rig::new(&settings(500.0));
        rig.run(&arc.commands(2.0, 6000.0), &[(reset, 0x18)]);
        let made = in_order(&rig.trace, steps_to(arc.start).min(rig.trace.steps(0).len()
            + rig.trace.steps(1).len()));
        prop_assert!(expected(arc).starts_with(&made));
    }
}

/// Where steps are due along the arc, in steps of path, and how long it is.
fn due(arc: Arc) -> (Vec<f64>, f64) {
    let radius = radius(arc.start);
    let (mut passed, mut last) = (0.0, [-1.0_f64; 2]);
    let length = |step: UnitStep| {
        if step.is_straight {
            1.0
        } else {
            step.area as f64 / radius
        }
    };
    let due = |step: UnitStep| {
        let own = usize::from(step.signs[0] == 0);
        let middle = passed + 0.5 * length(step);
        passed += length(step);
        // A step after another step of the same axis waits until it is a whole step later.
        last[own] = middle.max(last[own] + 1.0).max(last[1 - own]);
        last[own]
    };
    let due: Vec<_> = arc.steps().map(due).collect();
    let length = due.last().unwrap().max(passed);
    (due, length)
}

#[test]
fn each_step_takes_the_time_of_its_part_of_the_arc() {
    let quarter = [[400, 0], [0, 400]];
    for ([start, end], rotation) in [
        (quarter, Rotation::CounterClockwise),
        (quarter, Rotation::Clockwise),
        ([[30, 40], [-40, 30]], Rotation::Clockwise),
        ([[3, 4], [3, 4]], Rotation::CounterClockwise),
    ] {
        let arc = Arc {
            start,
            end,
            rotation,
            turns: 1,
        };
        let mm_s = 100.0;
        let trace = Rig::play(&settings(1.0e6), &arc.commands(0.0, 60.0 * mm_s as f32));
        let (due, _) = due(arc);
        let made = steps_of(&trace);
        assert_eq!(made.len(), due.len());
        let middle = due.len() / 2;
        let begin = made[middle].1.seconds - due[middle] / mm_s;
        for ((_, step), due) in made.iter().zip(&due) {
            let late = step.seconds - begin - due / mm_s;
            // A ramp of 0.1 ms at both ends, and a change of direction.
            assert!(late.abs() < 0.2e-3, "{late} s at {due} of {arc:?}");
        }
    }
}

#[test]
fn a_motor_steps_no_faster_than_the_feed_on_a_circle() {
    for whole in [2, 3, 5, 10, 50, 200] {
        let start = [whole, 0];
        let arc = Arc {
            start,
            end: start,
            rotation: Rotation::CounterClockwise,
            turns: 1,
        };
        let trace = Rig::play(&settings(1.0e6), &arc.commands(0.0, 15_000.0));
        for axis in 0..2 {
            let steps: Vec<_> = trace
                .steps(axis)
                .into_iter()
                .filter(|step| step.line == 7)
                .collect();
            let closest = steps
                .windows(2)
                .map(|two| two[1].ticks - two[0].ticks)
                .min();
            let period = u64::from(TICKS_PER_SECOND) / 250;
            // Limits may be exceeded by 1 %.
            assert!(
                closest.unwrap() * 1000 >= period * 989,
                "{closest:?} ticks of {period} at {whole}"
            );
        }
    }
}

/// What `prepare` does for a segment is bounded so: `src/stepper/generator/arc.rs`.
#[test]
fn an_arc_makes_few_steps_and_reverses_seldom_within_a_segment() {
    let settings = Settings {
        arc_rule: 1,
        ..with(&[1.0], &[6.0e6], &[1.0e7])
    };
    let longest = u64::from(TICKS_PER_SECOND) * 3 / 2000;
    let per_second = |steps: &[(usize, Step)]| {
        let ticks = steps[steps.len() - 1].1.ticks - steps[0].1.ticks;
        steps.len() as f64 / ticks as f64 * f64::from(TICKS_PER_SECOND)
    };
    for (start, turns) in [1, 2, 3, 5]
        .map(|whole| (around(whole), 3))
        .into_iter()
        .flat_map(|(starts, turns)| starts.into_iter().map(move |start| (start, turns)))
    {
        let arc = Arc {
            start,
            end: start,
            rotation: Rotation::Clockwise,
            turns,
        };
        if radius(start) <= 1.0 {
            continue;
        }
        let trace = Rig::play(&settings, &arc.commands(0.0, 6.0e6));
        let steps = steps_of(&trace);
        assert_eq!(in_order(&trace, steps_to(start)), expected(arc), "{arc:?}");
        for (first, (_, step)) in steps.iter().enumerate() {
            let within = steps[first..].iter();
            let within: Vec<_> = within
                .take_while(|(_, other)| other.ticks - step.ticks <= longest)
                .collect();
            assert!(within.len() <= 6, "{} steps of {arc:?}", within.len());
            let reversals = (0..2).map(|axis| {
                let signs: Vec<_> = within
                    .iter()
                    .filter(|(of, _)| *of == axis)
                    .map(|(_, step)| step.sign)
                    .collect();
                signs.windows(2).filter(|two| two[0] != two[1]).count()
            });
            assert!(reversals.sum::<usize>() <= 3, "{arc:?}");
        }
        assert!(per_second(&steps) < 3000.0, "{arc:?}");
    }
    let circle = Arc {
        start: [200, 0],
        end: [200, 0],
        rotation: Rotation::Clockwise,
        turns: 1,
    };
    let trace = Rig::play(&settings, &circle.commands(0.0, 6.0e6));
    let rate = per_second(&steps_of(&trace));
    // The path has 1500 steps a second, and the axes 4/π of them together.
    assert!((1880.0..1930.0).contains(&rate), "{rate} steps/s");
}

/// Steps of the third axis at even distances along the arc, by its area.
#[test]
fn the_third_axis_of_a_helix_follows_the_area() {
    let arc = Arc {
        start: [100, 0],
        end: [100, 0],
        rotation: Rotation::CounterClockwise,
        turns: 2,
    };
    let z = 500;
    let trace = Rig::play(&settings(1.0e6), &arc.commands(f64::from(z), 6000.0));
    let (due, length) = due(arc);
    let flat = steps_of(&trace);
    for (number, step) in trace.steps(2).iter().enumerate() {
        let part = (2 * number + 1) as f64 / f64::from(2 * z) * length;
        // Between the steps of the plane that are due before and after it.
        let after = due.partition_point(|due| *due < part);
        let tolerance = u64::from(TICKS_PER_SECOND) / 5000;
        if let Some((_, next)) = flat.get(after) {
            assert!(
                step.ticks <= next.ticks + tolerance,
                "step {number} is late"
            );
        }
        if after > 0 {
            assert!(
                step.ticks + tolerance >= flat[after - 1].1.ticks,
                "step {number} is early"
            );
        }
    }
}

#[test]
fn arcs_off_whole_steps_are_the_native_ones_and_reported() {
    let on_steps = Arc {
        start: [10, 0],
        end: [0, 10],
        rotation: Rotation::CounterClockwise,
        turns: 1,
    };
    let change = |change: &dyn Fn(&mut Circle)| {
        let mut command = on_steps.command(0.0, 600.0);
        if let Command::Arc { circle, .. } = &mut command {
            change(circle);
        }
        command
    };
    let uneven = with(&[1.0, 2.0], &[15_000.0], &[500.0]);
    let even = with(&[1.0], &[15_000.0], &[500.0]);
    let centre = change(&|circle| circle.centre[0] = at(&[-10.1])[0]);
    let radius_1 = Arc {
        start: [1, 0],
        end: [0, 1],
        ..on_steps
    };
    for (settings, command, start, applies) in [
        (even, on_steps.command(0.0, 600.0), [10.0, 0.0], true),
        (even, on_steps.command(0.0, 600.0), [10.3, 0.0], false),
        (even, centre, [10.0, 0.0], false),
        (uneven, on_steps.command(0.0, 600.0), [10.0, 0.0], false),
        (even, radius_1.command(0.0, 600.0), [1.0, 0.0], false),
    ] {
        let commands = [line(&start, 600.0), command];
        let settings = Settings {
            arc_rule: 1,
            ..settings
        };
        let mut rig = Rig::new(&settings);
        rig.run(&commands, &[]);
        assert_eq!(
            rig.router.takes_off_steps(),
            !applies,
            "{command:?} from {start:?}"
        );
        let native = Settings {
            arc_rule: 0,
            ..settings
        };
        let native = Rig::play(&native, &commands);
        assert_eq!(
            rig.trace.hash() == native.hash(),
            !applies,
            "{command:?} from {start:?}"
        );
    }
    let mut rig = Rig::new(&fast());
    rig.run(&on_steps.commands(0.0, 600.0), &[]);
    assert!(
        !rig.router.takes_off_steps(),
        "a rule that nobody asked for"
    );
}
