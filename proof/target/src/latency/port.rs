//! A board's serial port: sends the workload to it.

use std::{
    fs::{File, OpenOptions},
    os::unix::fs::OpenOptionsExt as _,
    path::Path,
    thread::{self, JoinHandle},
};

use anyhow::{Context, Result};
use rustix::{
    fs::OFlags,
    termios::{OptionalActions, tcgetattr, tcsetattr},
};
use simulation::settings::Loaded;

use super::workload::Workload;
use crate::bench::Sender;

/// What a reset is asked for with.
const RESET: &[u8] = b"\x18";
const BAUD: u32 = 115_200;

/// Streams a workload in a thread of its own.
pub(super) fn stream(
    path: &Path,
    workload: &Workload,
    loaded: &Loaded,
) -> Result<JoinHandle<Result<()>>> {
    let mut port = open(path).with_context(|| format!("cannot open {}", path.display()))?;
    let from = port.try_clone().context("the port cannot be shared")?;
    std::io::Write::write_all(&mut port, RESET).context("cannot write to the port")?;
    let statements: Vec<_> = loaded
        .statements
        .iter()
        .map(|statement| format!("${statement}"))
        .collect();
    let workload = workload.clone();
    Ok(thread::spawn(move || {
        let mut sender = Sender::connect(port, from)?;
        sender.stream(statements.iter().map(String::as_str))?;
        let mut program = workload.program();
        while let Some(line) = program.next_line()? {
            sender.send(&String::from_utf8_lossy(&line))?;
        }
        sender.wait()
    }))
}

/// Opens a port for bytes as they are, at the baud rate of the firmware.
pub(crate) fn open(path: &Path) -> Result<File> {
    let port = OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(OFlags::NOCTTY.bits().cast_signed())
        .open(path)?;
    let mut mode = tcgetattr(&port)?;
    mode.make_raw();
    mode.set_speed(BAUD)?;
    tcsetattr(&port, OptionalActions::Now, &mode)?;
    Ok(port)
}
