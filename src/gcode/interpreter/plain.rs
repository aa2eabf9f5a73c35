//! Plain lines, of which programs consist: `G0`, `G1` or neither, axes, `F`, `N`, and nothing else.
//!
//! Such a line changes the position, the motion mode and the feed, and makes one command. All other
//! lines, and lines with an error, are left to [`check`](super::check), which alone knows the errors
//! and their order. Whatever is accepted here has the same effect there (`tests/interpreter/plain.rs`).
//!
//! # Cost
//! A plain line is read where it waits, checked and executed at once, without a copy of all that a
//! line could change: nearly all lines of a program are plain.

use super::{Action, CheckedLine, Interpreter, LineCommands, LineKind, Move, reach};
use crate::{
    axis::AXES,
    gcode::{Distance, FEEDS_MM_MIN, Flow, MotionMode, NotPlain, PlainPrefix, Word, Words},
    model::{Command, FeedRate, Target},
    settings::Settings,
    units::Nm,
};

impl Interpreter {
    /// Checks and executes a plain line: a straight move in the modes before it. `checked` and
    /// `outcome` are then those of [`Self::check`] and [`Self::commit`]. Blanks, comments and lower
    /// case are allowed between words. The bytes come in two parts. Returns the number of bytes after
    /// the end of the line.
    ///
    /// # Errors
    /// [`NotPlain`] for any other line, and for one with an error: nothing has changed then, and
    /// `prefix` has the plain words that the line begins with, for [`Self::check_after`].
    #[inline(never)]
    pub fn execute_plain<I: ExactSizeIterator<Item = u8> + Clone>(
        &mut self,
        bytes: [I; 2],
        settings: &Settings,
        prefix: &mut PlainPrefix,
        checked: &mut CheckedLine,
        outcome: &mut LineCommands,
    ) -> Result<usize, NotPlain> {
        let modal = &self.modal;
        if !self.has_plain_modes || settings.laser {
            prefix.words = Words::NONE;
            return Err(NotPlain::OtherWords);
        }
        prefix.motion = modal.motion;
        prefix.feed = modal.feed;
        prefix.line = 0;
        let remaining = prefix.read(bytes)?;
        let is_feed = FEEDS_MM_MIN.contains(&prefix.feed);
        let feed_rate = match prefix.motion {
            MotionMode::Rapid if is_feed || prefix.feed == 0.0 => FeedRate::Rapid,
            MotionMode::Linear if is_feed => FeedRate::Feed(prefix.feed),
            MotionMode::Rapid
            | MotionMode::Linear
            | MotionMode::Arc(_)
            | MotionMode::Probe(_)
            | MotionMode::Cycle(_)
            | MotionMode::Cancelled => {
                return Err(NotPlain::OtherWords);
            }
        };
        let target = target(self, prefix).ok_or(NotPlain::OtherWords)?;
        if !prefix.words.contains(Word::AXES) || !reach::is_within_min_reach(&target.position) {
            return Err(NotPlain::OtherWords);
        }
        self.modal.motion = prefix.motion;
        self.modal.feed = prefix.feed;
        self.position = target.position;
        self.single_mm = target.single_mm;
        // All that may be asked of the line afterwards.
        checked.kind = LineKind::Program;
        checked.action = Action::None;
        checked.flow = Flow::Run;
        checked.changes_state = false;
        checked.movement = Move::Straight;
        outcome.clear();
        outcome.add(Command::Line {
            target,
            feed_rate,
            line: prefix.line,
        });
        Ok(remaining)
    }
}

/// The target of the line; `None` where a coordinate has too many decimals.
#[inline(always)]
#[expect(clippy::inline_always, reason = "a call would return by a copy")]
fn target(state: &Interpreter, prefix: &PlainPrefix) -> Option<Target> {
    let mut target = Target {
        position: state.position,
        single_mm: state.single_mm,
    };
    for axis in 0..AXES {
        if prefix.words.contains(Word::axis(axis)) {
            let (exact, single) = prefix.coordinates[axis].coordinate()?;
            let (base, single_base) = base(state, axis);
            target.position[axis] = base + Nm(exact);
            target.single_mm[axis] = single_base + single;
        }
    }
    Some(target)
}

/// The origin of an axis' coordinates, exactly and in Grbl's single precision.
#[inline]
fn base(state: &Interpreter, axis: usize) -> (Nm, f32) {
    match state.modal.distance {
        Distance::Absolute => {
            let total = state.frame.total[axis];
            (total, if total == Nm(0) { 0.0 } else { total.to_mm() })
        }
        Distance::Incremental => (state.position[axis], state.single_mm[axis]),
    }
}
