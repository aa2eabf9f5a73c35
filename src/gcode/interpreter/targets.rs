//! Axis words to coordinates: targets of moves, origins, offsets.

use super::{
    Action, CheckedLine, Interpreter, home,
    offsets::{Frame, frame, frame_of, present},
    reach::check_position,
};
use crate::{
    axis::{AXES, Axes, X, Y, Z},
    decimal::Decimal,
    gcode::{Distance, LineError, NonModal, ParsedLine, Units, Word, Words},
    model::WorkCoordinates,
    settings::Settings,
    units::{MM_PER_INCH, MicroDegrees, Nm},
};

/// The first angle that stands for every greater one, millionths of a degree.
const FARTHEST_ANGLE: u64 = Decimal::CONVERSION_LIMIT.unsigned_abs();

/// `G10`: returns the coordinate system of `P`; 0 and none stand for the system in use.
pub(super) fn system_to_set(
    parsed: &ParsedLine,
    unused: &mut Words,
) -> Result<WorkCoordinates, LineError> {
    if parsed.axes == 0 && !unused.contains(Word::R) {
        return Err(LineError::NoAxisWords);
    }
    if !unused.contains(Word::P) || !unused.contains(Word::L) {
        return Err(LineError::MissingWord);
    }
    if !parsed.p.is_whole() {
        return Err(LineError::NotInteger);
    }
    let number = usize::try_from(parsed.p.trunc()).unwrap_or(usize::MAX);
    let system = match number.checked_sub(1) {
        None => parsed.modal.coordinates,
        Some(index) => *WorkCoordinates::ALL
            .get(index)
            .ok_or(LineError::UnknownCoordinates)?,
    };
    match parsed.subcode() {
        2 if parsed.radius.to_millionths().unsigned_abs() >= FARTHEST_ANGLE => {
            return Err(LineError::ValueOutOfRange);
        }
        2 => unused.remove(Word::R),
        20 if parsed.axes == 0 => return Err(LineError::NoAxisWords),
        20 => {}
        _ => return Err(LineError::Unsupported),
    }
    unused.remove(Word::P);
    unused.remove(Word::L);
    Ok(system)
}

/// Returns the new origin and rotation of a system. `G10 L2`: the values. `G10 L20`: moved so that
/// the present position gets the values.
pub(super) fn new_origin(
    state: &Interpreter,
    parsed: &ParsedLine,
    checked: &CheckedLine,
    system: WorkCoordinates,
) -> (Axes<Nm>, MicroDegrees) {
    let offsets = &state.offsets;
    let origin = offsets.origin(system);
    let rotation = offsets.origins.rotations[system];
    if parsed.subcode() == 2 {
        let values = Axes::from_fn(|axis| {
            if parsed.has_axis(axis) {
                coordinate(parsed, axis)
            } else {
                origin[axis]
            }
        });
        let rotation = if parsed.words.contains(Word::R) {
            MicroDegrees::new(parsed.radius.to_millionths())
        } else {
            rotation
        };
        return (values, rotation);
    }
    let frame = frame_of(state, checked, system);
    let present = present(state, &frame);
    let moved = Axes::from_fn(|axis| {
        if parsed.has_axis(axis) {
            present[axis] - coordinate(parsed, axis)
        } else {
            Nm(0)
        }
    });
    (moved_origin(&origin, &frame, &moved), rotation)
}

/// Returns an origin that is moved by work coordinates.
fn moved_origin(origin: &Axes<Nm>, frame: &Frame, moved: &Axes<Nm>) -> Axes<Nm> {
    let mut values = origin.zip(*moved, |origin, moved| origin + moved);
    if !frame.rotation.is_none() {
        let rotated = frame.rotation.rotate([moved[X], moved[Y]]);
        for (axis, rotated) in [X, Y].into_iter().zip(rotated) {
            values[axis] = origin[axis] + rotated;
        }
    }
    values
}

/// Returns the origin with which a machine position has a work coordinate.
pub(super) fn origin_with(
    origin: &Axes<Nm>,
    frame: &Frame,
    machine: &Axes<Nm>,
    (axis, value): (usize, Nm),
) -> Axes<Nm> {
    let mut moved = Axes::all(Nm(0));
    moved[axis] = frame.work_position(machine)[axis] - value;
    moved_origin(origin, frame, &moved)
}

/// `G38.n P`: the work coordinate that the contact is to get, of the only axis in the move. A `P` of another command of
/// the line is not for the probe.
///
/// # Errors
/// 33 where the origin would be too far.
pub(super) fn set_contact(
    state: &Interpreter,
    settings: &Settings,
    parsed: &ParsedLine,
    unused: &mut Words,
    checked: &mut CheckedLine,
) -> Result<(), LineError> {
    let is_for_probe = unused.contains(Word::P)
        && !parsed.has_path_tolerance()
        && checked.action == Action::None
        && parsed.axes.is_power_of_two();
    if !is_for_probe {
        return Ok(());
    }
    unused.remove(Word::P);
    let axis = parsed.axes.trailing_zeros() as usize;
    let value = length_along(parsed, axis, parsed.p);
    let frame = frame(state, checked);
    let origin = state.offsets.origin(checked.modal.coordinates);
    // The contact comes between these.
    for end in [&state.position, &checked.values] {
        check_position(settings, &origin_with(&origin, &frame, end, (axis, value)))?;
    }
    checked.action = Action::SetAtContact { axis, value };
    Ok(())
}

