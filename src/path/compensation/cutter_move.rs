//! Moves of the cutter's centre, and the commands that they become.

use core::f64::consts::TAU;

use crate::{
    axis::Axes,
    model::{Circle, Command, FeedRate, Plane, Rotation},
    path::arc::Arc,
    units::{MicroDegrees, Nm},
};

/// A move of the cutter's centre.
#[derive(Debug, Clone, Copy)]
pub(super) struct CutterMove {
    pub(super) start: Axes<Nm>,
    pub(super) end: Axes<Nm>,
    pub(super) arc: Option<CutterArc>,
    pub(super) is_entry: bool,
    pub(super) feed_rate: FeedRate,
    pub(super) line: u32,
}

/// The arc of a move.
#[derive(Debug, Clone, Copy)]
pub(super) struct CutterArc {
    pub(super) centre: [Nm; 2],
    pub(super) rotation: Rotation,
    /// Angle travelled, rad, and how much of it is whole circles before the last one.
    pub(super) sweep: f64,
    pub(super) circles: f64,
}

/// Returns a position with other coordinates in the plane.
pub(super) fn placed(plane: Plane, position: &Axes<Nm>, [x, y]: [Nm; 2]) -> Axes<Nm> {
    let (first, second, _) = plane.axes();
    let mut position = *position;
    position[first] = x;
    position[second] = y;
    position
}

impl CutterMove {
    /// Returns the command.
    pub(super) fn command(&self, plane: Plane) -> Command {
        let target = self.end.into();
        let (feed_rate, line) = (self.feed_rate, self.line);
        match self.arc.and_then(|arc| self.circle(plane, &arc)) {
            Some(circle) => Command::Arc {
                target,
                circle,
                feed_rate,
                line,
            },
            None => Command::Line {
                target,
                feed_rate,
                line,
            },
        }
    }

    /// Returns the circle of an arc; `None` for one without a length.
    ///
    /// Its ends are rounded, so that those of a full circle may be a nanometre apart, or not: the angle
    /// decides how often the circle is travelled.
    fn circle(&self, plane: Plane, arc: &CutterArc) -> Option<Circle> {
        let (first, second, _) = plane.axes();
        let centre = [
            arc.centre[0] - self.start[first],
            arc.centre[1] - self.start[second],
        ];
        let displacement = [
            self.end[first] - self.start[first],
            self.end[second] - self.start[second],
        ];
        let mut circle = Circle {
            plane,
            centre,
            rotation: arc.rotation,
            turns: 1,
            tilt: MicroDegrees::ZERO,
        };
        let once = libm::fabs(Arc::new(&circle, displacement).sweep);
        let more = libm::round((arc.sweep - once) / TAU);
        if more < 0.0 || centre == [Nm(0); 2] || centre == displacement {
            return None;
        }
        circle.turns = circle.turns.saturating_add(more as u16);
        Some(circle)
    }
}
