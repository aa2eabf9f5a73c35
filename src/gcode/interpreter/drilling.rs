//! The moves of a line that drills, one command at a time.
//!
//! Between holes the tool moves at the clear level only: `R` under `G99`, else the level at which the
//! cycle began, if that is higher.

use super::{
    CheckedLine, Interpreter,
    offsets::{self, Frame},
};
use crate::{
    axis::Axes,
    gcode::{Cycle, Distance, RetractMode},
    model::{Command, FeedRate, Laser, OverrideSwitches, Plane, Spindle},
    units::Nm,
};

/// How long the spindle is off before it turns the other way, ms: longer than inputs of spindle drives
/// are filtered.
const DRIVE_TIME_MS: u32 = 10;

/// The words of a cycle, which its next lines may leave out.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct CycleWords {
    pub(super) cycle: Cycle,
    /// The level at which the first line in a cycle began.
    pub(super) initial_level: Nm,
    /// `R`.
    pub(super) r: Nm,
    /// The word of the depth axis.
    pub(super) bottom: Nm,
    /// `Q`: the depth of a peck.
    pub(super) peck: Nm,
    /// `P`, ms.
    pub(super) dwell_ms: u32,
    /// The words of the plane's axes, 0 without.
    pub(super) in_plane: [Nm; 2],
    /// The level at which the last line has ended.
    pub(super) end_level: Nm,
    /// Whether the line follows one of a cycle, which has left the tool at a level without obstacles.
    pub(super) is_continued: bool,
    /// `L`: how often this line drills.
    pub(super) repeats: u8,
    /// `$28`: how far above the last peck the next one begins.
    pub(super) clearance: Nm,
}

/// A line that drills.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Drilling {
    words: CycleWords,
    plane: Plane,
    /// From here on down the tool feeds.
    retract_level: Nm,
    bottom: Nm,
    /// Between holes.
    clear_level: Nm,
    /// How far the tool rises on the way to a hole, where it is lower than between holes.
    retract: RetractMode,
    /// Work position before the next command.
    position: Axes<Nm>,
    /// The hole, and the distance to the next one, along the plane's axes.
    hole: [Nm; 2],
    distance: [Nm; 2],
    /// Holes after this one.
    more_holes: u8,
    /// The next step of the hole.
    step: usize,
    /// Where the last peck has ended.
    depth: Nm,
    spindle: Spindle,
    rpm: f32,
    overrides: OverrideSwitches,
    feed_mm_min: f32,
    line: u32,
}

/// A step of a hole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum HoleStep {
    /// Up to `R`, if the tool is below it at the first hole, or at the bottom of one.
    Raise,
    /// Over the hole: on a straight line also where the tool has to rise to `R`, or to the clear level
    /// under `G98`.
    Traverse,
    /// Down to `R`.
    DownToRetract,
    OverridesOff,
    OverridesBack,
    /// Down by `Q`, or on with the step after the pecks if that would be the bottom.
    Peck,
    /// Up to `R` after a peck.
    ClearChips,
    /// To a little above the end of the peck, and to the next one.
    NextPeck,
    /// Down to the bottom.
    Feed,
    Dwell,
    SpindleOff,
    /// The time in which a drive sees that the spindle is off, before it turns the other way.
    DriveTime,
    SpindleReversed,
    SpindleBack,
    Pause,
    /// Up to `R` at feed.
    FeedToRetract,
    /// Up to the clear level at feed.
    FeedOut,
    /// Up to the clear level.
    RapidOut,
}

/// The steps that all cycles begin with.
const BEGIN: [HoleStep; 3] = [HoleStep::Raise, HoleStep::Traverse, HoleStep::DownToRetract];

