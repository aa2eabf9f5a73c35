//! The programmed path in double precision: lines, arcs and helices as curves over their length.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use leadscrew::{
    axis::{AXES, Axes},
    model::{Circle, Rotation},
    units::Nm,
};

pub(crate) use simulation::junction::Point;

/// Coordinates in mm.
pub(crate) fn millimetres(position: &Axes<Nm>) -> Point {
    position.0.map(|nm| nm.0 as f64 * 1.0e-6)
}

pub(crate) fn minus(a: &Point, b: &Point) -> Point {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

pub(crate) fn dot(a: &Point, b: &Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub(crate) fn norm(a: &Point) -> f64 {
    dot(a, a).sqrt()
}

/// A place, or a direction, of X and Y along the directions in which the motors of `CoreXY` move the tool.
///
/// These directions are at a right angle: the rotation keeps every distance and is its own inverse.
pub(crate) fn turned(at: &Point) -> Point {
    let mut turned = *at;
    let [x, y] = [at[0], at[1]];
    [turned[0], turned[1]] = [x + y, x - y].map(|sum| sum * FRAC_1_SQRT_2);
    turned
}

/// The linear axes. Where a linear axis moves, a distance counts along the linear axes only.
const LINEAR: usize = 3;

/// Length of a displacement as a feed counts: over the linear axes, or over the rotary axes when only these move.
pub(crate) fn length(displacement: &Point) -> f64 {
    let (linear, rotary) = displacement.split_at(LINEAR);
    let [linear, rotary] =
        [linear, rotary].map(|displacement| displacement.iter().map(|x| x * x).sum::<f64>());
    if linear > 1.0e-12 * rotary {
        linear.sqrt()
    } else {
        rotary.sqrt()
    }
}

/// Distance of a point from the stretch between two others.
pub(crate) fn distance_to_stretch(point: &Point, from: &Point, to: &Point) -> f64 {
    let displacement = minus(to, from);
    let square = dot(&displacement, &displacement);
    let offset = minus(point, from);
    let share = if square > 0.0 {
        (dot(&offset, &displacement) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    norm(&std::array::from_fn(|axis| {
        offset[axis] - share * displacement[axis]
    }))
}

/// One move of the program.
#[derive(Debug, Clone)]
pub(crate) struct Piece {
    begin: Point,
    end: Point,
    turn: Option<CircularArc>,
    /// Places and directions are rotated by [`turned`].
    is_turned: bool,
    /// Length, mm; degrees where only rotary axes move.
    pub(crate) length_mm: f64,
    /// Length of the path before the piece, mm.
    pub(crate) from_mm: f64,
    /// Programmed speed, mm/s; `None` for a rapid.
    pub(crate) feed_mm_s: Option<f64>,
    /// The joint with the piece before.
    pub(crate) corner: Corner,
}

/// The joint of a piece with the piece before.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Corner {
    /// By how much the direction changes, rad.
    pub(crate) turn_rad: f64,
    /// By how much the direction changes along each axis, as parts of the speed.
    pub(crate) change: Point,
    /// By how much the curvature changes along each axis, 1/mm.
    pub(crate) curvature_change: Point,
    /// The speed that the junction deviation allows, mm/s.
    pub(crate) allowed_mm_s: f64,
    /// A stop of the machine is programmed between the two pieces.
    pub(crate) is_stop: bool,
    /// The axes together move more than twice as far for one mm of the path as before, or less than
    /// half as far: the share of a rotary axis changes.
    pub(crate) is_regeared: bool,
}

/// The circular part of an arc.
#[derive(Debug, Clone)]
struct CircularArc {
    axes: [usize; 2],
    centre: [f64; 2],
    /// Radius at the start, and the difference between the radius at the end and the radius at the start.
    radius: [f64; 2],
    angle: f64,
    sweep: f64,
}

impl CircularArc {
    fn new(circle: &Circle, from: &Point, to: &Point) -> Self {
        let (first, second, _) = circle.plane.axes();
        let axes = [first, second];
        let offset = circle.centre.map(|nm| nm.0 as f64 * 1.0e-6);
        let centre = [0, 1].map(|n| from[axes[n]] + offset[n]);
        let arm = |at: &Point| [0, 1].map(|n| at[axes[n]] - centre[n]);
        let (begin, end) = (arm(from), arm(to));
        let angle = begin[1].atan2(begin[0]);
        let is_closed = axes
            .iter()
            .all(|axis| (from[*axis] - to[*axis]).abs() < 1.0e-9);
        let travel = (end[1].atan2(end[0]) - angle).rem_euclid(TAU);
        let once = match circle.rotation {
            _ if is_closed => TAU,
            Rotation::CounterClockwise => travel,
            Rotation::Clockwise => TAU - travel,
        };
        let sweep = once + TAU * f64::from(circle.turns.saturating_sub(1));
        let [start, stop] = [begin, end].map(|[x, y]| x.hypot(y));
        Self {
            axes,
            centre,
            radius: [start, stop - start],
            angle,
            sweep: match circle.rotation {
                Rotation::CounterClockwise => sweep,
                Rotation::Clockwise => -sweep,
            },
        }
    }
}

impl Piece {
    /// A move from one point to another, along a line or with a circle.
    pub(crate) fn new(begin: Point, end: Point, circle: Option<&Circle>) -> Self {
        let turn = circle.map(|circle| CircularArc::new(circle, &begin, &end));
        let mut displacement = minus(&end, &begin);
        if let Some(turn) = &turn {
            let [first, second] = turn.axes;
            displacement[first] = turn.sweep * (turn.radius[0] + turn.radius[1] / 2.0);
            displacement[second] = 0.0;
        }
        Self {
            begin,
            end,
            turn,
            is_turned: false,
            length_mm: length(&displacement),
            from_mm: 0.0,
            feed_mm_s: None,
            corner: Corner::default(),
        }
    }

    /// The piece along the directions of the motors of `CoreXY`.
    pub(super) fn turned(self) -> Self {
        Self {
            is_turned: true,
            ..self
        }
    }

    /// Whether the direction changes within the piece.
    pub(crate) fn is_arc(&self) -> bool {
        self.turn.is_some()
    }

    /// The point at a share of the length.
    pub(crate) fn at(&self, share: f64) -> Point {
        let mut point: Point =
            std::array::from_fn(|n| self.begin[n] + (self.end[n] - self.begin[n]) * share);
        if let Some(turn) = &self.turn {
            let radius = turn.radius[0] + turn.radius[1] * share;
            let (sine, cosine) = (turn.angle + turn.sweep * share).sin_cos();
            point[turn.axes[0]] = turn.centre[0] + radius * cosine;
            point[turn.axes[1]] = turn.centre[1] + radius * sine;
        }
        if self.is_turned {
            turned(&point)
        } else {
            point
        }
    }

    /// Change of the position over the share.
    fn slope(&self, share: f64) -> Point {
        let mut slope = minus(&self.end, &self.begin);
        if let Some(turn) = &self.turn {
            let radius = turn.radius[0] + turn.radius[1] * share;
            let (sine, cosine) = (turn.angle + turn.sweep * share).sin_cos();
            slope[turn.axes[0]] = turn.radius[1] * cosine - radius * turn.sweep * sine;
            slope[turn.axes[1]] = turn.radius[1] * sine + radius * turn.sweep * cosine;
        }
        if self.is_turned {
            turned(&slope)
        } else {
            slope
        }
    }

    /// The direction at a share of the length: the motion of the axes for one mm of the path.
    pub(crate) fn tangent(&self, share: f64) -> Point {
        let slope = self.slope(share);
        let length = length(&slope).max(f64::MIN_POSITIVE);
        slope.map(|part| part / length)
    }

    /// The curvature at a share of the length, towards the centre, 1/mm. It leaves out that the radius changes.
    pub(crate) fn curvature(&self, share: f64) -> Point {
        let mut curvature = [0.0; AXES];
        if let Some(turn) = &self.turn {
            let radius = turn.radius[0] + turn.radius[1] * share;
            let size = radius * (turn.sweep / self.length_mm).powi(2);
            let (sine, cosine) = (turn.angle + turn.sweep * share).sin_cos();
            curvature[turn.axes[0]] = -size * cosine;
            curvature[turn.axes[1]] = -size * sine;
        }
        if self.is_turned {
            turned(&curvature)
        } else {
            curvature
        }
    }

    /// The share of the point of the piece that is nearest to a point, sought from a share on (Gauss and Newton).
    pub(crate) fn nearest(&self, point: &Point, from: f64) -> f64 {
        let mut share = from;
        for _ in 0..if self.is_arc() { 6 } else { 1 } {
            let slope = self.slope(share);
            let square = dot(&slope, &slope).max(f64::MIN_POSITIVE);
            let displacement = dot(&minus(point, &self.at(share)), &slope) / square;
            share = (share + displacement).clamp(0.0, 1.0);
            if displacement.abs() < 1.0e-12 {
                break;
            }
        }
        share
    }

    /// The share near a share at which an axis is at a coordinate, maybe beyond the ends. `None`
    /// where less than a part of the displacement leads along the axis.
    pub(crate) fn crossing(
        &self,
        axis: usize,
        coordinate: f64,
        near: f64,
        part: f64,
    ) -> Option<f64> {
        let mut share = near;
        for _ in 0..if self.is_arc() { 4 } else { 1 } {
            let slope = self.slope(share)[axis];
            if slope.abs() < part * self.length_mm {
                return None;
            }
            share += (coordinate - self.at(share)[axis]) / slope;
        }
        Some(share)
    }
}

#[cfg(test)]
mod tests {
    use leadscrew::model::Plane;

    use super::*;

    fn point(x: f64, y: f64, z: f64) -> Point {
        std::array::from_fn(|axis| [x, y, z].get(axis).copied().unwrap_or(0.0))
    }

    fn quarter() -> Piece {
        let circle = Circle {
            plane: Plane::Xy,
            centre: [Nm(-10_000_000), Nm(0)],
            rotation: Rotation::CounterClockwise,
            turns: 1,
            tilt: leadscrew::units::MicroDegrees::ZERO,
        };
        Piece::new(point(10.0, 0.0, 0.0), point(0.0, 10.0, 0.0), Some(&circle))
    }

    #[test]
    fn an_arc_has_its_length_and_its_tangents() {
        let arc = quarter();
        assert!((arc.length_mm - TAU * 2.5).abs() < 1.0e-12);
        assert!((arc.tangent(0.0)[1] - 1.0).abs() < 1.0e-12);
        assert!((arc.tangent(1.0)[0] + 1.0).abs() < 1.0e-12);
        let (begin, end) = (arc.curvature(0.0), arc.curvature(1.0));
        assert!((begin[0] + 0.1).abs() < 1.0e-12 && (end[1] + 0.1).abs() < 1.0e-12);
        let middle = arc.at(0.5);
        assert!((middle[0] - 50.0_f64.sqrt()).abs() < 1.0e-12);
    }

    #[test]
    fn the_nearest_point_of_an_arc_is_on_the_radius() {
        let share = quarter().nearest(&point(7.2, 7.2, 0.0), 0.1);
        assert!((share - 0.5).abs() < 1.0e-9);
        let crossing = quarter().crossing(1, 50.0_f64.sqrt(), 0.4, 0.1).unwrap();
        assert!((crossing - 0.5).abs() < 1.0e-6);
        assert_eq!(quarter().crossing(0, 10.0, 0.0, 0.1), None);
    }

    #[test]
    fn the_distance_counts_along_the_linear_axes_where_one_of_them_moves() {
        const A: usize = if AXES > 3 { 3 } else { 0 };
        if A == 0 {
            return;
        }
        let with_a = |x: f64, y: f64, a: f64| {
            let mut point = point(x, y, 0.0);
            point[A] = a;
            point
        };
        let both = Piece::new(with_a(0.0, 0.0, 0.0), with_a(3.0, 4.0, 100.0), None);
        assert_eq!((both.length_mm, both.tangent(0.5)[A]), (5.0, 20.0));
        let alone = Piece::new(with_a(3.0, 4.0, 0.0), with_a(3.0, 4.0, -100.0), None);
        assert_eq!((alone.length_mm, alone.tangent(0.5)[A]), (100.0, -1.0));
    }

    #[test]
    fn a_stretch_ends() {
        let (a, b) = (point(0.0, 0.0, 0.0), point(4.0, 0.0, 0.0));
        assert_eq!(distance_to_stretch(&point(2.0, 3.0, 0.0), &a, &b), 3.0);
        assert_eq!(distance_to_stretch(&point(7.0, 4.0, 0.0), &a, &b), 5.0);
    }
}
