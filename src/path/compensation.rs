//! Cutter radius compensation: from the programmed moves to those of the cutter's centre.
//!
//! Stands between the interpreter and path control. How a move is compensated depends on the next move, so a move waits
//! until the next is known, and everything in between waits behind the move:
//!
//! ```text
//!  commands ──▶ waiting move ── up to MAX_QUEUED entries ──▶ released, with the corner ──▶ output
//! ```
//!
//! A move is planned by [`Compensator::plan`], which may find that the cutter does not fit and changes
//! nothing then, and takes part by [`Compensator::push`].
//!
//! Read with LinuxCNC 2.9 "Cutter Radius Compensation" and RS274NGC 3, appendix B.

mod cutter_move;
mod geometry;
mod plan;

use heapless::Deque;

use self::{
    cutter_move::{CutterMove, placed},
    plan::Plan,
};
use super::{OutsideTravel, leaves_travel};
use crate::{
    axis::Axes,
    gcode::interpreter::CompensatedMove,
    model::{Command, Coolant, FeedRate, Laser, OverrideSwitches, PathControl, Plane, Spindle},
    settings::Settings,
    units::Nm,
};

/// Most entries that wait behind a move: error 207 for more.
const MAX_QUEUED: usize = 16;

/// Why a move cannot be compensated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Misfit {
    /// An entry, an arc or a corner is too small for the cutter.
    Cutter,
    /// The cutter's centre would go farther than an axis counts.
    Reach,
}

/// An entry that waits behind a move.
#[derive(Debug, Clone, Copy)]
enum Queued {
    /// A move at the corner.
    Depth(Axes<Nm>, FeedRate, u32),
    Power(Laser),
    Dwell(u32),
    Spindle(Spindle, f32),
    Speed(f32),
    Coolant(Coolant),
    Overrides(OverrideSwitches),
    Pause,
    /// The path control of what comes after this.
    Control(PathControl),
}

/// The moves of the cutter: the moves that wait for the next move, and the released moves.
#[derive(Debug)]
pub struct Compensator {
    plane: Plane,
    plan: Option<Plan>,
    /// The end of all moves: that of the waiting one is not shortened.
    end: Axes<Nm>,
    waiting: Option<CutterMove>,
    queued: Deque<Queued, MAX_QUEUED>,
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
            queued: Deque::new(),
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
        self.queued.clear();
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
        (MAX_QUEUED - self.queued.len()).saturating_sub(changes)
    }

    /// Returns the path control of the next command that is released.
    #[must_use]
    pub fn control(&self) -> PathControl {
        if self.waiting.is_some() || !self.queued.is_empty() {
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
        let plan = Plan::new(programmed, self.waiting.as_ref(), &self.end);
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
        let entry = match *command {
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
                Queued::Depth(end, feed_rate, line)
            }
            Command::Power(laser) => Queued::Power(laser),
            Command::Dwell { milliseconds } => Queued::Dwell(milliseconds),
            Command::Spindle { spindle, rpm } => Queued::Spindle(spindle, rpm),
            Command::Speed(rpm) => Queued::Speed(rpm),
            Command::Coolant(coolant) => Queued::Coolant(coolant),
            Command::Overrides(switches) => Queued::Overrides(switches),
            Command::Pause => Queued::Pause,
            // Refused while compensation is on.
            Command::Probe { .. } | Command::ReverseTap { .. } | Command::ToolPause => return,
        };
        let mut is_full = false;
        if self.waiting.is_none() {
            self.control = control;
        } else if control != self.pushed_control {
            is_full = self.queued.push_back(Queued::Control(control)).is_err();
        }
        self.pushed_control = control;
        is_full |= self.queued.push_back(entry).is_err();
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
        for entry in &mut self.queued {
            if let Queued::Depth(position, ..) = entry {
                place(position);
            }
        }
        place(&mut self.end);
    }

    /// Releases everything: the waiting move goes to its end.
    pub fn release(&mut self) {
        self.is_released = self.waiting.is_some() || !self.queued.is_empty();
    }

    /// Lets the next move wait when everything before it has been dequeued, and changes the path control
    /// where that is next.
    fn settle(&mut self) {
        if self.is_released
            && self.waiting.is_none()
            && let Some(Queued::Control(control)) = self.queued.front()
        {
            self.control = *control;
            self.queued.pop_front();
        }
        if self.is_released
            && self.waiting.is_none()
            && self.queued.is_empty()
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
        match self.queued.front() {
            Some(entry) => entry.command(),
            None => self
                .around
                .as_ref()
                .map(|around| around.command(self.plane)),
        }
    }

    /// Removes the next command that is released.
    pub fn dequeue(&mut self) {
        if self.waiting.take().is_none() && self.queued.pop_front().is_none() {
            self.around = None;
        }
        self.settle();
    }

    /// Returns whether something that is released leaves the travel of the machine.
    #[must_use]
    pub fn leaves_travel(&self, settings: &Settings) -> bool {
        let leaves =
            |one: &CutterMove| leaves_travel(settings, &one.start, &one.command(self.plane));
        let entry_leaves = |entry: &Queued| {
            let command = entry.command();
            command.is_some_and(|command| leaves_travel(settings, &self.end, &command))
        };
        self.is_released
            && (self.waiting.as_ref().is_some_and(leaves)
                || self.queued.iter().any(entry_leaves)
                || self.around.as_ref().is_some_and(leaves))
    }

    /// Returns a coordinate for which [`Self::leaves_travel`] is true.
    #[must_use]
    pub fn outside(&self, settings: &Settings) -> Option<OutsideTravel> {
        if !self.is_released {
            return None;
        }
        let of = |one: &CutterMove| {
            OutsideTravel::on_path(settings, &one.start, &one.command(self.plane))
        };
        let mut queued = self.queued.iter().filter_map(Queued::command);
        let waiting = self.waiting.as_ref().and_then(of);
        waiting
            .or_else(|| queued.find_map(|one| OutsideTravel::on_path(settings, &self.end, &one)))
            .or_else(|| self.around.as_ref().and_then(of))
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

impl Queued {
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
            Self::Speed(rpm) => Command::Speed(rpm),
            Self::Coolant(coolant) => Command::Coolant(coolant),
            Self::Overrides(switches) => Command::Overrides(switches),
            Self::Pause => Command::Pause,
            Self::Control(_) => return None,
        })
    }
}
