//! Moves on their way to the router: where and how `G64` leaves the programmed path.
//!
//! Short lines that lie within a distance of one line become that line (LinuxCNC's "naive CAM
//! detector"), and the corner between two lines becomes an arc that touches both, in the plane of
//! the two. What a line becomes depends on what follows, so the newest are held back:
//!
//! ```text
//!  lines ──▶ chain of short lines ──▶ line before a corner ──▶ ready for the router
//! ```
//!
//! Everything that is no line at a feed or a rapid, or moves a rotary axis, ends both. The session
//! ends them too, by [`Path::release`], as soon as the machine could use what is held back.
//!
//! No point of the path that is executed is farther from the programmed path than `P`, nor the other
//! way round: a line that stands for others uses half of that at most, and a corner what the lines at
//! it have left.

mod chain;
mod corner;

use heapless::Vec;

use self::{chain::Chain, corner::Corner};
use super::router::Limits;
use crate::{
    axis::{AXES, Axes},
    math,
    model::{Command, FeedRate, Laser, PathControl, Target},
    units::Nm,
};

/// What one command makes ready at most: a line and a corner for each of two ends of lines, the
/// last line, and the command.
const READY: usize = 6;
/// Linear axes, which lines and corners are in.
const LINEAR: usize = 3;

/// One thing for the router to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BlendOutput {
    /// As the interpreter asks for it, or a line that is shorter or stands for several.
    Command(Command),
    /// A corner that is rounded.
    CornerArc(CornerArc),
}

/// An arc between two lines, from where the one before ended, in any plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerArc {
    /// Where it ends.
    pub target: Axes<Nm>,
    /// Its radius, mm.
    pub radius_mm: f32,
    /// The angle it turns, rad: less than a half turn.
    pub sweep_rad: f32,
    /// Direction from the centre to its start.
    pub radial: [f32; LINEAR],
    /// Direction at its start.
    pub tangent: [f32; LINEAR],
    /// How fast.
    pub feed_rate: FeedRate,
    /// `N` word of the line after it, 0 without.
    pub line: u32,
}

/// A line whose end is not yet known to be a corner.
#[derive(Debug, Clone, Copy)]
struct Straight {
    /// Where it begins: behind the corner before it.
    start: Axes<Nm>,
    target: Target,
    direction: [f32; LINEAR],
    /// Its length as programmed, mm, corners included.
    length_mm: f32,
    /// How far it is from the lines that it stands for, mm.
    error_mm: f32,
    feed_rate: FeedRate,
    line: u32,
}

/// What is held back, and what is ready.
#[derive(Debug)]
pub struct Blender {
    control: PathControl,
    /// What the laser does in the lines held back.
    laser: Option<Laser>,
    chain: Chain,
    held: Option<Straight>,
    ready: Vec<BlendOutput, READY>,
    deviation_mm: f32,
}

