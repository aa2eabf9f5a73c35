//! The coils of motors that are driven by phases: a table with a row for every change.

use std::{
    io::Write,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result};
use leadscrew::{
    axis::{AXES, Axes, LETTERS},
    stepper::COILS,
};
use simulation::output::Output;

use crate::trace::nanoseconds;

/// Writes the coils as comma-separated values, as they change.
pub(crate) struct CoilTable<W: Write> {
    output: W,
    /// The last row.
    coils: Option<Axes<u8>>,
}

impl CoilTable<Output> {
    /// Creates a file.
    pub(crate) fn create(path: &Path) -> Result<Self> {
        Self::new(Output::create(path)?).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Where it lies until it is whole.
    pub(crate) fn partial(&self) -> Option<PathBuf> {
        self.output.partial()
    }
}

impl<W: Write> CoilTable<W> {
    /// Writes the head of the table: `time_ns,x,y,z`.
    fn new(mut output: W) -> Result<Self> {
        let letters = LETTERS[..AXES]
            .iter()
            .map(|letter| letter.to_ascii_lowercase() as char);
        let letters: Vec<String> = letters.map(String::from).collect();
        writeln!(output, "time_ns,{}", letters.join(","))?;
        let coils = None;
        Ok(Self { output, coils })
    }

    /// Writes a row if the coils, bit 0 = IN1, are others than before; `ticks` since power-up.
    pub(crate) fn push(&mut self, ticks: u64, coils: Axes<u8>) -> Result<()> {
        if self.coils.replace(coils) == Some(coils) {
            return Ok(());
        }
        let patterns: Vec<String> = coils.0.iter().map(|coils| pattern(*coils)).collect();
        let time_ns = nanoseconds(ticks);
        writeln!(self.output, "{time_ns},{}", patterns.join(",")).context("cannot write the coils")
    }

    /// Writes what is still buffered.
    pub(crate) fn finish(mut self) -> Result<W> {
        self.output.flush().context("cannot write the coils")?;
        Ok(self.output)
    }
}

/// Returns a digit for each of IN1 to IN4: `1100`.
fn pattern(coils: u8) -> String {
    let digit = |coil: usize| char::from(b'0' + (coils >> coil & 1));
    (0..COILS).map(digit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_a_row_for_each_change_with_in1_first() {
        let mut table = CoilTable::new(Vec::new()).unwrap();
        let mut coils = Axes::all(0);
        for (ticks, x) in [(0, 0b0011), (84, 0b0011), (168, 0b0110)] {
            coils[0] = x;
            table.push(ticks, coils).unwrap();
        }
        let text = String::from_utf8(table.finish().unwrap()).unwrap();
        let zeros = ",0000".repeat(AXES - 1);
        let rows: Vec<_> = text.lines().skip(1).map(str::to_owned).collect();
        assert!(text.starts_with("time_ns,x,y,z"), "{text}");
        assert_eq!(
            rows,
            [format!("0,1100{zeros}"), format!("2000,0110{zeros}")]
        );
    }
}
