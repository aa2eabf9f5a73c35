//! How fast the junction deviation lets a corner be passed.

use std::array;

use leadscrew::axis::AXES;

/// A displacement of each axis, or a direction: mm, or degrees of a rotary axis.
pub type Point = [f64; AXES];

fn norm(displacement: &Point) -> f64 {
    displacement
        .iter()
        .map(|part| part * part)
        .sum::<f64>()
        .sqrt()
}

/// Returns sine and cosine of half the angle between two directions.
fn half_turn(before: &Point, after: &Point) -> [f64; 2] {
    let [before, after] = [before, after].map(|tangent| tangent.map(|part| part / norm(tangent)));
    let sum: Point = array::from_fn(|axis| before[axis] + after[axis]);
    let change: Point = array::from_fn(|axis| after[axis] - before[axis]);
    [0.5 * norm(&change), 0.5 * norm(&sum)]
}

/// Returns the angle between two directions, rad.
pub fn turn_rad(before: &Point, after: &Point) -> f64 {
    let [sine, cosine] = half_turn(before, after);
    2.0 * sine.atan2(cosine)
}

/// Returns the speed in a corner that a junction deviation allows (S. Jeon 2011), mm/s.
///
/// The circle of the junction touches both directions and passes the corner at the junction
/// deviation, mm. The acceleration limits of the axes, mm/s², in the direction of the change bound the
/// speed on the circle. A different share of a rotary axis is a change, too. The result is the same on
/// all platforms: only square roots are taken.
pub fn allowed_mm_s(before: &Point, after: &Point, limits: &Point, deviation_mm: f64) -> f64 {
    let change: Point = array::from_fn(|axis| after[axis] - before[axis]);
    let size = norm(&change);
    if size < 1.0e-9 {
        return f64::INFINITY;
    }
    let acceleration = (0..AXES)
        .filter(|axis| change[*axis] != 0.0)
        .map(|axis| limits[axis] * size / change[axis].abs())
        .fold(f64::INFINITY, f64::min);
    let [_, cosine] = half_turn(before, after);
    // cos / (1 - cos), without the difference that cancels.
    let radius = deviation_mm * cosine * (1.0 + cosine) / (0.25 * size * size);
    (acceleration * radius).sqrt()
}
