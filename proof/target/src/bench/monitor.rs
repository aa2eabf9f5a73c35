//! QEMU's monitor: reads the emulated memory, and ends QEMU in an orderly way.

use std::{
    fs,
    io::{BufRead, BufReader, Write},
    os::unix::net::UnixStream,
    path::Path,
    time::Duration,
};

use anyhow::{Context, Result};
use leadscrew::units::TICKS_PER_SECOND;
use object::{Object, ObjectSymbol};

/// The firmware's record of its pins, see `src/board/qemu/`.
const FIGURES: &str = "FIGURES";
/// Where in it the ticks from the first step to the last are: a low and a high word.
const TICKS_OFFSET: u64 = 3 * 4;

/// A connection.
pub(super) struct Monitor(BufReader<UnixStream>);

impl Monitor {
    /// Connects to a monitor.
    pub(super) fn connect(path: &Path) -> Result<Self> {
        let stream = UnixStream::connect(path).context("QEMU has no monitor")?;
        stream
            .set_read_timeout(Some(Duration::from_secs(20)))
            .context("cannot limit the wait for QEMU's monitor")?;
        Ok(Self(BufReader::new(stream)))
    }

    /// Time from the first step to the last, seconds.
    pub(super) fn motion_s(&mut self, elf: &Path) -> Result<f64> {
        let bytes = fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))?;
        let program = object::File::parse(&*bytes).context("not an ELF file")?;
        let figures = program
            .symbols()
            .find(|symbol| symbol.name() == Ok(FIGURES))
            .with_context(|| format!("the firmware has no {FIGURES}"))?;
        let [low, high] = self.words(figures.address() + TICKS_OFFSET)?;
        let ticks = u64::from(high) << 32 | u64::from(low);
        Ok(ticks as f64 / f64::from(TICKS_PER_SECOND))
    }

    /// Ends QEMU; only then does the plugin write its report. Keep the connection until QEMU has
    /// ended the command: QEMU forgets the output for a lost connection.
    pub(super) fn quit(&mut self) -> Result<()> {
        self.command("quit")
    }

    /// Two words of memory.
    fn words(&mut self, address: u64) -> Result<[u32; 2]> {
        self.command(&format!("xp /2xw {address:#x}"))?;
        loop {
            let mut line = String::new();
            let length = self
                .0
                .read_line(&mut line)
                .context("QEMU's monitor is silent")?;
            if let Some(words) = parse(&line, address) {
                return Ok(words);
            }
            anyhow::ensure!(length != 0, "QEMU's monitor has ended");
        }
    }

    fn command(&mut self, text: &str) -> Result<()> {
        let stream = self.0.get_mut();
        writeln!(stream, "{text}").context("cannot write to QEMU's monitor")
    }
}

/// Reads `0000000020000010: 0x00000001 0x00000002`.
fn parse(line: &str, address: u64) -> Option<[u32; 2]> {
    let (head, words) = line.split_once(": ")?;
    if u64::from_str_radix(head.trim(), 16).ok()? != address {
        return None;
    }
    let mut words = words.split_whitespace().map(|word| {
        let digits = word.strip_prefix("0x")?;
        u32::from_str_radix(digits, 16).ok()
    });
    Some([words.next()??, words.next()??])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_distinguished_from_the_monitors_echo() {
        let line = "0000000020000010: 0x00000001 0xffffffff\r\n";
        assert_eq!(parse(line, 0x2000_0010), Some([1, u32::MAX]));
        assert_eq!(parse(line, 0x2000_0014), None);
        assert_eq!(parse("(qemu) xp /2xw 0x20000010\r\n", 0x2000_0010), None);
    }
}
