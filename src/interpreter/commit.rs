//! The second phase of a line: carrying out what was checked, in the NIST order of execution.

use super::{Action, Checked, Interpreter, Message, Outcome, Path};
use crate::{
    axis::Axes,
    gcode::{Distance, FeedMode, Flow, Modal, Motion, Reference, WorkCoordinates},
    planner::{Command, Coolant, Pace, Plane, Spindle, Target},
    units::Nm,
};

pub(super) fn commit(state: &mut Interpreter, checked: &Checked, outcome: &mut Outcome) {
    outcome.commands.clear();
    outcome.message = None;
    switch(&state.modal, &checked.modal, outcome);
    if let Action::Dwell(milliseconds) = checked.action {
        outcome.add(Command::Dwell { milliseconds });
    }
    state.modal = checked.modal;
    state.offsets.tool_length = checked.tool_length;
    act(state, checked, outcome);
    travel(state, checked, outcome);
    end(state, checked.flow, outcome);
}

impl Outcome {
    fn add(&mut self, command: Command) {
        let is_full = self.commands.push(command).is_err();
        debug_assert!(!is_full, "a line makes fewer commands than COMMANDS");
    }
}

/// Spindle and coolant, where they change.
fn switch(before: &Modal, after: &Modal, outcome: &mut Outcome) {
    let new_speed = after.spindle != Spindle::Off && before.speed_rpm != after.speed_rpm;
    if before.spindle != after.spindle || new_speed {
        outcome.add(Command::Spindle {
            spindle: after.spindle,
            rpm: if after.spindle == Spindle::Off {
                0.0
            } else {
                after.speed_rpm
            },
        });
    }
    if before.coolant != after.coolant {
        outcome.add(Command::Coolant(after.coolant));
    }
}

/// The command of modal group 0.
fn act(state: &mut Interpreter, checked: &Checked, outcome: &mut Outcome) {
    match checked.action {
        Action::None | Action::Dwell(_) => {}
        Action::SetOrigin(system) => state.offsets.coordinates[system.index()] = checked.values,
        Action::GoTo(reference) => go_to(state, checked, reference, outcome),
        Action::Store(Reference::G28) => state.offsets.g28 = state.position,
        Action::Store(Reference::G30) => state.offsets.g30 = state.position,
        Action::SetOffset => state.offsets.work = checked.values,
        Action::ClearOffset => state.offsets.work = Axes::all(Nm(0)),
    }
}

/// To a stored position: all axes at once, or first to the target and then the named axes.
fn go_to(state: &mut Interpreter, checked: &Checked, reference: Reference, outcome: &mut Outcome) {
    let stored = state.offsets.stored(reference);
    let target = if checked.axes == 0 {
        stored
    } else {
        outcome.add(line(checked.target(), Pace::Rapid, checked));
        Axes::from_fn(|axis| {
            if checked.axes >> axis & 1 == 0 {
                checked.values[axis]
            } else {
                stored[axis]
            }
        })
    };
    outcome.add(line(target.into(), Pace::Rapid, checked));
    state.set_position(target);
}

/// The move of the motion mode.
fn travel(state: &mut Interpreter, checked: &Checked, outcome: &mut Outcome) {
    let pace = match (checked.modal.motion, checked.modal.feed_mode) {
        (Motion::Rapid, _) => Pace::Rapid,
        (_, FeedMode::PerMinute) => Pace::Feed(checked.modal.feed),
        (_, FeedMode::InverseTime) => Pace::InverseTime(checked.modal.feed),
    };
    let target = checked.target();
    let command = match checked.path {
        Path::None => return,
        Path::Straight => line(target, pace, checked),
        Path::Arc(circle) => Command::Arc {
            target,
            circle,
            pace,
            line: checked.line,
        },
    };
    outcome.add(command);
    state.position = target.position;
    state.single_mm = target.single_mm;
}

fn line(target: Target, pace: Pace, checked: &Checked) -> Command {
    Command::Line {
        target,
        pace,
        line: checked.line,
    }
}

/// Program pause and program end. `F`, `S`, `T`, the unit, `G92` and the tool length stay.
fn end(state: &mut Interpreter, flow: Flow, outcome: &mut Outcome) {
    match flow {
        Flow::Run => {}
        Flow::Pause => outcome.add(Command::Pause),
        Flow::End => {
            let modal = &mut state.modal;
            modal.motion = Motion::Linear;
            modal.plane = Plane::default();
            modal.distance = Distance::default();
            modal.feed_mode = FeedMode::default();
            modal.coordinates = WorkCoordinates::default();
            modal.spindle = Spindle::Off;
            modal.coolant = Coolant::default();
            outcome.add(Command::Spindle {
                spindle: Spindle::Off,
                rpm: 0.0,
            });
            outcome.add(Command::Coolant(Coolant::default()));
            outcome.message = Some(Message::ProgramEnd);
        }
    }
}
