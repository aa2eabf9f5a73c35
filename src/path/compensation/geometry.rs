//! The geometry of the cutter beside the programmed path, in its plane.
//!
//! The cutter's centre follows a line or a circle at the distance of the radius r from the programmed
//! one. Where two moves meet, at the origin here, u and u′ are the directions of travel before and after,
//! n and n′ the normals towards the cutter (u turned by +90° on the left, by -90° on the right):
//!
//! ```text
//!      convex: an arc about o          concave: both tracks end
//!            from r·n to r·n′          where they intersect
//!
//!        t ──╮ track                       │ track
//!    ────────o ╲                      track│
//!     path   │  │                     ─────┘  │ path
//!            │  │                     ────────o
//!                                       path
//! ```
//!
//! At an intersection the path of the cutter bends towards its side: s·(d × d′) > 0 for the directions d, d′
//! of the two tracks there, with s = 1 on the left and -1 on the right. A line meets a circle, and a circle a
//! circle, in two points; the bend has the opposite sign in the other one, where the cutter would come from
//! behind the programmed path. So the sign decides.
//!
//! Lengths are mm, in double precision, relative to a point near by.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::model::{Rotation, Side};

/// A point or a direction in the plane.
pub(super) type Vector = [f64; 2];

/// Angle up to which two moves count as tangent, rad; in LinuxCNC, too.
pub(super) const TANGENT_RAD: f64 = 0.05;

/// The path of the cutter's centre along a move, without its ends.
#[derive(Debug, Clone, Copy)]
pub(super) enum Track {
    /// Through a point, in a direction of length 1.
    Line(Vector, Vector),
    /// About a centre, with a radius.
    Circle(Vector, f64, Rotation),
}

/// How two moves meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meeting {
    Tangent,
    /// The path bends away from the cutter.
    Convex,
    /// The path bends towards the cutter.
    Concave,
}

pub(super) fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1]]
}

/// Returns `a` + `factor`·`b`.
pub(super) fn along(a: Vector, factor: f64, b: Vector) -> Vector {
    [a[0] + factor * b[0], a[1] + factor * b[1]]
}

pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub(super) fn cross(a: Vector, b: Vector) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

pub(super) fn length(a: Vector) -> f64 {
    libm::hypot(a[0], a[1])
}

/// Returns a vector of length 1; `None` for one without a direction.
pub(super) fn unit(a: Vector) -> Option<Vector> {
    let length = length(a);
    (length > 0.0).then(|| [a[0] / length, a[1] / length])
}

/// Returns a vector a quarter of a circle further counter-clockwise.
fn left_of([x, y]: Vector) -> Vector {
    [-y, x]
}

/// Returns 1 on the left and -1 on the right.
pub(super) const fn sign_of_side(side: Side) -> f64 {
    match side {
        Side::Left => 1.0,
        Side::Right => -1.0,
    }
}

/// Returns 1 counter-clockwise and -1 clockwise.
pub(super) const fn sign_of(rotation: Rotation) -> f64 {
    match rotation {
        Rotation::CounterClockwise => 1.0,
        Rotation::Clockwise => -1.0,
    }
}

/// Returns the direction towards the cutter for a direction of travel.
pub(super) fn normal(side: Side, direction: Vector) -> Vector {
    let sign = sign_of_side(side);
    left_of(direction).map(|part| sign * part)
}

/// Returns the direction of travel for a direction towards the cutter.
pub(super) fn travel(side: Side, normal: Vector) -> Vector {
    let sign = -sign_of_side(side);
    left_of(normal).map(|part| sign * part)
}

/// Returns the direction of travel on a circle, at a place relative to its centre.
pub(super) fn tangent(rotation: Rotation, radial: Vector) -> Option<Vector> {
    let sign = sign_of(rotation);
    unit(left_of(radial).map(|part| sign * part))
}

/// Whether the cutter is inside a circle along which it travels.
pub(super) fn is_inside(side: Side, rotation: Rotation) -> bool {
    (side == Side::Left) == (rotation == Rotation::CounterClockwise)
}

/// Returns the angle from one direction to another, rad, counter-clockwise, from -π to π.
pub(super) fn angle_between(from: Vector, to: Vector) -> f64 {
    libm::atan2(cross(from, to), dot(from, to))
}

/// Returns an angle of travel, rad, from more than 0 to a full circle, between two places on a circle
/// relative to its centre.
pub(super) fn sweep(rotation: Rotation, from: Vector, to: Vector) -> f64 {
    let angle = sign_of(rotation) * angle_between(from, to);
    if angle > 0.0 { angle } else { angle + TAU }
}

