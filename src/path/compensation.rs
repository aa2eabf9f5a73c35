//! Cutter radius compensation: from the programmed moves to those of the cutter's centre.
//!
//! Stands between the interpreter and path control. What a move becomes depends on the next one, so one
//! move waits until that is known, and everything that follows meanwhile waits behind it:
//!
//! ```text
//!  commands ──▶ waiting move ── up to MAX_ENTRIES_BEHIND entries ──▶ released, with the corner ──▶ output
//! ```
//!
//! A move is planned by [`Compensator::plan`], which may find that the cutter does not fit and changes
//! nothing then, and takes part by [`Compensator::push`].
//!
//! Read with LinuxCNC 2.9 "Cutter Radius Compensation" and RS274NGC 3, appendix B.

mod geometry;

use core::f64::consts::TAU;

use heapless::Deque;

use self::geometry::{
    Meeting, Track, Vector, along, angle_between, arc_entry, dot, intersection, is_inside, length,
    meeting, minus, normal, sign_of, sweep, tangent, travel, unit,
};
use super::{arc::Arc, leaves_travel};
use crate::{
    axis::Axes,
    gcode::interpreter::CompensatedMove,
    model::{
        Circle, Command, Coolant, Cutter, FeedRate, Laser, OverrideSwitches, PathControl, Plane,
        Rotation, Side, Spindle,
    },
    settings::Settings,
    units::{MicroDegrees, Nm},
};

/// Most entries that wait behind a move: error 207 for more.
const MAX_ENTRIES_BEHIND: usize = 16;
/// Most by which an arc may become longer at a concave corner, rad, as in LinuxCNC: where the corner lies
/// next to its end.
const LONGER_ARC_RAD: f64 = 0.0254;
/// Greatest angle and distance that rounding may make of none.
const ROUNDING_RAD: f64 = 1.0e-6;
const ROUNDING_MM: f64 = 5.0e-6;

/// Why a move cannot be compensated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Misfit {
    /// An entry, an arc or a corner is too small for the cutter.
    Cutter,
    /// The cutter's centre would go farther than an axis counts.
    Reach,
}

/// A move of the cutter's centre.
#[derive(Debug, Clone, Copy)]
struct CutterMove {
    start: Axes<Nm>,
    end: Axes<Nm>,
    arc: Option<CutterArc>,
    is_entry: bool,
    feed_rate: FeedRate,
    line: u32,
}

/// The arc of a move.
#[derive(Debug, Clone, Copy)]
struct CutterArc {
    centre: [Nm; 2],
    rotation: Rotation,
    /// Angle travelled, rad, and how much of it is whole circles before the last one.
    sweep: f64,
    circles: f64,
}

/// What waits behind a move.
#[derive(Debug, Clone, Copy)]
enum Behind {
    /// A move at the corner.
    Depth(Axes<Nm>, FeedRate, u32),
    Power(Laser),
    Dwell(u32),
    Spindle(Spindle, f32),
    Coolant(Coolant),
    Overrides(OverrideSwitches),
    Pause,
    /// The path control of what comes after this.
    Control(PathControl),
}

/// A move that fits: what becomes of the one before it, and of itself.
#[derive(Debug, Clone, Copy)]
struct Plan {
    /// The start of an entry.
    entry: Option<Axes<Nm>>,
    cutter: Cutter,
    /// The waiting move ends here instead, after this angle if it is an arc.
    shortened: Option<([Nm; 2], f64)>,
    /// The end of the move around a convex corner, and its arc.
    around: Option<([Nm; 2], Option<CutterArc>)>,
    end: [Nm; 2],
    arc: Option<CutterArc>,
    /// Length as programmed, mm.
    length_mm: f32,
}

/// The moves of the cutter that wait for the next one, and those that are released.
#[derive(Debug)]
pub struct Compensator {
    plane: Plane,
    plan: Option<Plan>,
    /// The end of all moves: that of the waiting one is not shortened.
    end: Axes<Nm>,
    waiting: Option<CutterMove>,
    behind: Deque<Behind, MAX_ENTRIES_BEHIND>,
    /// The path control of what waits, and of what was pushed last.
    control: PathControl,
    pushed_control: PathControl,
    /// What waits is released; then the corner, and the next move waits.
    is_released: bool,
    around: Option<CutterMove>,
    next: Option<CutterMove>,
}

