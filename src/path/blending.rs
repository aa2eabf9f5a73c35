//! Path control under `G64`: where and how the path leaves the programmed one.
//!
//! Short lines that lie within a distance of one line become this line (LinuxCNC's "naive CAM detector"), and the
//! corner between two lines becomes an arc tangent to both, in the plane of the two. So does the corner of an arc and a
//! line, or of two arcs, in one plane of two axes. What a move becomes depends on the next one, so the newest are held back:
//!
//! ```text
//!  lines ──▶ merger of short lines ──▶ move before a corner ──▶ output to the router
//!  arcs ───────────────────────────┘
//! ```
//!
//! A command other than a line or a flat arc at a feed rate or a rapid of the linear axes flushes both. The session
//! flushes them, too, by [`Router::flush`](super::Router::flush), as soon as the machine could use what
//! is held back.
//!
//! No point of the executed path is farther from the programmed path than `P`, nor the other way round. A merged line
//! uses half of `P` at most, and a corner the part that its lines have left.

mod corner;
mod corner_jerk;
mod corner_time;
mod fillet;
mod merge;
mod pending;

use heapless::Vec;

use self::{
    corner::Corner,
    merge::{Merger, NextMove, ProgrammedLine},
    pending::PendingMove,
};
use super::router::{Limits, PathEnd, to_axes};
use crate::{
    axis::{AXES, Axes, LINEAR},
    math,
    model::{Command, FeedRate, Laser, PathControl, Target},
    units::Nm,
};

/// Most outputs of one command: a move and a corner for each of two ends of merged lines, and either the same for an arc
/// or another line, or the last line and the command.
const OUTPUTS: usize = 6;
/// Farthest displacement of a blended line, nm: 2 m, up to which single precision has an error of a
/// tenth of a micrometre.
const FARTHEST_NM: i64 = 2_000_000_000;

/// An output of the blender, for the router.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BlendOutput {
    /// A command as the interpreter made it, or a line or an arc that is shortened, or a line merged from several.
    Command(Command),
    /// The arc in the place of a corner.
    CornerArc(CornerArc),
}

/// An arc between two moves, from the end of the move before, in any plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerArc {
    /// End of the arc.
    pub target: Axes<Nm>,
    /// Radius, mm.
    pub radius_mm: f32,
    /// Angle travelled, rad: less than half a turn.
    pub sweep_rad: f32,
    /// Direction from the centre to the start.
    pub radial: [f32; LINEAR],
    /// Direction of the path at the start.
    pub tangent: [f32; LINEAR],
    /// Feed rate: the lower one of the two moves.
    pub feed_rate: FeedRate,
    /// `N` word of the move after the corner, 0 without one.
    pub line: u32,
}

/// The moves held back, and the outputs.
#[derive(Debug)]
pub struct Blender {
    control: PathControl,
    /// State of the laser in the moves held back.
    laser: Option<Laser>,
    merger: Merger,
    pending: Option<PendingMove>,
    outputs: Vec<BlendOutput, OUTPUTS>,
    deviation_mm: f32,
}