/// Returns how two moves meet, by the normals n and n′ there.
///
/// The angle β from n′ to n is 0 where they are tangent, and between 0 and π at a convex corner. An exact
/// reversal at the end of a circle of which the cutter is outside, or at the beginning of one, is concave:
/// the cutter would go once around the corner otherwise.
pub(super) fn meeting(
    side: Side,
    n: Vector,
    n_after: Vector,
    is_reversal_concave: bool,
) -> Meeting {
    let mut beta = sign_of_side(side) * angle_between(n_after, n);
    if beta < -FRAC_PI_2 {
        beta += TAU;
    }
    if !(-TANGENT_RAD..=PI + TANGENT_RAD).contains(&beta) {
        Meeting::Concave
    } else if beta <= TANGENT_RAD {
        Meeting::Tangent
    } else if is_reversal_concave && beta > PI - TANGENT_RAD {
        Meeting::Concave
    } else {
        Meeting::Convex
    }
}

/// Returns where two tracks intersect at a concave corner; `None` where they do not.
pub(super) fn intersection(side: Side, before: Track, after: Track) -> Option<Vector> {
    let sign = sign_of_side(side);
    match (before, after) {
        (Track::Line(from, before), Track::Line(other, after)) => {
            // from + x·d lies on the other line: x = (other - from) × d′ / d × d′.
            let bend = cross(before, after);
            let x = cross(minus(other, from), after) / bend;
            (bend != 0.0).then(|| along(from, x, before))
        }
        (Track::Line(from, direction), Track::Circle(centre, radius, rotation)) => {
            on_line(from, direction, centre, radius, sign * sign_of(rotation))
        }
        (Track::Circle(centre, radius, rotation), Track::Line(from, direction)) => {
            on_line(from, direction, centre, radius, -sign * sign_of(rotation))
        }
        (Track::Circle(centre, radius, before), Track::Circle(other, other_radius, after)) => {
            // In the direction of m′ - m at a = (D² + r² - r′²) / 2D, beside it at h = √(r² - a²). There
            // d × d′ = ±D·h / r·r′, positive to the left of m′ - m where both circles have one sense.
            let sign = sign * sign_of(before) * sign_of(after);
            on_circle(centre, radius, other, other_radius, sign)
        }
    }
}

/// Returns a point where two circles intersect: with a positive sign the one to the left of the direction
/// from the first centre to the other.
fn on_circle(
    centre: Vector,
    radius: f64,
    other: Vector,
    other_radius: f64,
    sign: f64,
) -> Option<Vector> {
    let between = minus(other, centre);
    let distance = length(between);
    let direction = unit(between)?;
    let ahead = 0.5 * (distance + (radius - other_radius) * (radius + other_radius) / distance);
    let aside = leg(radius, ahead)?;
    let foot = along(centre, ahead, direction);
    Some(along(foot, sign * aside, left_of(direction)))
}

/// Returns a point where a line intersects a circle: with a positive sign the one that lies further in the
/// direction of the line, where a counter-clockwise circle goes from its right to its left.
fn on_line(p: Vector, d: Vector, centre: Vector, radius: f64, sign: f64) -> Option<Vector> {
    let to_centre = minus(centre, p);
    let half = leg(radius, cross(d, to_centre))?;
    Some(along(p, dot(to_centre, d) + sign * half, d))
}

/// Returns the other leg of a right triangle; `None` where the given one is longer than the hypotenuse.
fn leg(hypotenuse: f64, given: f64) -> Option<f64> {
    let sqr = (hypotenuse - given) * (hypotenuse + given);
    (sqr >= 0.0).then(|| libm::sqrt(sqr))
}

/// Returns the centre of an entry along an arc to `end`, which lies on the radius of the programmed circle
/// about `m`: that of the circle through both ends which touches the track there.
///
/// It lies on the line from `end` to m, as far from both ends: at |c - e| / (2·cos γ), with the angle γ at
/// `end` between that line and the chord. From a quarter of a circle on, the cutter would come from the other
/// side: `None`.
pub(super) fn arc_entry(from: Vector, end: Vector, m: Vector) -> Option<Vector> {
    let chord = minus(from, end);
    let inwards = unit(minus(m, end))?;
    let cosine_by_chord = dot(chord, inwards);
    let radius = 0.5 * dot(chord, chord) / cosine_by_chord;
    (cosine_by_chord > 0.0).then(|| along(end, radius, inwards))
}
