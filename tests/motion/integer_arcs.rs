//! Arcs in whole steps, and the arcs of the machine beside them.

use leadscrew::{
    model::{Plane, Rotation},
    settings::Settings,
    stepper::{IntegerArc, StepRule, UnitStep},
};
use proptest::prelude::*;

use crate::support::{Rig, Trace, arc, cases, each, line, with};

const ROTATIONS: [Rotation; 2] = [Rotation::CounterClockwise, Rotation::Clockwise];
const RULES: [StepRule; 3] = [
    StepRule::Sign,
    StepRule::LeastDeviation,
    StepRule::EightDirections,
];
/// Most by which the radius of an arc of the least deviation may be off, steps.
const MOST_OFF: f64 = std::f64::consts::FRAC_1_SQRT_2;

pub(crate) fn radius([x, y]: [i32; 2]) -> f64 {
    f64::from(x).hypot(f64::from(y))
}

/// The letters of the axes that step, `D` for both: `XYY`.
fn letters(steps: impl Iterator<Item = UnitStep>) -> String {
    steps
        .map(|step| match step.signs {
            [_, 0] => 'X',
            [0, _] => 'Y',
            [_, _] => 'D',
        })
        .collect()
}

/// The places that an arc visits, its start included.
pub(crate) fn places(start: [i32; 2], steps: impl Iterator<Item = UnitStep>) -> Vec<[i32; 2]> {
    let mut place = start;
    let mut places = vec![start];
    places.extend(steps.map(|step| {
        for (coordinate, sign) in place.iter_mut().zip(step.signs) {
            *coordinate += sign;
        }
        place
    }));
    places
}

/// The whole places within half a step of a circle.
pub(crate) fn around(whole_radius: i32) -> Vec<[i32; 2]> {
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
    let eight = letters(quarter(StepRule::EightDirections));
    assert_eq!(eight, "YYYDYDDDDXDXXX");
}

#[test]
fn full_circles_have_the_steps_of_the_tables() {
    for (whole, counts) in [(10, [80, 80, 56]), (200, [1600, 1600, 1132])] {
        let start = [whole, 0];
        for (rule, expected) in RULES.into_iter().zip(counts) {
            for rotation in ROTATIONS {
                let arc = IntegerArc::new(start, start, rotation, 1, rule).unwrap();
                assert_eq!(arc.count(), expected, "{start:?} {rule:?}");
            }
        }
    }
}

/// How far an arc is off its circle before it turns straight to its end, and how many steps that takes.
#[derive(Debug, Default, Clone, Copy)]
struct Worst {
    off: f64,
    straight: usize,
}

/// Follows an arc to its end.
fn follow(start: [i32; 2], end: [i32; 2], rotation: Rotation, rule: StepRule) -> Worst {
    let from_start = radius(start);
    let mut worst = Worst::default();
    let mut place = start;
    // A circle of radius r has 8·r steps, and the way straight to the end is shorter than r.
    let longest = 9 * from_start.ceil() as usize + 16;
    let arc = IntegerArc::new(start, end, rotation, 1, rule).unwrap();
    for step in arc.take(longest) {
        for (coordinate, sign) in place.iter_mut().zip(step.signs) {
            *coordinate += sign;
        }
        if step.is_straight {
            worst.straight += 1;
        } else {
            worst.off = worst.off.max((radius(place) - from_start).abs());
        }
    }
    assert_eq!(place, end, "from {start:?} {rotation:?} {rule:?}");
    worst
}

#[test]
fn every_arc_between_whole_places_ends_there_and_stays_on_its_circle() {
    for (rule, (most, longest)) in RULES
        .into_iter()
        .zip([(1.0, 8), (0.6965, 7), (0.4934, 6)])
        .rev()
        .step_by(each(2))
    {
        let mut arcs = 0;
        for whole in 1..=24 {
            let places = around(whole);
            let is_possible = |start: &&[i32; 2]| rule != StepRule::Sign || radius(**start) > 1.0;
            for rotation in ROTATIONS {
                for (number, start) in places.iter().filter(is_possible).enumerate() {
                    arcs += places.len();
                    // When it must be quick, to other ends from each start.
                    let nth = each(7);
                    for end in places.iter().skip(number % nth).step_by(nth) {
                        let worst = follow(*start, *end, rotation, rule);
                        let is_good = worst.off <= most && worst.straight <= longest;
                        assert!(is_good, "{start:?} to {end:?}: {worst:?}");
                    }
                }
            }
        }
        // All but those from the four places at a distance of 1 to eight others, in both directions.
        let without = if rule == StepRule::Sign { 4 * 8 * 2 } else { 0 };
        assert_eq!(arcs, 386_656 - without);
    }
}

