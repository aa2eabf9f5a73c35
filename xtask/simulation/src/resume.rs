//! Where a job can be continued, and the lines that bring the machine there.
//!
//! The state before a line is that of the firmware's own interpreter, which has read all lines before it.
//! It does so twice, from two different positions wherever a position is unknown: where both agree, the
//! state does not depend on it. The lines of the approach are then read by a third interpreter that stands
//! as the machine does now, and the lines of the job that follow must be the same commands to both.

mod approach;

use anyhow::{Result, bail, ensure};
use leadscrew::{
    axis::{AXES, Axes, Z},
    gcode::{Modal, interpreter::Interpreter},
    model::WorkCoordinates,
    protocol::{ReportUnit, Text, listing},
    settings::Settings,
    units::Nm,
};
use serde::{Deserialize, Serialize};

use crate::{
    machine_answers::{self, MachineAnswers},
    replay::{Effect, Replay},
};
pub use approach::Plunge;
use approach::{approach, top, words, work_position};

/// How far apart the two interpreters stand where a position is unknown.
const UNKNOWN_POSITION_OFFSET: Nm = Nm(17_123_457);
/// Lines of the job by which the approach is checked, at most.
const CHECKED: usize = 200;
/// A stored offset is shown with three decimals: the farthest that one may be off, nm.
const SHOWN: i64 = 1_000;
/// Earlier lines that are tried where an approach does not lead to one.
const TRIES: usize = 20;

/// What a job began with, as far as it is known.
struct Beginning {
    interpreter: Interpreter,
    /// Whether the position is known.
    is_placed: bool,
}

/// Where a job is continued.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// The line, counted from 0.
    pub line: usize,
    /// What is sent before it.
    pub approach: Vec<String>,
    /// The modes before it, as `$G` lists them.
    pub modes: String,
    /// The tool that must be in the spindle.
    pub tool: u8,
    /// The work position at which it begins, mm and degrees.
    pub position: Vec<String>,
}

/// [`entry`] at a machine that is known by its answers, of a job that has begun at it as it answered then: `None` where
/// the line is wanted by the operator alone.
///
/// # Errors
/// There is none, or the virtual machine cannot be as the machine is.
pub fn entry_of_answers(
    lines: &[Vec<u8>],
    wanted: usize,
    began: Option<&MachineAnswers>,
    now: &MachineAnswers,
    plunge: Plunge,
) -> Result<Entry> {
    let interpreter = |answers: &MachineAnswers| -> Result<_> {
        let simulator = machine_answers::simulator(answers, false)?;
        Ok(simulator.session().interpreter().clone())
    };
    let settings = machine_answers::settings(now);
    let mut beginning = Beginning {
        interpreter: interpreter(began.unwrap_or(now))?,
        is_placed: began.is_some(),
    };
    let now = interpreter(now)?;
    // The operator may have measured the workpiece anew.
    beginning.interpreter.set_origins(&now.offsets().origins);
    entry(lines, wanted, &beginning, &now, &settings, plunge)
}

/// Finds the last line up to `wanted` at which a job can be continued by a machine that stands as `now`.
///
/// # Errors
/// There is none.
fn entry(
    lines: &[Vec<u8>],
    wanted: usize,
    beginning: &Beginning,
    now: &Interpreter,
    settings: &Settings,
    plunge: Plunge,
) -> Result<Entry> {
    ensure!(wanted < lines.len(), "the job has {} lines", lines.len());
    let mut most = wanted;
    let mut reason = String::from(
        ": the place depends on where the machine stood, or where a probe met something",
    );
    for _ in 0..TRIES {
        let Some(Begin {
            line,
            state,
            highest,
        }) = last_begin(lines, most, beginning, settings)
        else {
            break;
        };
        let top = top(highest.max(now.position()[Z]), settings);
        let tried = approach(&state, now, top, settings, plunge);
        match check(&lines[line..], &state, now, settings, &tried) {
            Ok(()) => {
                return Ok(Entry {
                    line,
                    approach: tried,
                    modes: modes(state.interpreter.modal(), settings),
                    tool: state.interpreter.loaded_tool(),
                    position: words(&work_position(&state.interpreter), 0..AXES),
                });
            }
            Err(error) => reason = format!(": line {}: {error}", line + 1),
        }
        let Some(earlier) = line.checked_sub(1) else {
            break;
        };
        most = earlier;
    }
    bail!(
        "the job cannot be continued at line {} or before it{reason}",
        wanted + 1
    )
}

