//! Geometry and limits of each move: from commands in nanometres to blocks.
//!
//! Runs in `interpret`, which has no deadline, so that `prepare` needs single precision only.
//! Junction speed: S. Jeon, "Improving Grbl's cornering algorithm" (2011): the corner is followed
//! at the speed at which a circle that leaves it by the junction deviation would be.

mod arc_limits;
mod corner_arc;
mod limits;

pub(super) use self::limits::Limits;

use self::arc_limits::ArcPlane;
use super::{
    BlendOutput, Blender, Block, Curve, MoveKind, Shape, Work,
    arc::{Arc, PHASE_PER_RAD},
    block::MIN_SPEED_MM_S,
};
use crate::{
    axis::{AXES, Axes},
    math,
    model::{Circle, Command, FeedRate, Laser, PathControl, Target},
    settings::Settings,
    units::{FineSteps, Nm, Steps},
};

/// Axes that are linear: X, Y, Z. The others turn, and give the feed only when alone.
const LINEAR: usize = 3;
/// Farthest that rotary axes turn for each mm of a way that is measured along the linear axes,
/// degrees: with limits of jerk a way is counted in nanometres, and these would be too coarse.
const MOST_TURN_PER_MM: f32 = 1.0e3;
/// As far as that, a speed along the linear axes means nothing, degrees.
const MEANINGLESS_PER_MM: f32 = 1.0e6;
/// Shortest time for an arc, s, and for each of its quarter turns: it has a segment more for every
/// axis that reverses. What holds for lines too is in the look-ahead.
const SHORTEST_ARC_S: f32 = 3.0e-3;
const SHORTEST_QUARTER_S: f32 = 1.5e-3;

/// The fastest that each axis can go, mm/s, while no more than two move.
pub(crate) fn fastest_mm_s(settings: &Settings) -> Axes<f32> {
    let limits = Limits::new(settings);
    limits.speed_mm_s.zip(limits.steps_per_mm, |speed, steps| {
        math::min(speed, 0.5 * limits.steps_per_s / steps)
    })
}

/// Where a router stands, to return to.
#[derive(Debug, Clone, Copy, Default)]
pub struct Checkpoint {
    position: Axes<Nm>,
    sent: Axes<Nm>,
    fine: Axes<FineSteps>,
    steps: Axes<Steps>,
    tangent: Axes<f32>,
    curvature: Axes<f32>,
}

/// Turns commands into work, from where the one before ended.
#[derive(Debug)]
pub struct Router {
    settings: Settings,
    limits: Limits,
    /// Where the last command ended.
    position: Axes<Nm>,
    /// Where the last move with a step ended, as a coordinate and in steps.
    sent: Axes<Nm>,
    fine: Axes<FineSteps>,
    steps: Axes<Steps>,
    /// Direction at the end of the block before: what the axes move for one mm of its path.
    tangent: Axes<f32>,
    /// Its curvature there, 1/mm, towards the centre.
    curvature: Axes<f32>,
    /// What the laser does during moves.
    laser: Laser,
    /// Moves end at a standstill (`G61.1`), and the last one does.
    stops: bool,
    ends_stopped: bool,
}

impl Router {
    /// At the origin.
    #[must_use]
    pub fn new(settings: &Settings) -> Self {
        Self {
            settings: *settings,
            limits: Limits::new(settings),
            position: Axes::all(Nm(0)),
            sent: Axes::all(Nm(0)),
            fine: Axes::all(FineSteps(0)),
            steps: Axes::all(Steps(0)),
            tangent: Axes::all(0.0),
            curvature: Axes::all(0.0),
            laser: Laser::None,
            stops: false,
            ends_stopped: false,
        }
    }

    /// Whether the moves to come end at a standstill each, as under `G61.1`; a jog never does.
    pub fn set_exact_stop(&mut self, stops: bool) {
        self.stops = stops;
    }

    /// Takes over new settings at standstill at `steps`, and tells the position they mean now.
    pub fn configure(&mut self, settings: &Settings, steps: Axes<i32>) -> Axes<Nm> {
        self.settings = *settings;
        self.limits = Limits::new(settings);
        self.laser = Laser::None;
        self.set_steps(steps)
    }

