//! Lines to commands, positions and errors.

use leadscrew::{
    axis::Axes,
    gcode::{
        LineError,
        interpreter::{Interpreter, LineCommands},
    },
    model::{Command, FeedRate},
    settings::Settings,
    units::Nm,
};

/// Sends one line.
pub(crate) fn send(machine: &mut Interpreter, line: &str) -> Result<LineCommands, LineError> {
    let checked = machine.check(line.as_bytes(), &Settings::default())?;
    let mut outcome = LineCommands::default();
    machine.commit(&checked, &mut outcome);
    Ok(outcome)
}

/// The machine after lines that are all accepted.
pub(crate) fn after(lines: &[&str]) -> Interpreter {
    let mut machine = Interpreter::new();
    for line in lines {
        send(&mut machine, line).unwrap_or_else(|error| panic!("{line}: {error}"));
    }
    machine
}

/// The commands of the last of some lines.
pub(crate) fn commands(lines: &[&str]) -> Vec<Command> {
    let (last, before) = lines.split_last().unwrap();
    let mut machine = after(before);
    send(&mut machine, last).unwrap().commands.to_vec()
}

/// The error of the last of some lines.
pub(crate) fn error(lines: &[&str]) -> LineError {
    let (last, before) = lines.split_last().unwrap();
    let mut machine = after(before);
    let unchanged = machine.clone();
    let Err(error) = send(&mut machine, last) else {
        panic!("{last} is accepted: if it is new, take it from the lines that are refused");
    };
    assert_eq!(machine, unchanged, "{last}");
    error
}

/// A position in thousandths of a mm; axes beyond the third at 0.
pub(crate) fn um(x: i64, y: i64, z: i64) -> Axes<Nm> {
    Axes::from_fn(|axis| Nm([x, y, z].get(axis).copied().unwrap_or(0) * 1000))
}

pub(crate) fn line(target: Axes<Nm>, feed_rate: FeedRate) -> Command {
    Command::Line {
        target: target.into(),
        feed_rate,
        line: 0,
    }
}

/// A coordinate as a program writes it.
pub(crate) fn decimal(nm: i64) -> String {
    let sign = if nm < 0 { "-" } else { "" };
    format!(
        "{sign}{}.{:06}",
        nm.abs() / Nm::PER_MM,
        nm.abs() % Nm::PER_MM
    )
}
