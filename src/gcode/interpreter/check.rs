//! The first phase of a line: every check, in the order in which Grbl finds errors.
//!
//! One function per step of the NIST order of execution that can fail.

use core::ops::RangeInclusive;

use super::{
    Action, CheckedLine, Hint, Interpreter, LineKind, Move, arc, commit, compensation, cycle,
    drilling::Drilling, home, offsets, power, reach::check_position, targets, tools,
};
use crate::{
    decimal::Decimal,
    gcode::{
        ArcDistance, AxisCommand, FEEDS_MM_MIN, FeedMode, Flow, INVERSE_TIMES, LineError,
        MAX_LINE_NUMBER, Modal, MotionMode, NonModal, ParsedLine, PlainPrefix, SwitchedOverride,
        ToolCommand, Units, Word, Words, tool_number,
    },
    model::{Laser, OverrideSwitches, PathControl},
    settings::Settings,
    units::{MM_PER_INCH, Nm, Steps},
};

pub(super) fn check(
    state: &Interpreter,
    prefix: &PlainPrefix,
    line: &[u8],
    kind: LineKind,
    settings: &Settings,
) -> Result<CheckedLine, LineError> {
    check_parsed(state, &parse(state, prefix, line, kind)?, kind, settings)
}

fn check_parsed(
    state: &Interpreter,
    parsed: &ParsedLine,
    kind: LineKind,
    settings: &Settings,
) -> Result<CheckedLine, LineError> {
    let mut unused = parsed.words;
    let mut checked = unchanged(state, kind, parsed);
    check_modes(state, settings, parsed, &mut unused, &mut checked)?;
    compensation::set(state, parsed, &mut unused, &mut checked)?;
    check_non_modal(state, settings, parsed, &mut unused, &mut checked)?;
    check_motion(state, settings, parsed, &mut unused, &mut checked)?;
    compensation::check_line(&checked)?;
    check_words(kind, parsed, unused)?;
    if kind == LineKind::Jog && settings.shortens_jogs {
        home::shorten_jog(state, settings, &mut checked);
    }
    check_reach(state, settings, &checked)?;
    let is_motion = parsed.has_target() && parsed.axis_command == AxisCommand::Motion;
    power::set(state, settings, is_motion, &mut checked);
    checked.changes_state = changes_state(state, &checked);
    Ok(checked)
}

/// Returns what a refused line lacks, if that can be said.
pub(super) fn hint(
    state: &Interpreter,
    prefix: &PlainPrefix,
    line: &[u8],
    settings: &Settings,
    error: LineError,
) -> Option<Hint> {
    let mut parsed = parse(state, prefix, line, LineKind::Program).ok()?;
    match error {
        LineError::MissingWord => cycle::missing_letter(state, &parsed).map(Hint::MissingWord),
        LineError::InvalidTarget if parsed.modal.arc_distance == ArcDistance::Incremental => {
            parsed.modal.arc_distance = ArcDistance::Absolute;
            let is_arc = matches!(parsed.modal.motion, MotionMode::Arc(_));
            let fits = is_arc && check_parsed(state, &parsed, LineKind::Program, settings).is_ok();
            fits.then_some(Hint::AbsoluteCentre)
        }
        _ => None,
    }
}

/// The words of the line, of which the plain ones have been read.
fn parse(
    state: &Interpreter,
    prefix: &PlainPrefix,
    line: &[u8],
    kind: LineKind,
) -> Result<ParsedLine, LineError> {
    let mut parsed = match kind {
        LineKind::Program => ParsedLine::new(&state.modal),
        LineKind::Jog => ParsedLine::jog(&state.modal),
    };
    if kind == LineKind::Program && is_program_mark(line) {
        return Ok(parsed);
    }
    parsed.add_plain(prefix);
    parsed.read(prefix.rest_of(line))?;
    if parsed.line > MAX_LINE_NUMBER {
        return Err(LineError::LineNumberTooHigh);
    }
    Ok(parsed)
}

/// Whether a line only begins or ends a program, or tells its number: `%`, `O1234`, `:1234`.
pub(in crate::gcode) fn is_program_mark(line: &[u8]) -> bool {
    let is_number = |digits: &[u8]| !digits.is_empty() && digits.iter().all(u8::is_ascii_digit);
    match line {
        b"%" => true,
        [b'O' | b':', digits @ ..] => is_number(digits),
        _ => false,
    }
}

