//! The workload of the measurement: a program, repeated until the time is over.

use std::{
    fs,
    io::{self, BufReader, Read},
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
};

use anyhow::{Context, Result, ensure};
use simulation::{
    program::Program,
    settings::{self, Loaded},
};

/// A program that comes back to where it begins: three axes, short lines, arcs, a drilling cycle, a
/// rest, and the laser's power.
const BUSY: &str = include_str!("workload.nc");
/// Steps per mm, mm/s² and highest mm/min of a fast machine: 48 kHz an axis.
const STEPS_PER_MM: u32 = 320;
const ACCELERATION: u32 = 2000;
const FASTEST: u32 = 9000;

/// Lines to send, and whether to stop.
#[derive(Clone)]
pub(super) struct Workload {
    name: String,
    lines: Arc<Vec<Vec<u8>>>,
    /// Ends after one time.
    once: bool,
    stop: Arc<AtomicBool>,
}

impl Workload {
    /// A file, or the workload that is built in. With `once` it ends by itself.
    pub(super) fn new(file: Option<&Path>, once: bool) -> Result<Self> {
        let (name, text) = match file {
            Some(path) => {
                let name = path.display().to_string();
                let text = fs::read(path);
                let text = text.with_context(|| format!("cannot read the program {name}"))?;
                (name, text)
            }
            None => ("built-in workload".into(), BUSY.into()),
        };
        ensure!(!text.is_empty(), "the program {name} is empty");
        Ok(Self {
            name,
            once,
            ..Self::of(&text)
        })
    }

    /// A program that is executed once.
    pub(super) fn of(text: &[u8]) -> Self {
        let lines = text.split_inclusive(|byte| *byte == b'\n');
        Self {
            name: String::new(),
            lines: Arc::new(lines.map(<[u8]>::to_vec).collect()),
            once: true,
            stop: Arc::new(AtomicBool::new(false)),
        }
    }

    /// Its name.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Ends after the line that is being sent.
    pub(super) fn stop(&self) {
        self.stop.store(true, Relaxed);
    }

    /// The program that a sender sends.
    pub(super) fn program(&self) -> Program {
        let reader = Lines {
            workload: self.clone(),
            next: 0,
        };
        Program::from_reader(self.name.clone(), BufReader::new(reader))
    }
}

/// Reads a workload's lines, one at a time.
struct Lines {
    workload: Workload,
    next: usize,
}

impl Read for Lines {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let Workload {
            lines, once, stop, ..
        } = &self.workload;
        let is_over = *once && self.next == lines.len();
        if stop.load(Relaxed) || is_over {
            return Ok(0);
        }
        let line = &lines[self.next % lines.len()];
        // Longer lines are no program's.
        let length = line.len().min(bytes.len());
        bytes[..length].copy_from_slice(&line[..length]);
        self.next += 1;
        Ok(length)
    }
}

/// The settings asked for, and before them a fast machine's for the workload that is built in: as
/// fast as the firmware allows.
pub(super) fn settings(elf: &Path, file: Option<&Path>, set: &[String]) -> Result<Loaded> {
    let allowed = crate::step_rate(elf)?;
    let speed = FASTEST.min(allowed.hz() * 60 / STEPS_PER_MM);
    let axes = (0..3).filter(|_| file.is_none());
    let fast = axes.flat_map(|axis| {
        let each = [(100, STEPS_PER_MM), (110, speed), (120, ACCELERATION)];
        each.map(|(setting, value)| format!("${}={value}", setting + axis))
    });
    let all: Vec<_> = fast.chain(set.iter().cloned()).collect();
    settings::load_for(allowed, None, &all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_workload_goes_on_until_it_is_stopped() {
        let workload = Workload::new(None, false).unwrap();
        let mut program = workload.program();
        let count = workload.lines.len();
        for index in 0..3 * count {
            let line = program.next_line().unwrap().unwrap();
            let expected = workload.lines[index % count].trim_ascii_end();
            assert_eq!(line, expected);
        }
        workload.stop();
        assert!(program.next_line().unwrap().is_none());
    }

    #[test]
    fn once_is_once() {
        let workload = Workload::new(None, true).unwrap();
        let mut program = workload.program();
        let lines = std::iter::from_fn(|| program.next_line().unwrap());
        assert_eq!(lines.count(), workload.lines.len());
    }
}