impl Compensator {
    /// A compensator without moves.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            plane: Plane::Xy,
            plan: None,
            end: Axes::all(Nm(0)),
            waiting: None,
            behind: Deque::new(),
            control: PathControl::ExactPath,
            pushed_control: PathControl::ExactPath,
            is_released: false,
            around: None,
            next: None,
        }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.plan = None;
        self.waiting = None;
        self.behind.clear();
        self.is_released = false;
        self.around = None;
        self.next = None;
    }

    /// Returns whether a move waits for the next one.
    #[must_use]
    pub const fn is_waiting(&self) -> bool {
        self.waiting.is_some()
    }

    /// Returns how many commands under a path control may wait behind the move that waits.
    #[must_use]
    pub fn room(&self, control: PathControl) -> usize {
        let changes = usize::from(control != self.pushed_control);
        (MAX_ENTRIES_BEHIND - self.behind.len()).saturating_sub(changes)
    }

    /// Returns the path control of the next command that is released.
    #[must_use]
    pub fn control(&self) -> PathControl {
        if self.waiting.is_some() || !self.behind.is_empty() {
            self.control
        } else {
            self.pushed_control
        }
    }

    /// Returns the end of all moves.
    #[must_use]
    pub const fn end(&self) -> Axes<Nm> {
        self.end
    }

    /// Returns whether a planned move has not been pushed.
    #[must_use]
    pub const fn has_plan(&self) -> bool {
        self.plan.is_some()
    }

    /// Forgets a plan.
    pub const fn drop_plan(&mut self) {
        self.plan = None;
    }

    /// Plans a move.
    ///
    /// # Errors
    /// [`Misfit`]; then there is no plan.
    pub fn plan(
        &mut self,
        programmed: &CompensatedMove,
        farthest: &Axes<Nm>,
    ) -> Result<(), Misfit> {
        self.plan = None;
        let site = Site::new(programmed);
        let plan = if programmed.is_entry {
            site.entry()
        } else {
            site.follow(self)
        };
        let plan = plan.ok_or(Misfit::Cutter)?;
        if !plan.is_within(farthest) {
            return Err(Misfit::Reach);
        }
        self.plan = Some(plan);
        Ok(())
    }

    /// Adds a command under a path control: the planned move, a move of other axes, or anything else. What
    /// was released before has been dequeued.
    pub fn push(&mut self, command: &Command, control: PathControl) {
        let behind = match *command {
            Command::Line {
                target,
                feed_rate,
                line,
            }
            | Command::Arc {
                target,
                feed_rate,
                line,
                ..
            } => {
                if let Some(plan) = self.plan.take() {
                    self.pushed_control = control;
                    return self.push_planned(&plan, &target.position, feed_rate, line);
                }
                let end = self.in_place(&target.position);
                self.end = end;
                Behind::Depth(end, feed_rate, line)
            }
            Command::Power(laser) => Behind::Power(laser),
            Command::Dwell { milliseconds } => Behind::Dwell(milliseconds),
            Command::Spindle { spindle, rpm } => Behind::Spindle(spindle, rpm),
            Command::Coolant(coolant) => Behind::Coolant(coolant),
            Command::Overrides(switches) => Behind::Overrides(switches),
            Command::Pause => Behind::Pause,
            // Refused while compensation is on.
            Command::Probe { .. } | Command::ToolPause => return,
        };
        let mut is_full = false;
        if self.waiting.is_none() {
            self.control = control;
        } else if control != self.pushed_control {
            is_full = self.behind.push_back(Behind::Control(control)).is_err();
        }
        self.pushed_control = control;
        is_full |= self.behind.push_back(behind).is_err();
        debug_assert!(!is_full, "no more than `room` are pushed");
        self.is_released |= self.waiting.is_none();
    }

    /// Adds the planned move, which releases what waits.
    fn push_planned(&mut self, plan: &Plan, to: &Axes<Nm>, feed_rate: FeedRate, line: u32) {
        self.plane = plan.cutter.plane;
        if let Some(start) = plan.entry {
            self.end = start;
        }
        if let Some((corner, sweep)) = plan.shortened {
            self.shorten(corner, sweep);
        }
        // Around a corner at the speed of the move after it.
        let feed_rate = match feed_rate {
            FeedRate::InverseTime(per_minute) => FeedRate::Feed(per_minute * plan.length_mm),
            FeedRate::Rapid | FeedRate::Feed(_) | FeedRate::Jog(_) => feed_rate,
        };
        let mut at = self.end;
        self.around = plan.around.map(|(corner, arc)| CutterMove {
            start: core::mem::replace(&mut at, placed(plan.cutter.plane, &self.end, corner)),
            end: at,
            arc,
            is_entry: false,
            feed_rate,
            line,
        });
        self.end = placed(plan.cutter.plane, to, plan.end);
        self.next = Some(CutterMove {
            start: at,
            end: self.end,
            arc: plan.arc,
            is_entry: plan.entry.is_some(),
            feed_rate,
            line,
        });
        self.is_released = true;
        self.settle();
    }

    /// Shortens the waiting move: what waits behind it takes place at the corner.
    fn shorten(&mut self, corner: [Nm; 2], sweep: f64) {
        let plane = self.plane;
        let place = |position: &mut Axes<Nm>| *position = placed(plane, position, corner);
        if let Some(waiting) = &mut self.waiting {
            place(&mut waiting.end);
            if let Some(arc) = &mut waiting.arc {
                arc.sweep = sweep;
            }
        }
        for behind in &mut self.behind {
            if let Behind::Depth(position, ..) = behind {
                place(position);
            }
        }
        place(&mut self.end);
    }

    /// Releases everything: the waiting move goes to its end.
    pub fn release(&mut self) {
        self.is_released = self.waiting.is_some() || !self.behind.is_empty();
    }

    /// Lets the next move wait when everything before it has been dequeued, and changes the path control
    /// where that is next.
    fn settle(&mut self) {
        if self.is_released
            && self.waiting.is_none()
            && let Some(Behind::Control(control)) = self.behind.front()
        {
            self.control = *control;
            self.behind.pop_front();
        }
        if self.is_released
            && self.waiting.is_none()
            && self.behind.is_empty()
            && self.around.is_none()
        {
            self.waiting = self.next.take();
            self.control = self.pushed_control;
            self.is_released = false;
        }
    }

    /// Returns the next command that is released.
    #[must_use]
    pub fn front(&self) -> Option<Command> {
        if !self.is_released {
            return None;
        }
        if let Some(waiting) = &self.waiting {
            return Some(waiting.command(self.plane));
        }
        match self.behind.front() {
            Some(behind) => behind.command(),
            None => self
                .around
                .as_ref()
                .map(|around| around.command(self.plane)),
        }
    }

    /// Removes the next command that is released.
    pub fn dequeue(&mut self) {
        if self.waiting.take().is_none() && self.behind.pop_front().is_none() {
            self.around = None;
        }
        self.settle();
    }

    /// Returns whether something that is released leaves the travel of the machine.
    #[must_use]
    pub fn leaves_travel(&self, settings: &Settings) -> bool {
        let leaves =
            |one: &CutterMove| leaves_travel(settings, &one.start, &one.command(self.plane));
        let leaves_behind = |behind: &Behind| {
            let command = behind.command();
            command.is_some_and(|command| leaves_travel(settings, &self.end, &command))
        };
        self.is_released
            && (self.waiting.as_ref().is_some_and(leaves)
                || self.behind.iter().any(leaves_behind)
                || self.around.as_ref().is_some_and(leaves))
    }

    /// Returns the plane coordinates of the end, and the other ones of a position.
    fn in_place(&self, position: &Axes<Nm>) -> Axes<Nm> {
        let (first, second, _) = self.plane.axes();
        placed(self.plane, position, [self.end[first], self.end[second]])
    }
}

