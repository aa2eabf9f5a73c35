//! The second phase of a line: its commands, in the NIST order of execution.

use super::{
    Action, CheckedLine, Compensation, Interpreter, LineCommands, LineKind, Message, Move,
    drilling::Drilling,
};
use crate::{
    axis::{Axes, Z},
    gcode::{CompensationMode, Distance, FeedMode, Flow, Modal, MotionMode, StoredPosition, Units},
    model::{
        Command, Coolant, FeedRate, Laser, OverrideSwitches, Plane, Spindle, Target,
        WorkCoordinates,
    },
    units::{MM_PER_INCH, Nm},
};

/// A longer dwell of a cycle is announced, ms.
const LONG_DWELL_MS: u32 = 60_000;

pub(super) fn commit(state: &mut Interpreter, checked: &CheckedLine, outcome: &mut LineCommands) {
    outcome.clear();
    outcome.ends_before_switch = checked.ends_before_switch && !state.has_reported_switch;
    state.has_reported_switch |= checked.ends_before_switch;
    if checked.kind == LineKind::Jog {
        add_laser_power(checked, outcome);
        let feed_rate = FeedRate::Jog(feed(state, checked));
        outcome.add(line(checked.target(), feed_rate, checked));
        state.set_target(checked);
        return;
    }
    add_switching(state, checked, outcome);
    if let Action::Dwell(milliseconds) = checked.action {
        outcome.add(Command::Dwell { milliseconds });
    }
    let drilling = match &checked.movement {
        Move::Cycle(words) => Some(Drilling::new(state, checked, words)),
        Move::None | Move::Straight | Move::Arc(_) | Move::Probe(_) => None,
    };
    let message = message(state, checked);
    outcome.shows_offset =
        state.modal.coordinates != checked.modal.coordinates || state.offsets.tool != checked.tool;
    state.modal = checked.modal;
    state.wants_speed &= !checked.has_speed;
    outcome.lacks_speed = checked.feeds() && state.lacks_speed();
    state.wants_speed &= !outcome.lacks_speed;
    state.compensation = checked.compensation;
    if checked.moves() {
        state
            .compensation
            .advance(checked.moves_in_plane(&state.position));
    }
    state.offsets.tool = checked.tool;
    outcome.message = message;
    outcome.shows_tool = state.loaded_tool != checked.loaded_tool;
    state.loaded_tool = checked.loaded_tool;
    state.update_frame();
    if checked.moves() {
        add_laser_power(checked, outcome);
    }
    execute_action(state, checked, outcome);
    add_movement(state, checked, outcome);
    state.drilling = drilling;
    if let (Some(drilling), Move::Cycle(words)) = (drilling, checked.movement) {
        state.cycle = words;
        state.cycle.end_level = drilling.end()[checked.modal.plane.axes().2];
        outcome.add(line(state.position.into(), FeedRate::Rapid, checked));
        state.set_work_position(drilling.end());
    }
    end_line(state, checked.flow, outcome);
    state.update_plain_modes();
}

/// Returns the message that a line begins with: of the dwell of a cycle, where the dwell is new.
fn message(state: &Interpreter, checked: &CheckedLine) -> Option<Message> {
    let long_dwell = match &checked.movement {
        Move::Cycle(words) => {
            let is_new = state.modal.motion != checked.modal.motion
                || state.cycle.dwell_ms != words.dwell_ms;
            (is_new && words.dwell_ms > LONG_DWELL_MS).then_some(Message::LongDwell {
                seconds: words.dwell_ms / 1000,
            })
        }
        Move::None | Move::Straight | Move::Arc(_) | Move::Probe(_) => None,
    };
    let lacks_tools = checked.lacks_tools.then_some(Message::EmptyToolTable);
    lacks_tools.or(long_dwell)
}

impl LineCommands {
    /// Removes all commands and messages.
    pub(super) fn clear(&mut self) {
        self.commands.clear();
        self.message = None;
        self.shows_offset = false;
        self.shows_tool = false;
        self.lacks_speed = false;
        self.ends_before_switch = false;
    }

    pub(super) fn add(&mut self, command: Command) {
        let is_full = self.commands.push(command).is_err();
        debug_assert!(!is_full, "a line makes fewer commands than COMMANDS");
    }
}

/// Spindle and coolant, where they change.
fn add_switching(state: &mut Interpreter, checked: &CheckedLine, outcome: &mut LineCommands) {
    if let Some((spindle, rpm)) = checked.spindle {
        outcome.add(Command::Spindle { spindle, rpm });
        let runs = spindle != Spindle::Off && checked.power == Laser::None;
        state.has_run_spindle |= runs;
        state.lacks_spindle &= !runs;
    }
    if let Some(rpm) = checked.speed {
        outcome.add(Command::Speed(rpm));
    }
    if state.modal.coolant != checked.modal.coolant {
        outcome.add(Command::Coolant(checked.modal.coolant));
    }
    if state.modal.overrides != checked.modal.overrides {
        outcome.add(Command::Overrides(checked.modal.overrides));
    }
}

/// The laser power of the moves that follow, in laser mode.
fn add_laser_power(checked: &CheckedLine, outcome: &mut LineCommands) {
    if checked.power != Laser::None {
        outcome.add(Command::Power(checked.power));
    }
}

