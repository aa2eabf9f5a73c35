//! The machine at power-up: stored records and wiring.

use std::{
    fs,
    io::{ErrorKind, Write as _},
    path::Path,
};

use anyhow::{Context, Result, bail, ensure};
use common::options::SecondMotor;
use leadscrew::{
    gcode::LineError,
    model::State,
    sim::{Flash, Simulator},
};
use simulation::{machine::SwitchPositions, output::Output, play, proven, settings::Loaded};

use crate::{gantry, tool_table::Tool};

/// How the machine is switched on.
pub(crate) struct PowerUp<'a> {
    /// Settings that are given beside what is stored.
    pub(crate) loaded: &'a Loaded,
    /// Tools that are given beside those of its table.
    pub(crate) tools: &'a [Tool],
    /// Where the contents of its flash are kept; without it, what is stored is forgotten in the end.
    pub(crate) flash: Option<&'a Path>,
    /// It has limit switches and a probe plate.
    pub(crate) has_switches: bool,
    /// Axes with a second motor, which has a switch too.
    pub(crate) second: &'a [SecondMotor],
}

impl PowerUp<'_> {
    /// Switches the machine on. A flash file that is not there is a new machine.
    pub(crate) fn simulator(&self) -> Result<Box<Simulator>> {
        let mut simulator = match self.flash {
            None => self.with_tools(Box::new(Simulator::new(&self.loaded.settings)))?,
            Some(path) => self.stored(path)?,
        };
        if !self.second.is_empty() {
            gantry::mount(self.second, &mut simulator)?;
        } else if self.has_switches {
            SwitchPositions::of(simulator.session().settings()).mount_on(&mut simulator);
        }
        Ok(simulator)
    }

    /// A machine with the records of its file and with the settings of the command line, which are stored, too.
    fn stored(&self, path: &Path) -> Result<Box<Simulator>> {
        let flash =
            read(path).with_context(|| format!("cannot use {} as a flash", path.display()))?;
        let mut simulator = power_up(flash);
        if !self.loaded.statements.is_empty() {
            // What it says at power-up comes first.
            play::ask(&mut simulator, b"");
            for statement in &self.loaded.statements {
                let answer = play::ask(&mut simulator, format!("${statement}\n").as_bytes());
                if let Some(error) = answer.iter().find(|line| line.starts_with("error:")) {
                    bail!("the machine refuses ${statement} beside what it has stored: {error}");
                }
            }
            simulator = power_up((*simulator).into_flash());
        }
        simulator = self.with_tools(simulator)?;
        save(path, simulator.flash())?;
        Ok(simulator)
    }

    /// The machine with the tools that are given in its table, switched on again.
    fn with_tools(&self, mut simulator: Box<Simulator>) -> Result<Box<Simulator>> {
        if self.tools.is_empty() {
            return Ok(simulator);
        }
        play::ask(&mut simulator, b"");
        for Tool { line, statement } in self.tools {
            let answer = play::ask(&mut simulator, format!("${statement}\n").as_bytes());
            let mut errors = LineError::ALL.iter();
            if let Some(error) = errors.find(|error| answer.contains(&error.to_string())) {
                let reason = error.text();
                bail!("the machine refuses line {line} of the tool table, ${statement}: {reason}");
            }
        }
        Ok(power_up((*simulator).into_flash()))
    }
}

/// Powers up a machine with a flash. The function is separate because several machines do not fit on one stack.
fn power_up(flash: Flash) -> Box<Simulator> {
    Box::new(Simulator::power_up(flash, proven::committed()))
}

/// Unlocks a machine that was switched on locked, as homing would: without moving it.
pub(crate) fn unlock(simulator: &mut Simulator) {
    // The tasks that begin at power-up come first.
    simulator.settle();
    if simulator.snapshot().state == State::Alarm {
        play::ask(simulator, b"$X\n");
    }
}

fn read(path: &Path) -> Result<Flash> {
    let mut flash = Flash::new();
    let contents = flash.contents_mut();
    match fs::read(path) {
        Ok(bytes) => {
            let (size, wanted) = (bytes.len(), contents.len());
            ensure!(size == wanted, "it has {size} bytes, and not {wanted}");
            contents.copy_from_slice(&bytes);
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        Err(error) => return Err(error.into()),
    }
    Ok(flash)
}

/// Writes a flash to a file, all of it or nothing.
pub(crate) fn save(path: &Path, flash: &Flash) -> Result<()> {
    let mut file = Output::create(path)?;
    file.write_all(flash.contents())
        .with_context(|| format!("cannot write {}", path.display()))?;
    file.finish()
}