    /// Continues from a standstill at `steps`, and tells the position.
    pub fn set_steps(&mut self, steps: Axes<i32>) -> Axes<Nm> {
        self.steps = steps.map(Steps);
        self.fine = steps.map(|steps| FineSteps(i64::from(steps) << 32));
        self.position = self
            .settings
            .steps_per_mm
            .zip(self.steps, |resolution, steps| {
                resolution.position_of(steps)
            });
        self.sent = self.position;
        self.position
    }

    /// Where the last command ended.
    #[must_use]
    pub fn checkpoint(&self) -> Checkpoint {
        Checkpoint {
            position: self.position,
            sent: self.sent,
            fine: self.fine,
            steps: self.steps,
            tangent: self.tangent,
            curvature: self.curvature,
        }
    }

    /// Takes back the commands since a mark: the machine has not begun them.
    pub fn restore(&mut self, mark: &Checkpoint) {
        self.position = mark.position;
        self.sent = mark.sent;
        self.fine = mark.fine;
        self.steps = mark.steps;
        self.tangent = mark.tangent;
        self.curvature = mark.curvature;
    }

    /// The way in a straight line from a place to where the last move ends, over the linear axes,
    /// mm.
    #[must_use]
    pub fn distance_from_mm(&self, steps: &Axes<i32>) -> f32 {
        let mut sum_sqr = 0.0;
        for axis in 0..LINEAR {
            let way = self.steps[axis].0.wrapping_sub(steps[axis]) as f32;
            let way_mm = way / self.limits.steps_per_mm[axis];
            sum_sqr += way_mm * way_mm;
        }
        math::sqrt(sum_sqr)
    }

    /// What the laser does during moves.
    #[must_use]
    pub fn laser(&self) -> Laser {
        self.laser
    }

    /// The work that a command makes; `None` for a move that makes no step, which becomes part of
    /// the next one.
    ///
    /// Targets must not be beyond [`Settings::farthest`].
    pub fn work(&mut self, command: &Command) -> Option<Work> {
        let mut work = Work::Pause;
        self.route(command, &mut work).then_some(work)
    }

    /// As [`Self::work`], but replaces what the caller keeps, which is too large to be copied for
    /// every line; false for a move that makes no step.
    ///
    /// Targets must not be beyond [`Settings::farthest`].
    pub fn route(&mut self, command: &Command, work: &mut Work) -> bool {
        match command {
            Command::Line {
                target,
                feed_rate,
                line,
            } => return self.line(target, *feed_rate, *line, work),
            Command::Arc {
                target,
                circle,
                feed_rate,
                line,
            } => return self.arc(target, circle, *feed_rate, *line, work),
            Command::Probe {
                target,
                feed_rate,
                probing,
                line,
            } => {
                let moves = self.line(target, *feed_rate, *line, work);
                if let Work::Move(block) = work
                    && moves
                {
                    *work = Work::Probe(
                        Block {
                            kind: MoveKind::Fixed,
                            ..*block
                        },
                        *probing,
                    );
                }
                return moves;
            }
            Command::Power(laser) => {
                self.laser = *laser;
                return false;
            }
            Command::Dwell { milliseconds } => *work = Work::Dwell(*milliseconds),
            Command::Spindle { spindle, rpm } => *work = Work::Spindle(*spindle, *rpm),
            Command::Coolant(coolant) => *work = Work::Coolant(*coolant),
            Command::Pause => *work = Work::Pause,
        }
        true
    }

    /// Gives a command to the path: what becomes of it, and when, is [`Path::next`].
    ///
    /// Apart, as is what ends the path: most programs have none.
    #[inline(never)]
    pub fn blend(&self, path: &mut Blender, control: PathControl, command: &Command) {
        path.push(control, self.position, &self.limits, command);
    }

    /// Ends what the path holds back.
    #[inline]
    pub fn flush(&self, path: &mut Blender) {
        if path.has_pending() {
            self.end(path);
        }
    }

