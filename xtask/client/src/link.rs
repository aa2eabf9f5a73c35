//! The line to a machine: a serial port or a TCP address. Nothing here waits but what says so.

use std::{
    error::Error,
    fmt,
    os::{
        fd::{AsFd, BorrowedFd, OwnedFd},
        unix::net::UnixStream,
    },
    path::Path,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, anyhow, bail, ensure};
pub use rustix::event::PollFlags;
use rustix::{
    event::{PollFd, Timespec, poll},
    fs::OFlags,
    io::Errno,
};

use crate::{Lines, port};

/// How long a machine may take no bytes.
const WRITE: Duration = Duration::from_secs(10);
/// How often it is looked whether it takes some.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// The other end has gone: the port has been unplugged, the connection has ended.
#[derive(Debug)]
pub struct LinkLost(String);

impl fmt::Display for LinkLost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} has gone", self.0)
    }
}

/// A wait was ended from outside, as by Ctrl-C.
#[derive(Debug)]
pub struct Stopped;

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("it was stopped")
    }
}

impl Error for Stopped {}

/// A line to a machine.
pub struct Link {
    line: OwnedFd,
    lines: Lines,
    /// The port or the address, as the user has named it.
    pub name: String,
    /// What may be wrong where nothing answers.
    pub hint: String,
}

impl AsFd for Link {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.line.as_fd()
    }
}

impl Link {
    /// Opens a serial port, which no other program may have open, or connects to a TCP address.
    ///
    /// # Errors
    /// Neither is given, or it cannot be had.
    pub fn open(
        port: Option<&Path>,
        baud: u32,
        address: Option<&str>,
        timeout: Duration,
    ) -> Result<Self> {
        match (port, address) {
            (Some(path), _) => {
                let port = port::serial(path, baud)?;
                let hint = format!("is it switched on, and is {baud} its baud rate?");
                Self::over(&port, path.display().to_string(), hint)
            }
            (None, Some(address)) => {
                let stream = port::tcp(address, timeout)?;
                let hint = "does it serve another sender?".into();
                Self::over(&stream, address.into(), hint)
            }
            (None, None) => bail!("neither a port nor an address is given"),
        }
    }

    /// Talks over a file that is open, such as a terminal's.
    ///
    /// # Errors
    /// It cannot be told not to wait.
    pub fn over(file: &impl AsFd, name: String, hint: String) -> Result<Self> {
        let own = || {
            // The lock of a port is that of its description, which both share.
            let line = file.as_fd().try_clone_to_owned()?;
            let flags = rustix::fs::fcntl_getfl(&line)?;
            rustix::fs::fcntl_setfl(&line, flags | OFlags::NONBLOCK)?;
            std::io::Result::Ok(line)
        };
        Ok(Self {
            line: own().with_context(|| format!("cannot use {name}"))?,
            lines: Lines::default(),
            name,
            hint,
        })
    }

    /// Reads bytes that have come. Returns how many.
    ///
    /// # Errors
    /// [`LinkLost`].
    pub fn read(&self, chunk: &mut [u8]) -> Result<usize> {
        let length = self.moved(rustix::io::read(&self.line, chunk))?;
        let ended = || anyhow!("the connection has ended").context(self.lost());
        length.map_or(Ok(0), |length| {
            if length == 0 {
                Err(ended())
            } else {
                Ok(length)
            }
        })
    }

    /// Writes the bytes for which there is room, and takes them away.
    ///
    /// # Errors
    /// [`LinkLost`].
    pub fn write(&self, waiting: &mut Vec<u8>) -> Result<()> {
        let length = self.moved(rustix::io::write(&self.line, waiting))?;
        waiting.drain(..length.unwrap_or_default());
        Ok(())
    }

    /// Sends bytes; waits while the machine takes none.
    ///
    /// # Errors
    /// [`LinkLost`], or it takes nothing for 10 s.
    pub fn send(&self, bytes: &[u8]) -> Result<()> {
        let mut waiting = bytes.to_vec();
        let mut since = Instant::now();
        while !waiting.is_empty() {
            let before = waiting.len();
            self.write(&mut waiting)?;
            if waiting.len() < before {
                since = Instant::now();
                continue;
            }
            let (name, hint) = (&self.name, &self.hint);
            ensure!(since.elapsed() < WRITE, "{name} takes nothing: {hint}");
            wait(&[(self.as_fd(), PollFlags::OUT)], POLL_INTERVAL)?;
        }
        Ok(())
    }

