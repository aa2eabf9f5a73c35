//! Plain lines, of which programs consist: `G0`, `G1` or neither, axes, `F`, `N`, and nothing else.
//!
//! Such a line changes the position, the motion mode and the feed, and makes one command. All other
//! lines, and lines with an error, are left to [`check`](super::check), which alone knows the errors
//! and their order. Whatever is accepted here has the same effect there (`tests/interpreter/plain.rs`).
//!
//! # Cost
//! A plain line is read where it waits, checked and executed at once, without a copy of all that a
//! line could change: nearly all lines of a program are plain.

use super::{Action, Checked, Interpreter, LineKind, Move, Outcome, check};
use crate::{
    axis::{AXES, Axes, LETTERS},
    decimal::SmallDecimal,
    gcode::{Distance, FeedMode, Flow, MotionMode, Units, Word, WordReader, Words},
    model::{Command, FeedRate, Target},
    settings::Settings,
    units::Nm,
};

/// The reason why a line has not been executed as a plain one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// The line has other words, or an error.
    NotPlain,
    /// The bytes end before the line, which may be plain yet.
    Incomplete,
}

/// The words of a plain line.
struct Plain {
    /// Letters of the words.
    words: Words,
    coordinates: Axes<SmallDecimal>,
    motion: MotionMode,
    /// mm/min.
    feed: f32,
    line: u32,
}

/// Executes a plain line, and returns the bytes after it. Nothing has changed after a refusal.
#[inline(never)]
pub(super) fn execute<I: Iterator<Item = u8>>(
    state: &mut Interpreter,
    bytes: I,
    settings: &Settings,
    checked: &mut Checked,
    outcome: &mut Outcome,
) -> Result<I, Refusal> {
    let modal = &state.modal;
    let has_plain_modes = modal.units == Units::Millimetres
        && modal.feed_units == Units::Millimetres
        && modal.feed_mode == FeedMode::PerMinute
        && !settings.laser
        && state.frame.rotation.is_none();
    if !has_plain_modes {
        return Err(Refusal::NotPlain);
    }
    let mut plain = Plain {
        words: Words::NONE,
        coordinates: Axes::default(),
        motion: modal.motion,
        feed: modal.feed,
        line: 0,
    };
    let rest = plain.read(bytes)?;
    let feed_rate = match plain.motion {
        MotionMode::Rapid => FeedRate::Rapid,
        MotionMode::Linear if plain.feed != 0.0 => FeedRate::Feed(plain.feed),
        MotionMode::Linear | MotionMode::Arc(_) | MotionMode::Probe(_) | MotionMode::Cancelled => {
            return Err(Refusal::NotPlain);
        }
    };
    let target = plain.target(state).ok_or(Refusal::NotPlain)?;
    if !plain.words.contains(Word::AXES) || !check::is_always_reached(&target.position) {
        return Err(Refusal::NotPlain);
    }
    state.modal.motion = plain.motion;
    state.modal.feed = plain.feed;
    state.position = target.position;
    state.single_mm = target.single_mm;
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
        line: plain.line,
    });
    Ok(rest)
}

impl Plain {
    /// Reads the words of a line, and returns the bytes after it.
    #[inline]
    fn read<I: Iterator<Item = u8>>(&mut self, bytes: I) -> Result<I, Refusal> {
        let mut words = WordReader::new(bytes);
        while !words.is_at_line_end() {
            if self.read_word(&mut words).is_none() {
                return Err(if words.is_cut_off() {
                    Refusal::Incomplete
                } else {
                    Refusal::NotPlain
                });
            }
        }
        Ok(words.following())
    }

    /// Reads a word; `None` where it is not plain.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "for each word")]
    fn read_word<I: Iterator<Item = u8>>(&mut self, words: &mut WordReader<I>) -> Option<()> {
        let (letter, number) = words.small_word()?;
        match letter {
            b'G' => {
                self.motion = match number.natural()? {
                    0 => MotionMode::Rapid,
                    1 => MotionMode::Linear,
                    _ => return None,
                }
            }
            b'F' => self.feed = number.non_negative()?,
            b'N' => {
                self.line = number
                    .natural()
                    .filter(|line| *line <= check::MAX_LINE_NUMBER)?;
            }
            letter => {
                let mut axes = LETTERS.iter().take(AXES);
                let axis = axes.position(|known| *known == letter)?;
                *self.coordinates.0.get_mut(axis)? = number;
            }
        }
        let word = Word::new(letter);
        if self.words.contains(word) {
            return None;
        }
        self.words.insert(word);
        Some(())
    }

    /// The target of the line; `None` where a coordinate has too many decimals.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a call would return by a copy")]
    fn target(&self, state: &Interpreter) -> Option<Target> {
        let mut target = Target {
            position: state.position,
            single_mm: state.single_mm,
        };
        for axis in 0..AXES {
            if self.words.contains(Word::axis(axis)) {
                let (exact, single) = self.coordinates[axis].coordinate()?;
                let (base, single_base) = base(state, axis);
                target.position[axis] = base + Nm(exact);
                target.single_mm[axis] = single_base + single;
            }
        }
        Some(target)
    }
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
