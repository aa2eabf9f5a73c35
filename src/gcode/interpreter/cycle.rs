//! The words of canned cycles, and what a line of one drills.
//!
//! Levels are work coordinates of the axis perpendicular to the plane. Read with LinuxCNC 2.9 "G-Codes",
//! G73 to G89, and RS274NGC 3, section 3.5.16.

use super::{
    CheckedLine, Interpreter,
    drilling::{CycleWords, Drilling},
    offsets, targets,
};
use crate::{
    axis::{LETTERS, Z},
    gcode::{Cycle, FeedMode, LineError, MotionMode, ParsedLine, Word, Words},
    units::Nm,
};

/// Returns the words of a line that drills, with earlier words where the line leaves them out; removes the words from
/// the unused ones.
///
/// # Errors
/// 4, 19, 23, 24, 28, 39, 41, 54 and 208.
#[inline(never)]
pub(super) fn words(
    state: &Interpreter,
    parsed: &ParsedLine,
    unused: &mut Words,
    checked: &CheckedLine,
    cycle: Cycle,
) -> Result<CycleWords, LineError> {
    let modal = &checked.modal;
    check_mode(parsed, checked, cycle)?;
    let (first, second, depth) = modal.plane.axes();
    let is_same_plane = modal.plane == state.modal.plane;
    let is_cycle_before = matches!(state.modal.motion, MotionMode::Cycle(_)) && is_same_plane;
    let is_same_cycle = state.modal.motion == modal.motion && is_same_plane;
    let before = &state.cycle;
    let present = offsets::present(state, &offsets::frame(state, checked));
    let given_or = |is_given: bool, given: Nm, before: Nm| match (is_given, is_same_cycle) {
        (true, _) => Ok(given),
        (false, true) => Ok(before),
        (false, false) => Err(LineError::MissingWord),
    };
    let r = given_or(
        unused.contains(Word::R),
        parsed.length(parsed.radius),
        before.r,
    )?;
    let mut words = CycleWords {
        cycle,
        initial_level: if is_cycle_before {
            before.initial_level
        } else {
            present[depth]
        },
        r,
        is_continued: is_cycle_before
            && before.cycle != Cycle::G88
            && present[depth] == before.end_level,
        bottom: given_or(
            parsed.has_axis(depth),
            targets::coordinate(parsed, depth),
            before.bottom,
        )?,
        in_plane: [first, second].map(|axis| targets::coordinate(parsed, axis)),
        repeats: repeats(parsed, unused)?,
        ..CycleWords::default()
    };
    if cycle.has_pecks() {
        let given = parsed.length(parsed.q);
        words.peck = given_or(unused.contains(Word::Q), given, before.peck)?;
        if words.peck <= Nm(0) {
            return Err(LineError::NotPositive);
        }
        unused.remove(Word::Q);
    }
    if cycle.has_dwell() {
        let known_ms = match (is_same_cycle, cycle.needs_dwell()) {
            (true, _) => Some(before.dwell_ms),
            (false, false) => Some(0),
            (false, true) => None,
        };
        words.dwell_ms = dwell_ms(parsed, unused, known_ms)?;
    }
    unused.remove(Word::R);
    if Drilling::new(state, checked, &words).is_retract_below_bottom() {
        return Err(LineError::RetractBelowBottom);
    }
    Ok(words)
}

/// Returns the letter of the first missing word of a line with a cycle, if any.
pub(super) fn missing_letter(state: &Interpreter, parsed: &ParsedLine) -> Option<u8> {
    let MotionMode::Cycle(cycle) = parsed.modal.motion else {
        return None;
    };
    let has_words_before =
        state.modal.motion == parsed.modal.motion && state.modal.plane == parsed.modal.plane;
    let depth = parsed.modal.plane.axes().2;
    let has = |word: Word| parsed.words.contains(word);
    let needed = [
        (has(Word::R), b'R'),
        (parsed.has_axis(depth), LETTERS[depth]),
        (has(Word::Q) || !cycle.has_pecks(), b'Q'),
        (has(Word::P) || !cycle.needs_dwell(), b'P'),
    ];
    let missing = needed.into_iter().find(|(is_there, _)| !is_there);
    missing
        .filter(|_| !has_words_before)
        .map(|(_, letter)| letter)
}

/// Checks the modes and the axis words that a cycle needs.
fn check_mode(parsed: &ParsedLine, checked: &CheckedLine, cycle: Cycle) -> Result<(), LineError> {
    if checked.modal.feed_mode == FeedMode::InverseTime {
        Err(LineError::CycleNeedsFeedPerMinute)
    } else if parsed.axes >> (Z + 1) != 0 {
        Err(LineError::AxisCommandConflict)
    } else if !cycle.accepts(checked.modal.spindle) {
        Err(LineError::SpindleOff)
    } else {
        Ok(())
    }
}

/// Returns `P` in ms, or what is known without one.
fn dwell_ms(
    parsed: &ParsedLine,
    unused: &mut Words,
    known_ms: Option<u32>,
) -> Result<u32, LineError> {
    if !unused.contains(Word::P) {
        return known_ms.ok_or(LineError::MissingWord);
    }
    unused.remove(Word::P);
    parsed.dwell_ms()
}

/// Returns `L`, 1 without.
fn repeats(parsed: &ParsedLine, unused: &mut Words) -> Result<u8, LineError> {
    if !unused.contains(Word::L) {
        return Ok(1);
    }
    unused.remove(Word::L);
    if !parsed.l.is_whole() {
        return Err(LineError::NotInteger);
    }
    match parsed.l.trunc() {
        ..=0 => Err(LineError::NotPositive),
        number => u8::try_from(number).map_err(|_| LineError::ValueOutOfRange),
    }
}
