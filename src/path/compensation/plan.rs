//! What the cutter does beside a programmed move: its entry, its corner with the move before, its end.

use core::f64::consts::TAU;

use super::{
    cutter_move::{CutterArc, CutterMove},
    geometry::{
        Meeting, Track, Vector, along, angle_between, arc_entry, dot, intersection, is_inside,
        length, meeting, minus, normal, sign_of, sweep, tangent, travel, unit,
    },
};
use crate::{
    axis::Axes,
    gcode::interpreter::CompensatedMove,
    model::{Cutter, Rotation, Side},
    path::arc::Arc,
    units::Nm,
};

/// Most by which an arc may become longer at a concave corner, rad, as in LinuxCNC: where the corner lies
/// next to its end.
const LONGER_ARC_RAD: f64 = 0.0254;
/// Greatest angle and distance that rounding may make of none.
const ROUNDING_RAD: f64 = 1.0e-6;
const ROUNDING_MM: f64 = 5.0e-6;

/// A move that fits: its compensated end, and the changes of the move before it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plan {
    /// The start of an entry.
    pub(super) entry: Option<Axes<Nm>>,
    pub(super) cutter: Cutter,
    /// The waiting move ends here instead, after this angle if it is an arc.
    pub(super) shortened: Option<([Nm; 2], f64)>,
    /// The end of the move around a convex corner, and its arc.
    pub(super) around: Option<([Nm; 2], Option<CutterArc>)>,
    pub(super) end: [Nm; 2],
    pub(super) arc: Option<CutterArc>,
    /// Length as programmed, mm.
    pub(super) length_mm: f32,
}

impl Plan {
    /// Plans a move behind the one that waits, if any, where all moves so far end; `None` where the cutter
    /// does not fit.
    pub(super) fn new(
        programmed: &CompensatedMove,
        waiting: Option<&CutterMove>,
        end: &Axes<Nm>,
    ) -> Option<Self> {
        let site = Site::new(programmed);
        if programmed.is_entry {
            site.entry()
        } else {
            site.follow(waiting, end)
        }
    }

    /// Whether every axis counts up to the ends of the moves.
    pub(super) fn is_within(&self, farthest: &Axes<Nm>) -> bool {
        let (first, second, _) = self.cutter.plane.axes();
        let shortened = self.shortened.map(|(corner, _)| corner);
        let around = self.around.map(|(corner, _)| corner);
        let mut ends = [Some(self.end), shortened, around].into_iter().flatten();
        ends.all(|end| {
            let mut both = end.into_iter().zip([farthest[first], farthest[second]]);
            both.all(|(value, farthest)| value.0.unsigned_abs() <= farthest.0.unsigned_abs())
        })
    }
}

/// A programmed move, relative to its start.
struct Site<'a> {
    programmed: &'a CompensatedMove,
    origin: [Nm; 2],
    to: Vector,
    arc: Option<ProgrammedArc>,
}

/// The arc of a programmed move.
#[derive(Clone, Copy)]
struct ProgrammedArc {
    centre: Vector,
    rotation: Rotation,
    /// Angle travelled, rad, and the length, mm.
    sweep: f64,
    length_mm: f64,
    /// The part of the angle that is whole circles before the last one, rad.
    circles: f64,
}

impl<'a> Site<'a> {
    fn new(programmed: &'a CompensatedMove) -> Self {
        let (first, second, _) = programmed.cutter.plane.axes();
        let (from, to) = (&programmed.from, &programmed.to);
        let displacement = [to[first] - from[first], to[second] - from[second]];
        Self {
            programmed,
            origin: [from[first], from[second]],
            to: displacement.map(Nm::to_mm_f64),
            arc: programmed.circle.map(|circle| {
                let arc = Arc::new(&circle, displacement);
                ProgrammedArc {
                    centre: circle.centre.map(Nm::to_mm_f64),
                    rotation: circle.rotation,
                    sweep: libm::fabs(arc.sweep),
                    length_mm: arc.length_mm(),
                    circles: TAU * f64::from(circle.turns.saturating_sub(1)),
                }
            }),
        }
    }