/// The line's modes and values, without a command.
fn unchanged(state: &Interpreter, kind: LineKind, parsed: &ParsedLine) -> CheckedLine {
    CheckedLine {
        kind,
        modal: parsed.modal,
        action: Action::None,
        flow: match parsed.flow {
            Flow::OptionalPause if state.stops_optionally => Flow::Pause,
            Flow::OptionalPause => Flow::Run,
            flow => flow,
        },
        axes: parsed.axes,
        spindle: None,
        speed: None,
        has_speed: parsed.words.contains(Word::S),
        power: Laser::None,
        changes_state: false,
        line: parsed.line,
        tool: state.offsets.tool,
        loaded_tool: state.loaded_tool,
        lacks_tools: false,
        ends_before_switch: false,
        tool_command: parsed.tool_command,
        changes_tool: parsed.tool_command == ToolCommand::Change
            && parsed.modal.tool != state.loaded_tool,
        values: state.position,
        work_target: state.work_position,
        single_mm: state.single_mm,
        movement: Move::None,
        compensation: state.compensation,
    }
}

/// Feed, path tolerance, dwell, tool and tool length.
fn check_modes(
    state: &Interpreter,
    settings: &Settings,
    parsed: &ParsedLine,
    unused: &mut Words,
    checked: &mut CheckedLine,
) -> Result<(), LineError> {
    checked.modal.feed = match checked.kind {
        LineKind::Program => feed(parsed, &state.modal)?,
        LineKind::Jog => jog_feed(parsed)?,
    };
    if parsed.words.contains(Word::F) {
        checked.modal.feed_units = parsed.modal.units;
    }
    if parsed.has_path_tolerance() {
        checked.modal.path = path_tolerance(parsed, settings)?;
    }
    if parsed.non_modal == NonModal::Dwell {
        checked.action = dwell(parsed, unused)?;
    }
    if let Some(switched) = parsed.switched {
        switch_override(switched, parsed, unused, &mut checked.modal.overrides);
    }
    match parsed.tool_command {
        ToolCommand::None => {}
        ToolCommand::Change => {
            checked.loaded_tool = parsed.modal.tool;
        }
        ToolCommand::Set => checked.loaded_tool = tool_in_spindle(parsed, unused)?,
    }
    if parsed.has_tool_length() {
        tools::set_length(state, parsed, unused, checked)?;
    }
    Ok(())
}

/// Checks that every value word has been used, and that a jog has no words of another line.
fn check_words(kind: LineKind, parsed: &ParsedLine, mut unused: Words) -> Result<(), LineError> {
    if parsed.has_path_tolerance() {
        // Only here, as a P belongs to every command of its line that takes one.
        unused.remove(Word::P);
        unused.remove(Word::Q);
    }
    unused.remove(Word::N);
    unused.remove(Word::F);
    if kind == LineKind::Program {
        unused.remove(Word::S);
        unused.remove(Word::T);
    }
    if !unused.is_empty() {
        return Err(LineError::UnusedWords);
    }
    if kind == LineKind::Jog {
        if !parsed.is_joggable() {
            return Err(LineError::InvalidJog);
        }
        if parsed.axes == 0 {
            // Grbl moves to machine zero then.
            return Err(LineError::NoAxisWords);
        }
    }
    Ok(())
}

/// The feed of a jog, which each has to have, mm/min.
fn jog_feed(parsed: &ParsedLine) -> Result<f32, LineError> {
    if !parsed.words.contains(Word::F) {
        return Err(LineError::FeedUndefined);
    }
    feed_mm_min(parsed)
}

/// `F` per minute in mm: 0, or within the feeds that there are.
fn feed_mm_min(parsed: &ParsedLine) -> Result<f32, LineError> {
    let feed = match parsed.modal.units {
        Units::Millimetres => parsed.feed,
        Units::Inches => parsed.feed * MM_PER_INCH,
    };
    within(feed, &FEEDS_MM_MIN)
}

/// `F` as it is, if it is 0 or in a range.
fn within(feed: f32, range: &RangeInclusive<f32>) -> Result<f32, LineError> {
    if feed == 0.0 || range.contains(&feed) {
        Ok(feed)
    } else {
        Err(LineError::ValueOutOfRange)
    }
}

/// Feed rate mode and feed rate. Every `G93` move needs its own; none survives `G93`.
fn feed(parsed: &ParsedLine, before: &Modal) -> Result<f32, LineError> {
    let has_feed = parsed.words.contains(Word::F);
    match parsed.modal.feed_mode {
        FeedMode::InverseTime => {
            let needs_feed = parsed.axis_command == AxisCommand::Motion
                && !matches!(
                    parsed.modal.motion,
                    MotionMode::Cancelled | MotionMode::Rapid | MotionMode::Cycle(_)
                );
            if needs_feed && !has_feed {
                return Err(LineError::FeedUndefined);
            }
            within(parsed.feed, &INVERSE_TIMES)
        }
        FeedMode::PerMinute if has_feed => feed_mm_min(parsed),
        FeedMode::PerMinute => Ok(match before.feed_mode {
            FeedMode::PerMinute => before.feed,
            FeedMode::InverseTime => 0.0,
        }),
    }
}

