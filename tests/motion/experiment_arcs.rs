//! How the experiment ended its arcs, and the fault of this method, which `IntegerArc` does not have.
//!
//! The experiment stopped when the point was in the quadrant of the end and past the end with both
//! coordinates; in the fourth quadrant it compared a coordinate with itself in place of Y. Nothing knew
//! that the quadrant of the start must first be left.

use leadscrew::{
    model::Rotation,
    stepper::{IntegerArc, StepRule},
};

use crate::{integer_arcs::places, support::each};

const ROTATIONS: [Rotation; 2] = [Rotation::CounterClockwise, Rotation::Clockwise];

/// Returns the quadrant that is entered at a place, 1 to 4.
fn quadrant([x, y]: [i32; 2], rotation: Rotation) -> u8 {
    if rotation == Rotation::Clockwise {
        return match quadrant([x, -y], Rotation::CounterClockwise) {
            1 => 4,
            2 => 3,
            3 => 2,
            _ => 1,
        };
    }
    if x > 0 && y >= 0 {
        1
    } else if x <= 0 && y > 0 {
        2
    } else if x < 0 {
        3
    } else {
        4
    }
}

/// Returns the directions of X and Y in a quadrant.
fn directions(quadrant: u8, rotation: Rotation) -> [i32; 2] {
    let [x, y] = [[-1, 1], [-1, -1], [1, -1], [1, 1]][usize::from(quadrant - 1)];
    match rotation {
        Rotation::CounterClockwise => [x, y],
        Rotation::Clockwise => [-x, -y],
    }
}

/// A place and its quadrant.
type Visited = ([i32; 2], u8);

/// The places that the experiment visits in three turns: its rule goes on for ever.
fn visited(start: [i32; 2], rotation: Rotation) -> Vec<Visited> {
    let radius = f64::from(start[0]).hypot(f64::from(start[1]));
    let steps = (3.0 * 8.0 * radius) as usize;
    let circles = IntegerArc::new(start, start, rotation, 5, StepRule::Sign).unwrap();
    let places = places(start, circles.take(steps)).into_iter().skip(1);
    places
        .map(|place| (place, quadrant(place, rotation)))
        .collect()
}

/// Returns where the experiment stops; nothing where it goes round for ever.
fn stop(
    visited: &[Visited],
    end: [i32; 2],
    rotation: Rotation,
    compares_y_in_fourth: bool,
) -> Option<[i32; 2]> {
    let last = quadrant(end, rotation);
    let [to_x, to_y] = directions(last, rotation);
    let is_past = |(place, quadrant): &&Visited| {
        *quadrant == last
            && (place[0] - end[0]) * to_x >= 0
            && ((place[1] - end[1]) * to_y >= 0 || last == 4 && !compares_y_in_fourth)
    };
    visited.iter().find(is_past).map(|(place, _)| *place)
}

/// The places of the experiment's own circle, clockwise from the end of X.
fn circle(radius: i32) -> Vec<[i32; 2]> {
    let first = [radius, 0];
    let circle = IntegerArc::new(first, first, Rotation::Clockwise, 1, StepRule::Sign).unwrap();
    places(first, circle)[1..].to_vec()
}

/// Counts arcs that end exactly, more than 1.5 steps off along an axis, and never; as the experiment was, and
/// with Y compared in the fourth quadrant.
fn count(radius: i32) -> [[usize; 3]; 2] {
    let circle = circle(radius);
    let mut counts = [[0; 3]; 2];
    for rotation in ROTATIONS {
        for start in &circle {
            let visited = visited(*start, rotation);
            for end in &circle {
                for (counts, compares_y) in counts.iter_mut().zip([false, true]) {
                    match stop(&visited, *end, rotation, compares_y) {
                        None => counts[2] += 1,
                        Some(place) if place == *end => counts[0] += 1,
                        Some([x, y]) => {
                            let off = (x - end[0]).abs().max((y - end[1]).abs());
                            counts[1] += usize::from(off >= 2);
                        }
                    }
                }
            }
        }
    }
    counts
}

/// The radii of the tables; the greatest only where tests may take long.
fn radii() -> &'static [i32] {
    if each(2) == 1 {
        &[10, 50, 100]
    } else {
        &[10, 50]
    }
}

#[test]
fn the_experiment_ended_less_than_half_of_its_arcs_where_they_should() {
    // Of 12 800, 320 000 and 1 280 000 arcs: all places of the circle to all, both directions.
    let expected = [
        [[6020, 2695, 96], [6848, 2084, 128]],
        [[150_764, 73_054, 216], [172_200, 55_568, 288]],
        [[599_184, 298_040, 336], [684_892, 226_500, 448]],
    ];
    for (radius, expected) in radii().iter().zip(expected) {
        assert_eq!(count(*radius), expected, "radius {radius}");
    }
}

#[test]
fn the_same_arcs_end_where_they_should_when_their_quadrants_are_counted() {
    for (radius, expected) in radii().iter().zip([12_800, 320_000, 182_860]) {
        let circle = circle(*radius);
        // All of them, but to other ends from each start of the largest circle.
        let nth = if *radius > 50 { 7 } else { 1 };
        let mut arcs = 0;
        for rotation in ROTATIONS {
            for (number, start) in circle.iter().enumerate() {
                for end in circle.iter().skip(number % nth).step_by(nth) {
                    let arc = IntegerArc::new(*start, *end, rotation, 1, StepRule::Sign).unwrap();
                    let mut place = *start;
                    for step in arc.take(9 * *radius as usize + 16) {
                        place = [place[0] + step.signs[0], place[1] + step.signs[1]];
                    }
                    assert_eq!(place, *end, "from {start:?} {rotation:?}");
                    arcs += 1;
                }
            }
        }
        assert_eq!(arcs, expected, "radius {radius}");
    }
}
