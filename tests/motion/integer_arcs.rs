//! Arcs in whole steps, and the arcs of the machine beside them.

use leadscrew::{
    model::{Plane, Rotation},
    path::{IntegerArc, StepRule, UnitStep},
    settings::Settings,
};
use proptest::prelude::*;

use crate::support::{Rig, Trace, arc, cases, line, with};

const ROTATIONS: [Rotation; 2] = [Rotation::CounterClockwise, Rotation::Clockwise];
const RULES: [StepRule; 2] = [StepRule::Sign, StepRule::LeastDeviation];
/// Most by which the radius may be off, steps.
const RADIUS: [f64; 2] = [1.0, std::f64::consts::FRAC_1_SQRT_2];

fn radius([x, y]: [i32; 2]) -> f64 {
    f64::from(x).hypot(f64::from(y))
}

/// The letters of the axes that step: `XYY`.
fn letters(steps: impl Iterator<Item = UnitStep>) -> String {
    steps.map(|step| ['X', 'Y'][step.axis]).collect()
}

/// The places that an arc visits, its start included.
pub(crate) fn places(start: [i32; 2], steps: impl Iterator<Item = UnitStep>) -> Vec<[i32; 2]> {
    let mut place = start;
    let mut places = vec![start];
    places.extend(steps.map(|step| {
        place[step.axis] += step.sign;
        place
    }));
    places
}

/// The whole places within half a step of a circle.
fn around(whole_radius: i32) -> Vec<[i32; 2]> {
    let side = -whole_radius - 1..=whole_radius + 1;
    let all = side.clone().flat_map(|x| side.clone().map(move |y| [x, y]));
    all.filter(|place| (radius(*place) - f64::from(whole_radius)).abs() <= 0.5)
        .collect()
}

#[test]
fn a_quarter_circle_is_that_of_the_tables() {
    let quarter = |rule| {
        let rotation = Rotation::CounterClockwise;
        IntegerArc::new([10, 0], [0, 10], rotation, 1, rule).unwrap()
    };
    assert_eq!(letters(quarter(StepRule::Sign)), "XYYYYYXYXYYXXYXYXXXX");
    let least = letters(quarter(StepRule::LeastDeviation));
    assert_eq!(least, "YYYXYYXYYXYXXYXXYXXX");
}

/// Follows an arc; the farthest from its circle, in steps, before it turns straight to its end.
fn follow(start: [i32; 2], end: [i32; 2], rotation: Rotation, rule: StepRule) -> f64 {
    let from_start = radius(start);
    let arc = IntegerArc::new(start, end, rotation, 1, rule).unwrap();
    // A circle of radius r has 8·r steps, and the way straight to the end is shorter than r.
    let longest = 9 * from_start.ceil() as usize + 16;
    let places = places(start, arc.take(longest));
    assert_eq!(
        places.last(),
        Some(&end),
        "from {start:?} {rotation:?} {rule:?}"
    );
    assert!(places.len() <= longest, "{start:?} to {end:?}");
    let is_straight = |place: &&[i32; 2]| place[0] != end[0] && place[1] != end[1];
    let curve = places.iter().rev().skip_while(|place| !is_straight(place));
    curve
        .map(|place| (radius(*place) - from_start).abs())
        .fold(0.0, f64::max)
}

