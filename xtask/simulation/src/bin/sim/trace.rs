//! The step trace: a table with a row for every event that steps.

use std::{
    io::Write,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result};
use leadscrew::{
    axis::{AXES, LETTERS},
    units::TICKS_PER_SECOND,
};
use simulation::output::Output;

/// One event that steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Row {
    /// Time since the first step, ns.
    pub(crate) time_ns: u64,
    /// Steps of each axis after it.
    pub(crate) steps: [i32; AXES],
    /// The move that it is of.
    pub(crate) of: Move,
}

/// What is known of a move beside its steps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Move {
    pub(crate) is_rapid: bool,
    /// Duty of the spindle PWM, 0 to `Outputs::FULL`.
    pub(crate) duty: u16,
}

/// Timer ticks as nanoseconds, rounded down.
pub(crate) fn nanoseconds(ticks: u64) -> u64 {
    let rate = u64::from(TICKS_PER_SECOND);
    ticks / rate * 1_000_000_000 + ticks % rate * 1_000_000_000 / rate
}

/// Writes the trace as comma-separated values, as it comes.
pub(crate) struct Table<W: Write> {
    output: W,
    line: Vec<u8>,
}

impl Table<Output> {
    /// Creates a file.
    pub(crate) fn create(path: &Path) -> Result<Self> {
        Self::new(Output::create(path)?).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Where it lies until it is whole.
    pub(crate) fn partial(&self) -> Option<PathBuf> {
        self.output.partial()
    }
}

impl<W: Write> Table<W> {
    /// Writes the head of the table: `time_ns,x,y,z`.
    pub(crate) fn new(mut output: W) -> Result<Self> {
        write!(output, "time_ns")?;
        for letter in &LETTERS[..AXES] {
            write!(output, ",{}", letter.to_ascii_lowercase() as char)?;
        }
        writeln!(output)?;
        Ok(Self {
            output,
            line: Vec::new(),
        })
    }

    /// Writes one row.
    pub(crate) fn push(&mut self, row: &Row) -> Result<()> {
        self.line.clear();
        decimal(&mut self.line, i128::from(row.time_ns));
        for steps in row.steps {
            self.line.push(b',');
            decimal(&mut self.line, i128::from(steps));
        }
        self.line.push(b'\n');
        self.output
            .write_all(&self.line)
            .context("cannot write the trace")
    }

    /// Writes what is still buffered.
    pub(crate) fn finish(mut self) -> Result<W> {
        self.output.flush().context("cannot write the trace")?;
        Ok(self.output)
    }
}

/// Appends a number: several times faster than `write!`, and a trace has millions.
fn decimal(text: &mut Vec<u8>, number: i128) {
    if number < 0 {
        text.push(b'-');
    }
    let start = text.len();
    let mut remainder = number.unsigned_abs() as u64;
    loop {
        text.push(b'0' + (remainder % 10) as u8);
        remainder /= 10;
        if remainder == 0 {
            break;
        }
    }
    text[start..].reverse();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(time_ns: u64, x: i32) -> Row {
        let mut steps = [0; AXES];
        steps[0] = x;
        Row {
            time_ns,
            steps,
            of: Move::default(),
        }
    }

    #[test]
    fn ticks_become_nanoseconds_without_drift() {
        assert_eq!(nanoseconds(84), 1_000);
        assert_eq!(nanoseconds(1), 11);
        assert_eq!(nanoseconds(84_000_000 * 100_000), 100_000_000_000_000);
    }

    #[test]
    fn the_table_has_one_row_per_event() {
        let mut table = Table::new(Vec::new()).unwrap();
        table.push(&row(0, 1)).unwrap();
        table.push(&row(12_345, -2)).unwrap();
        let text = String::from_utf8(table.finish().unwrap()).unwrap();
        let remainder = ",0".repeat(AXES - 1);
        let (_, rows) = text.split_once('\n').unwrap();
        assert!(text.starts_with("time_ns,x,y,z"));
        assert_eq!(rows, format!("0,1{remainder}\n12345,-2{remainder}\n"));
    }
}
