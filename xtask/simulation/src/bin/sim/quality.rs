//! How good a motion is: figures from the edges on the step pins, and the program beside them.
//!
//! Nothing of the planner is asked. The program's lines go to an interpreter of their own
//! ([`program`]), whose path the steps are compared with ([`follow`]); speeds, accelerations and jerks
//! are fitted to the step times ([`sweep`]). Everything is taken as it comes, in bounded memory.
//! `docs/motion-quality.md` has the formulas.

mod arcs;
mod axis;
mod corners;
mod fit;
mod follow;
pub(crate) mod geometry;
mod intervals;
mod motor_scales;
mod print;
mod program;
mod sweep;
#[cfg(test)]
mod tests;

use std::{array, collections::VecDeque};

use leadscrew::{
    axis::AXES, model::timing::EVENT_SPACING_TICKS, settings::Settings, sim::Edge,
    units::TICKS_PER_SECOND,
};
use serde::Serialize;
use simulation::program_reader::ProgramReader;

use arcs::{ArcFigures, JerkOfArcs};
use axis::Track;
use corners::Corners;
use fit::Crossing;
use follow::{Deviation, Follower, Passed, Progress};
use geometry::{Point, turned};
use intervals::IntervalError;
use motor_scales::MotorScales;
pub(crate) use motor_scales::name;
pub(crate) use print::text;
use program::Programmed;
use sweep::Peak;

use crate::{series::Series, steps_per_mm};

/// A change of direction at which an axis is not judged across it, rad: half a degree.
const KINK_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// How near to the programmed feed counts as there.
const AT_FEED: f64 = 0.01;
/// How much of a limit a measurement may be wrong.
const UNCERTAIN: f64 = 0.05;
/// Standard deviation of what is spread evenly over 1.
const EVEN: f64 = 0.288_675_134_594_813;
/// Events that are no farther from each other than that many spacings may have shifted each other.
const NEAR: u64 = 4;

/// The figures of one axis, or of the path.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(crate) struct Smoothness {
    /// Greatest jump of the speed that no acceleration explains, mm/s.
    pub(crate) speed_jump_mm_s: Peak,
    /// Greatest acceleration, mm/s².
    pub(crate) acceleration_mm_s2: Peak,
    /// Greatest jerk, mm/s³.
    pub(crate) jerk_mm_s3: Peak,
}

/// The figures of one axis that moved.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct AxisQuality {
    /// Its letter; of a motor of `CoreXY`, `motor` and the letter of its outputs.
    pub(crate) axis: String,
    /// Errors of the step times against a smooth motion.
    pub(crate) interval_error: IntervalError,
    #[serde(flatten)]
    pub(crate) smoothness: Smoothness,
    /// The greatest acceleration that is set, mm/s².
    pub(crate) acceleration_limit_mm_s2: f64,
    /// The greatest jerk that is set, mm/s³; null for none.
    pub(crate) jerk_limit_mm_s3: Option<f64>,
}

/// Time at the programmed feed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub(crate) struct FeedTime {
    /// Within one part in a hundred of it, s.
    pub(crate) at_feed_s: f64,
    /// In moves that have one, s.
    pub(crate) feed_s: f64,
    /// The one as a part of the other.
    pub(crate) part: f64,
}

/// How good a motion is.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(crate) struct Quality {
    /// From the first to the last step, s.
    pub(crate) job_time_s: f64,
    /// The axes that moved.
    pub(crate) axes: Vec<AxisQuality>,
    /// Along the path, where the steps are on it.
    pub(crate) path: Smoothness,
    /// Between the steps and the programmed path.
    pub(crate) deviation: Deviation,
    /// At the corners of the program.
    pub(crate) corners: Corners,
    /// Jerk of arcs beside the limit of jerk.
    pub(crate) arcs: ArcFigures,
    /// At the programmed feed.
    pub(crate) feed: FeedTime,
    /// The limits that were exceeded by more than the error of the measurement: limits of moves, and for corners the
    /// jump of the speed that the junction deviation allows.
    pub(crate) violations: Vec<String>,
    /// Whether the whole path was known. After homing, probing, or a line that only the machine refused, the path is
    /// unknown; the measurements of the path end there.
    pub(crate) is_path_known: bool,
}

/// Curves over time, for a picture.
#[derive(Debug, Clone, Default)]
pub(crate) struct Traces {
    /// Acceleration of each axis, mm/s².
    pub(crate) accelerations: Vec<(usize, Series)>,
    /// Jerk of each axis, mm/s³.
    pub(crate) jerks: Vec<(usize, Series)>,
    /// Distance from the programmed path, mm.
    pub(crate) deviation: Series,
    /// What rounding to steps makes of it, mm.
    pub(crate) floor_mm: f64,
    /// The curves of X and Y are those of the motors of `CoreXY`.
    pub(crate) is_core_xy: bool,
}