impl Default for Compensator {
    fn default() -> Self {
        Self::new()
    }
}

/// Returns a position with other coordinates in the plane.
fn placed(plane: Plane, position: &Axes<Nm>, [x, y]: [Nm; 2]) -> Axes<Nm> {
    let (first, second, _) = plane.axes();
    let mut position = *position;
    position[first] = x;
    position[second] = y;
    position
}

impl Plan {
    /// Whether every axis counts up to the ends of the moves.
    fn is_within(&self, farthest: &Axes<Nm>) -> bool {
        let (first, second, _) = self.cutter.plane.axes();
        let shortened = self.shortened.map(|(corner, _)| corner);
        let around = self.around.map(|(corner, _)| corner);
        let mut ends = [Some(self.end), shortened, around].into_iter().flatten();
        ends.all(|end| {
            let mut both = end.into_iter().zip([farthest[first], farthest[second]]);
            both.all(|(value, farthest)| value.0.unsigned_abs() <= farthest.0.unsigned_abs())
        })
    }
}

impl Behind {
    /// Returns the command; `None` for a change of the path control alone.
    fn command(&self) -> Option<Command> {
        Some(match *self {
            Self::Depth(position, feed_rate, line) => Command::Line {
                target: position.into(),
                feed_rate,
                line,
            },
            Self::Power(laser) => Command::Power(laser),
            Self::Dwell(milliseconds) => Command::Dwell { milliseconds },
            Self::Spindle(spindle, rpm) => Command::Spindle { spindle, rpm },
            Self::Coolant(coolant) => Command::Coolant(coolant),
            Self::Overrides(switches) => Command::Overrides(switches),
            Self::Pause => Command::Pause,
            Self::Control(_) => return None,
        })
    }
}