/// Returns the steps of a cycle at `R`.
const fn steps(cycle: Cycle) -> &'static [HoleStep] {
    use HoleStep::{
        ClearChips, DriveTime, Dwell, Feed, FeedOut, FeedToRetract, NextPeck, OverridesBack,
        OverridesOff, Pause, Peck, RapidOut, SpindleBack, SpindleOff, SpindleReversed,
    };
    match cycle {
        Cycle::G73 => &[Peck, NextPeck, Feed, Dwell, RapidOut],
        Cycle::G81 => &[Feed, RapidOut],
        Cycle::G82 => &[Feed, Dwell, RapidOut],
        Cycle::G83 => &[Peck, ClearChips, NextPeck, Feed, Dwell, RapidOut],
        Cycle::G74 | Cycle::G84 => &[
            OverridesOff,
            Feed,
            SpindleOff,
            DriveTime,
            SpindleReversed,
            Dwell,
            FeedOut,
            SpindleOff,
            DriveTime,
            SpindleBack,
            OverridesBack,
        ],
        Cycle::G85 => &[Feed, FeedToRetract, RapidOut],
        Cycle::G86 => &[Feed, Dwell, SpindleOff, RapidOut, SpindleBack],
        Cycle::G88 => &[Feed, Dwell, SpindleOff, Pause, SpindleBack],
        Cycle::G89 => &[Feed, Dwell, FeedOut],
    }
}

impl Drilling {
    /// The holes of a line that is to be executed in the present state.
    pub(super) fn new(state: &Interpreter, checked: &CheckedLine, words: &CycleWords) -> Self {
        let modal = &checked.modal;
        let (first, second, _) = modal.plane.axes();
        let position = offsets::present(state, &offsets::frame(state, checked));
        let (retract_level, bottom) = match modal.distance {
            Distance::Absolute => (words.r, words.bottom),
            Distance::Incremental => {
                let retract_level = words.initial_level + words.r;
                (retract_level, retract_level + words.bottom)
            }
        };
        let is_given = [first, second].map(|axis| checked.axes >> axis & 1 != 0);
        let hole = |index: usize, axis: usize| match modal.distance {
            Distance::Absolute if is_given[index] => words.in_plane[index],
            Distance::Absolute => position[axis],
            Distance::Incremental => position[axis] + words.in_plane[index],
        };
        Self {
            words: *words,
            plane: modal.plane,
            retract_level,
            bottom,
            clear_level: match modal.retract {
                RetractMode::InitialLevel => retract_level.max(words.initial_level),
                RetractMode::ReferencePlane => retract_level,
            },
            retract: modal.retract,
            position,
            hole: [hole(0, first), hole(1, second)],
            distance: match modal.distance {
                Distance::Absolute => [Nm(0); 2],
                Distance::Incremental => words.in_plane,
            },
            more_holes: words.repeats.saturating_sub(1),
            step: 0,
            depth: retract_level,
            spindle: modal.spindle,
            // A laser is dark in all of a cycle, also where the spindle would be switched.
            rpm: if checked.power == Laser::None {
                modal.speed_rpm
            } else {
                0.0
            },
            overrides: modal.overrides,
            feed_mm_min: modal.feed,
            line: checked.line,
        }
    }

    pub(super) fn is_retract_below_bottom(&self) -> bool {
        self.retract_level < self.bottom
    }

    /// Returns the work position after the last hole.
    pub(super) fn end(&self) -> Axes<Nm> {
        let level = match self.words.cycle {
            Cycle::G88 => self.bottom,
            _ => self.clear_level,
        };
        self.at(self.last_hole(), level)
    }

    /// Returns work positions between which all of the way lies: the corners of its box.
    pub(super) fn corners(&self) -> [Axes<Nm>; 5] {
        let highest = self.clear_level.max(self.position[self.plane.axes().2]);
        let mut raised = self.position;
        raised[self.plane.axes().2] = highest;
        [
            raised,
            self.at(self.hole, highest),
            self.at(self.hole, self.bottom),
            self.at(self.last_hole(), highest),
            self.at(self.last_hole(), self.bottom),
        ]
    }

    fn last_hole(&self) -> [Nm; 2] {
        let more = i64::from(self.more_holes);
        [0, 1].map(|index| {
            let moved = self.distance[index].0.saturating_mul(more);
            Nm(self.hole[index].0.saturating_add(moved))
        })
    }

    fn at(&self, hole: [Nm; 2], level: Nm) -> Axes<Nm> {
        let (first, second, depth) = self.plane.axes();
        let mut position = self.position;
        (position[first], position[second], position[depth]) = (hole[0], hole[1], level);
        position
    }

    /// Returns the next command; `None` when all holes are drilled.
    pub(super) fn next_command(&mut self, frame: &Frame) -> Option<Command> {
        loop {
            let steps = steps(self.words.cycle);
            let at_hole = BEGIN.iter().chain(steps).copied();
            let Some(step) = at_hole.clone().nth(self.step) else {
                if self.more_holes == 0 {
                    return None;
                }
                self.more_holes -= 1;
                for (hole, distance) in self.hole.iter_mut().zip(self.distance) {
                    *hole = *hole + distance;
                }
                self.step = 0;
                // A hole may have left the tool at its bottom.
                self.words.is_continued = false;
                self.depth = self.retract_level;
                continue;
            };
            self.step += 1;
            if let Some(command) = self.command(step, frame) {
                return Some(command);
            }
        }
    }

