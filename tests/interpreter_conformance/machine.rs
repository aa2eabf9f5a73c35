//! An interpreter behind lines as they are sent, and its state as Grbl reports it.

use leadscrew::{
    axis::Axes,
    gcode::{Distance, FeedMode, LineError, Motion, Probe, ToolLength, Units, WorkCoordinates},
    interpreter::{Interpreter, Message},
    planner::{Plane, Rotation, Spindle},
    settings::Settings,
    units::Nm,
};

/// A line as the line assembler hands it on, or `None` where it is too long for it.
pub(crate) fn assembled(line: &[u8]) -> Option<Vec<u8>> {
    const LONGEST: usize = 255;
    let mut text = Vec::new();
    let mut in_comment = false;
    for &byte in line {
        match byte {
            b')' if in_comment => in_comment = false,
            _ if in_comment => {}
            b'(' => in_comment = true,
            b';' => break,
            0..=b' ' | b'/' | b'?' | b'!' | b'~' | 0x80.. => {}
            _ => text.push(byte.to_ascii_uppercase()),
        }
    }
    (text.len() <= LONGEST).then_some(text)
}

/// Sends a line and gives its answer.
pub(crate) fn answer(machine: &mut Interpreter, line: &[u8]) -> (String, Option<Message>) {
    let Some(text) = assembled(line) else {
        return (LineError::LineOverflow.to_string(), None);
    };
    match machine.check(&text, &Settings::default()) {
        Ok(checked) => {
            let outcome = machine.commit(&checked);
            ("ok".to_owned(), outcome.message)
        }
        Err(error) => (error.to_string(), None),
    }
}

/// The modal state in Grbl's numbers, as the recordings have it.
pub(crate) fn modal_numbers(machine: &Interpreter) -> String {
    let modal = machine.modal();
    let motion = match modal.motion {
        Motion::Rapid => 0,
        Motion::Linear => 1,
        Motion::Arc(Rotation::Clockwise) => 2,
        Motion::Arc(Rotation::CounterClockwise) => 3,
        Motion::Cancelled => 80,
        Motion::Probe(Probe::Contact) => 140,
        Motion::Probe(Probe::TryContact) => 141,
        Motion::Probe(Probe::Release) => 142,
        Motion::Probe(Probe::TryRelease) => 143,
    };
    let plane = match modal.plane {
        Plane::Xy => 0,
        Plane::Zx => 1,
        Plane::Yz => 2,
    };
    let spindle = match modal.spindle {
        Spindle::Off => 0,
        Spindle::Clockwise => 16,
        Spindle::CounterClockwise => 32,
    };
    format!(
        "{motion}/{}/{}/{}/{plane}/{}/{}/0/{}/{spindle}",
        u8::from(modal.feed_mode == FeedMode::InverseTime),
        u8::from(modal.units == Units::Inches),
        u8::from(modal.distance == Distance::Incremental),
        u8::from(modal.tool_length == ToolLength::Dynamic),
        modal.coordinates.index(),
        u8::from(modal.coolant.flood) * 64,
    )
}

/// The answer to `$G`.
pub(crate) fn modes(machine: &Interpreter) -> String {
    let modal = machine.modal();
    let plane = match modal.plane {
        Plane::Xy => "G17",
        Plane::Zx => "G18",
        Plane::Yz => "G19",
    };
    let spindle = match modal.spindle {
        Spindle::Off => "M5",
        Spindle::Clockwise => "M3",
        Spindle::CounterClockwise => "M4",
    };
    format!(
        "[GC:{} {} {plane} {} {} {} {spindle} {} T{} F{:.0} S{:.0}]",
        modal.motion.word(),
        modal.coordinates.word(),
        modal.units.word(),
        modal.distance.word(),
        modal.feed_mode.word(),
        if modal.coolant.flood { "M8" } else { "M9" },
        modal.tool,
        modal.feed,
        modal.speed_rpm,
    )
}

/// The answer to `$#`, but for the probe.
pub(crate) fn parameters(machine: &Interpreter) -> Vec<String> {
    let offsets = machine.offsets();
    let mut named: Vec<(&str, Axes<Nm>)> = WorkCoordinates::ALL
        .iter()
        .map(|&system| (system.word(), offsets.origin(system)))
        .collect();
    named.extend([("G28", offsets.origins.g28), ("G30", offsets.origins.g30)]);
    named.push(("G92", offsets.work));
    let mut lines: Vec<String> = named
        .iter()
        .map(|(name, position)| {
            let [x, y, z] = [0, 1, 2].map(|axis| position[axis].to_mm_f64() + 0.0);
            format!("[{name}:{x:.3},{y:.3},{z:.3}]")
        })
        .collect();
    lines.push(format!("[TLO:{:.3}]", offsets.tool_length.to_mm_f64()));
    lines
}
