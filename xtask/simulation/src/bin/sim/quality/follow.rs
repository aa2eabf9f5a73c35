//! Follows the programmed path with the steps, and measures their distance from the path.
//!
//! The place on the path only moves forward. It is the nearest point of the present piece. A later
//! piece becomes the present piece where the later piece is nearer, or where an axis steps against
//! the direction of the present piece. So a path that crosses itself, or returns on itself, is
//! followed in its order.

use std::collections::VecDeque;

use leadscrew::axis::AXES;
use serde::Serialize;

use super::geometry::{Corner, Piece, Point, distance_to_stretch, minus, norm};

/// Length of the path ahead in which a place is sought, mm: longer than the rounding of a corner.
const AHEAD_MM: f64 = 2.0;
/// Maximum number of pieces in which a place is sought.
const AHEAD_PIECES: usize = 256;
/// Maximum distance of an axis on the path, steps: half a step of rounding and some shift.
const ON_PATH: f64 = 0.9;
/// Maximum distance of the steps from a corner that is passed and not rounded, steps of each axis.
const AT_CORNER: f64 = 1.05;
/// Distance added to a piece whose direction an axis steps against, steps.
const AGAINST: f64 = 1.5;
/// Spacing of the points of the path whose distance from the steps is measured, mm.
const SAMPLES_MM: f64 = 1.0;

/// The largest distance between the programmed path and the steps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub(crate) struct Deviation {
    /// The Hausdorff distance: the greater of `mm` and `left_out_mm`, mm.
    pub(crate) hausdorff_mm: f64,
    /// From the steps to the path, mm.
    pub(crate) mm: f64,
    /// The distance from the path with each axis in its steps.
    pub(crate) steps: f64,
    /// The time of the largest distance, s since the first step.
    pub(crate) at_s: f64,
    /// From the path to the steps, mm: the part of a corner that was left out.
    pub(crate) left_out_mm: f64,
    /// Half a step on each axis that moves, mm: the rounding to steps.
    pub(crate) floor_mm: f64,
}

/// The point of the path where an axis is due to step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Progress {
    /// The axis.
    pub(super) axis: usize,
    /// Distance along the path, mm.
    pub(super) mm: f64,
    /// The direction of the path, and its curvature, 1/mm.
    pub(super) tangent: Point,
    pub(super) curvature: Point,
    pub(super) feed_mm_s: Option<f64>,
}

/// A corner that was passed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Passed {
    pub(super) corner: Corner,
    pub(super) at: Point,
    /// Distance along the path, mm.
    pub(super) mm: f64,
    /// The steps went through the corner.
    pub(super) is_exact: bool,
}

/// Measurements of an event of steps.
#[derive(Debug, Clone, Default)]
pub(super) struct Followed {
    /// Distance from the path, mm.
    pub(super) distance_mm: f64,
    /// The progress; `None` where the steps are off the path, or no axis determines the progress.
    pub(super) progress: Option<Progress>,
    /// For each axis that steps, the distance along the path at which the step is due, mm.
    pub(super) distances_mm: [Option<f64>; AXES],
    /// The steps are off the path.
    pub(super) is_off_path: bool,
    pub(super) passed: Vec<Passed>,
}

/// A point of the path whose distance to the steps is sought.
#[derive(Debug)]
struct Sample {
    at: Point,
    /// Way along the path, mm.
    mm: f64,
    nearest_mm: f64,
}

/// Follows a path.
pub(super) struct Follower {
    steps_per_mm: Point,
    pieces: VecDeque<Piece>,
    /// The piece before the present piece.
    previous: Option<Piece>,
    share: f64,
    before: Point,
    samples: VecDeque<Sample>,
    moves: [bool; AXES],
    /// The path is unknown after its last piece.
    is_ended: bool,
    pub(super) deviation: Deviation,
}

impl Follower {
    pub(super) fn new(steps_per_mm: Point) -> Self {
        Self {
            steps_per_mm,
            pieces: VecDeque::new(),
            previous: None,
            share: 0.0,
            before: [0.0; AXES],
            samples: VecDeque::new(),
            moves: [false; AXES],
            is_ended: false,
            deviation: Deviation::default(),
        }
    }