    /// Returns the command of a step; `None` where there is nothing to do.
    fn command(&mut self, step: HoleStep, frame: &Frame) -> Option<Command> {
        let level = self.position[self.plane.axes().2];
        match step {
            HoleStep::Raise if level < self.retract_level && !self.words.is_continued => {
                self.rapid_to(self.retract_level, frame)
            }
            HoleStep::Raise => None,
            HoleStep::Traverse => {
                let level = match self.retract {
                    RetractMode::InitialLevel => level.max(self.clear_level),
                    RetractMode::ReferencePlane => level.max(self.retract_level),
                };
                self.go(self.at(self.hole, level), FeedRate::Rapid, frame)
            }
            HoleStep::DownToRetract | HoleStep::ClearChips => {
                self.rapid_to(self.retract_level, frame)
            }
            HoleStep::Peck => {
                let end = self.depth - self.words.peck;
                if end <= self.bottom {
                    // The last one is the step after the pecks.
                    self.step += self.steps_of_pecks();
                    return None;
                }
                self.depth = end;
                self.feed_to(end, frame)
            }
            HoleStep::NextPeck => {
                self.step -= self.steps_of_pecks() + 1;
                let above = self.depth + self.words.clearance;
                self.rapid_to(above.min(self.retract_level), frame)
            }
            HoleStep::Feed => self.feed_to(self.bottom, frame),
            HoleStep::FeedToRetract => self.feed_to(self.retract_level, frame),
            HoleStep::FeedOut => self.feed_to(self.clear_level, frame),
            HoleStep::RapidOut => self.rapid_to(self.clear_level, frame),
            HoleStep::Dwell if self.words.dwell_ms == 0 => None,
            HoleStep::Dwell => Some(Command::Dwell {
                milliseconds: self.words.dwell_ms,
            }),
            HoleStep::DriveTime => Some(Command::Dwell {
                milliseconds: DRIVE_TIME_MS,
            }),
            HoleStep::SpindleOff => Some(self.switch(Spindle::Off)),
            HoleStep::SpindleReversed => Some(Command::ReverseTap {
                spindle: match self.spindle {
                    Spindle::Clockwise => Spindle::CounterClockwise,
                    Spindle::CounterClockwise => Spindle::Clockwise,
                    Spindle::Off => Spindle::Off,
                },
                rpm: self.rpm,
            }),
            HoleStep::SpindleBack => Some(self.switch(self.spindle)),
            HoleStep::Pause => Some(Command::Pause),
            HoleStep::OverridesOff => Some(Command::Overrides(OverrideSwitches::NONE)),
            HoleStep::OverridesBack => Some(Command::Overrides(self.overrides)),
        }
    }

    /// The steps that a peck has after its first.
    fn steps_of_pecks(&self) -> usize {
        usize::from(self.words.cycle == Cycle::G83) + 1
    }

    fn switch(&self, spindle: Spindle) -> Command {
        let rpm = if spindle == Spindle::Off {
            0.0
        } else {
            self.rpm
        };
        Command::Spindle { spindle, rpm }
    }

    fn rapid_to(&mut self, level: Nm, frame: &Frame) -> Option<Command> {
        self.move_to(level, FeedRate::Rapid, frame)
    }

    fn feed_to(&mut self, level: Nm, frame: &Frame) -> Option<Command> {
        self.move_to(level, FeedRate::Feed(self.feed_mm_min), frame)
    }

    fn move_to(&mut self, level: Nm, feed_rate: FeedRate, frame: &Frame) -> Option<Command> {
        let mut target = self.position;
        target[self.plane.axes().2] = level;
        self.go(target, feed_rate, frame)
    }

    fn go(&mut self, target: Axes<Nm>, feed_rate: FeedRate, frame: &Frame) -> Option<Command> {
        if target == self.position {
            return None;
        }
        self.position = target;
        Some(Command::Line {
            target: frame.machine(&target).into(),
            feed_rate,
            line: self.line,
        })
    }
}
