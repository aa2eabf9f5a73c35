//! Short lines that one line can stand for.
//!
//! As in LinuxCNC's "naive CAM detector": all points between the first and the last are near the
//! line from the one to the other. Here they also come in order along it, so that no point of that
//! line is farther from them than they are from it.

use super::{LINEAR, Straight, direction, dot, linear_mm};
use crate::{
    axis::Axes,
    math,
    model::{Circle, FeedRate, Rotation, Target},
    units::Nm,
};

/// Lines that one can stand for.
const POINTS: usize = 100;

/// Lines one after the other, with the ends of all of them.
#[derive(Debug)]
pub(super) struct Chain {
    start: Axes<Nm>,
    end: Target,
    /// Ends, seen from the start, mm.
    points: [[f32; LINEAR]; POINTS],
    count: usize,
    /// How far the ends but the last are from the line from the start to it, mm, and how far that
    /// is from what was programmed.
    error_mm: f32,
    given_mm: f32,
    feed_rate: FeedRate,
    line: u32,
}

impl Chain {
    pub(super) const fn new() -> Self {
        Self {
            start: Axes([Nm(0); crate::axis::AXES]),
            end: Target {
                position: Axes([Nm(0); crate::axis::AXES]),
                single_mm: Axes([0.0; crate::axis::AXES]),
            },
            points: [[0.0; LINEAR]; POINTS],
            count: 0,
            error_mm: 0.0,
            given_mm: 0.0,
            feed_rate: FeedRate::Rapid,
            line: 0,
        }
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.count == 0
    }

    pub(super) fn clear(&mut self) {
        self.count = 0;
    }

    /// Where it ends.
    pub(super) fn end(&self) -> Option<&Target> {
        (self.count != 0).then_some(&self.end)
    }

    /// From its start to its end.
    pub(super) fn direction(&self) -> Option<[f32; LINEAR]> {
        direction(self.points.get(self.count.checked_sub(1)?)?)
    }

    /// From its start to another end.
    pub(super) fn direction_to(&self, target: &Target) -> Option<[f32; LINEAR]> {
        let is_any = self.count != 0;
        direction(&linear_mm(&self.start, &target.position)).filter(|_| is_any)
    }

    /// Begins with a line that is off the programmed one by an error.
    pub(super) fn begin(
        &mut self,
        from: Axes<Nm>,
        target: Target,
        feed_rate: FeedRate,
        line: u32,
        error_mm: f32,
    ) {
        self.start = from;
        self.end = target;
        self.points[0] = linear_mm(&from, &target.position);
        self.count = 1;
        self.error_mm = 0.0;
        self.given_mm = error_mm;
        self.feed_rate = feed_rate;
        self.line = line;
    }

    /// Adds a line; false if one line from the start to its end would be too far from the others.
    pub(super) fn extend(
        &mut self,
        target: &Target,
        feed_rate: FeedRate,
        line: u32,
        error_mm: f32,
        most_mm: f32,
    ) -> bool {
        if self.count == 0 || self.count == POINTS || feed_rate != self.feed_rate {
            return false;
        }
        let given_mm = math::max(self.given_mm, error_mm);
        let way = linear_mm(&self.start, &target.position);
        let Some(error_mm) = self.error_to(&way, most_mm - given_mm) else {
            return false;
        };
        self.points[self.count] = way;
        self.count += 1;
        self.end = *target;
        self.error_mm = error_mm;
        self.given_mm = given_mm;
        self.line = line;
        true
    }

    /// How far the ends are from a way from the start, if it is no more than that, mm.
    fn error_to(&self, way: &[f32; LINEAR], most_mm: f32) -> Option<f32> {
        let length_mm = math::sqrt(dot(way, way));
        if length_mm <= 0.0 || most_mm <= 0.0 {
            return None;
        }
        let unit = way.map(|way| way / length_mm);
        let most_sqr = most_mm * most_mm;
        let mut done_mm = 0.0;
        let mut error_sqr = 0.0;
        for point in self.points.iter().take(self.count) {
            let along_mm = dot(point, &unit);
            if along_mm < done_mm {
                return None;
            }
            done_mm = along_mm;
            let off: [f32; LINEAR] =
                core::array::from_fn(|axis| point[axis] - along_mm * unit[axis]);
            error_sqr = math::max(error_sqr, dot(&off, &off));
            if error_sqr > most_sqr {
                return None;
            }
        }
        (done_mm <= length_mm).then(|| math::sqrt(error_sqr))
    }

    /// The line that stands for all, if there are any; the chain is empty then.
    pub(super) fn end_line(&mut self) -> Option<Straight> {
        let way = *self.points.get(self.count.checked_sub(1)?)?;
        self.count = 0;
        let length_mm = math::sqrt(dot(&way, &way));
        Some(Straight {
            start: self.start,
            target: self.end,
            direction: way.map(|way| way / length_mm),
            length_mm,
            error_mm: self.error_mm + self.given_mm,
            feed_rate: self.feed_rate,
            line: self.line,
        })
    }
}

/// The way to the middle of an arc so flat that two lines by way of it stand for the arc, and how
/// far they are from it, mm. `way` leads to its end.
pub(super) fn halves(circle: &Circle, way: &Axes<Nm>, most_mm: f32) -> Option<(Axes<Nm>, f32)> {
    let (first, second, _) = circle.plane.axes();
    if most_mm <= 0.0 || circle.turns > 1 {
        return None;
    }
    let chord = [way[first], way[second]].map(Nm::to_mm);
    let centre = circle.centre.map(Nm::to_mm);
    let chord_sqr = chord[0] * chord[0] + chord[1] * chord[1];
    let [to_start, to_end] = [centre, [centre[0] - chord[0], centre[1] - chord[1]]]
        .map(|[x, y]| math::sqrt(x * x + y * y));
    let radius = 0.5 * (to_start + to_end);
    let inner_sqr = radius * radius - 0.25 * chord_sqr;
    if chord_sqr <= 0.0 || inner_sqr <= 0.0 {
        return None;
    }
    // Less than a half turn: the centre is to the left of the chord of a counter-clockwise arc.
    let left = chord[0] * centre[1] - chord[1] * centre[0];
    let is_minor = match circle.rotation {
        Rotation::CounterClockwise => left > 0.0,
        Rotation::Clockwise => left < 0.0,
    };
    let height_mm = 0.25 * chord_sqr / (radius + math::sqrt(inner_sqr));
    if !is_minor || height_mm >= most_mm {
        return None;
    }
    // To the right of a counter-clockwise chord, on the side that the centre is not on.
    let part = height_mm / math::sqrt(chord_sqr);
    let part = if left > 0.0 { part } else { -part };
    let to_side = [chord[1] * part, -chord[0] * part];
    let mut half = way.map(|way| Nm(way.0 / 2));
    half[first] = half[first] + nm(to_side[0]);
    half[second] = half[second] + nm(to_side[1]);
    // Half the angle has a quarter of the height, and a little more.
    Some((half, 0.26 * height_mm + (to_start - to_end).abs()))
}

/// The nearest coordinate to a short distance in mm.
pub(super) fn nm(mm: f32) -> Nm {
    let nm = mm * 1.0e6;
    Nm((nm + if nm < 0.0 { -0.5 } else { 0.5 }) as i64)
}