    #[inline(never)]
    fn end(&self, path: &mut Blender) {
        path.flush(&self.limits);
    }

    /// As [`Self::work_into`], for what has come through the path.
    pub fn route_blended(&mut self, way: &BlendOutput, work: &mut Work) -> bool {
        match way {
            BlendOutput::Command(command) => self.route(command, work),
            BlendOutput::CornerArc(round) => self.corner_arc_into(round, work),
        }
    }

    #[inline(never)]
    fn line(&mut self, target: &Target, feed_rate: FeedRate, line: u32, work: &mut Work) -> bool {
        let block = self.line_block(target, feed_rate, line);
        let moves = block.is_some();
        if let Some(block) = block {
            *work = Work::Move(block);
        }
        moves
    }

    /// The block of a line; `None` for one that makes no step. It becomes part of its caller, so that
    /// it is made where it is to be and not copied.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a call would return by a copy")]
    pub(crate) fn line_block(
        &mut self,
        target: &Target,
        feed_rate: FeedRate,
        line: u32,
    ) -> Option<Block> {
        let end = self.place(target);
        if end.steps == self.steps {
            self.position = target.position;
            return None;
        }
        let way = target
            .position
            .zip(self.sent, |to, from| (to - from).to_mm());
        let makes_linear_steps =
            AXES == LINEAR || (0..LINEAR).any(|axis| end.steps[axis] != self.steps[axis]);
        let (length_mm, per_feed) = length(&way, makes_linear_steps);
        let per_mm = 1.0 / length_mm;
        let direction = way.map(|way| way * per_mm);
        let resolution = self.limits.steps_per_mm;
        let steps_per_mm = direction.zip(resolution, |share, steps| share * steps);
        let rate = math::min(
            Limits::along(&self.limits.speed_mm_s, &direction),
            self.limits.together(&steps_per_mm),
        );
        let rate = self
            .limits
            .for_steps(self.steps_to(&end) as f32, length_mm, rate);
        let programmed_mm_s = pace_mm_s(scaled(feed_rate, per_feed), length_mm, rate);
        let block = Block {
            delta: end.fine.zip(self.fine, |to, from| to.0 - from.0),
            steps_per_mm,
            length_mm,
            nominal_mm_s: math::min(programmed_mm_s, rate),
            programmed_mm_s,
            limit_mm_s: rate,
            kind: pacing(feed_rate),
            laser: self.laser,
            acceleration_mm_s2: Limits::along(&self.limits.acceleration_mm_s2, &direction),
            junction_sqr: self.junction_sqr(&direction, &Axes::all(0.0)),
            curve: None,
            line,
        };
        self.finish(target.position, end, direction, Axes::all(0.0));
        Some(block)
    }

    /// Steps of all axes to a place.
    fn steps_to(&self, end: &BlockEnd) -> u32 {
        let steps = end
            .steps
            .zip(self.steps, |to, from| to.0.wrapping_sub(from.0));
        { steps.iter() }.fold(0, |sum, way| way.unsigned_abs().saturating_add(sum))
    }