    /// Returns a point of the machine, relative to the start.
    fn relative(&self, point: [Nm; 2]) -> Vector {
        [point[0] - self.origin[0], point[1] - self.origin[1]].map(Nm::to_mm_f64)
    }

    /// Returns a place of the plane, rounded.
    fn machine(&self, place: Vector) -> [Nm; 2] {
        let [x, y] = place.map(Nm::from_mm_f64);
        [self.origin[0] + x, self.origin[1] + y]
    }

    /// Returns the length along the linear axes, mm.
    fn length_mm(&self) -> f32 {
        let depth = self.programmed.cutter.plane.axes().2;
        let rise = (self.programmed.to[depth] - self.programmed.from[depth]).to_mm_f64();
        let in_plane = match &self.arc {
            Some(arc) => arc.length_mm,
            None => length(self.to),
        };
        libm::hypot(in_plane, rise) as f32
    }

    /// Returns the radius of the track along a circle.
    fn track_radius(&self, rotation: Rotation, radius: f64) -> Option<f64> {
        let Cutter {
            side, radius_mm, ..
        } = self.programmed.cutter;
        if is_inside(side, rotation) {
            (radius > radius_mm).then_some(radius - radius_mm)
        } else {
            Some(radius + radius_mm)
        }
    }

    /// Plans the first move.
    fn entry(&self) -> Option<Plan> {
        let Cutter {
            side, radius_mm, ..
        } = self.programmed.cutter;
        let here = [0.0; 2];
        if length(self.to) <= radius_mm {
            return None;
        }
        let (end, arc) = match &self.arc {
            None => {
                let aside = normal(side, unit(self.to)?);
                (along(self.to, radius_mm, aside), None)
            }
            Some(arc) => {
                let radial = minus(self.to, arc.centre);
                let radius = self.track_radius(arc.rotation, length(radial))?;
                let end = along(arc.centre, radius, unit(radial)?);
                let centre = arc_entry(here, end, arc.centre)?;
                let angle =
                    |centre, end| sweep(arc.rotation, minus(here, centre), minus(end, centre));
                let entry = CutterArc {
                    centre: self.machine(centre),
                    rotation: arc.rotation,
                    sweep: angle(centre, end) + arc.circles,
                    circles: arc.circles,
                };
                (end, Some(entry))
            }
        };
        Some(Plan {
            entry: Some(self.programmed.from),
            cutter: self.programmed.cutter,
            shortened: None,
            around: None,
            end: self.machine(end),
            arc,
            length_mm: self.length_mm(),
        })
    }

    /// Returns the direction of travel at the start, and the track with its end.
    fn track(&self) -> Option<(Vector, Track, Vector)> {
        let Cutter {
            side, radius_mm, ..
        } = self.programmed.cutter;
        Some(match &self.arc {
            None => {
                let direction = unit(self.to)?;
                let aside = normal(side, direction);
                let start = along([0.0; 2], radius_mm, aside);
                let end = along(self.to, radius_mm, aside);
                (direction, Track::Line(start, direction), end)
            }
            Some(arc) => {
                let ProgrammedArc {
                    centre, rotation, ..
                } = *arc;
                let direction = tangent(rotation, centre.map(|part| -part))?;
                let radius = self.track_radius(rotation, length(centre))?;
                let radial = unit(minus(self.to, centre))?;
                let end = along(centre, radius, radial);
                (direction, Track::Circle(centre, radius, rotation), end)
            }
        })
    }