impl Blender {
    /// A blender that holds nothing back.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            control: PathControl::ExactPath,
            laser: None,
            merger: Merger::new(),
            pending: None,
            outputs: Vec::new(),
            deviation_mm: 0.0,
        }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.laser = None;
        self.merger.clear();
        self.pending = None;
        self.outputs.clear();
        self.deviation_mm = 0.0;
    }

    /// Returns true if the router has not got everything.
    #[inline]
    #[must_use]
    pub fn has_pending(&self) -> bool {
        self.has_move() || !self.outputs.is_empty()
    }

    #[inline]
    fn has_move(&self) -> bool {
        self.pending.is_some() || !self.merger.is_empty()
    }

    /// Returns the greatest distance from the programmed path since the last call, mm.
    pub fn take_deviation_mm(&mut self) -> f32 {
        core::mem::take(&mut self.deviation_mm)
    }

    /// Returns the next output.
    #[inline]
    #[must_use]
    pub fn front(&self) -> Option<&BlendOutput> {
        self.outputs.first()
    }

    /// Removes the next output.
    pub fn dequeue(&mut self) {
        if !self.outputs.is_empty() {
            self.outputs.remove(0);
        }
    }

    /// Adds a command, which begins at `end` if nothing is held back. No output may wait.
    pub(super) fn push(
        &mut self,
        control: PathControl,
        end: &PathEnd,
        limits: &Limits,
        command: &Command,
    ) {
        // Commands begin where what is held back ends.
        let from = self.position().unwrap_or(end.position);
        if control != self.control {
            self.end_lines(limits, NextMove::Unknown);
            self.control = control;
        }
        let PathControl::Continuous { .. } = control else {
            return self.pass(limits, command);
        };
        match *command {
            Command::Line {
                target,
                feed_rate,
                line,
            } if is_blended(&from, &target, feed_rate) => {
                if let Some(direction) = direction(&linear_mm(&from, &target.position)) {
                    let line = ProgrammedLine {
                        target,
                        direction: to_axes(&direction),
                        feed_rate,
                        line,
                    };
                    self.line(limits, (from, end.tangent), &line);
                }
            }
            Command::Arc { .. } => match PendingMove::arc(limits, &from, command) {
                Some(arc) => self.arc(limits, arc),
                None => self.pass(limits, command),
            },
            Command::Power(laser) if self.laser == Some(laser) && self.has_move() => {}
            _ => self.pass(limits, command),
        }
        if let Command::Power(laser) = command {
            self.laser = Some(*laser);
        }
    }

    /// Outputs everything that is held back: nothing follows for now.
    pub(super) fn flush(&mut self, limits: &Limits) {
        self.end_lines(limits, NextMove::Standstill);
    }

    /// Outputs everything that is held back.
    fn end_lines(&mut self, limits: &Limits, next_move: NextMove) {
        self.settle(limits, next_move);
        self.end_merged_line(limits);
        if let Some(last) = self.pending.take() {
            self.output_move(&last, last.target);
        }
    }

    /// Outputs everything that is held back, then a command unchanged.
    fn pass(&mut self, limits: &Limits, command: &Command) {
        let next_move = self
            .position()
            .map_or(NextMove::Unknown, |from| NextMove::of(command, &from));
        self.end_lines(limits, next_move);
        self.output(BlendOutput::Command(*command));
    }

    /// Returns the end of what is held back.
    fn position(&self) -> Option<Axes<Nm>> {
        let pending = self.pending.as_ref().map(|last| last.target.position);
        self.merger.end().map(|end| end.position).or(pending)
    }

    /// Adds a line, which begins at a place and after a direction if nothing is held back.
    fn line(
        &mut self,
        limits: &Limits,
        (from, tangent): (Axes<Nm>, Axes<f32>),
        line: &ProgrammedLine,
    ) {
        self.settle(limits, NextMove::Direction(line.direction));
        let merging_mm = self.merging_mm();
        let is_feed = matches!(line.feed_rate, FeedRate::Feed(_));
        if is_feed && self.merger.extend(limits, line, merging_mm) {
            return;
        }
        self.end_merged_line(limits);
        self.begin(limits, (from, tangent), line);
        if !is_feed || merging_mm <= 0.0 {
            self.end_merged_line(limits);
        }
    }

    /// Ends the merged line before its last one, if the corner to what follows would become slower.
    fn settle(&mut self, limits: &Limits, next_move: NextMove) {
        let Some(last) = self.merger.take_last_before(limits, next_move) else {
            return;
        };
        if let Some(from) = self.position() {
            self.end_merged_line(limits);
            self.begin(limits, (from, last.direction), &last);
        }
    }

    /// Begins a merged line: see [`Self::line`].
    fn begin(
        &mut self,
        limits: &Limits,
        (from, tangent): (Axes<Nm>, Axes<f32>),
        line: &ProgrammedLine,
    ) {
        let before = match &self.pending {
            Some(pending) => [to_axes(&pending.directions[1]), pending.last_direction],
            None => [tangent; 2],
        };
        self.merger.begin(limits, from, before, line);
    }

    /// Adds an arc.
    fn arc(&mut self, limits: &Limits, arc: PendingMove) {
        self.settle(limits, NextMove::Direction(to_axes(&arc.directions[0])));
        self.end_merged_line(limits);
        self.hold_back(limits, arc);
    }

    /// Ends the merged line, and outputs the move and the corner before.
    fn end_merged_line(&mut self, limits: &Limits) {
        if let Some(line) = self.merger.end_line() {
            self.deviation_mm = math::max(self.deviation_mm, line.error_mm);
            self.hold_back(limits, line);
        }
    }

    /// Holds a move back, and outputs the move and the corner before.
    fn hold_back(&mut self, limits: &Limits, mut next: PendingMove) {
        if let Some(before) = self.pending.take() {
            let corner = Corner::new(limits, &before, &next);
            if let Some(rounding) = corner.rounded(limits, self.tolerance_mm()) {
                next.begin_after(&rounding);
                self.deviation_mm = math::max(self.deviation_mm, rounding.deviation_mm);
                self.output_move(&before, rounding.start.into());
                self.output(BlendOutput::CornerArc(rounding.arc));
            } else {
                next.reach = corner.reach();
                self.output_move(&before, before.target);
            }
        }
        self.pending = Some(next);
    }

    /// Outputs what the corners have left of a move, up to a target.
    fn output_move(&mut self, held_back: &PendingMove, target: Target) {
        // Two corners may leave a rounding error of a line.
        let is_left = |axis| {
            let distance: Nm = target.position[axis] - held_back.start[axis];
            distance.0.abs() > corner::ROUNDING_NM
        };
        if held_back.arc.is_some() || (0..AXES).any(is_left) {
            self.output(BlendOutput::Command(held_back.command(target)));
        }
    }

    fn output(&mut self, output: BlendOutput) {
        let is_full = self.outputs.push(output).is_err();
        debug_assert!(!is_full, "a command has at most OUTPUTS outputs");
    }

    /// Returns the greatest distance of a corner from the programmed path, mm.
    fn tolerance_mm(&self) -> f32 {
        match self.control {
            PathControl::Continuous { tolerance_nm, .. } if tolerance_nm > 0 => {
                1.0e-6 * tolerance_nm as f32
            }
            PathControl::Continuous { .. } => f32::MAX,
            PathControl::ExactPath | PathControl::ExactStop => 0.0,
        }
    }

    /// Returns the greatest distance of a merged line from the programmed path, mm: at most half of the
    /// tolerance, so that as much is left for the corners at its ends.
    fn merging_mm(&self) -> f32 {
        match self.control {
            PathControl::Continuous { merging_nm, .. } => {
                math::min(1.0e-6 * merging_nm as f32, 0.5 * self.tolerance_mm())
            }
            PathControl::ExactPath | PathControl::ExactStop => 0.0,
        }
    }
}

