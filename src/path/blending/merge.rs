//! Merging of short lines into one.
//!
//! As in LinuxCNC's "naive CAM detector", all points between the first and the last are near the line
//! from the first to the last. Here the points also follow each other along this line, so the line is nowhere farther
//! from the programmed path than the points are from the line.

use super::{PendingLine, direction, linear_mm};
use crate::{
    axis::{AXES, Axes, LINEAR},
    math,
    model::{Circle, FeedRate, Rotation, Target},
    units::Nm,
};

/// Most lines merged into one, which bounds the time of a line and the memory.
const POINTS: usize = 100;

/// Lines one after the other, with the ends of all of them.
#[derive(Debug)]
pub(super) struct Merger {
    start: Axes<Nm>,
    end: Target,
    /// Ends, relative to the start, mm.
    points: [[f32; LINEAR]; POINTS],
    count: usize,
    /// Greatest distance of the ends from the line to the last one, mm.
    error_mm: f32,
    /// Greatest distance of the lines from the programmed path, mm.
    line_error_mm: f32,
    feed_rate: FeedRate,
    line: u32,
}

impl Merger {
    pub(super) const fn new() -> Self {
        Self {
            start: Axes([Nm(0); AXES]),
            end: Target {
                position: Axes([Nm(0); AXES]),
                single_mm: Axes([0.0; AXES]),
            },
            points: [[0.0; LINEAR]; POINTS],
            count: 0,
            error_mm: 0.0,
            line_error_mm: 0.0,
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

    /// Returns the end of the last line.
    pub(super) fn end(&self) -> Option<&Target> {
        (self.count != 0).then_some(&self.end)
    }

    /// Returns the direction from the start to the end.
    pub(super) fn direction(&self) -> Option<[f32; LINEAR]> {
        direction(self.points.get(self.count.checked_sub(1)?)?)
    }

    /// Returns the direction from the start to another end.
    pub(super) fn direction_to(&self, target: &Target) -> Option<[f32; LINEAR]> {
        let is_any = self.count != 0;
        direction(&linear_mm(&self.start, &target.position)).filter(|_| is_any)
    }

    /// Begins with a line at a distance of `error_mm` from the programmed path.
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
        self.line_error_mm = error_mm;
        self.feed_rate = feed_rate;
        self.line = line;
    }

    /// Adds a line; returns false if the merged line would be farther than `max_mm` from the programmed path.
    pub(super) fn extend(
        &mut self,
        target: &Target,
        feed_rate: FeedRate,
        line: u32,
        error_mm: f32,
        max_mm: f32,
    ) -> bool {
        if self.count == 0 || self.count == POINTS || feed_rate != self.feed_rate {
            return false;
        }
        let line_error_mm = math::max(self.line_error_mm, error_mm);
        let displacement = linear_mm(&self.start, &target.position);
        let Some(error_mm) = self.error_to(&displacement, max_mm - line_error_mm) else {
            return false;
        };
        self.points[self.count] = displacement;
        self.count += 1;
        self.end = *target;
        self.error_mm = error_mm;
        self.line_error_mm = line_error_mm;
        self.line = line;
        true
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
    pub(super) fn end_line(&mut self) -> Option<PendingLine> {
        let displacement = *self.points.get(self.count.checked_sub(1)?)?;
        self.count = 0;
        let length_mm = math::sqrt(math::dot(&displacement, &displacement));
        Some(PendingLine {
            start: self.start,
            target: self.end,
            direction: displacement.map(|part| part / length_mm),
            length_mm,
            error_mm: self.error_mm + self.line_error_mm,
            feed_rate: self.feed_rate,
            line: self.line,
        })
    }
}

/// Returns the displacement to the middle of an arc, and the distance of the two lines through the middle
/// from the arc, mm; `None` for an arc whose height, or that distance, is above `max_mm`. `displacement` is
/// that to the end.
pub(super) fn flat_arc_middle(
    circle: &Circle,
    displacement: &Axes<Nm>,
    max_mm: f32,
) -> Option<(Axes<Nm>, f32)> {
    let (first, second, _) = circle.plane.axes();
    if max_mm <= 0.0 || circle.turns > 1 {
        return None;
    }
    let chord = [displacement[first], displacement[second]].map(Nm::to_mm);
    let centre = circle.centre.map(Nm::to_mm);
    let chord_mm = math::sqrt(math::dot(&chord, &chord));
    let [to_start, to_end] = [centre, [centre[0] - chord[0], centre[1] - chord[1]]]
        .map(|offset| math::sqrt(math::dot(&offset, &offset)));
    if chord_mm <= 0.0 {
        return None;
    }
    // Less than half a turn: the centre is to the left of the chord of a counter-clockwise arc.
    let left_mm = (chord[0] * centre[1] - chord[1] * centre[0]) / chord_mm;
    let is_minor = match circle.rotation {
        Rotation::CounterClockwise => left_mm > 0.0,
        Rotation::Clockwise => left_mm < 0.0,
    };
    let radius_mm = 0.5 * (to_start + to_end);
    let to_chord_mm = left_mm.abs();
    let height_mm = 0.25 * chord_mm * chord_mm / (radius_mm + to_chord_mm);
    // The radii may differ.
    let error_mm = half_height_mm(height_mm, to_chord_mm / radius_mm) + (to_start - to_end).abs();
    if !is_minor || height_mm >= max_mm || error_mm >= max_mm {
        return None;
    }
    // To the right of a counter-clockwise chord, on the side that the centre is not on.
    let part = height_mm / chord_mm;
    let part = if left_mm > 0.0 { part } else { -part };
    let to_side = [chord[1] * part, -chord[0] * part];
    let mut middle = displacement.map(|distance| Nm(distance.0 / 2));
    middle[first] = middle[first] + Nm::from_mm(to_side[0]);
    middle[second] = middle[second] + Nm::from_mm(to_side[1]);
    Some((middle, error_mm))
}

/// Returns the height of each half of an arc over its own chord, mm, from the height of the arc over its
/// chord and the cosine of half the angle travelled.
///
/// With half the angle φ and the radius r the height is r(1 - cos φ), and that of a half r(1 - cos φ/2). As
/// 1 - cos φ = 2(1 - cos² φ/2), their ratio is 1 / (2 + 2cos φ/2): from 0.25 of a flat arc to 0.293 of half a
/// turn. A helix rises in proportion to its angle, so that its middles are the farthest, too.
fn half_height_mm(height_mm: f32, cosine: f32) -> f32 {
    let half_cosine = math::sqrt(0.5 + 0.5 * cosine);
    0.5 * height_mm / (1.0 + half_cosine)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{model::Plane, units::MicroDegrees};

    /// Returns an arc in XY from the origin, its displacement, and the exact distance of the two lines
    /// through its middle, mm.
    fn arc(radius_mm: f64, start: f64, sweep: f64) -> (Circle, Axes<Nm>, f64) {
        let mm = |[x, y]: [f64; 2]| [x, y].map(Nm::from_mm_f64);
        let at = |angle: f64| [radius_mm * angle.cos(), radius_mm * angle.sin()];
        let ([x, y], [end_x, end_y]) = (at(start), at(start + sweep));
        let mut displacement = Axes([Nm(0); AXES]);
        [displacement[0], displacement[1]] = mm([end_x - x, end_y - y]);
        let circle = Circle {
            plane: Plane::Xy,
            centre: mm([-x, -y]),
            rotation: if sweep > 0.0 {
                Rotation::CounterClockwise
            } else {
                Rotation::Clockwise
            },
            turns: 1,
            tilt: MicroDegrees::ZERO,
        };
        (
            circle,
            displacement,
            radius_mm * (1.0 - (0.25 * sweep).cos()),
        )
    }

    proptest! {
        #![proptest_config(crate::cases(64))]

        #[test]
        fn two_lines_are_as_far_from_an_arc_as_they_are_told_to_be(
            radius_mm in 0.1..100.0_f64,
            start in 0.0..core::f64::consts::TAU,
            sweep in prop_oneof![0.02..3.1_f64, 3.0..3.13_f64],
            is_clockwise: bool,
        ) {
            let sweep = if is_clockwise { -sweep } else { sweep };
            let (circle, displacement, exact_mm) = arc(radius_mm, start, sweep);
            let (middle, error_mm) = flat_arc_middle(&circle, &displacement, 1.0e3).unwrap();
            let error_mm = f64::from(error_mm);
            // Single precision, and whole nanometres.
            let rounding_mm = 1.0e-6 * radius_mm + 5.0e-6;
            prop_assert!((error_mm - exact_mm).abs() < rounding_mm, "{error_mm} of {exact_mm} mm");
            let [x, y] = [middle[0] - circle.centre[0], middle[1] - circle.centre[1]]
                .map(Nm::to_mm_f64);
            prop_assert!((x.hypot(y) - radius_mm).abs() < rounding_mm);
        }
    }

    #[test]
    fn an_arc_whose_radii_differ_by_more_than_the_distance_stays_an_arc() {
        let (circle, mut displacement, _) = arc(10.0, 0.5, 0.02);
        assert!(flat_arc_middle(&circle, &displacement, 2.0e-3).is_some());
        // Away from the centre, 4 µm.
        for (axis, angle) in [(0, 0.52_f64.cos()), (1, 0.52_f64.sin())] {
            displacement[axis] = displacement[axis] + Nm::from_mm_f64(4.0e-3 * angle);
        }
        assert_eq!(flat_arc_middle(&circle, &displacement, 2.0e-3), None);
    }
}
