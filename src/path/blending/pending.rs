//! A line or an arc that is held back until the corner at its end is known.

use super::{FARTHEST_NM, corner::RoundedCorner, fillet::PlaneCurve, linear_mm};
use crate::{
    axis::{AXES, Axes, LINEAR},
    math,
    model::{Circle, Command, FeedRate, Plane, Rotation, Target},
    path::{
        arc::Arc,
        router::{Limits, to_axes},
    },
    units::{MicroDegrees, Nm},
};
use core::f64::consts::FRAC_PI_2;

/// Shortest time for the rest of a line between two arcs, s: the mean of segments.
pub(super) const SHORTEST_REST_S: f32 = 0.7e-3;
/// Least radius and rest of an arc whose ends are moved, mm: its directions have errors of a ten-thousandth from whole nm.
const LEAST_MM: f64 = 0.01;
/// Greatest difference of the radii at both ends, per mm of length, of an arc that counts as a circle. It is twice as much
/// where corners have left half of the arc.
const MAX_GROWTH: f64 = 2.0e-3;

/// A move that is held back.
#[derive(Debug, Clone, Copy)]
pub(super) struct PendingMove {
    /// Start: the end of the corner arc before.
    pub(super) start: Axes<Nm>,
    pub(super) target: Target,
    /// Directions at the start as programmed and at the end.
    pub(super) directions: [[f32; LINEAR]; 2],
    /// Direction of the last of the lines that were merged: movement of the axes per mm.
    pub(super) last_direction: Axes<f32>,
    /// Length as programmed, from corner to corner, mm.
    pub(super) length_mm: f32,
    /// Distance from the lines that were merged, or of a trimmed arc from that with other radii at its ends, mm.
    pub(super) error_mm: f32,
    pub(super) feed_rate: FeedRate,
    pub(super) line: u32,
    /// Speed that can be reached at the start.
    pub(super) reach: Reach,
    /// What the corner at the end has to leave, mm.
    pub(super) rest_mm: f32,
    /// The circle of an arc.
    pub(super) arc: Option<PendingArc>,
}

/// A speed that moves can reach at a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    /// Square, (mm/s)².
    pub(super) sqr: f32,
    /// More cannot be reached. Otherwise moves count that are not known here.
    pub(super) is_known: bool,
}

impl Reach {
    /// Any speed.
    pub(super) const UNKNOWN: Self = Self {
        sqr: 0.0,
        is_known: false,
    };

    /// Returns what is reached under a limit of the squared speed, (mm/s)².
    pub(super) fn up_to(self, limit_sqr: f32) -> Self {
        Self {
            sqr: math::min(self.sqr, limit_sqr),
            is_known: self.is_known || self.sqr >= limit_sqr,
        }
    }
}

/// The circle of an arc that is held back, in a plane of two axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct PendingArc {
    pub(super) plane: Plane,
    rotation: Rotation,
    /// Centre along the axes of the plane.
    centre: [Nm; 2],
    /// Least radius, mm.
    pub(super) radius_mm: f32,
    /// Quarter turns, rounded down.
    quarters: usize,
    /// What the corner at the start has trimmed, mm.
    pub(super) trimmed_mm: f32,
}

impl PendingMove {
    /// The arc of a command; `None` for another command and for an arc that stays as it is.
    pub(super) fn arc(limits: &Limits, from: &Axes<Nm>, command: &Command) -> Option<Self> {
        let Command::Arc {
            target,
            circle,
            feed_rate,
            line,
        } = *command
        else {
            return None;
        };
        let is_fixed_speed = matches!(feed_rate, FeedRate::Rapid | FeedRate::Feed(_));
        if !is_fixed_speed || !is_blended(limits, from, &target, &circle) {
            return None;
        }
        let (first, second, _) = circle.plane.axes();
        let axes = [first, second];
        let displacement = axes.map(|axis| target.position[axis] - from[axis]);
        let arc = Arc::new(&circle, displacement);
        let length_mm = arc.length_mm();
        let growth_mm = libm::fabs(arc.radius[1] - arc.radius[0]);
        let radius_mm = arc.radius[0].min(arc.radius[1]);
        if radius_mm < LEAST_MM || growth_mm > MAX_GROWTH * length_mm {
            return None;
        }
        let directions = [0, 1].map(|end| {
            let tangent = arc.tangent(end);
            let mut direction = [0.0; LINEAR];
            for (axis, part) in axes.into_iter().zip(tangent) {
                direction[axis] = part as f32;
            }
            direction
        });
        Some(Self {
            start: *from,
            target,
            directions,
            last_direction: to_axes(&directions[1]),
            length_mm: length_mm as f32,
            error_mm: 0.5 * growth_mm as f32,
            feed_rate,
            line,
            reach: Reach::UNKNOWN,
            rest_mm: 0.0,
            arc: Some(PendingArc {
                plane: circle.plane,
                rotation: circle.rotation,
                centre: [0, 1].map(|n| from[axes[n]] + circle.centre[n]),
                radius_mm: radius_mm as f32,
                quarters: (libm::fabs(arc.sweep) / FRAC_PI_2) as usize,
                trimmed_mm: 0.0,
            }),
        })
    }