    /// Takes what has come: for [`line`](Self::line).
    ///
    /// # Errors
    /// [`LinkLost`], or what comes is no text.
    pub fn receive(&mut self) -> Result<()> {
        let mut chunk = [0; 1024];
        loop {
            let length = self.read(&mut chunk)?;
            if length == 0 {
                break;
            }
            self.lines.push(&chunk[..length]);
        }
        let (name, hint) = (&self.name, &self.hint);
        ensure!(
            !self.lines.is_too_long(),
            "{name} sends what is no text: {hint}"
        );
        Ok(())
    }

    /// The next line of what has been taken, without its end and without blanks around it.
    ///
    /// # Errors
    /// The machine serves another.
    pub fn line(&mut self) -> Result<Option<String>> {
        let line = self.lines.next_line().map(|line| line.trim().to_owned());
        line.iter().try_for_each(|line| self.ensure_is_free(line))?;
        Ok(line)
    }

    /// Waits for the next line; none when none is complete in time.
    ///
    /// # Errors
    /// Something is to be read from `stop`: [`Stopped`]. The machine serves another, or [`LinkLost`].
    pub fn wait_for_line(
        &mut self,
        most: Duration,
        stop: Option<&UnixStream>,
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
            let mut files = vec![(self.as_fd(), PollFlags::IN)];
            files.extend(stop.map(|stop| (stop.as_fd(), PollFlags::IN)));
            ensure!(wait(&files, end - now)?.get(1) != Some(&true), Stopped);
            self.receive()?;
        }
    }

    /// Takes a line by which the simulator, which serves one sender at a time, refuses another.
    ///
    /// # Errors
    /// It is one.
    pub fn ensure_is_free(&self, line: &str) -> Result<()> {
        match line.strip_prefix("[MSG:In use by ") {
            Some(holder) => bail!(
                "{} is in use by {}",
                self.name,
                holder.trim_end_matches(']')
            ),
            None => Ok(()),
        }
    }

    fn lost(&self) -> LinkLost {
        LinkLost(self.name.clone())
    }

    /// How many bytes went; none when the other end is not ready.
    fn moved(&self, result: rustix::io::Result<usize>) -> Result<Option<usize>> {
        match result {
            Ok(length) => Ok(Some(length)),
            Err(Errno::AGAIN | Errno::INTR) => Ok(None),
            Err(error) => Err(error).with_context(|| self.lost()),
        }
    }
}

/// Whether something is to be read from a file that tells to stop.
///
/// # Errors
/// The file cannot be polled.
pub fn is_stopped(stop: &UnixStream) -> Result<bool> {
    Ok(wait(&[(stop.as_fd(), PollFlags::IN)], Duration::ZERO)?[0])
}

/// Waits until one of some files is ready. Returns which are.
///
/// # Errors
/// They cannot be polled.
pub fn wait(files: &[(BorrowedFd<'_>, PollFlags)], most: Duration) -> Result<Vec<bool>> {
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

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn link() -> (Link, UnixStream) {
        let (own, other) = UnixStream::pair().unwrap();
        let link = Link::over(&own, "here".into(), "is it there?".into()).unwrap();
        (link, other)
    }

    #[test]
    fn lines_come_until_the_other_end_has_gone() {
        let (mut link, mut other) = link();
        let short = Duration::from_millis(1);
        assert_eq!(link.wait_for_line(short, None).unwrap(), None);
        other.write_all(b" ok \r\nhal").unwrap();
        assert_eq!(link.wait_for_line(short, None).unwrap().unwrap(), "ok");
        assert_eq!(link.wait_for_line(short, None).unwrap(), None);
        drop(other);
        let error = link.wait_for_line(short, None).unwrap_err();
        assert!(error.is::<LinkLost>());
        assert_eq!(
            format!("{error:#}"),
            "here has gone: the connection has ended"
        );
        assert!(link.send(b"?").unwrap_err().is::<LinkLost>());
    }

    #[test]
    fn a_wait_can_be_stopped_and_noise_ends_it() {
        let (mut link, mut other) = link();
        let (stop, mut stopper) = UnixStream::pair().unwrap();
        assert!(!is_stopped(&stop).unwrap());
        stopper.write_all(b"x").unwrap();
        let error = link.wait_for_line(WRITE, Some(&stop)).unwrap_err();
        assert!(error.is::<Stopped>() && is_stopped(&stop).unwrap());
        other.write_all(&[b'x'; 5000]).unwrap();
        let error = link.wait_for_line(WRITE, None).unwrap_err().to_string();
        assert_eq!(error, "here sends what is no text: is it there?");
    }

    #[test]
    fn a_machine_that_serves_another_is_reported() {
        let (mut link, mut other) = link();
        other.write_all(b"[MSG:In use by process 7]\r\n").unwrap();
        let error = link.wait_for_line(WRITE, None).unwrap_err().to_string();
        assert_eq!(error, "here is in use by process 7");
    }
}
