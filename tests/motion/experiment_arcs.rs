//! How the experiment ended its arcs, and what came of it: the fault that `IntegerArc` does not have.
//!
//! The experiment stopped when the point was in the quadrant of the end and past the end with both
//! coordinates; in the fourth quadrant it compared a coordinate with itself in place of Y. Nothing knew
//! that the quadrant of the start must first be left.

use leadscrew::{
    model::Rotation,
    path::{IntegerArc, StepRule},
};

use crate::integer_arcs::places;

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

/// Returns where the experiment stops; nothing where it goes round for ever.
fn stop(
    start: [i32; 2],
    end: [i32; 2],
    rotation: Rotation,
    compares_y_in_fourth: bool,
) -> Option<[i32; 2]> {
    let last = quadrant(end, rotation);
    let [to_x, to_y] = directions(last, rotation);
    // The rule of the experiment goes on for ever: three turns show all of it.
    let radius = f64::from(start[0]).hypot(f64::from(start[1]));
    let steps = (3.0 * 8.0 * radius) as usize;
    let circles = IntegerArc::new(start, start, rotation, 5, StepRule::Sign)?;
    places(start, circles.take(steps))
        .into_iter()
        .skip(1)
        .find(|place| {
            let is_past_x = (place[0] - end[0]) * to_x >= 0;
            let is_past_y = (place[1] - end[1]) * to_y >= 0;
            quadrant(*place, rotation) == last
                && is_past_x
                && (is_past_y || last == 4 && !compares_y_in_fourth)
        })
}

/// Counts arcs that end exactly, more than 1.5 steps off along an axis, and never.
fn count(radius: i32, compares_y_in_fourth: bool) -> [usize; 3] {
    let rotation = Rotation::Clockwise;
    let first = [radius, 0];
    let circle = IntegerArc::new(first, first, rotation, 1, StepRule::Sign).unwrap();
    let circle = &places(first, circle)[1..];
    let mut counts = [0; 3];
    for rotation in [Rotation::CounterClockwise, Rotation::Clockwise] {
        for start in circle {
            for end in circle {
                match stop(*start, *end, rotation, compares_y_in_fourth) {
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
    counts
}

#[test]
fn the_experiment_ended_less_than_half_of_its_arcs_where_they_should() {
    // Of 12 800 arcs: 80 places to 80 places, both directions. Those of radius 50 and 100 are as bad.
    assert_eq!(count(10, false), [6020, 2695, 96]);
    // With Y compared in the fourth quadrant.
    assert_eq!(count(10, true), [6848, 2084, 128]);
}