impl Blender {
    /// Nothing held back.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            control: PathControl::ExactPath,
            laser: None,
            chain: Chain::new(),
            held: None,
            ready: Vec::new(),
            deviation_mm: 0.0,
        }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.laser = None;
        self.chain.clear();
        self.held = None;
        self.ready.clear();
        self.deviation_mm = 0.0;
    }

    /// Whether there is anything that the router does not know of.
    #[inline]
    #[must_use]
    pub fn has_pending(&self) -> bool {
        self.holds_line() || !self.ready.is_empty()
    }

    #[inline]
    fn holds_line(&self) -> bool {
        self.held.is_some() || !self.chain.is_empty()
    }

    /// The greatest distance from the programmed path since the last call, mm; 0 without any.
    pub fn take_deviation_mm(&mut self) -> f32 {
        core::mem::take(&mut self.deviation_mm)
    }

    /// What the router is to do next.
    #[inline]
    #[must_use]
    pub fn front(&self) -> Option<&BlendOutput> {
        self.ready.first()
    }

    /// That has been done.
    pub fn dequeue(&mut self) {
        if !self.ready.is_empty() {
            self.ready.remove(0);
        }
    }

    /// Takes a command, from where the router stands if nothing is held back. Nothing may be ready.
    pub(super) fn push(
        &mut self,
        control: PathControl,
        from: Axes<Nm>,
        limits: &Limits,
        command: &Command,
    ) {
        // Where the router will stand when it has done what is held back, which ends here or later.
        let from = self.position().unwrap_or(from);
        if control != self.control {
            self.flush(limits);
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
            } if is_plain(&from, &target, feed_rate) => {
                self.line(limits, from, target, feed_rate, line, 0.0);
            }
            Command::Arc {
                target,
                circle,
                feed_rate,
                line,
            } if is_plain(&from, &target, feed_rate) => {
                let way = target.position.zip(from, |to, from| to - from);
                match chain::halves(&circle, &way, self.merging_mm()) {
                    Some((half, error_mm)) => {
                        let middle = from.zip(half, |from, half| from + half);
                        self.line(limits, from, middle.into(), feed_rate, line, error_mm);
                        self.line(limits, middle, target, feed_rate, line, error_mm);
                    }
                    None => self.pass(limits, command),
                }
            }
            Command::Power(laser) if self.laser == Some(laser) && self.holds_line() => {}
            _ => self.pass(limits, command),
        }
        if let Command::Power(laser) = command {
            self.laser = Some(*laser);
        }
    }

    /// Makes everything ready that is held back.
    pub(super) fn flush(&mut self, limits: &Limits) {
        self.end_chain(limits);
        if let Some(straight) = self.held.take() {
            self.put_line(straight.start, straight.target, &straight);
        }
    }

    /// What is held back, and then a command as it is.
    fn pass(&mut self, limits: &Limits, command: &Command) {
        self.flush(limits);
        self.put(BlendOutput::Command(*command));
    }

    /// Where what is held back ends.
    fn position(&self) -> Option<Axes<Nm>> {
        let held = self.held.as_ref().map(|held| held.target.position);
        self.chain.end().map(|end| end.position).or(held)
    }

    /// A line, which may be off the programmed path already.
    fn line(
        &mut self,
        limits: &Limits,
        from: Axes<Nm>,
        target: Target,
        feed_rate: FeedRate,
        line: u32,
        error_mm: f32,
    ) {
        let merging_mm = self.merging_mm();
        let is_cut = matches!(feed_rate, FeedRate::Feed(_));
        let is_extended = is_cut
            && self.keeps_speed(limits, &target, feed_rate)
            && self
                .chain
                .extend(&target, feed_rate, line, error_mm, merging_mm);
        if is_extended {
            return;
        }
        self.end_chain(limits);
        self.chain.begin(from, target, feed_rate, line, error_mm);
        if !is_cut || merging_mm <= 0.0 {
            self.end_chain(limits);
        }
    }

    /// Whether the corner before the chain does not become slower by a line more.
    ///
    /// Along a curve, few long lines make sharper corners than many short ones.
    fn keeps_speed(&self, limits: &Limits, target: &Target, feed_rate: FeedRate) -> bool {
        let Some(before) = &self.held else {
            return true;
        };
        let (Some(now), Some(then)) = (self.chain.direction(), self.chain.direction_to(target))
        else {
            return true;
        };
        let before = corner::spread(&before.direction);
        let [now, then] = [now, then].map(|direction| corner::spread(&direction));
        let speed_mm_s = limits.paced_mm_s(feed_rate, &then);
        let enough_sqr = math::min(limits.junction_sqr(&before, &now), speed_mm_s * speed_mm_s);
        limits.junction_sqr(&before, &then) >= enough_sqr
    }

    /// The chain has become one line.
    fn end_chain(&mut self, limits: &Limits) {
        let Some(mut next) = self.chain.end_line() else {
            return;
        };
        self.deviation_mm = math::max(self.deviation_mm, next.error_mm);
        if let Some(before) = self.held.take() {
            let corner = Corner::between(limits, &before, &next, self.tolerance_mm());
            match corner {
                Some(corner) => {
                    self.put_line(before.start, corner.start.into(), &before);
                    self.put(BlendOutput::CornerArc(corner.round));
                    next.start = corner.round.target;
                    self.deviation_mm = math::max(self.deviation_mm, corner.deviation_mm);
                }
                None => self.put_line(before.start, before.target, &before),
            }
        }
        self.held = Some(next);
    }

    /// What is left of a line.
    fn put_line(&mut self, from: Axes<Nm>, target: Target, straight: &Straight) {
        // What two corners leave of a line by rounding is no line.
        let is_left = |axis| {
            let way: Nm = target.position[axis] - from[axis];
            way.0.abs() > corner::NOTHING_NM
        };
        if (0..AXES).any(is_left) {
            self.put(BlendOutput::Command(Command::Line {
                target,
                feed_rate: straight.feed_rate,
                line: straight.line,
            }));
        }
    }

    fn put(&mut self, way: BlendOutput) {
        let is_full = self.ready.push(way).is_err();
        debug_assert!(!is_full, "a command makes fewer ways ready than READY");
    }

    /// How far from the programmed path a corner may be, mm.
    fn tolerance_mm(&self) -> f32 {
        match self.control {
            PathControl::Continuous { tolerance_nm, .. } if tolerance_nm > 0 => {
                1.0e-6 * tolerance_nm as f32
            }
            PathControl::Continuous { .. } => f32::MAX,
            PathControl::ExactPath | PathControl::ExactStop => 0.0,
        }
    }

    /// How far from the programmed path a line that stands for several may be, mm: half of what a
    /// corner may at most, so that there is as much left for the corners at its ends.
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

/// Whether a move is one of the linear axes alone, at a speed that does not depend on its length.
fn is_plain(from: &Axes<Nm>, target: &Target, feed_rate: FeedRate) -> bool {
    let moves = |axis: &usize| target.position[*axis] != from[*axis];
    let is_paced = match feed_rate {
        FeedRate::Rapid | FeedRate::Feed(_) => true,
        FeedRate::InverseTime(_) | FeedRate::Jog(_) => false,
    };
    let way = |axis: usize| target.position[axis] - from[axis];
    let is_near = (0..LINEAR).all(|axis| way(axis).0.abs() < FARTHEST_NM);
    is_paced
        && is_near
        && (0..LINEAR).any(|axis| moves(&axis))
        && !(LINEAR..AXES).any(|axis| moves(&axis))
}

/// Single precision tells ways apart to a tenth of a micrometre up to here: 2 m.
const FARTHEST_NM: i64 = 2_000_000_000;

/// A way over the linear axes, mm.
fn linear_mm(from: &Axes<Nm>, to: &Axes<Nm>) -> [f32; LINEAR] {
    core::array::from_fn(|axis| (to[axis] - from[axis]).to_mm())
}

/// The direction of a way, if it has any.
fn direction(way: &[f32; LINEAR]) -> Option<[f32; LINEAR]> {
    let length_mm = math::sqrt(dot(way, way));
    (length_mm > 0.0).then(|| way.map(|way| way / length_mm))
}

fn dot(a: &[f32; LINEAR], b: &[f32; LINEAR]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