/// The jerk limit of each axis, mm/s³; `None` where there is none.
pub(crate) fn jerk_limits(settings: &Settings) -> [Option<f64>; AXES] {
    let limits = settings.jerk_mm_s3.0;
    limits.map(|limit| (limit > 0.0).then_some(f64::from(limit)))
}

/// The greatest speed that an acceleration from standstill reaches within one step of an axis, mm/s. It bounds the
/// resolution of speeds that last for an instant only.
fn resolved_mm_s(accelerations: &Point, steps_per_mm: &Point) -> f64 {
    let axes = accelerations.iter().zip(steps_per_mm);
    let speeds = axes.map(|(acceleration, scale)| (2.0 * acceleration / scale).sqrt());
    speeds.fold(0.0, f64::max)
}

/// Standard deviation of a step's time, s: of a tick, or where other axes begin or end pulses nearby, the
/// spacing of events. A step makes way by up to two of these, and beats between two axes shift many
/// steps in a row the same way.
fn grain_s(is_shared: bool) -> f64 {
    let ticks = if is_shared {
        f64::from(EVENT_SPACING_TICKS)
    } else {
        EVEN
    };
    ticks / f64::from(TICKS_PER_SECOND)
}

/// Takes a run and measures it.
pub(crate) struct Meter {
    programmed: Programmed,
    /// For each line that is not answered: whether its path is part of what is followed.
    taken: VecDeque<bool>,
    follower: Follower,
    is_path_known: bool,
    is_core_xy: bool,
    motor_scales: MotorScales,
    tracks: [Track; AXES],
    path: Track,
    path_mm: f64,
    /// The axis that says it.
    path_axis: Option<usize>,
    feed_mm_s: Option<f64>,
    /// The newest speed along the path.
    speed_mm_s: f64,
    corners: corners::Meter,
    arcs: JerkOfArcs,
    feed: FeedTime,
    steps: [i32; AXES],
    first_ticks: Option<u64>,
    last_ticks: u64,
    /// The newest edge that steps, and whether other axes move nearby. An edge is measured when the next edge is
    /// known.
    held: Option<(Edge, bool)>,
    /// When a pulse of each axis began or ended last, ticks.
    active: [Option<u64>; AXES],
    deviation: Series,
}

impl Meter {
    /// A machine at the origin, which gets what this reads.
    pub(crate) fn new(reader: ProgramReader) -> Self {
        let settings = reader.settings();
        let motor_scales = MotorScales::of(settings);
        Self {
            is_core_xy: settings.core_xy,
            tracks: steps_per_mm(settings).map(Track::of_axis),
            corners: corners::Meter::new(resolved_mm_s(
                &motor_scales.accelerations,
                &motor_scales.steps_per_mm,
            )),
            arcs: JerkOfArcs {
                is_allowed: motor_scales.jerks.iter().any(Option::is_some)
                    && settings.junction_deviation_mm > 0.0,
                ..JerkOfArcs::default()
            },
            follower: Follower::new(motor_scales.steps_per_mm),
            motor_scales,
            programmed: Programmed::new(reader),
            taken: VecDeque::new(),
            is_path_known: true,
            path: Track::of_path(),
            path_mm: f64::NEG_INFINITY,
            path_axis: None,
            feed_mm_s: None,
            speed_mm_s: 0.0,
            feed: FeedTime::default(),
            steps: [0; AXES],
            first_ticks: None,
            last_ticks: 0,
            held: None,
            active: [None; AXES],
            deviation: Series::default(),
        }
    }

    /// A line is sent: before its steps come.
    pub(crate) fn line(&mut self, line: &[u8]) {
        let pieces = self.programmed.line(line);
        self.taken.push_back(!pieces.is_empty());
        for piece in pieces {
            self.follower.push(piece);
        }
        if self.programmed.is_lost() {
            self.follower.end();
            self.is_path_known = false;
        }
    }

    /// A line has been answered.
    pub(crate) fn answer(&mut self, is_refused: bool) {
        if self.taken.pop_front() == Some(true) && is_refused {
            self.is_path_known = false;
            self.follower.lose();
        }
    }

