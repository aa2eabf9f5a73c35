//! Merging of short lines into one.
//!
//! As in LinuxCNC's "naive CAM detector", all points between the first and the last are near the line
//! from the first to the last. Here the points also follow each other along this line, so the line is nowhere farther
//! from the programmed path than the points are from the line.
//!
//! A merged line is no longer than its lines, and has none of the corners between them. So it is never slower, if it has
//! an acceleration like theirs, and if the corners at both its ends are no slower. The latter depends on what follows:
//! the last line is taken out again where the merged line would have a slower corner with that.

use super::{
    direction, linear_mm,
    pending::{PendingMove, Reach},
};
use crate::{
    axis::{AXES, Axes, LINEAR},
    math,
    model::{Circle, Command, FeedRate, Rotation, Target},
    path::router::{Limits, to_axes},
    units::{MicroDegrees, Nm},
};

/// Most lines merged into one, which bounds the time of a line and the memory.
const POINTS: usize = 100;
/// Least acceleration of a merged line as a part of the acceleration of each of its lines. A line may accelerate more
/// slowly than the lines around it: where axes have different accelerations, and where one axis moves nearly alone.
const ACCELERATION_PART: f32 = 0.99;

/// A line as programmed.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProgrammedLine {
    pub(super) target: Target,
    /// Movement of the axes per mm.
    pub(super) direction: Axes<f32>,
    pub(super) feed_rate: FeedRate,
    pub(super) line: u32,
}

impl ProgrammedLine {
    const NONE: Self = Self {
        target: Target {
            position: Axes([Nm(0); AXES]),
            single_mm: Axes([0.0; AXES]),
        },
        direction: Axes([0.0; AXES]),
        feed_rate: FeedRate::Rapid,
        line: 0,
    };
}

/// What follows the lines that are held back.
#[derive(Debug, Clone, Copy)]
pub(super) enum NextMove {
    /// A move that begins in a direction: movement of the axes per mm of path.
    Direction(Axes<f32>),
    /// Nothing for now.
    Standstill,
    /// A move in any direction, or none.
    Unknown,
}

impl NextMove {
    /// What a command is that cannot be merged, from the end of the lines.
    pub(super) fn of(command: &Command, from: &Axes<Nm>) -> Self {
        match command {
            Command::Arc { target, circle, .. } => {
                tangent(circle, from, &target.position).map_or(Self::Unknown, Self::Direction)
            }
            _ => Self::Unknown,
        }
    }
}

/// The lines from the start to one of the ends, as one.
#[derive(Debug, Clone, Copy)]
struct MergedLines {
    last: ProgrammedLine,
    /// Greatest distance of the ends from the line to the last one, mm.
    error_mm: f32,
}

impl MergedLines {
    const NONE: Self = Self {
        last: ProgrammedLine::NONE,
        error_mm: 0.0,
    };
}

/// Lines one after the other, with the ends of all of them.
#[derive(Debug)]
pub(super) struct Merger {
    start: Axes<Nm>,
    /// Direction of the path before the start.
    before: Axes<f32>,
    /// Limit of the squared speed at the start as programmed, (mm/s)².
    junction_sqr: f32,
    /// Ends, relative to the start, mm.
    points: [[f32; LINEAR]; POINTS],
    count: usize,
    /// All lines, and all but the last one.
    whole: MergedLines,
    shorter: MergedLines,
    /// Greatest acceleration of a line, mm/s².
    acceleration_mm_s2: f32,
}

impl Merger {
    pub(super) const fn new() -> Self {
        Self {
            start: Axes([Nm(0); AXES]),
            before: Axes([0.0; AXES]),
            junction_sqr: 0.0,
            points: [[0.0; LINEAR]; POINTS],
            count: 0,
            whole: MergedLines::NONE,
            shorter: MergedLines::NONE,
            acceleration_mm_s2: 0.0,
        }
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.count == 0
    }

    pub(super) fn clear(&mut self) {
        self.count = 0;
    }

    /// Returns the end of the last line.
    pub(super) fn end(&self) -> Option<&Target> {
        (self.count != 0).then_some(&self.whole.last.target)
    }

    /// Begins with a line. `before` is the direction of the path before it, and `programmed` that as programmed: none
    /// at the start of everything.
    pub(super) fn begin(
        &mut self,
        limits: &Limits,
        from: Axes<Nm>,
        [before, programmed]: [Axes<f32>; 2],
        line: &ProgrammedLine,
    ) {
        self.start = from;
        self.before = before;
        self.junction_sqr = if math::dot(&programmed.0, &programmed.0) > 0.0 {
            limits.junction_sqr(&programmed, &line.direction)
        } else {
            0.0
        };
        self.points[0] = linear_mm(&from, &line.target.position);
        self.count = 1;
        self.whole = MergedLines {
            last: *line,
            error_mm: 0.0,
        };
        self.acceleration_mm_s2 = limits.line_acceleration_mm_s2(&line.direction);
    }