impl Default for Blender {
    fn default() -> Self {
        Self::new()
    }
}

/// Returns true for a move of the linear axes alone, at a speed that does not depend on its length.
fn is_blended(from: &Axes<Nm>, target: &Target, feed_rate: FeedRate) -> bool {
    let moves = |axis: &usize| target.position[*axis] != from[*axis];
    let is_fixed_speed = match feed_rate {
        FeedRate::Rapid | FeedRate::Feed(_) => true,
        FeedRate::InverseTime(_) | FeedRate::Jog(_) => false,
    };
    let distance = |axis: usize| target.position[axis] - from[axis];
    let is_near = (0..LINEAR).all(|axis| distance(axis).0.abs() < FARTHEST_NM);
    is_fixed_speed
        && is_near
        && (0..LINEAR).any(|axis| moves(&axis))
        && !(LINEAR..AXES).any(|axis| moves(&axis))
}

/// Returns the displacement over the linear axes, mm.
pub(super) fn linear_mm(from: &Axes<Nm>, to: &Axes<Nm>) -> [f32; LINEAR] {
    core::array::from_fn(|axis| (to[axis] - from[axis]).to_mm())
}

/// Returns the direction of a displacement; `None` for none.
fn direction(displacement: &[f32; LINEAR]) -> Option<[f32; LINEAR]> {
    let length_mm = math::sqrt(math::dot(displacement, displacement));
    (length_mm > 0.0).then(|| displacement.map(|part| part / length_mm))
}
