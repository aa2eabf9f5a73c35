//! The program in QEMU: facts by semihosting, bytes over the emulated serial line.

use std::{
    fs,
    io::{self, BufRead, BufReader, Write},
    os::unix::net::UnixStream,
    path::Path,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail};
use target::emulator::semihosting;

use super::{
    exchange::{exchange, listen, send_bursts, send_early},
    facts::{BEGIN, END, Facts, READY},
    stream,
};

/// The files that request a stack without a guard, and a flash that does not erase.
pub(super) const UNGUARDED: &str = "unguarded";
pub(super) const WORN_FLASH: &str = "worn";
/// An instruction takes 4 ns, whatever this computer does meanwhile: so the clock of the emulated timers is exact.
const CLOCK: [&str; 2] = ["-icount", "shift=2"];
/// Longest silence of the serial line.
const LIMIT: Duration = Duration::from_secs(20);

/// Runs the program, and returns what it says.
pub(super) fn run(elf: &Path) -> Result<Facts> {
    run_with(elf, &[], |line| line)
}

/// Runs the program with flaws that files ask for, and with a serial line that damages a byte of each write.
pub(super) fn run_flawed(elf: &Path, flaws: &[&str]) -> Result<Facts> {
    run_with(elf, flaws, DamagingWriter)
}

/// A line that damages the last byte of each write.
struct DamagingWriter<W>(W);

impl<W: Write> Write for DamagingWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut damaged = bytes.to_vec();
        if let Some(last) = damaged.last_mut() {
            *last ^= 1;
        }
        self.0.write_all(&damaged)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

fn run_with<W: Write + Send>(
    elf: &Path,
    asked: &[&str],
    through: impl Fn(UnixStream) -> W,
) -> Result<Facts> {
    let folder = tempfile::tempdir().context("there is no room for the files of the run")?;
    for file in asked {
        fs::write(folder.path().join(file), "").context("cannot write into a folder")?;
    }
    let line = semihosting::start_with_serial(elf, folder.path(), &CLOCK, LIMIT)?;
    let semihosting::Serial {
        mut qemu,
        mut from,
        to,
    } = line;
    let mut to = through(to);
    let output = qemu.stdout.take().context("QEMU has no output")?;
    let mut output = BufReader::new(output);
    let mut facts = Facts::default();
    let result = (|| {
        facts.put("port", 1);
        send_early(&mut from, &mut to)?;
        listen(&mut from, &mut facts)?;
        send_early(&mut from, &mut to)?;
        read(&mut output, BEGIN, &mut facts)?;
        read(&mut output, READY, &mut facts)?;
        let bytes = facts.get("serial.expected").unwrap_or_default();
        exchange(&mut from, &mut to, bytes, &mut facts)?;
        if facts.get("serial.returned") == Some(bytes) {
            let bytes = facts.get("stream.expected").unwrap_or_default();
            let start = Instant::now();
            stream::receive(&mut from, &mut to, || start.elapsed(), bytes, &mut facts)?;
            send_bursts(&mut from, &mut to)?;
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