    /// Apart: most moves are lines, and it has much to keep.
    #[inline(never)]
    fn arc(
        &mut self,
        target: &Target,
        circle: &Circle,
        feed_rate: FeedRate,
        line: u32,
        work: &mut Work,
    ) -> bool {
        let (first, second, _) = circle.plane.axes();
        let way = target.position.zip(self.position, |to, from| to - from);
        let behind = self.position.zip(self.sent, |to, from| to - from);
        let finest = self.limits.steps_per_mm[first].max(self.limits.steps_per_mm[second]);
        let arc = Arc::new(circle, way[first], way[second]).begun_at(
            circle,
            [behind[first], behind[second]],
            f64::from(finest),
        );
        if arc.length_mm() as f32 * finest < 0.5 {
            // Shorter than half a step in its plane: what is left of it is a line.
            return self.line(target, feed_rate, line, work);
        }
        let end = self.place(target);
        let linear = target
            .position
            .zip(self.sent, |to, from| (to - from).to_mm());
        let linear = without(linear, [first, second]);
        let plane_mm = arc.length_mm() as f32;
        let rest_mm = linear_length(&linear);
        let length_mm = math::sqrt(plane_mm * plane_mm + rest_mm * rest_mm);
        let flat = plane_mm / length_mm;
        let mut direction = linear.map(|way| way / length_mm);
        let plane = ArcPlane::new([first, second], flat);
        let [start_tangent, end_tangent] =
            [0, 1].map(|end| plane.tangent(direction, arc.tangent(end)));
        // Any direction in the plane occurs: the axes share the smaller of their limits.
        let shared = |limits: &Axes<f32>| limits[first].min(limits[second]);
        let acceleration = shared(&self.limits.acceleration_mm_s2)
            .min(Limits::along(&self.limits.acceleration_mm_s2, &direction));
        let limit_sqr = acceleration * arc.tightest_mm() as f32 / (flat * flat);
        let rate = (shared(&self.limits.speed_mm_s) / flat)
            .min(Limits::along(&self.limits.speed_mm_s, &direction));
        direction[first] = flat;
        direction[second] = flat;
        let steps_per_mm = direction.zip(self.limits.steps_per_mm, |share, steps| share * steps);
        let rate = rate
            .min(self.limits.together(&steps_per_mm))
            .min(math::sqrt(limit_sqr))
            .min(length_mm / shortest_s(&arc));
        let paced = |rate| pace_mm_s(feed_rate, length_mm, rate);
        let ([start_curvature, end_curvature], rate, acceleration) =
            self.limits.bent(&arc, &plane, rate, acceleration, paced);
        let even = arc.evenness() as f32;
        let (rate, acceleration) = (rate * even, acceleration * even);
        let programmed_mm_s = pace_mm_s(feed_rate, length_mm, rate);
        *work = Work::Move(Block {
            delta: end.fine.zip(self.fine, |to, from| to.0 - from.0),
            steps_per_mm,
            length_mm,
            nominal_mm_s: math::min(programmed_mm_s, rate),
            programmed_mm_s,
            limit_mm_s: rate,
            kind: pacing(feed_rate),
            laser: self.laser,
            acceleration_mm_s2: acceleration,
            junction_sqr: self.junction_sqr(&start_tangent, &start_curvature),
            curve: Some(self.curve(&arc, [first, second], limit_sqr, length_mm)),
            line,
        });
        self.finish(target.position, end, end_tangent, end_curvature);
        true
    }

    fn curve(&self, arc: &Arc, axes: [usize; 2], limit_sqr: f32, length_mm: f32) -> Curve {
        let [start, end] = arc.radius;
        let fine = |axis: usize, mm: f64| {
            let steps_per_mm = self.settings.steps_per_mm[axis].millionths() as f64 * 1.0e-6;
            libm::round(mm * steps_per_mm * FineSteps::ONE as f64) as i64
        };
        Curve {
            phase: libm::round(arc.start * PHASE_PER_RAD) as i64 as u32,
            sweep: libm::round(arc.sweep * PHASE_PER_RAD) as i64,
            limit_sqr,
            mm_per_phase: (f64::from(length_mm) / (libm::fabs(arc.sweep) * PHASE_PER_RAD)) as f32,
            shape: Shape::Planar {
                first: axes[0] as u8,
                second: axes[1] as u8,
                radius: axes.map(|axis| fine(axis, start)),
                radius_delta: axes.map(|axis| fine(axis, end - start)),
            },
        }
    }

    /// Where a move to `target` ends. It becomes part of its callers, as what it tells would be copied.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a call would return by a copy")]
    fn place(&self, target: &Target) -> BlockEnd {
        let mut end = BlockEnd {
            steps: self.steps,
            fine: self.fine,
        };
        for axis in 0..AXES {
            if target.position[axis] != self.sent[axis] {
                (end.steps[axis], end.fine[axis]) = self.settings.steps_per_mm[axis]
                    .steps_as_grbl(target.position[axis], target.single_mm[axis]);
            }
        }
        end
    }

