//! The programmed contour beside which cutter compensation leads the tool, and what the tool cuts there.

use leadscrew::{
    axis::{Axes, LINEAR},
    model::{Circle, Cutter, Plane},
    units::Nm,
};

use crate::quality::geometry::{Piece, millimetres};

/// Most points that are kept.
const KEPT: usize = 1 << 17;
/// What is nearer is the same place: ends are rounded to nm.
const NEAR_MM: f64 = 1e-5;
/// Points along an arc for each mm and at least, and at most.
const POINTS: (f64, f64) = (4.0, 360.0);

/// Moves that follow each other in a plane.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Stretch {
    pub(crate) plane: Plane,
    /// Diameter of the tool, mm.
    pub(crate) diameter: f64,
    /// In machine coordinates, mm.
    pub(crate) points: Vec<[f64; LINEAR]>,
}

impl Stretch {
    /// A move beside which a tool goes, or that it makes; `None` without a way in the plane.
    pub(crate) fn of(
        cutter: &Cutter,
        from: &Axes<Nm>,
        to: &Axes<Nm>,
        circle: Option<&Circle>,
    ) -> Option<Self> {
        let (first, second, _) = cutter.plane.axes();
        if circle.is_none() && [first, second].iter().all(|axis| from[*axis] == to[*axis]) {
            return None;
        }
        let piece = Piece::new(millimetres(from), millimetres(to), circle);
        let count = if piece.is_arc() {
            (piece.length_mm * POINTS.0).clamp(24.0, POINTS.1).ceil()
        } else {
            1.0
        };
        let at = |index: u32| {
            let point = piece.at(f64::from(index) / count);
            std::array::from_fn(|axis| point[axis])
        };
        Some(Self {
            plane: cutter.plane,
            diameter: 2.0 * cutter.radius_mm,
            points: (0..=count as u32).map(at).collect(),
        })
    }

    /// Whether another one goes on where this one ends.
    fn is_continued_by(&self, next: &Self) -> bool {
        let ends = self.points.last().zip(next.points.first());
        let is_near = |(a, b): (&[f64; LINEAR], &[f64; LINEAR])| {
            a.iter().zip(b).all(|(a, b)| (a - b).abs() < NEAR_MM)
        };
        self.plane == next.plane && self.diameter == next.diameter && ends.is_some_and(is_near)
    }

    fn extent(&self, axis: usize, room: f64) -> Option<(f64, f64)> {
        let (first, second, _) = self.plane.axes();
        let room = if axis == first || axis == second {
            room
        } else {
            0.0
        };
        let values = self.points.iter().map(|point| point[axis]);
        values
            .map(|value| (value - room, value + room))
            .reduce(either)
    }
}

/// A contour, and the feed moves of the tool on the offset path.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Contour {
    pub(crate) programmed: Vec<Stretch>,
    pub(crate) removed: Vec<Stretch>,
}

impl Contour {
    /// Adds what a line is programmed to do, and what the tool does in it.
    pub(crate) fn append(&mut self, line: Self) {
        add(&mut self.programmed, line.programmed);
        add(&mut self.removed, line.removed);
    }

    /// Returns the least and the greatest coordinate along an axis of all that is programmed or cut.
    pub(crate) fn extent(&self, axis: usize) -> Option<(f64, f64)> {
        let programmed = self.programmed.iter();
        let programmed = programmed.filter_map(|stretch| stretch.extent(axis, 0.0));
        let removed = self.removed.iter();
        let removed = removed.filter_map(|stretch| stretch.extent(axis, stretch.diameter / 2.0));
        programmed.chain(removed).reduce(either)
    }
}

fn either(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0.min(b.0), a.1.max(b.1))
}

fn add(all: &mut Vec<Stretch>, more: Vec<Stretch>) {
    for next in more {
        let kept: usize = all.iter().map(|stretch| stretch.points.len()).sum();
        match all.last_mut() {
            _ if kept + next.points.len() > KEPT => {}
            Some(last) if last.is_continued_by(&next) => last.points.extend(&next.points[1..]),
            _ => all.push(next),
        }
    }
}