    /// The pins change.
    pub(crate) fn edge(&mut self, edge: &Edge) {
        let near = NEAR * u64::from(EVENT_SPACING_TICKS);
        let bits = edge.raise | edge.drop;
        if let Some((held, is_shared)) = &mut self.held {
            *is_shared |= bits & !held.raise != 0 && edge.ticks - held.ticks < near;
        }
        if edge.raise != 0 {
            if let Some((held, is_shared)) = self.held.take() {
                self.take(&held, is_shared);
            }
            let others = (0..AXES).filter(|axis| edge.raise >> axis & 1 == 0);
            let mut active = others.filter_map(|axis| self.active[axis]);
            let is_near = active.any(|ticks| edge.ticks - ticks < near);
            let is_joint = edge.raise.count_ones() > 1 || edge.drop & !edge.raise != 0;
            self.held = Some((*edge, is_near || is_joint));
        }
        for axis in (0..AXES).filter(|axis| bits >> axis & 1 != 0) {
            self.active[axis] = Some(edge.ticks);
        }
    }

    /// Takes an edge that steps; whether events of other axes may have shifted it.
    fn take(&mut self, edge: &Edge, is_shared: bool) {
        let first = *self.first_ticks.get_or_insert(edge.ticks);
        let seconds = (edge.ticks - first) as f64 / f64::from(TICKS_PER_SECOND);
        let grain_s = grain_s(is_shared);
        let signs: [i32; AXES] = array::from_fn(|axis| match edge.raise >> axis & 1 {
            0 => 0,
            _ if edge.directions >> axis & 1 == 0 => 1,
            _ => -1,
        });
        for (steps, sign) in self.steps.iter_mut().zip(signs) {
            *steps += sign;
        }
        if let Some(followed) = self.follower.step(seconds, &self.steps, &signs) {
            let distance = followed.distance_mm;
            self.deviation.push(seconds, seconds, distance);
            for passed in followed.passed {
                self.pass(passed, seconds);
            }
            if followed.is_off_path {
                self.path.interrupt();
                self.corners.interrupt();
            } else if let Some(progress) = followed.progress {
                self.progress(&progress, seconds, grain_s);
            }
            for axis in (0..AXES).filter(|axis| signs[*axis] != 0) {
                let step = (axis, signs[axis]);
                self.path.step(step, seconds, followed.distances_mm[axis]);
            }
        } else {
            self.path.interrupt();
            self.corners.interrupt();
        }
        let here = array::from_fn(|n| f64::from(self.steps[n]) / self.motor_scales.steps_per_mm[n]);
        self.corners.place(seconds, here);
        for (axis, sign) in signs.into_iter().enumerate().filter(|(_, sign)| *sign != 0) {
            let [acceleration, jerk] = self.motor_scales.limits[axis];
            let allowed = self.arcs.allowed_mm_s3 * self.motor_scales.ratios[axis];
            self.tracks[axis].push(Crossing {
                seconds,
                position: f64::from(self.steps[axis]) - 0.5 * f64::from(sign),
                grain_s,
                limit: [acceleration, with_arc(jerk, allowed)],
            });
        }
        self.last_ticks = edge.ticks;
    }

    /// The limits along a direction: where each axis has its share of what is along the path.
    fn limits_along(&self, tangent: &Point) -> [f64; 2] {
        let least = |limit: &dyn Fn(usize) -> Option<f64>| {
            let axes = (0..AXES).filter(|axis| tangent[*axis].abs() > 1.0e-9);
            let limits = axes.filter_map(|axis| Some(limit(axis)? / tangent[axis].abs()));
            limits.fold(f64::INFINITY, f64::min)
        };
        let jerk = least(&|axis| self.motor_scales.jerks[axis]);
        [
            least(&|axis| Some(self.motor_scales.accelerations[axis])),
            if jerk.is_finite() {
                with_arc(jerk, self.arcs.along_mm_s3)
            } else {
                0.0
            },
        ]
    }

    fn pass(&mut self, mut passed: Passed, seconds: f64) {
        if self.is_core_xy {
            passed.at = turned(&passed.at);
        }
        let is_kink = passed.is_exact && passed.corner.turn_rad > KINK_RAD;
        if is_kink || passed.corner.is_stop {
            self.tracks.iter_mut().for_each(Track::turn);
            self.path.turn();
        } else if passed.is_exact {
            let speed_mm_s = self.speed_mm_s.min(passed.corner.allowed_mm_s);
            let curvature_change = &passed.corner.curvature_change;
            let jumps_mm_s2 = self.arcs.jumps_mm_s2(curvature_change, self.speed_mm_s);
            for (axis, track) in self.tracks.iter_mut().enumerate() {
                let jumps = [speed_mm_s * passed.corner.change[axis], jumps_mm_s2[axis]];
                let ratio = self.motor_scales.ratios[axis];
                track.allow(seconds, jumps.map(|jump| (jump * ratio).abs()));
            }
        }
        if passed.corner.is_stop || passed.corner.is_regeared {
            self.path.interrupt();
        }
        self.corners.pass(passed, seconds);
    }