impl CutterMove {
    fn command(&self, plane: Plane) -> Command {
        let target = self.end.into();
        let (feed_rate, line) = (self.feed_rate, self.line);
        match self.arc.and_then(|arc| self.circle(plane, &arc)) {
            Some(circle) => Command::Arc {
                target,
                circle,
                feed_rate,
                line,
            },
            None => Command::Line {
                target,
                feed_rate,
                line,
            },
        }
    }

    /// Returns the circle of an arc; `None` for one without a length.
    ///
    /// Its ends are rounded, so that those of a full circle may be a nanometre apart, or not: the angle
    /// decides how often the circle is travelled.
    fn circle(&self, plane: Plane, arc: &CutterArc) -> Option<Circle> {
        let (first, second, _) = plane.axes();
        let centre = [
            arc.centre[0] - self.start[first],
            arc.centre[1] - self.start[second],
        ];
        let displacement = [
            self.end[first] - self.start[first],
            self.end[second] - self.start[second],
        ];
        let mut circle = Circle {
            plane,
            centre,
            rotation: arc.rotation,
            turns: 1,
            tilt: MicroDegrees::ZERO,
        };
        let once = libm::fabs(Arc::new(&circle, displacement).sweep);
        let more = libm::round((arc.sweep - once) / TAU);
        if more < 0.0 || centre == [Nm(0); 2] || centre == displacement {
            return None;
        }
        circle.turns = circle.turns.saturating_add(more as u16);
        Some(circle)
    }
}

/// A programmed move, relative to its start.
struct Site<'a> {
    programmed: &'a CompensatedMove,
    origin: [Nm; 2],
    to: Vector,
    arc: Option<ProgrammedArc>,
}

/// The arc of a programmed move.
#[derive(Clone, Copy)]
struct ProgrammedArc {
    centre: Vector,
    rotation: Rotation,
    /// Angle travelled, rad, and the length, mm.
    sweep: f64,
    length_mm: f64,
    /// The part of the angle that is whole circles before the last one, rad.
    circles: f64,
}