/// Farthest inside and outside of all circles from places within half a step of a radius, both directions; or of those
/// from the places of one octant.
fn farthest(whole: i32, rule: StepRule, is_octant: bool) -> [f64; 2] {
    let mut farthest = [0.0_f64; 2];
    let is_tried = |[x, y]: &[i32; 2]| !is_octant || (0 <= *y && y <= x);
    for start in around(whole).into_iter().filter(is_tried) {
        for rotation in ROTATIONS {
            let Some(circle) = IntegerArc::new(start, start, rotation, 2, rule) else {
                continue;
            };
            let mut place = start;
            for step in circle.take(9 * whole as usize + 9) {
                for (coordinate, sign) in place.iter_mut().zip(step.signs) {
                    *coordinate += sign;
                }
                let off = radius(place) - radius(start);
                farthest = [farthest[0].min(off), farthest[1].max(off)];
            }
        }
    }
    farthest
}

#[test]
fn circles_are_off_their_radius_by_what_the_tables_say() {
    let radii = || {
        let is_full = each(2) == 1;
        (1..=200).filter(move |whole| is_full || *whole <= 10 || matches!(whole, 196 | 198))
    };
    for (rule, expected) in RULES
        .into_iter()
        .zip([[-1.0, 0.9974], [-0.7058, 0.7059], [-0.4994, 0.4981]])
        // The rule of the machine by itself, when it must be quick.
        .rev()
        .step_by(each(3))
    {
        let mut worst = [0.0_f64; 2];
        for whole in radii() {
            let [inside, outside] = farthest(whole, rule, true);
            // Circles from one octant, mirrored, have the places of all others: tried up to this radius.
            if whole <= 50 {
                assert_eq!(
                    farthest(whole, rule, false),
                    [inside, outside],
                    "{rule:?} {whole}"
                );
            }
            worst = [worst[0].min(inside), worst[1].max(outside)];
        }
        let is_as_expected = |(worst, expected): (&f64, &f64)| (worst - expected).abs() < 1e-4;
        assert!(
            worst.iter().zip(&expected).all(is_as_expected),
            "{rule:?}: {worst:?}"
        );
    }
}

#[test]
fn a_radius_of_one_needs_the_least_deviation() {
    for rotation in ROTATIONS {
        let start = [1, 0];
        assert!(IntegerArc::new(start, start, rotation, 1, StepRule::Sign).is_none());
        let worst = follow(start, start, rotation, StepRule::LeastDeviation);
        assert!(worst.off <= MOST_OFF, "{worst:?}");
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

/// The axis of a step, and its sign.
pub(crate) fn axis_and_sign(step: UnitStep) -> (usize, i32) {
    match step.signs {
        [x, 0] => (0, x),
        [_, y] => (1, y),
    }
}

/// The steps of both axes in their order, from the given number of steps on.
pub(crate) fn in_order(trace: &Trace, first: usize) -> Vec<(usize, i32)> {
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
pub(crate) fn steps_to(start: [i32; 2]) -> usize {
    start
        .iter()
        .map(|coordinate| coordinate.unsigned_abs() as usize)
        .sum()
}

/// The ends of the axes of a circle: all of them, or one when it must be quick.
fn starts(whole: i32) -> impl Iterator<Item = [i32; 2]> {
    let all = [[whole, 0], [0, whole], [-whole, 0], [0, -whole]];
    all.into_iter()
        .cycle()
        .skip(whole as usize % all.len())
        .take(all.len())
        .step_by(each(all.len()))
}

#[test]
fn full_circles_of_the_machine_are_those_of_the_least_deviation() {
    for whole in (1..=200).step_by(each(3)) {
        for rotation in ROTATIONS {
            for start in starts(whole) {
                let rule = StepRule::LeastDeviation;
                let arc = IntegerArc::new(start, start, rotation, 1, rule).unwrap();
                let expected: Vec<_> = arc.map(axis_and_sign).collect();
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
            let most = MOST_OFF + 1.0 / f64::from(whole);
            prop_assert!(off <= most, "{:?} is {} off", place, off);
        }
        prop_assert_eq!(place, end);
    }
}