    /// Appends a piece to the path.
    pub(super) fn push(&mut self, piece: Piece) {
        let parts = (piece.length_mm / SAMPLES_MM).ceil().max(1.0);
        for part in 1..=parts as u32 {
            let share = f64::from(part) / parts;
            self.samples.push_back(Sample {
                at: piece.at(share),
                mm: piece.from_mm + piece.length_mm * share,
                nearest_mm: f64::INFINITY,
            });
        }
        self.pieces.push_back(piece);
    }

    /// Measures an event of steps; `None` where the path is unknown.
    pub(super) fn step(
        &mut self,
        seconds: f64,
        steps: &[i32; AXES],
        signs: &[i32; AXES],
    ) -> Option<Followed> {
        let here: Point =
            std::array::from_fn(|axis| f64::from(steps[axis]) / self.steps_per_mm[axis]);
        for (moves, sign) in self.moves.iter_mut().zip(signs) {
            *moves |= *sign != 0;
        }
        let mut followed = Followed::default();
        self.advance(&here, signs, &mut followed.passed)?;
        let piece = self.pieces.front()?;
        let offset = minus(&here, &piece.at(self.share));
        if self.is_ended && self.pieces.len() == 1 && !self.is_near(&offset, ON_PATH) {
            self.lose();
            return None;
        }
        followed.distance_mm = norm(&offset);
        followed.is_off_path = !self.is_near(&offset, 1.2);
        if !followed.is_off_path {
            for (axis, sign) in signs.iter().enumerate().filter(|(_, sign)| **sign != 0) {
                followed.distances_mm[axis] = self.distance_along(axis, steps[axis], *sign);
            }
            followed.progress = self.progress(piece, &followed.distances_mm);
        }
        let mm = piece.from_mm + piece.length_mm * self.share;
        self.measure(seconds, &offset, &here, mm);
        self.before = here;
        Some(followed)
    }

    /// Whether the offset of every axis is below some steps.
    fn is_near(&self, offset: &Point, steps: f64) -> bool {
        let scales = offset.iter().zip(self.steps_per_mm);
        scales
            .map(|(offset, scale)| offset.abs() * scale)
            .all(|off| off <= steps)
    }

    /// Moves the place on the path forward.
    fn advance(
        &mut self,
        here: &Point,
        signs: &[i32; AXES],
        passed: &mut Vec<Passed>,
    ) -> Option<()> {
        let piece = self.pieces.front()?;
        let share = piece.nearest(here, self.share).max(self.share);
        let offset = minus(here, &piece.at(share));
        let is_over = self.is_against(piece, share, signs);
        if !is_over && share < 1.0 && self.is_near(&offset, ON_PATH) {
            self.share = share;
            return Some(());
        }
        let reach = piece.from_mm + piece.length_mm * share + AHEAD_MM;
        // At a rounded corner an axis may rarely step against a piece as well.
        let against = AGAINST / self.coarsest();
        let handicap = |is_against: bool| if is_against { against } else { 0.0 };
        let mut best = (0, share, norm(&offset) + handicap(is_over));
        for (index, next) in self.pieces.iter().enumerate().take(AHEAD_PIECES).skip(1) {
            if next.from_mm > reach {
                break;
            }
            let share = next.nearest(here, 0.0);
            let offset = minus(here, &next.at(share));
            let is_against = self.is_against(next, share, signs);
            if !is_against && self.is_near(&offset, ON_PATH) {
                // Where the path passes a point twice, the first passage is due.
                best = (index, share, 0.0);
                break;
            }
            let distance = norm(&offset) + handicap(is_against);
            if distance < best.2 {
                best = (index, share, distance);
            }
        }
        for _ in 0..best.0 {
            self.previous = self.pieces.pop_front();
            let piece = self.pieces.front()?;
            let at = piece.at(0.0);
            let is_exact = [here, &self.before]
                .into_iter()
                .any(|place| self.is_near(&minus(place, &at), AT_CORNER));
            passed.push(Passed {
                corner: piece.corner,
                at,
                mm: piece.from_mm,
                is_exact,
            });
        }
        self.share = best.1;
        Some(())
    }

    /// Least steps/mm of all axes.
    fn coarsest(&self) -> f64 {
        let scales = self.steps_per_mm.iter().copied();
        scales.fold(f64::INFINITY, f64::min)
    }