/// `M61`: the tool `Q`.
fn tool_in_spindle(parsed: &ParsedLine, unused: &mut Words) -> Result<u8, LineError> {
    if !unused.contains(Word::Q) {
        return Err(LineError::MissingWord);
    }
    unused.remove(Word::Q);
    tool_number(parsed.q)
}

/// `M50`, `M51`, `M53`: `P0` switches the override off, any other `P` and none switch it on.
fn switch_override(
    switched: SwitchedOverride,
    parsed: &ParsedLine,
    unused: &mut Words,
    switches: &mut OverrideSwitches,
) {
    let is_on = !parsed.words.contains(Word::P) || !parsed.p.is_zero();
    unused.remove(Word::P);
    match switched {
        SwitchedOverride::Feed => switches.feed = is_on,
        SwitchedOverride::Spindle => switches.spindle = is_on,
        SwitchedOverride::FeedStop => {}
    }
}

/// `G4`: the `P` word, in seconds.
fn dwell(parsed: &ParsedLine, unused: &mut Words) -> Result<Action, LineError> {
    if !unused.contains(Word::P) {
        return Err(LineError::MissingWord);
    }
    unused.remove(Word::P);
    parsed.dwell_ms().map(Action::Dwell)
}

/// `G64`: the tolerances of the path, `P`, and of short lines, `Q`, which is `P` without the word. Without
/// a `P`, or with 0, the path keeps to `$785` and no lines are merged.
fn path_tolerance(parsed: &ParsedLine, settings: &Settings) -> Result<PathControl, LineError> {
    let distance_nm = |number: Decimal| {
        let Nm(nm) = parsed.exact_length(number)?;
        u32::try_from(nm).map_err(|_| LineError::ValueOutOfRange)
    };
    let tolerance_nm = distance_nm(parsed.p)?;
    let merging_nm = if parsed.words.contains(Word::Q) {
        distance_nm(parsed.q)?
    } else {
        tolerance_nm
    };
    let default_nm = Nm::from_mm(settings.path_tolerance_mm).0;
    Ok(PathControl::Continuous {
        tolerance_nm: match tolerance_nm {
            0 => u32::try_from(default_nm).unwrap_or(u32::MAX),
            tolerance_nm => tolerance_nm,
        },
        merging_nm,
    })
}

/// The commands of modal group 0, and with them what the axis words mean.
fn check_non_modal(
    state: &Interpreter,
    settings: &Settings,
    parsed: &ParsedLine,
    unused: &mut Words,
    checked: &mut CheckedLine,
) -> Result<(), LineError> {
    match parsed.non_modal {
        NonModal::SetCoordinates if !parsed.l.is_whole() => return Err(LineError::NotInteger),
        NonModal::SetCoordinates if matches!(parsed.subcode(), 1 | 10 | 11) => {
            return tools::set_entry(state, settings, parsed, unused, checked);
        }
        NonModal::SetCoordinates => {
            let system = targets::system_to_set(parsed, unused)?;
            let (origin, rotation) = targets::new_origin(state, parsed, checked, system);
            checked.values = origin;
            checked.action = Action::SetOrigin(system, rotation);
            return Ok(());
        }
        NonModal::SetOffset | NonModal::SetLocalOffset => {
            if parsed.axes == 0 {
                return Err(LineError::NoAxisWords);
            }
            checked.values = if parsed.non_modal == NonModal::SetOffset {
                targets::new_work_offset(state, parsed, checked)
            } else {
                targets::given_work_offset(state, parsed)
            };
            checked.action = Action::SetOffset;
            return Ok(());
        }
        NonModal::GoTo(reference) => checked.action = Action::GoTo(reference),
        NonModal::Store(reference) => checked.action = Action::Store(reference),
        NonModal::ClearOffset => checked.action = Action::ClearOffset,
        NonModal::SuspendOffset => checked.action = Action::SuspendOffset,
        NonModal::RestoreOffset => checked.action = Action::RestoreOffset,
        NonModal::MachineCoordinates => {
            if !matches!(parsed.modal.motion, MotionMode::Rapid | MotionMode::Linear) {
                return Err(LineError::MachineCoordinatesMotion);
            }
        }
        NonModal::None | NonModal::Dwell => {}
    }
    if parsed.has_target() && parsed.axis_command != AxisCommand::ToolLength {
        targets::set_target(state, settings, parsed, checked);
    }
    Ok(())
}