impl<'a> Site<'a> {
    fn new(programmed: &'a CompensatedMove) -> Self {
        let (first, second, _) = programmed.cutter.plane.axes();
        let (from, to) = (&programmed.from, &programmed.to);
        let displacement = [to[first] - from[first], to[second] - from[second]];
        Self {
            programmed,
            origin: [from[first], from[second]],
            to: displacement.map(Nm::to_mm_f64),
            arc: programmed.circle.map(|circle| {
                let arc = Arc::new(&circle, displacement);
                ProgrammedArc {
                    centre: circle.centre.map(Nm::to_mm_f64),
                    rotation: circle.rotation,
                    sweep: libm::fabs(arc.sweep),
                    length_mm: arc.length_mm(),
                    circles: TAU * f64::from(circle.turns.saturating_sub(1)),
                }
            }),
        }
    }

    /// Returns a point of the machine, relative to the start.
    fn relative(&self, point: [Nm; 2]) -> Vector {
        [point[0] - self.origin[0], point[1] - self.origin[1]].map(Nm::to_mm_f64)
    }

    /// Returns a place of the plane, rounded.
    fn machine(&self, place: Vector) -> [Nm; 2] {
        let [x, y] = place.map(Nm::from_mm_f64);
        [self.origin[0] + x, self.origin[1] + y]
    }

    /// Returns the length along the linear axes, mm.
    fn length_mm(&self) -> f32 {
        let depth = self.programmed.cutter.plane.axes().2;
        let rise = (self.programmed.to[depth] - self.programmed.from[depth]).to_mm_f64();
        let in_plane = match &self.arc {
            Some(arc) => arc.length_mm,
            None => length(self.to),
        };
        libm::hypot(in_plane, rise) as f32
    }

    /// Returns the radius of the track along a circle.
    fn track_radius(&self, rotation: Rotation, radius: f64) -> Option<f64> {
        let Cutter {
            side, radius_mm, ..
        } = self.programmed.cutter;
        if is_inside(side, rotation) {
            (radius > radius_mm).then_some(radius - radius_mm)
        } else {
            Some(radius + radius_mm)
        }
    }

    /// Plans the first move.
    fn entry(&self) -> Option<Plan> {
        let Cutter {
            side, radius_mm, ..
        } = self.programmed.cutter;
        let here = [0.0; 2];
        if length(self.to) <= radius_mm {
            return None;
        }
        let (end, arc) = match &self.arc {
            None => {
                let aside = normal(side, unit(self.to)?);
                (along(self.to, radius_mm, aside), None)
            }
            Some(arc) => {
                let radial = minus(self.to, arc.centre);
                let radius = self.track_radius(arc.rotation, length(radial))?;
                let end = along(arc.centre, radius, unit(radial)?);
                let centre = arc_entry(here, end, arc.centre)?;
                let angle =
                    |centre, end| sweep(arc.rotation, minus(here, centre), minus(end, centre));
                let entry = CutterArc {
                    centre: self.machine(centre),
                    rotation: arc.rotation,
                    sweep: angle(centre, end) + arc.circles,
                    circles: arc.circles,
                };
                (end, Some(entry))
            }
        };
        Some(Plan {
            entry: Some(self.programmed.from),
            cutter: self.programmed.cutter,
            shortened: None,
            around: None,
            end: self.machine(end),
            arc,
            length_mm: self.length_mm(),
        })
    }

    /// Returns the direction of travel at the start, and the track with its end.
    fn track(&self) -> Option<(Vector, Track, Vector)> {
        let Cutter {
            side, radius_mm, ..
        } = self.programmed.cutter;
        Some(match &self.arc {
            None => {
                let direction = unit(self.to)?;
                let aside = normal(side, direction);
                let start = along([0.0; 2], radius_mm, aside);
                let end = along(self.to, radius_mm, aside);
                (direction, Track::Line(start, direction), end)
            }
            Some(arc) => {
                let ProgrammedArc {
                    centre, rotation, ..
                } = *arc;
                let direction = tangent(rotation, centre.map(|part| -part))?;
                let radius = self.track_radius(rotation, length(centre))?;
                let radial = unit(minus(self.to, centre))?;
                let end = along(centre, radius, radial);
                (direction, Track::Circle(centre, radius, rotation), end)
            }
        })
    }