    fn progress(&mut self, progress: &Progress, seconds: f64, grain_s: f64) {
        if progress.mm <= self.path_mm {
            return;
        }
        self.path_mm = progress.mm;
        // Two axes say it differently where the steps are a little beside the path.
        if self.path_axis.replace(progress.axis) != Some(progress.axis) {
            self.path.interrupt();
        }
        let plane = progress.tangent.iter().zip(&progress.curvature);
        let accelerations = plane
            .zip(&self.motor_scales.accelerations)
            .filter(|((tangent, curvature), _)| tangent.abs() + curvature.abs() > 1.0e-9);
        let acceleration = accelerations.fold(f64::INFINITY, |least, (_, a)| least.min(*a));
        self.arcs
            .follow(&progress.curvature, self.speed_mm_s, acceleration);
        let crossing = Crossing {
            seconds,
            position: progress.mm,
            grain_s,
            limit: self.limits_along(&progress.tangent),
        };
        self.corners.progress(crossing);
        let feed_mm_s = self.feed_mm_s.filter(|_| progress.feed_mm_s.is_some());
        self.feed_mm_s = progress.feed_mm_s;
        let Some(speed) = self.path.push(crossing) else {
            return;
        };
        self.speed_mm_s = speed.value;
        if let Some(feed) = feed_mm_s {
            let took_s = speed.to_s - speed.from_s;
            self.feed.feed_s += took_s;
            if (speed.value / feed - 1.0).abs() <= AT_FEED {
                self.feed.at_feed_s += took_s;
            }
        }
    }

    /// What was measured.
    pub(crate) fn finish(mut self) -> (Quality, Traces) {
        if let Some((held, is_shared)) = self.held.take() {
            self.take(&held, is_shared);
        }
        self.feed.part = self.feed.at_feed_s / self.feed.feed_s.max(f64::MIN_POSITIVE);
        let deviation = self.follower.finish();
        let mut traces = Traces {
            deviation: self.deviation,
            floor_mm: deviation.floor_mm,
            is_core_xy: self.is_core_xy,
            ..Traces::default()
        };
        let path = self.path.finish();
        let mut axes = Vec::new();
        for (axis, track) in self.tracks.into_iter().enumerate() {
            if !track.has_moved() {
                continue;
            }
            let finished = track.finish();
            let [acceleration_limit_mm_s2, jerk_limit_mm_s3] = self.motor_scales.limits[axis];
            traces.accelerations.push((axis, finished.accelerations));
            traces.jerks.push((axis, finished.jerks));
            axes.push(AxisQuality {
                axis: name(axis, self.is_core_xy),
                interval_error: path.interval_errors[axis],
                smoothness: finished.smoothness,
                acceleration_limit_mm_s2,
                jerk_limit_mm_s3: self.motor_scales.jerks[axis].map(|_| jerk_limit_mm_s3),
            });
        }
        let ticks = self.last_ticks - self.first_ticks.unwrap_or(self.last_ticks);
        let quality = Quality {
            job_time_s: ticks as f64 / f64::from(TICKS_PER_SECOND),
            axes,
            path: path.smoothness,
            deviation,
            corners: self.corners.finish(),
            arcs: self.arcs.greatest,
            feed: self.feed,
            violations: Vec::new(),
            is_path_known: self.is_path_known,
        };
        let quality = Quality {
            violations: violations(&quality),
            ..quality
        };
        (quality, traces)
    }
}

/// A limit of jerk with what an arc allows beside it; 0 without a limit.
fn with_arc(limit_mm_s3: f64, allowed_mm_s3: f64) -> f64 {
    if limit_mm_s3 > 0.0 {
        limit_mm_s3 + allowed_mm_s3
    } else {
        0.0
    }
}

/// The limits that were exceeded, as sentences.
fn violations(quality: &Quality) -> Vec<String> {
    let of_axes = quality.axes.iter().flat_map(|axis| {
        let Smoothness {
            acceleration_mm_s2,
            jerk_mm_s3,
            ..
        } = &axis.smoothness;
        let peaks = [(acceleration_mm_s2, "acceleration"), (jerk_mm_s3, "jerk")];
        peaks.map(|(peak, what)| (peak.of_limit, format!("the {what} limit of {}", axis.axis)))
    });
    let corners = (
        quality.corners.most_of_allowed,
        "the speed that $11 allows in a corner".to_owned(),
    );
    let all = of_axes.chain([corners]);
    let exceeded = all.filter_map(|(part, limit)| {
        let percent = 100.0 * part.filter(|part| *part > 1.0 + UNCERTAIN)?;
        Some(format!("{percent:.1} % of {limit}"))
    });
    exceeded.collect()
}
