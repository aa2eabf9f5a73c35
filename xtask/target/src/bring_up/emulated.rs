//! The program in QEMU: facts by semihosting, bytes over the emulated serial line.

use std::{
    fs,
    io::{BufRead, BufReader},
    path::Path,
    time::Duration,
};

use anyhow::{Context, Result, bail};
use emulator::semihosting;

use super::{
    exchange::{exchange, listen, send_early},
    facts::{END, Facts, READY},
};

/// The file by which the program knows that it is wanted.
const WANTED: &str = "bring-up";
/// The file that asks it for a stack without a guard.
pub(super) const UNGUARDED: &str = "unguarded";
/// An instruction takes 4 ns, whatever this computer does meanwhile: so the clock of the emulated timers is exact.
const CLOCK: [&str; 2] = ["-icount", "shift=2"];
/// Longest silence of the serial line.
const LIMIT: Duration = Duration::from_secs(20);

/// Runs the program, with files that ask it for more, and returns what it says.
pub(super) fn run(elf: &Path, asked: &[&str]) -> Result<Facts> {
    let folder = tempfile::tempdir().context("there is no room for the files of the run")?;
    for file in [&[WANTED], asked].concat() {
        fs::write(folder.path().join(file), "").context("cannot write into a folder")?;
    }
    let line = semihosting::start_with_serial(elf, folder.path(), &CLOCK, LIMIT)?;
    let semihosting::Serial {
        mut qemu,
        mut from,
        to,
    } = line;
    let output = qemu.stdout.take().context("QEMU has no output")?;
    let mut output = BufReader::new(output);
    let mut facts = Facts::default();
    let result = (|| {
        facts.put("port", 1);
        send_early(&mut from, &to)?;
        listen(&mut from, &mut facts)?;
        send_early(&mut from, &to)?;
        read(&mut output, READY, &mut facts)?;
        let bytes = facts.get("serial.expected").unwrap_or_default();
        exchange(&mut from, to, bytes, &mut facts)?;
        if facts.get("serial.returned") == Some(bytes) {
            read(&mut output, END, &mut facts)?;
        }
        Ok(())
    })();
    let _ = qemu.kill();
    let _ = qemu.wait();
    result.map(|()| facts)
}

/// Reads facts up to a line.
fn read(output: &mut impl BufRead, last: &str, facts: &mut Facts) -> Result<()> {
    for line in output.lines() {
        let line = line.context("cannot read what the program says")?;
        if line == last {
            return Ok(());
        }
        facts.read(&line)?;
    }
    bail!("the program has not come to its end")
}