#[test]
fn every_arc_between_whole_places_ends_there_and_stays_on_its_circle() {
    for whole in 2..=24 {
        let places = around(whole);
        for (rule, most) in RULES.into_iter().zip(RADIUS) {
            for rotation in ROTATIONS {
                for start in &places {
                    for end in &places {
                        let worst = follow(*start, *end, rotation, rule);
                        assert!(worst <= most, "{start:?} to {end:?}: {worst}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_radius_of_one_needs_the_least_deviation() {
    for rotation in ROTATIONS {
        let start = [1, 0];
        assert!(IntegerArc::new(start, start, rotation, 1, StepRule::Sign).is_none());
        let off = follow(start, start, rotation, StepRule::LeastDeviation);
        assert!(off <= RADIUS[1], "{off}");
        assert!(IntegerArc::new([0, 0], start, rotation, 1, StepRule::LeastDeviation).is_none());
    }
}

#[test]
fn each_further_turn_is_a_full_circle() {
    for (rotation, turns) in ROTATIONS.into_iter().zip([2, 7]) {
        let count = |turns| {
            let rule = StepRule::LeastDeviation;
            IntegerArc::new([8, 6], [-6, 8], rotation, turns, rule)
                .unwrap()
                .count()
        };
        assert_eq!(count(turns), count(1) + (usize::from(turns) - 1) * 80);
    }
}

#[test]
fn the_areas_of_a_full_circle_are_twice_its_area() {
    let (start, rotation) = ([200, 0], Rotation::Clockwise);
    let arc = IntegerArc::new(start, start, rotation, 1, StepRule::LeastDeviation).unwrap();
    let area: i64 = arc.map(|step| step.area).sum();
    let exact = std::f64::consts::TAU * 200.0 * 200.0;
    assert!(
        (area as f64 / exact - 1.0).abs() < 0.001,
        "{area} for {exact}"
    );
}

/// A step is a millimetre.
fn settings() -> Settings {
    with(&[1.0], &[15_000.0], &[10_000.0])
}

/// The steps that the machine makes along an arc from its start, after a line there.
fn native(start: [i32; 2], end: [i32; 2], rotation: Rotation) -> Trace {
    let [x, y] = start.map(f64::from);
    let target = end.map(f64::from);
    Rig::play(
        &settings(),
        &[
            line(&[x, y, 0.0], 15_000.0),
            arc(
                Plane::Xy,
                rotation,
                &[target[0], target[1], 0.0],
                [-x, -y],
                15_000.0,
            ),
        ],
    )
}

/// The steps of both axes in their order, from the given number of steps on.
fn in_order(trace: &Trace, first: usize) -> Vec<(usize, i32)> {
    let mut steps: Vec<_> = (0..2)
        .flat_map(|axis| trace.steps(axis).into_iter().map(move |step| (step, axis)))
        .collect();
    steps.sort_by_key(|(step, axis)| (step.ticks, *axis));
    steps[first..]
        .iter()
        .map(|(step, axis)| (*axis, step.sign))
        .collect()
}

/// The steps of the line to the start.
fn steps_to(start: [i32; 2]) -> usize {
    start.iter().map(|way| way.unsigned_abs() as usize).sum()
}

/// The ends of the axes of a circle: all of them, or one where the tests must be quick.
fn starts(whole: i32) -> impl Iterator<Item = [i32; 2]> {
    let all = [[whole, 0], [0, whole], [-whole, 0], [0, -whole]];
    let count = if cases(1).cases > 1 { all.len() } else { 1 };
    all.into_iter()
        .cycle()
        .skip(whole as usize % all.len())
        .take(count)
}

#[test]
fn full_circles_of_the_machine_are_those_of_the_least_deviation() {
    for whole in 1..=200 {
        for rotation in ROTATIONS {
            for start in starts(whole) {
                let rule = StepRule::LeastDeviation;
                let arc = IntegerArc::new(start, start, rotation, 1, rule).unwrap();
                let expected: Vec<_> = arc.map(|step| (step.axis, step.sign)).collect();
                let made = in_order(&native(start, start, rotation), steps_to(start));
                assert_eq!(made, expected, "{start:?} {rotation:?}");
            }
        }
    }
}

proptest! {
    #![proptest_config(cases(64))]

    #[test]
    fn arcs_of_the_machine_make_the_steps_of_integer_arcs(
        whole in 2..=200,
        picks in (any::<prop::sample::Index>(), any::<prop::sample::Index>()),
        rotation in prop::sample::select(&ROTATIONS[..]),
    ) {
        let all = around(whole);
        let (start, end) = (all[picks.0.index(all.len())], all[picks.1.index(all.len())]);
        let rule = StepRule::LeastDeviation;
        let arc = IntegerArc::new(start, end, rotation, 1, rule).unwrap();
        let places = places(start, arc);
        let made = in_order(&native(start, end, rotation), steps_to(start));
        prop_assert_eq!(made.len(), places.len() - 1);
        let mut place = start;
        for (axis, sign) in made {
            place[axis] += sign;
            // The machine's radius changes evenly where the end lies beside the circle.
            let (low, high) = (radius(start).min(radius(end)), radius(start).max(radius(end)));
            let off = (low - radius(place)).max(radius(place) - high);
            let most = RADIUS[1] + 1.0 / f64::from(whole);
            prop_assert!(off <= most, "{:?} is {} off", place, off);
        }
        prop_assert_eq!(place, end);
    }
}