    /// Plans a move that follows another one.
    fn follow(&self, waiting: Option<&CutterMove>, at: &Axes<Nm>) -> Option<Plan> {
        let cutter = self.programmed.cutter;
        let Cutter {
            side,
            radius_mm,
            plane,
        } = cutter;
        let (first, second, _) = plane.axes();
        let tool = self.relative([at[first], at[second]]);
        let n = unit(tool)?;
        let (direction, after, end) = self.track()?;
        let n_after = normal(side, direction);
        let mut plan = Plan {
            entry: None,
            cutter,
            shortened: None,
            around: None,
            end: self.machine(end),
            arc: None,
            length_mm: self.length_mm(),
        };
        let mut start = tool;
        match meeting(side, n, n_after, self.is_reversal_concave(waiting)) {
            Meeting::Tangent => {}
            Meeting::Convex => {
                start = along([0.0; 2], radius_mm, n_after);
                let rotation = match side {
                    Side::Left => Rotation::Clockwise,
                    Side::Right => Rotation::CounterClockwise,
                };
                let arc = CutterArc {
                    centre: self.origin,
                    rotation,
                    sweep: sweep(rotation, n, n_after),
                    circles: 0.0,
                };
                let arc = (!self.programmed.is_rapid).then_some(arc);
                plan.around = Some((self.machine(start), arc));
            }
            Meeting::Concave => {
                if let Some(waiting) = waiting {
                    let (corner, sweep) = self.shortened(waiting, tool, n, after)?;
                    plan.shortened = Some((self.machine(corner), sweep));
                    start = corner;
                }
            }
        }
        match &self.arc {
            Some(arc) => {
                plan.arc = Some(CutterArc {
                    centre: self.machine(arc.centre),
                    rotation: arc.rotation,
                    sweep: arc.sweep_from(start)?,
                    circles: arc.circles,
                });
            }
            // A line shorter than what the corner takes of it would lead the cutter back into the contour.
            None if dot(direction, minus(end, start)) < -ROUNDING_MM => return None,
            None => {}
        }
        Some(plan)
    }

    /// Whether an exact reversal is a concave corner: see [`meeting`].
    fn is_reversal_concave(&self, waiting: Option<&CutterMove>) -> bool {
        let side = self.programmed.cutter.side;
        match &self.arc {
            Some(arc) => !is_inside(side, arc.rotation),
            None => waiting
                .and_then(|waiting| waiting.arc)
                .is_some_and(|arc| !is_inside(side, arc.rotation)),
        }
    }

    /// Returns the corner up to which the waiting move is shortened, and its angle if it is an arc.
    ///
    /// `None` where there is no corner on both tracks, or where the waiting move would go back from its start,
    /// or around the circle once more: on the contour, which an entry is not part of.
    fn shortened(
        &self,
        waiting: &CutterMove,
        tool: Vector,
        n: Vector,
        after: Track,
    ) -> Option<(Vector, f64)> {
        let Cutter { side, plane, .. } = self.programmed.cutter;
        let (first, second, _) = plane.axes();
        let start = self.relative([waiting.start[first], waiting.start[second]]);
        let Some(arc) = &waiting.arc else {
            let before = Track::Line(tool, travel(side, n));
            let corner = intersection(side, before, after)?;
            let is_back = dot(travel(side, n), minus(corner, start)) < 0.0;
            return (waiting.is_entry || !is_back).then_some((corner, 0.0));
        };
        let centre = self.relative(arc.centre);
        let before = Track::Circle(centre, length(minus(tool, centre)), arc.rotation);
        let corner = intersection(side, before, after)?;
        let last = sweep(arc.rotation, minus(start, centre), minus(corner, centre));
        let shorter = last + arc.circles;
        let is_shorter = shorter <= arc.sweep + LONGER_ARC_RAD;
        (waiting.is_entry || is_shorter).then_some((corner, shorter))
    }
}

impl ProgrammedArc {
    /// Returns the angle of the track that begins at a place beside the start, rad; `None` where that is
    /// beyond its end.
    fn sweep_from(&self, start: Vector) -> Option<f64> {
        let from = self.centre.map(|part| -part);
        let ahead = sign_of(self.rotation) * angle_between(from, minus(start, self.centre));
        let sweep = self.sweep - ahead;
        (sweep >= -ROUNDING_RAD).then_some(sweep.max(0.0))
    }
}
