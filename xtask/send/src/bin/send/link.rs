//! The line to a machine: bytes to lines. Nothing here waits but what says so.

use std::{
    error::Error,
    fmt,
    net::TcpStream,
    os::{
        fd::{AsFd, BorrowedFd},
        unix::net::UnixStream,
    },
    path::Path,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, anyhow, bail, ensure};
use grbl_client::port::SerialPort;
use rustix::{
    event::{PollFd, PollFlags, Timespec, poll},
    fs::OFlags,
    io::Errno,
};

/// Longest line that is kept: a machine's are shorter.
const LONGEST: usize = 4096;
/// How long a machine may take no bytes.
const WRITE: Duration = Duration::from_secs(10);

/// The other end of the line.
enum Port {
    Serial(SerialPort),
    Tcp(TcpStream),
}

impl AsFd for Port {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Serial(port) => port.as_fd(),
            Self::Tcp(stream) => stream.as_fd(),
        }
    }
}

/// The other end has gone: the port has been unplugged, the connection has ended.
#[derive(Debug)]
pub(crate) struct LinkLost(String);

impl fmt::Display for LinkLost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} has gone", self.0)
    }
}

/// Ctrl-C was pressed before the job.
#[derive(Debug)]
pub(crate) struct Stopped;

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("it was stopped before the job was begun")
    }
}

impl Error for Stopped {}

/// A line to a machine.
pub(crate) struct Link {
    port: Port,
    received: Vec<u8>,
    /// The port or the address, as the user has named it.
    pub(crate) name: String,
    /// What may be wrong where nothing answers.
    pub(crate) hint: String,
}

impl AsFd for Link {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.port.as_fd()
    }
}

impl Link {
    /// Opens a serial port, which no other program may have open.
    pub(crate) fn serial(path: &Path, baud: u32) -> Result<Self> {
        let port = grbl_client::port::serial(path, baud)?;
        let name = path.display().to_string();
        Self::new(
            Port::Serial(port),
            name,
            grbl_client::port::serial_hint(baud),
        )
    }

    /// Connects to a TCP address.
    pub(crate) fn tcp(address: &str, timeout: Duration) -> Result<Self> {
        let stream = grbl_client::port::tcp(address, timeout)?;
        Self::new(
            Port::Tcp(stream),
            address.into(),
            grbl_client::port::TCP_HINT.into(),
        )
    }

    fn new(port: Port, name: String, hint: String) -> Result<Self> {
        let set_up = || -> rustix::io::Result<()> {
            let flags = rustix::fs::fcntl_getfl(&port)?;
            rustix::fs::fcntl_setfl(&port, flags | OFlags::NONBLOCK)
        };
        set_up().with_context(|| format!("cannot use {name}"))?;
        Ok(Self {
            port,
            received: Vec::new(),
            name,
            hint,
        })
    }

    /// Sends bytes; waits while the machine takes none.
    pub(crate) fn send(&mut self, mut bytes: &[u8]) -> Result<()> {
        let start = Instant::now();
        while !bytes.is_empty() {
            match rustix::io::write(&self.port, bytes) {
                Ok(length) => bytes = &bytes[length..],
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) if start.elapsed() < WRITE => {
                    wait(
                        &[(self.as_fd(), PollFlags::OUT)],
                        Duration::from_millis(100),
                    )?;
                }
                Err(Errno::AGAIN) => bail!("{} takes nothing: {}", self.name, self.hint),
                Err(error) => {
                    return Err(error).with_context(|| LinkLost(self.name.clone()));
                }
            }
        }
        Ok(())
    }

    /// Takes what has come.
    pub(crate) fn receive(&mut self) -> Result<()> {
        let mut chunk = [0; 1024];
        loop {
            match rustix::io::read(&self.port, &mut chunk) {
                Ok(0) => {
                    return Err(anyhow!("the connection has ended"))
                        .with_context(|| LinkLost(self.name.clone()));
                }
                Ok(length) => self.received.extend(&chunk[..length]),
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => break,
                Err(error) => {
                    return Err(error).with_context(|| LinkLost(self.name.clone()));
                }
            }
        }
        if self.received.len() > LONGEST && !self.received.contains(&b'\n') {
            bail!("{} sends what is no text: {}", self.name, self.hint);
        }
        Ok(())
    }

    /// The next line of what has come, without its end and without blanks around it.
    pub(crate) fn line(&mut self) -> Result<Option<String>> {
        let Some(length) = self.received.iter().position(|byte| *byte == b'\n') else {
            return Ok(None);
        };
        let line: Vec<u8> = self.received.drain(..=length).collect();
        let text = String::from_utf8_lossy(&line).trim().to_owned();
        grbl_client::port::ensure_is_free(&self.name, &text)?;
        Ok(Some(text))
    }

    /// Waits for the next line; none when none is complete in time.
    ///
    /// # Errors
    /// Something is to be read from `stop`: [`Stopped`].
    pub(crate) fn wait_for_line(
        &mut self,
        most: Duration,
        stop: &UnixStream,
    ) -> Result<Option<String>> {
        let end = Instant::now() + most;
        loop {
            if let Some(line) = self.line()? {
                return Ok(Some(line));
            }
            let now = Instant::now();
            if now >= end {
                return Ok(None);
            }
            let files = [(self.as_fd(), PollFlags::IN), (stop.as_fd(), PollFlags::IN)];
            ensure!(!wait(&files, end - now)?[1], Stopped);
            self.receive()?;
        }
    }
}

/// Whether Ctrl-C has been pressed.
///
/// # Errors
/// The file cannot be polled.
pub(crate) fn is_stopped(stop: &UnixStream) -> Result<bool> {
    Ok(wait(&[(stop.as_fd(), PollFlags::IN)], Duration::ZERO)?[0])
}

/// Waits until one of some files is ready. Returns which are.
pub(crate) fn wait(files: &[(BorrowedFd<'_>, PollFlags)], most: Duration) -> Result<Vec<bool>> {
    let polled = files
        .iter()
        .map(|(file, flags)| PollFd::from_borrowed_fd(*file, *flags));
    let mut polled: Vec<_> = polled.collect();
    let timeout = Timespec {
        tv_sec: most.as_secs().cast_signed(),
        tv_nsec: most.subsec_nanos().into(),
    };
    match poll(&mut polled, Some(&timeout)) {
        Ok(_) | Err(Errno::INTR) => {}
        Err(error) => return Err(error).context("cannot wait"),
    }
    Ok(polled
        .iter()
        .map(|file| !file.revents().is_empty())
        .collect())
}