    /// Plans a move that follows another one.
    fn follow(&self, before: &Compensator) -> Option<Plan> {
        let cutter = self.programmed.cutter;
        let Cutter {
            side,
            radius_mm,
            plane,
        } = cutter;
        let (first, second, _) = plane.axes();
        let tool = self.relative([before.end[first], before.end[second]]);
        let n = unit(tool)?;
        let (direction, after, end) = self.track()?;
        let n_after = normal(side, direction);
        let mut plan = Plan {
            entry: None,
            cutter,
            shortened: None,
            around: None,
            end: self.machine(end),
            arc: None,
            length_mm: self.length_mm(),
        };
        let mut start = tool;
        match meeting(side, n, n_after, self.is_reversal_concave(before)) {
            Meeting::Tangent => {}
            Meeting::Convex => {
                start = along([0.0; 2], radius_mm, n_after);
                let rotation = match side {
                    Side::Left => Rotation::Clockwise,
                    Side::Right => Rotation::CounterClockwise,
                };
                let arc = CutterArc {
                    centre: self.origin,
                    rotation,
                    sweep: sweep(rotation, n, n_after),
                    circles: 0.0,
                };
                let arc = (!self.programmed.is_rapid).then_some(arc);
                plan.around = Some((self.machine(start), arc));
            }
            Meeting::Concave => {
                if let Some(waiting) = &before.waiting {
                    let (corner, sweep) = self.shortened(waiting, tool, n, after)?;
                    plan.shortened = Some((self.machine(corner), sweep));
                    start = corner;
                }
            }
        }
        match &self.arc {
            Some(arc) => {
                plan.arc = Some(CutterArc {
                    centre: self.machine(arc.centre),
                    rotation: arc.rotation,
                    sweep: arc.sweep_from(start)?,
                    circles: arc.circles,
                });
            }
            // A line shorter than what the corner takes of it would lead the cutter back into the contour.
            None if dot(direction, minus(end, start)) < -ROUNDING_MM => return None,
            None => {}
        }
        Some(plan)
    }

    /// Whether an exact reversal is a concave corner: see [`meeting`].
    fn is_reversal_concave(&self, before: &Compensator) -> bool {
        let side = self.programmed.cutter.side;
        match &self.arc {
            Some(arc) => !is_inside(side, arc.rotation),
            None => before
                .waiting
                .as_ref()
                .and_then(|waiting| waiting.arc)
                .is_some_and(|arc| !is_inside(side, arc.rotation)),
        }
    }

    /// Returns the corner up to which the waiting move is shortened, and its angle if it is an arc.
    ///
    /// `None` where there is no corner on both tracks, or where the waiting move would go back from its start,
    /// or around the circle once more: on the contour, which an entry is not part of.
    fn shortened(
        &self,
        waiting: &CutterMove,
        tool: Vector,
        n: Vector,
        after: Track,
    ) -> Option<(Vector, f64)> {
        let Cutter { side, plane, .. } = self.programmed.cutter;
        let (first, second, _) = plane.axes();
        let start = self.relative([waiting.start[first], waiting.start[second]]);
        let Some(arc) = &waiting.arc else {
            let before = Track::Line(tool, travel(side, n));
            let corner = intersection(side, before, after)?;
            let is_back = dot(travel(side, n), minus(corner, start)) < 0.0;
            return (waiting.is_entry || !is_back).then_some((corner, 0.0));
        };
        let centre = self.relative(arc.centre);
        let before = Track::Circle(centre, length(minus(tool, centre)), arc.rotation);
        let corner = intersection(side, before, after)?;
        let last = sweep(arc.rotation, minus(start, centre), minus(corner, centre));
        let shorter = last + arc.circles;
        let is_shorter = shorter <= arc.sweep + LONGER_ARC_RAD;
        (waiting.is_entry || is_shorter).then_some((corner, shorter))
    }
}

impl ProgrammedArc {
    /// Returns the angle of the track that begins at a place beside the start, rad; `None` where that is
    /// beyond its end.
    fn sweep_from(&self, start: Vector) -> Option<f64> {
        let from = self.centre.map(|part| -part);
        let ahead = sign_of(self.rotation) * angle_between(from, minus(start, self.centre));
        let sweep = self.sweep - ahead;
        (sweep >= -ROUNDING_RAD).then_some(sweep.max(0.0))
    }
}