/// Returns the new offset of `G92`: with it the values are the present work position.
pub(super) fn new_work_offset(
    state: &Interpreter,
    parsed: &ParsedLine,
    checked: &CheckedLine,
) -> Axes<Nm> {
    let present = present(state, &frame(state, checked));
    Axes::from_fn(|axis| {
        let offset = state.offsets.work[axis];
        if parsed.has_axis(axis) {
            offset + present[axis] - coordinate(parsed, axis)
        } else {
            offset
        }
    })
}

/// Returns the new offset of `G52`: the values.
pub(super) fn given_work_offset(state: &Interpreter, parsed: &ParsedLine) -> Axes<Nm> {
    Axes::from_fn(|axis| {
        if parsed.has_axis(axis) {
            coordinate(parsed, axis)
        } else {
            state.offsets.work[axis]
        }
    })
}

/// Sets the target of the axis words, in the machine frame: exactly, and in Grbl's single precision.
pub(super) fn set_target(
    state: &Interpreter,
    settings: &Settings,
    parsed: &ParsedLine,
    checked: &mut CheckedLine,
) {
    let frame = frame(state, checked);
    let is_of_machine = parsed.non_modal == NonModal::MachineCoordinates;
    if !frame.rotation.is_none() && !is_of_machine {
        return set_rotated_target(state, parsed, &frame, checked);
    }
    let (base, single_base) = if is_of_machine {
        (Axes::all(Nm(0)), Axes::all(0.0))
    } else {
        match parsed.modal.distance {
            Distance::Absolute => {
                let is_none = frame.total == Axes::all(Nm(0));
                let single = if is_none {
                    Axes::all(0.0)
                } else {
                    frame.total.map(Nm::to_mm)
                };
                (frame.total, single)
            }
            Distance::Incremental => (state.position, state.single_mm),
        }
    };
    for axis in 0..AXES {
        if parsed.has_axis(axis) {
            let (exact, single) = if parsed.modal.units == Units::Millimetres {
                let number: &Decimal = &parsed.coordinates[axis];
                (Nm(number.to_millionths()), number.to_grbl_f32())
            } else {
                (coordinate(parsed, axis), single_coordinate(parsed, axis))
            };
            checked.values[axis] = base[axis] + exact;
            checked.single_mm[axis] = single_base[axis] + single;
            if is_of_machine {
                let end = home::before_switch(state, settings, axis, exact);
                if end != exact {
                    checked.values[axis] = end;
                    checked.single_mm[axis] = end.to_mm();
                    checked.ends_before_switch = true;
                }
            }
        }
    }
    if !frame.rotation.is_none() {
        checked.work_target = frame.work_position(&checked.values);
    }
}

/// Sets the target under rotation: work coordinates add up exactly, and are rounded once.
fn set_rotated_target(
    state: &Interpreter,
    parsed: &ParsedLine,
    frame: &Frame,
    checked: &mut CheckedLine,
) {
    let present = present(state, frame);
    let target = Axes::from_fn(|axis| {
        let base = match parsed.modal.distance {
            _ if !parsed.has_axis(axis) => return present[axis],
            Distance::Absolute => Nm(0),
            Distance::Incremental => present[axis],
        };
        base + coordinate(parsed, axis)
    });
    let machine = frame.machine(&target);
    // X and Y move together.
    let is_in_plane = parsed.has_axis(X) || parsed.has_axis(Y);
    for axis in 0..AXES {
        if parsed.has_axis(axis) || axis < Z && is_in_plane {
            checked.values[axis] = machine[axis];
            checked.single_mm[axis] = machine[axis].to_mm();
        }
    }
    checked.work_target = target;
}

/// Returns the present position and the target between which an arc is computed: in work
/// coordinates, where its plane is rotated.
pub(super) fn ends(state: &Interpreter, checked: &CheckedLine) -> (Frame, Axes<Nm>, Axes<Nm>) {
    let frame = frame(state, checked);
    if frame.rotation.is_none() {
        (frame, state.position, checked.values)
    } else {
        let present = present(state, &frame);
        (frame, present, checked.work_target)
    }
}

/// Returns an axis word in mm as Grbl has it.
fn single_coordinate(parsed: &ParsedLine, axis: usize) -> f32 {
    let value = parsed.coordinates[axis].to_grbl_f32();
    match parsed.modal.units {
        Units::Inches if axis <= Z => value * MM_PER_INCH,
        Units::Inches | Units::Millimetres => value,
    }
}

/// Returns an axis word in nm. Rotary axes have no inches.
pub(super) fn coordinate(parsed: &ParsedLine, axis: usize) -> Nm {
    length_along(parsed, axis, parsed.coordinates[axis])
}

fn length_along(parsed: &ParsedLine, axis: usize, number: Decimal) -> Nm {
    Nm(match parsed.modal.units {
        Units::Inches if axis <= Z => number.inches_to_nm(),
        Units::Inches | Units::Millimetres => number.to_millionths(),
    })
}