    /// Whether an axis steps against the direction of a piece at a share.
    fn is_against(&self, piece: &Piece, share: f64, signs: &[i32; AXES]) -> bool {
        let tangent = piece.tangent(share);
        // The direction of an arc is known to about two steps of its length.
        let slack = if piece.is_arc() {
            10.0 * 2.0 / self.coarsest() / piece.length_mm
        } else {
            -1.0e-9
        };
        let mut axes = tangent.iter().zip(signs);
        axes.any(|(tangent, sign)| *sign != 0 && tangent * f64::from(*sign) < -slack)
    }

    /// The progress along the path, from the dominant axis.
    fn progress(&self, piece: &Piece, distances_mm: &[Option<f64>; AXES]) -> Option<Progress> {
        let tangent = piece.tangent(self.share);
        let axis = (0..AXES).max_by(|a, b| tangent[*a].abs().total_cmp(&tangent[*b].abs()))?;
        Some(Progress {
            axis,
            mm: distances_mm[axis]?,
            tangent,
            curvature: piece.curvature(self.share),
            feed_mm_s: piece.feed_mm_s,
        })
    }

    /// The distance along the path at which an axis is due to step, mm.
    fn distance_along(&self, axis: usize, steps: i32, sign: i32) -> Option<f64> {
        let scale = self.steps_per_mm[axis];
        let coordinate = (f64::from(steps) - 0.5 * f64::from(sign)) / scale;
        let present = self.pieces.front()?;
        let near_mm = present.from_mm + present.length_mm * self.share;
        // A step next to the end of a piece may belong to the next or the previous piece.
        let following = self.pieces.get(1).map(|piece| (piece, 0.0));
        let before = self.previous.as_ref().map(|piece| (piece, 1.0));
        let pieces = [Some((present, self.share)), following, before];
        pieces.into_iter().flatten().find_map(|(piece, near)| {
            let part = if piece.is_arc() { 0.05 } else { 0.02 };
            let share = piece.crossing(axis, coordinate, near, part)?;
            let mm = piece.from_mm + piece.length_mm * share;
            let rounding = 1.0e-6 / piece.length_mm;
            let is_in = (-rounding..=1.0 + rounding).contains(&share);
            let off = (mm - near_mm) * piece.tangent(share.clamp(0.0, 1.0))[axis] * scale;
            (is_in && off.abs() < 2.5).then_some(mm)
        })
    }

    fn measure(&mut self, seconds: f64, offset: &Point, here: &Point, mm: f64) {
        let distance = norm(offset);
        let scaled: Point = std::array::from_fn(|axis| offset[axis] * self.steps_per_mm[axis]);
        self.deviation.steps = self.deviation.steps.max(norm(&scaled));
        if distance > self.deviation.mm {
            (self.deviation.mm, self.deviation.at_s) = (distance, seconds);
        }
        let open = self.samples.iter_mut();
        for sample in open.take_while(|sample| sample.mm < mm + AHEAD_MM) {
            let distance = distance_to_stretch(&sample.at, &self.before, here);
            sample.nearest_mm = sample.nearest_mm.min(distance);
        }
        while self
            .samples
            .front()
            .is_some_and(|sample| sample.mm + AHEAD_MM < mm)
        {
            self.close_sample();
        }
    }

    fn close_sample(&mut self) {
        if let Some(sample) = self.samples.pop_front()
            && sample.nearest_mm.is_finite()
        {
            let most = &mut self.deviation.left_out_mm;
            *most = most.max(sample.nearest_mm);
        }
    }

    /// The path is unknown after the last piece that has been pushed.
    pub(super) fn end(&mut self) {
        self.is_ended = true;
    }

    /// The path is unknown from now on.
    pub(super) fn lose(&mut self) {
        self.pieces.clear();
        self.previous = None;
        self.samples.clear();
    }

    /// The deviation of the whole path.
    pub(super) fn finish(mut self) -> Deviation {
        while !self.samples.is_empty() {
            self.close_sample();
        }
        let half = |axis: usize| {
            if self.moves[axis] {
                0.5 / self.steps_per_mm[axis]
            } else {
                0.0
            }
        };
        self.deviation.floor_mm = norm(&std::array::from_fn(half));
        self.deviation.hausdorff_mm = self.deviation.mm.max(self.deviation.left_out_mm);
        self.deviation
    }
}