/// The motion mode, if the axis words belong to it.
fn check_motion(
    state: &Interpreter,
    settings: &Settings,
    parsed: &ParsedLine,
    unused: &mut Words,
    checked: &mut CheckedLine,
) -> Result<(), LineError> {
    let motion = parsed.modal.motion;
    if parsed.axis_command != AxisCommand::Motion {
        return Ok(());
    }
    if motion == MotionMode::Cancelled && parsed.axes != 0 {
        return Err(LineError::UnusedAxisWords);
    }
    if motion == MotionMode::Cancelled {
        return Ok(());
    }
    if let MotionMode::Cycle(cycle) = motion {
        let mut words = cycle::words(state, parsed, unused, checked, cycle)?;
        words.clearance = Nm::from_mm(settings.peck_clearance_mm);
        let resolution = settings.steps_per_mm[checked.modal.plane.axes().2];
        if cycle.has_pecks() && words.peck < resolution.position_of(Steps(1)) {
            // More of them than the axis makes steps.
            return Err(LineError::ValueOutOfRange);
        }
        checked.movement = Move::Cycle(words);
    }
    if motion != MotionMode::Rapid && checked.modal.feed == 0.0 {
        return Err(LineError::FeedUndefined);
    }
    match motion {
        MotionMode::Arc(rotation) => {
            let (frame, start, target) = targets::ends(state, checked);
            checked.movement = arc::movement(parsed, unused, rotation, &frame, start, target)?;
        }
        MotionMode::Probe(_) if parsed.axes == 0 => return Err(LineError::NoAxisWords),
        MotionMode::Probe(_) if checked.values == state.position => {
            return Err(LineError::InvalidTarget);
        }
        MotionMode::Probe(probe) => {
            checked.movement = Move::Probe(probe.probing());
            targets::set_contact(state, settings, parsed, unused, checked)?;
        }
        MotionMode::Rapid | MotionMode::Linear if parsed.axes != 0 => {
            checked.movement = Move::Straight;
        }
        MotionMode::Rapid | MotionMode::Linear | MotionMode::Cycle(_) | MotionMode::Cancelled => {}
    }
    if motion != MotionMode::Rapid && checked.modal.feed_mode == FeedMode::PerMinute {
        // Of inches, where only rotary axes move.
        within(commit::feed(state, checked), &FEEDS_MM_MIN)?;
    }
    Ok(())
}

/// Checks that every axis can count up to the positions of the line.
fn check_reach(
    state: &Interpreter,
    settings: &Settings,
    checked: &CheckedLine,
) -> Result<(), LineError> {
    if let Move::Cycle(words) = &checked.movement {
        let frame = offsets::frame(state, checked);
        for corner in Drilling::new(state, checked, words).corners() {
            check_position(settings, &frame.machine(&corner))?;
        }
    } else if checked.axes != 0 {
        check_position(settings, &checked.values)?;
    }
    if let Action::GoTo(reference) = checked.action {
        check_position(settings, &state.stored(reference))?;
    }
    if checked.tool != state.offsets.tool {
        check_position(settings, &checked.tool)?;
    }
    if let Move::Arc(circle) = checked.movement {
        let (first, second, _) = circle.plane.axes();
        let mut centre = state.position;
        centre[first] = centre[first] + circle.centre[0];
        centre[second] = centre[second] + circle.centre[1];
        check_position(settings, &centre)?;
        // Its radius must be a number of steps on both axes, however much finer one of them is.
        let farthest = settings.farthest();
        let most = farthest[first].min(farthest[second]).0.unsigned_abs();
        let is_far = |offset: &Nm| offset.0.unsigned_abs() > 2 * most;
        if circle.centre.iter().any(is_far) {
            return Err(LineError::InvalidTarget);
        }
    }
    Ok(())
}

/// Whether the line switches the spindle or the coolant, or changes the tool or the work offset.
fn changes_state(state: &Interpreter, checked: &CheckedLine) -> bool {
    let (before, after) = (&state.modal, &checked.modal);
    checked.spindle.is_some()
        || before.coolant != after.coolant
        || before.overrides != after.overrides
        || before.coordinates != after.coordinates
        || state.offsets.tool != checked.tool
        || state.loaded_tool != checked.loaded_tool
}