/// The command of modal group 0.
fn execute_action(state: &mut Interpreter, checked: &CheckedLine, outcome: &mut LineCommands) {
    match checked.action {
        Action::None | Action::Dwell(_) | Action::SetAtContact { .. } => {}
        Action::SetOrigin(..) | Action::Store(_) => {
            if let Some(origins) = state.origins_after(checked) {
                state.offsets.origins = origins;
            }
            outcome.shows_offset |= matches!(
                checked.action,
                Action::SetOrigin(system, _) if system == checked.modal.coordinates
            );
        }
        Action::SetTool { .. } => {
            if let Some((slot, entry)) = checked.new_tool() {
                state.tools.replace(slot, Some(entry));
            }
        }
        Action::GoTo(reference) => go_to(state, checked, reference, outcome),
        Action::SetOffset => {
            state.offsets.work = checked.values;
            state.offsets.remembered_work = checked.values;
            outcome.shows_offset = true;
        }
        Action::ClearOffset => {
            state.offsets.work = Axes::all(Nm(0));
            state.offsets.remembered_work = Axes::all(Nm(0));
            outcome.shows_offset = true;
        }
        Action::SuspendOffset => {
            state.offsets.work = Axes::all(Nm(0));
            outcome.shows_offset = true;
        }
        Action::RestoreOffset => {
            state.offsets.work = state.offsets.remembered_work;
            outcome.shows_offset = true;
        }
    }
    state.update_frame();
}

/// To a stored position: all axes at once, or first to the target and then the named axes.
fn go_to(
    state: &mut Interpreter,
    checked: &CheckedLine,
    reference: StoredPosition,
    outcome: &mut LineCommands,
) {
    let stored = state.stored(reference);
    let target = if checked.axes == 0 {
        stored
    } else {
        outcome.add(line(checked.target(), FeedRate::Rapid, checked));
        Axes::from_fn(|axis| {
            if checked.axes >> axis & 1 == 0 {
                checked.values[axis]
            } else {
                stored[axis]
            }
        })
    };
    outcome.add(line(target.into(), FeedRate::Rapid, checked));
    state.set_position(target);
}

/// The feed of a move per minute: mm, or degrees where only rotary axes move, which have no inches.
pub(super) fn feed(state: &Interpreter, checked: &CheckedLine) -> f32 {
    let modal = &checked.modal;
    let only_turns = || {
        let mut linear = 0..=Z;
        !matches!(checked.movement, Move::Arc(_))
            && linear.all(|axis| state.position[axis] == checked.values[axis])
            && state.position != checked.values
    };
    if modal.feed_units == Units::Inches && only_turns() {
        modal.feed / MM_PER_INCH
    } else {
        modal.feed
    }
}

/// The move of the motion mode.
fn add_movement(state: &mut Interpreter, checked: &CheckedLine, outcome: &mut LineCommands) {
    let feed_rate = match (checked.modal.motion, checked.modal.feed_mode) {
        (MotionMode::Rapid, _) => FeedRate::Rapid,
        (_, FeedMode::PerMinute) => FeedRate::Feed(feed(state, checked)),
        (_, FeedMode::InverseTime) => FeedRate::InverseTime(checked.modal.feed),
    };
    match checked.movement {
        Move::None | Move::Cycle(_) => return,
        Move::Straight => outcome.add(line(checked.target(), feed_rate, checked)),
        Move::Arc(circle) => outcome.add(Command::Arc {
            target: checked.target(),
            circle,
            feed_rate,
            line: checked.line,
        }),
        Move::Probe(probing) => outcome.add(Command::Probe {
            target: checked.target(),
            feed_rate,
            probing,
            line: checked.line,
        }),
    }
    state.set_target(checked);
}

fn line(target: Target, feed_rate: FeedRate, checked: &CheckedLine) -> Command {
    Command::Line {
        target,
        feed_rate,
        line: checked.line,
    }
}

/// Program pause and program end. `F`, `S`, `T`, the unit, `G92` and the tool length stay.
fn end_line(state: &mut Interpreter, flow: Flow, outcome: &mut LineCommands) {
    match flow {
        Flow::Run | Flow::OptionalPause => {}
        Flow::Pause => outcome.add(Command::Pause),
        Flow::End => {
            // Every mode, so that a new mode has to be reset or named here as lasting.
            let Modal {
                motion,
                feed_mode,
                units: _,
                distance,
                arc_distance: _,
                retract: _,
                overrides,
                plane,
                compensation,
                tool_length: _,
                coordinates,
                path: _,
                spindle,
                coolant,
                tool: _,
                feed: _,
                feed_units: _,
                speed_rpm: _,
            } = &mut state.modal;
            *motion = MotionMode::Linear;
            *plane = Plane::default();
            *compensation = CompensationMode::Off;
            *distance = Distance::default();
            *feed_mode = FeedMode::default();
            *coordinates = WorkCoordinates::default();
            *overrides = OverrideSwitches::ALL;
            *spindle = Spindle::Off;
            *coolant = Coolant::default();
            state.compensation = Compensation::default();
            state.forget_program();
            outcome.add(Command::Spindle {
                spindle: Spindle::Off,
                rpm: 0.0,
            });
            outcome.add(Command::Coolant(Coolant::default()));
            outcome.message = Some(Message::ProgramEnd);
            outcome.shows_offset = true;
        }
    }
}
