//! The line to a machine: bytes to lines, with a time after which silence is an error.

use std::{
    io::{ErrorKind, Read, Write},
    net::TcpStream,
    path::Path,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail};
use grbl_client::port::SerialPort;

/// Longest wait for one byte, after which it is looked at the clock.
const POLL: Duration = Duration::from_millis(20);
/// Longest line that is kept: a machine's are shorter.
const LONGEST: usize = 4096;

/// The other end of the line.
trait Port: Read + Write {}

impl Port for SerialPort {}
impl Port for TcpStream {}

/// A line to a machine.
pub(crate) struct Link {
    port: Box<dyn Port>,
    received: Vec<u8>,
    /// How long the machine may be silent.
    pub(crate) timeout: Duration,
    /// The port or the address, as the user has named it.
    pub(crate) name: String,
    /// What may be wrong where nothing answers.
    pub(crate) hint: String,
}

impl Link {
    /// Opens a serial port, which no other program may have open.
    pub(crate) fn serial(path: &Path, baud: u32, timeout: Duration) -> Result<Self> {
        let name = path.display().to_string();
        let mut port = grbl_client::port::serial(path, baud)?;
        port.set_read_timeout(POLL)
            .and_then(|()| port.set_write_timeout(timeout))
            .with_context(|| format!("cannot use {name}"))?;
        let hint = grbl_client::port::serial_hint(baud);
        Ok(Self::new(Box::new(port), timeout, name, hint))
    }

    /// Connects to a TCP address.
    pub(crate) fn tcp(address: &str, timeout: Duration) -> Result<Self> {
        let stream = grbl_client::port::tcp(address, timeout)?;
        stream
            .set_read_timeout(Some(POLL))
            .and_then(|()| stream.set_write_timeout(Some(timeout)))
            .with_context(|| format!("cannot use {address}"))?;
        let hint = grbl_client::port::TCP_HINT.into();
        Ok(Self::new(Box::new(stream), timeout, address.into(), hint))
    }

    fn new(port: Box<dyn Port>, timeout: Duration, name: String, hint: String) -> Self {
        Self {
            port,
            received: Vec::new(),
            timeout,
            name,
            hint,
        }
    }

    /// Sends bytes.
    pub(crate) fn send(&mut self, bytes: &[u8]) -> Result<()> {
        let sent = self.port.write_all(bytes).and_then(|()| self.port.flush());
        sent.with_context(|| format!("cannot send to {}", self.name))
    }

    /// The next line without its end and without blanks around it; none when no line is complete in
    /// time.
    pub(crate) fn line(&mut self, wait: Duration) -> Result<Option<String>> {
        let end = Instant::now() + wait;
        loop {
            if let Some(length) = self.received.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = self.received.drain(..=length).collect();
                let text = String::from_utf8_lossy(&line).trim().to_owned();
                grbl_client::port::ensure_is_free(&self.name, &text)?;
                return Ok(Some(text));
            }
            if Instant::now() >= end {
                return Ok(None);
            }
            self.receive()?;
        }
    }

    /// Takes what has come, and waits for it a little.
    fn receive(&mut self) -> Result<()> {
        let mut chunk = [0; 512];
        match self.port.read(&mut chunk) {
            Ok(0) => bail!("{} has gone: the connection has ended", self.name),
            Ok(length) => self.received.extend(&chunk[..length]),
            Err(error) => match error.kind() {
                ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => {}
                _ => {
                    return Err(error).with_context(|| format!("cannot read from {}", self.name));
                }
            },
        }
        if self.received.len() > LONGEST && !self.received.contains(&b'\n') {
            bail!("{} sends what is no text: {}", self.name, self.hint);
        }
        Ok(())
    }
}
