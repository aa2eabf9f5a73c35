//! The record file of a program: an interrupted job is continued from the file.

use std::{
    ffi::OsString,
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use common::ui;
use serde::{Deserialize, Serialize};
use simulation::output;

use grbl_client::MachineAnswers;

/// How far a job has come.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Record {
    /// A checksum of the program.
    pub(crate) program: u64,
    /// The lines that the machine has answered.
    pub(crate) answered: usize,
    /// The lines before a change of the tool in which the operator has set an offset that a reset clears.
    #[serde(default)]
    pub(crate) measured: Option<usize>,
    /// Where the machine stood when the job was stopped, so that the line is known in which that was.
    #[serde(default)]
    pub(crate) stopped_at: Option<Vec<f64>>,
    /// The machine before the first line.
    pub(crate) began: MachineAnswers,
}

/// The file of a record.
pub(crate) struct RecordFile {
    path: PathBuf,
    /// The file could not be written, which has been reported.
    pub(crate) is_lost: bool,
    /// What it was to hold last: a job has begun, even where nothing can be written.
    pub(crate) last: Option<Record>,
}

impl RecordFile {
    /// The record file of a program, in the same folder: `plate.nc.resume`.
    pub(crate) fn of_program(program: &Path) -> Self {
        let mut path = OsString::from(program);
        path.push(".resume");
        Self {
            path: path.into(),
            is_lost: false,
            last: None,
        }
    }

    /// Reads the record of a program.
    ///
    /// # Errors
    /// There is none, or the program has been changed since.
    pub(crate) fn read(&self, program: u64) -> Result<Record> {
        let name = self.path.display();
        let bytes = fs::read(&self.path).with_context(|| {
            format!("there is no record of an interrupted job, {name}: see --from LINE")
        })?;
        let record: Record = serde_json::from_slice(&bytes)
            .with_context(|| format!("{name} is no record of a job"))?;
        ensure!(
            record.program == program,
            "the program has been changed since the job was interrupted: see --from LINE"
        );
        Ok(record)
    }

    /// Writes a record; a job goes on without.
    pub(crate) fn write(&mut self, record: &Record) {
        self.last = Some(record.clone());
        match output::write_json(&self.path, record) {
            Ok(()) => self.is_lost = false,
            Err(error) if !self.is_lost => {
                self.is_lost = true;
                ui::warning(&format!("an interruption will need --from LINE: {error}"));
            }
            Err(_) => {}
        }
    }

    /// Removes it: the job is done.
    pub(crate) fn remove(&self) {
        let _ = fs::remove_file(&self.path);
    }
}

/// The checksum of a program: FNV-1a over its lines.
pub(crate) fn checksum(lines: &[Vec<u8>]) -> u64 {
    let bytes = lines.iter().flat_map(|line| line.iter().chain(b"\n"));
    bytes.fold(0xcbf2_9ce4_8422_2325, |sum, byte| {
        (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}
