//! Contours that the tool does not fit.

use super::{
    geometry::{Piece, Point, ToolPath, left, plus, unit},
    job::{FINE_SAMPLES, Job},
};

/// Why the tool does not fit a job.
#[derive(Debug, Clone, Copy)]
pub(super) enum Misfit {
    /// The entry is not longer than the radius.
    Entry,
    /// An arc around the tool is not larger than it.
    Arc,
    /// A line is shorter than what a corner at its end takes of it.
    Line,
    /// A line is shorter than the part that a corner at its start removes.
    LineAfterCorner,
    /// A line between two corners is shorter than the two parts that the corners remove, and longer than each part.
    Between,
    /// The line after an arc around the tool crosses the path along the arc.
    Missed,
}

pub(super) const MISFITS: [Misfit; 6] = [
    Misfit::Entry,
    Misfit::Arc,
    Misfit::Line,
    Misfit::LineAfterCorner,
    Misfit::Between,
    Misfit::Missed,
];

impl Misfit {
    /// Adds it to a job, by numbers from 0 to 1. Returns where the tool stands before it: where the move
    /// begins that waits. `None` where there is no room for it.
    pub(super) fn add(
        self,
        job: &mut Job,
        tool_path: &ToolPath,
        size: f64,
        angle: f64,
    ) -> Option<Point> {
        let radius = job.radius;
        let at = job.end(0.0);
        let side = job.side;
        let turned = |(start, direction): (Point, Point), angle: f64| {
            let direction = unit(direction[1].atan2(direction[0]) + side * angle);
            (start, direction)
        };
        let last = tool_path[tool_path.len() - 1].0;
        Some(match self {
            Self::Entry => {
                job.entry = Piece::Line {
                    start: [0.0; 2],
                    end: job.form.rounded(plus(
                        [0.0; 2],
                        unit(angle),
                        radius * (0.01 + 0.98 * size),
                    )),
                };
                job.contour.clear();
                [0.0; 2]
            }
            Self::Arc => {
                job.add_arc(at, radius * (0.2 + 0.79 * size), side * (0.3 + 2.0 * angle));
                // Where the move before has ended.
                tool_path[tool_path.len() - 2].0.end()
            }
            Self::Line => {
                let angle = 0.3 + 1.8 * angle;
                let taken = radius * (angle / 2.0).tan();
                let corner = job.add_line(at, taken * (0.2 + 0.7 * size));
                job.add_line(turned(corner, angle), 4.0 * radius);
                last.end()
            }
            Self::LineAfterCorner | Self::Between => {
                // What is before the first corner is long enough.
                let first = 0.3 + 1.8 * angle;
                let [taken, more] = [first, 1.2].map(|angle| radius * (angle / 2.0).tan());
                let before = job.add_line(at, 2.0 * taken + radius);
                if !job.is_wide(&job.tool_path()?, FINE_SAMPLES) {
                    return None;
                }
                let part = 0.1 + 0.8 * size;
                if matches!(self, Self::LineAfterCorner) {
                    job.add_line(turned(before, first), taken * part);
                    return Some(tool_path[tool_path.len() - 1].0.end());
                }
                let corner = job.add_line(turned(before, first), taken + more * part);
                job.add_line(turned(corner, 1.2), 8.0 * radius);
                plus(
                    plus(before.0, before.1, -taken),
                    left(before.1),
                    side * radius,
                )
            }
            Self::Missed => {
                let corner = job.add_arc(at, 1.1 * radius, side * (0.3 + size));
                job.add_line(turned(corner, 0.8 + angle), 4.0 * radius);
                last.end()
            }
        })
    }
}