    /// Limit of the squared speed where a block begins with a tangent and a curvature.
    fn junction_sqr(&self, tangent: &Axes<f32>, curvature: &Axes<f32>) -> f32 {
        if self.ends_stopped {
            return 0.0;
        }
        let corner_sqr = self.limits.junction_sqr(&self.tangent, tangent);
        let change = curvature.zip(self.curvature, |after, before| after - before);
        math::min(corner_sqr, self.limits.bend_sqr(&change))
    }

    fn finish(
        &mut self,
        target: Axes<Nm>,
        end: BlockEnd,
        tangent: Axes<f32>,
        curvature: Axes<f32>,
    ) {
        self.position = target;
        self.sent = target;
        self.steps = end.steps;
        self.fine = end.fine;
        self.tangent = tangent;
        self.ends_stopped = self.stops;
        self.curvature = curvature;
    }
}

/// Shortest time for an arc, s.
fn shortest_s(arc: &Arc) -> f32 {
    let turns = (libm::fabs(arc.sweep) / core::f64::consts::TAU) as f32;
    SHORTEST_ARC_S.max(4.0 * turns * SHORTEST_QUARTER_S)
}

#[derive(Debug, Clone, Copy)]
struct BlockEnd {
    steps: Axes<Steps>,
    fine: Axes<FineSteps>,
}

/// Length of a way: over the linear axes, or over the rotary ones when only they make steps, or turn
/// so far that a linear way is too short to be divided. And how much of it goes by for each unit of
/// a feed, which is along the linear axes where these make steps.
fn length(way: &Axes<f32>, makes_linear_steps: bool) -> (f32, f32) {
    let linear_mm = linear_length(way);
    if AXES == LINEAR {
        return (linear_mm, 1.0);
    }
    let rotary = math::sqrt(way.iter().skip(LINEAR).map(|way| way * way).sum());
    if rotary <= 0.0 || makes_linear_steps && rotary <= MOST_TURN_PER_MM * linear_mm {
        (linear_mm, 1.0)
    } else if makes_linear_steps && rotary <= MEANINGLESS_PER_MM * linear_mm {
        (rotary, rotary / linear_mm)
    } else {
        (rotary, 1.0)
    }
}

/// Length of a way over the linear axes.
fn linear_length(way: &Axes<f32>) -> f32 {
    math::sqrt(way.iter().take(LINEAR).map(|way| way * way).sum())
}

/// A way without what leads along two axes.
fn without(way: Axes<f32>, axes: [usize; 2]) -> Axes<f32> {
    Axes::from_fn(|axis| if axes.contains(&axis) { 0.0 } else { way[axis] })
}

fn dot(a: &Axes<f32>, b: &Axes<f32>) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// A feed rate for a way of which so much goes by for each mm of a feed.
fn scaled(feed_rate: FeedRate, per_feed: f32) -> FeedRate {
    match feed_rate {
        FeedRate::Feed(mm_min) => FeedRate::Feed(mm_min * per_feed),
        FeedRate::Jog(mm_min) => FeedRate::Jog(mm_min * per_feed),
        FeedRate::Rapid | FeedRate::InverseTime(_) => feed_rate,
    }
}

/// The programmed speed, mm/s: for a rapid the limit.
fn pace_mm_s(feed_rate: FeedRate, length_mm: f32, limit_mm_s: f32) -> f32 {
    let asked = match feed_rate {
        FeedRate::Rapid => return limit_mm_s,
        FeedRate::Feed(mm_min) | FeedRate::Jog(mm_min) => mm_min / 60.0,
        FeedRate::InverseTime(per_min) => length_mm * per_min / 60.0,
    };
    math::max(asked, MIN_SPEED_MM_S)
}

fn pacing(feed_rate: FeedRate) -> MoveKind {
    match feed_rate {
        FeedRate::Rapid => MoveKind::Rapid,
        FeedRate::Feed(_) | FeedRate::InverseTime(_) => MoveKind::Feed,
        FeedRate::Jog(_) => MoveKind::Jog,
    }
}