    /// Adds a line; returns false if the merged line would be slower than its lines up to its end, or farther than
    /// `max_mm` from the programmed path.
    pub(super) fn extend(&mut self, limits: &Limits, line: &ProgrammedLine, max_mm: f32) -> bool {
        if self.count == 0 || self.count == POINTS || line.feed_rate != self.whole.last.feed_rate {
            return false;
        }
        let displacement = linear_mm(&self.start, &line.target.position);
        let Some(merged) = direction(&displacement) else {
            return false;
        };
        let merged = to_axes(&merged);
        if limits.is_jerk_limited() && !self.is_straight(limits, &merged, &line.direction) {
            return false;
        }
        let acceleration_mm_s2 = math::max(
            self.acceleration_mm_s2,
            limits.line_acceleration_mm_s2(&line.direction),
        );
        let is_as_fast = limits.line_acceleration_mm_s2(&merged)
            >= ACCELERATION_PART * acceleration_mm_s2
            && is_passed_as_fast(
                limits.junction_sqr(&self.before, &merged),
                self.junction_sqr,
                limits.line_mm_s(line.feed_rate, &merged),
            );
        if !is_as_fast {
            return false;
        }
        let Some(error_mm) = self.error_to(&displacement, max_mm) else {
            return false;
        };
        self.points[self.count] = displacement;
        self.count += 1;
        let last = *line;
        self.shorter = core::mem::replace(&mut self.whole, MergedLines { last, error_mm });
        self.acceleration_mm_s2 = acceleration_mm_s2;
        true
    }

    /// Returns whether the first line and the last one have the direction of the merged one. With limits of jerk the time of
    /// another line is not known: a change of acceleration takes time, too.
    fn is_straight(&self, limits: &Limits, merged: &Axes<f32>, last: &Axes<f32>) -> bool {
        let first = direction(&self.points[0]).map(|first| to_axes(&first));
        let is_along = |direction| limits.junction_sqr(merged, direction) == f32::MAX;
        first.as_ref().is_some_and(is_along) && is_along(last)
    }

    /// Takes out the last line, if all lines as one would have a slower corner to what follows.
    ///
    /// Along a curve, few long lines make sharper corners than many short ones.
    pub(super) fn take_last_before(
        &mut self,
        limits: &Limits,
        next_move: NextMove,
    ) -> Option<ProgrammedLine> {
        if self.count < 2 || self.ends_as_fast(limits, next_move) {
            return None;
        }
        self.count -= 1;
        Some(core::mem::replace(&mut self.whole, self.shorter).last)
    }

    fn ends_as_fast(&self, limits: &Limits, next_move: NextMove) -> bool {
        let Some(merged) = self.points.get(self.count - 1).and_then(direction) else {
            return true;
        };
        let (merged, last) = (to_axes(&merged), &self.whole.last);
        match next_move {
            NextMove::Standstill => true,
            NextMove::Unknown => limits.junction_sqr(&merged, &last.direction) == f32::MAX,
            NextMove::Direction(after) => is_passed_as_fast(
                limits.junction_sqr(&merged, &after),
                limits.junction_sqr(&last.direction, &after),
                limits.line_mm_s(last.feed_rate, &merged),
            ),
        }
    }

    /// Returns the greatest distance of the ends from a line from the start, mm; `None` above `max_mm`.
    fn error_to(&self, displacement: &[f32; LINEAR], max_mm: f32) -> Option<f32> {
        let length_mm = math::sqrt(math::dot(displacement, displacement));
        if length_mm <= 0.0 || max_mm <= 0.0 {
            return None;
        }
        let unit = displacement.map(|part| part / length_mm);
        let max_sqr = max_mm * max_mm;
        let mut before_mm = 0.0;
        let mut error_sqr = 0.0;
        for point in self.points.iter().take(self.count) {
            let along_mm = math::dot(point, &unit);
            if along_mm < before_mm {
                return None;
            }
            before_mm = along_mm;
            let off: [f32; LINEAR] =
                core::array::from_fn(|axis| point[axis] - along_mm * unit[axis]);
            error_sqr = math::max(error_sqr, math::dot(&off, &off));
            if error_sqr > max_sqr {
                return None;
            }
        }
        (before_mm <= length_mm).then(|| math::sqrt(error_sqr))
    }

    /// Returns the merged line and begins anew; `None` for no lines.
    pub(super) fn end_line(&mut self) -> Option<PendingMove> {
        let displacement = *self.points.get(self.count.checked_sub(1)?)?;
        self.count = 0;
        let MergedLines { last, error_mm } = self.whole;
        let length_mm = math::sqrt(math::dot(&displacement, &displacement));
        Some(PendingMove {
            start: self.start,
            target: last.target,
            directions: [displacement.map(|part| part / length_mm); 2],
            last_direction: last.direction,
            length_mm,
            error_mm,
            feed_rate: last.feed_rate,
            line: last.line,
            reach: Reach::UNKNOWN,
            rest_mm: 0.0,
            arc: None,
        })
    }
}

/// Returns true if a junction with a limit of the squared speed is passed no more slowly than with another limit, beside
/// a line of a speed.
fn is_passed_as_fast(sqr: f32, programmed_sqr: f32, line_mm_s: f32) -> bool {
    sqr >= math::min(programmed_sqr, line_mm_s * line_mm_s)
}

/// Returns the direction in which an arc begins; `None` for one that moves other axes than two, too.
fn tangent(circle: &Circle, from: &Axes<Nm>, target: &Axes<Nm>) -> Option<Axes<f32>> {
    let (first, second, _) = circle.plane.axes();
    let is_planar =
        (0..AXES).all(|axis| axis == first || axis == second || target[axis] == from[axis]);
    let centre = circle.centre.map(Nm::to_mm);
    let radius_mm = math::sqrt(math::dot(&centre, &centre));
    if radius_mm <= 0.0 || !is_planar || circle.tilt != MicroDegrees::ZERO {
        return None;
    }
    let per_mm = match circle.rotation {
        Rotation::CounterClockwise => 1.0 / radius_mm,
        Rotation::Clockwise => -1.0 / radius_mm,
    };
    let mut tangent = Axes([0.0; AXES]);
    tangent[first] = centre[1] * per_mm;
    tangent[second] = -centre[0] * per_mm;
    Some(tangent)
}