/// A line at which a job may begin.
struct Begin {
    line: usize,
    /// The state before it.
    state: Replay,
    /// The highest machine position of Z that the job has had until then.
    highest: Nm,
}

/// The last line up to `most` before which the state is known and a job may begin, and that state.
fn last_begin(
    lines: &[Vec<u8>],
    most: usize,
    beginning: &Beginning,
    settings: &Settings,
) -> Option<Begin> {
    let mut one = Replay::new(beginning.interpreter.clone(), *settings);
    let mut other = one.clone();
    if !beginning.is_placed {
        // An axis that the job does not move at all is where it is now.
        displace(&one, &mut other, [true; AXES]);
        let moved = moved_axes(lines, other.clone());
        other = one.clone();
        displace(&one, &mut other, moved);
    }
    let mut found = None;
    let mut highest = one.interpreter.position()[Z];
    for (index, line) in lines.iter().enumerate().take(most + 1) {
        highest = highest.max(one.interpreter.position()[Z]);
        if one.may_begin() && agree(&one.interpreter, &other.interpreter) {
            found = Some(Begin {
                line: index,
                state: one.clone(),
                highest,
            });
        }
        let effect = one.read(line);
        other.read(line);
        if let Effect::Lost(axes) = effect {
            displace(&one, &mut other, axes);
        }
    }
    found
}

/// The axes that lines move from where nothing leads by chance.
fn moved_axes(lines: &[Vec<u8>], mut replay: Replay) -> [bool; AXES] {
    let mut moved = [false; AXES];
    for line in lines {
        let before = replay.interpreter.position();
        let lost = match replay.read(line) {
            Effect::Lost(axes) => axes,
            _ => [false; AXES],
        };
        let after = replay.interpreter.position();
        for (axis, moved) in moved.iter_mut().enumerate() {
            *moved |= lost[axis] || before[axis] != after[axis];
        }
    }
    moved
}

/// Makes the positions of two interpreters differ in some axes.
fn displace(one: &Replay, other: &mut Replay, axes: [bool; AXES]) {
    let position = one.interpreter.position();
    let displacement = |axis: usize| {
        Nm(UNKNOWN_POSITION_OFFSET.0 * (1 + i64::from(axis as u8)) * i64::from(axes[axis]))
    };
    let moved = Axes::from_fn(|axis| position[axis] + displacement(axis));
    other.interpreter.set_position(moved);
}

/// Whether two interpreters are in the same state.
fn agree(one: &Interpreter, other: &Interpreter) -> bool {
    one.modal() == other.modal()
        && one.position() == other.position()
        && one.offsets() == other.offsets()
        && one.loaded_tool() == other.loaded_tool()
}

/// Fails where the approach, and the job after it, would not do what the job does undisturbed.
fn check(
    rest: &[Vec<u8>],
    state: &Replay,
    now: &Interpreter,
    settings: &Settings,
    approach: &[String],
) -> Result<()> {
    let wanted = state.interpreter.offsets();
    let shown = now.offsets();
    let is_near = |one: Nm, other: Nm| (one.0 - other.0).abs() <= SHOWN;
    for system in WorkCoordinates::ALL {
        let (wanted, shown) = (wanted.origin(system), shown.origin(system));
        ensure!(
            (0..AXES).all(|axis| is_near(wanted[axis], shown[axis])),
            "the origin of {} is not where the job has it",
            system.word()
        );
    }
    let mut one = state.clone();
    let mut other = Replay::new(now.clone(), *settings);
    other.interpreter.set_origins(&wanted.origins);
    for line in approach {
        let is_read = matches!(other.read(line.as_bytes()), Effect::Commands(_));
        ensure!(is_read, "the approach would need {line}, which is refused");
    }
    ensure!(
        one.interpreter.position() == other.interpreter.position(),
        "the approach would end elsewhere"
    );
    for line in rest.iter().take(CHECKED) {
        let (wanted, done) = (one.read(line), other.read(line));
        ensure!(
            wanted == done,
            "{} would do something else",
            grbl_client::sender::shown(line)
        );
        if matches!(wanted, Effect::Lost(_)) {
            break;
        }
    }
    Ok(())
}

/// The modes as `$G` lists them.
fn modes(modal: &Modal, settings: &Settings) -> String {
    let mut text = Text::new();
    listing::modes(&mut text, modal, false, ReportUnit::of(settings));
    String::from_utf8_lossy(text.as_bytes()).trim().to_owned()
}

#[cfg(test)]
mod pulled;
#[cfg(test)]
mod tests;