    /// Makes the move begin after a rounded corner.
    pub(super) fn begin_after(&mut self, rounding: &RoundedCorner) {
        self.start = rounding.arc.target;
        self.reach = rounding.reach;
        self.rest_mm = rounding.rest_mm;
        if let Some(arc) = &mut self.arc {
            arc.trimmed_mm = rounding.trimmed_mm;
        }
    }

    /// Returns what the corner at its start has left of the move, mm.
    pub(super) fn left_mm(&self) -> f32 {
        if let Some(arc) = &self.arc {
            return self.length_mm - arc.trimmed_mm;
        }
        let left = linear_mm(&self.start, &self.target.position);
        math::sqrt(math::dot(&left, &left))
    }

    /// Returns the most that a corner may trim, mm, so that at a speed no limit of short moves counts for the rest.
    pub(super) fn most_trimmed_mm(&self, speed_mm_s: f32) -> f32 {
        let least_mm = if let Some(arc) = &self.arc {
            let seconds = Limits::shortest_corner_arc_s(1 + arc.quarters, false);
            math::max(seconds * speed_mm_s, LEAST_MM as f32)
        } else {
            SHORTEST_REST_S * speed_mm_s
        };
        math::min(0.5 * self.length_mm, self.left_mm() - least_mm)
    }

    /// Returns the move as a curve through the corner at its start (0) or its end (1), along two axes.
    pub(super) fn curve(&self, axes: [usize; 2], end: usize, most_mm: f32) -> PlaneCurve {
        let corner = if end == 0 {
            &self.start
        } else {
            &self.target.position
        };
        let (tangent, curvature) = match &self.arc {
            None => (axes.map(|axis| f64::from(self.directions[end][axis])), 0.0),
            Some(arc) => {
                let sense = match arc.rotation {
                    Rotation::CounterClockwise => 1.0,
                    Rotation::Clockwise => -1.0,
                };
                let [x, y] = [0, 1].map(|n| (arc.centre[n] - corner[axes[n]]).to_mm_f64());
                ([sense * y, -sense * x], sense / libm::hypot(x, y))
            }
        };
        let length = libm::hypot(tangent[0], tangent[1]);
        PlaneCurve {
            tangent: tangent.map(|part| part / length),
            curvature,
            most_mm: f64::from(most_mm),
        }
    }

    /// Returns the command of what corners have left of the move, up to a target.
    pub(super) fn command(&self, target: Target) -> Command {
        let (feed_rate, line) = (self.feed_rate, self.line);
        let Some(arc) = &self.arc else {
            return Command::Line {
                target,
                feed_rate,
                line,
            };
        };
        let (first, second, _) = arc.plane.axes();
        Command::Arc {
            target,
            circle: Circle {
                plane: arc.plane,
                centre: [
                    arc.centre[0] - self.start[first],
                    arc.centre[1] - self.start[second],
                ],
                rotation: arc.rotation,
                turns: 1,
                tilt: MicroDegrees::ZERO,
            },
            feed_rate,
            line,
        }
    }
}

/// Returns whether corners at an arc may be rounded: not of a full turn or more, in a tilted plane, of great radius, nor
/// with another axis that moves.
fn is_blended(limits: &Limits, from: &Axes<Nm>, target: &Target, circle: &Circle) -> bool {
    let (first, second, _) = circle.plane.axes();
    let moves = |axis: usize| target.position[axis] != from[axis];
    let is_planar = (0..AXES).all(|axis| axis == first || axis == second || !moves(axis));
    let is_part_of_turn = circle.turns == 1 && (moves(first) || moves(second));
    let is_near = circle
        .centre
        .iter()
        .all(|centre| centre.0.abs() < FARTHEST_NM);
    is_planar
        && is_part_of_turn
        && is_near
        && circle.tilt == MicroDegrees::ZERO
        && limits.rounds_arcs(circle.plane)
}
