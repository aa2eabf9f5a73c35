//! A pseudo-terminal for the sender, and all that passes between it and the machine.
//!
//! One thread moves the bytes both ways as soon as they come, tells the account of them, and keeps
//! them for the log.

use std::{
    fmt::Write as _,
    fs,
    os::fd::{AsFd, OwnedFd},
    path::Path,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use anyhow::{Context, Result};
use rustix::{
    event::{PollFd, PollFlags, Timespec},
    fs::OFlags,
    io::Errno,
};

use super::account::Account;
use crate::serve::{Link, Pty};

/// Longest wait for bytes before it is looked whether the tap is to end.
const WAIT: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 20_000_000,
};

/// Which way bytes went.
#[derive(Debug, Clone, Copy)]
enum Way {
    ToMachine,
    FromMachine,
}

/// Bytes that passed, and when.
struct Passed {
    at: Duration,
    way: Way,
    bytes: Vec<u8>,
}

/// What the tap has seen.
#[derive(Default)]
pub(super) struct Seen {
    pub(super) account: Account,
    passed: Vec<Passed>,
}

/// The two ends of the line; dropping it ends the thread.
pub(super) struct Tap {
    seen: Arc<Mutex<Seen>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<()>>>,
    _link: Link,
}

impl Tap {
    /// Opens a terminal at `path` for the sender, on the line to a machine.
    pub(super) fn open(path: &Path, machine: OwnedFd) -> Result<Self> {
        let (pty, link) = Pty::at(path)?;
        let flags = rustix::fs::fcntl_getfl(&machine)?;
        rustix::fs::fcntl_setfl(&machine, flags | OFlags::NONBLOCK)?;
        let seen = Arc::new(Mutex::new(Seen::default()));
        let is_over = Arc::new(AtomicBool::new(false));
        let thread = {
            let (seen, is_over) = (seen.clone(), is_over.clone());
            thread::spawn(move || carry(pty.controller(), machine.as_fd(), &seen, &is_over))
        };
        Ok(Self {
            seen,
            is_over,
            thread: Some(thread),
            _link: link,
        })
    }

    /// What has passed so far.
    pub(super) fn seen(&self) -> MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends the thread, and tells whether the line was whole until then.
    pub(super) fn close(&mut self) -> Result<()> {
        self.is_over.store(true, Ordering::Relaxed);
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(_)) => anyhow::bail!("the tap has panicked"),
            None => Ok(()),
        }
    }
}

impl Drop for Tap {
    fn drop(&mut self) {
        let _ = self.close();
    }
}

impl Seen {
    fn take_note(&mut self, at: Duration, way: Way, bytes: &[u8]) {
        match way {
            Way::ToMachine => self.account.sent(bytes),
            Way::FromMachine => self.account.received(bytes),
        }
        self.passed.push(Passed {
            at,
            way,
            bytes: bytes.to_vec(),
        });
    }

    /// Writes all that passed, one chunk per line.
    pub(super) fn write_log(&self, path: &Path) -> Result<()> {
        let mut text = String::new();
        for passed in &self.passed {
            let way = match passed.way {
                Way::ToMachine => '>',
                Way::FromMachine => '<',
            };
            let (at_s, bytes) = (passed.at.as_secs_f64(), passed.bytes.escape_ascii());
            writeln!(text, "{at_s:9.4} {way} {bytes}").context("text can be written")?;
        }
        fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
    }
}

/// Moves bytes until it is told to end.
fn carry(
    sender: impl AsFd,
    machine: impl AsFd,
    seen: &Mutex<Seen>,
    is_over: &AtomicBool,
) -> Result<()> {
    let start = Instant::now();
    let (mut to_machine, mut to_sender) = (Vec::new(), Vec::new());
    let mut chunk = [0; 1024];
    while !is_over.load(Ordering::Relaxed) {
        let flags = |waiting: &Vec<u8>| {
            let out = if waiting.is_empty() {
                PollFlags::empty()
            } else {
                PollFlags::OUT
            };
            PollFlags::IN | out
        };
        let mut ends = [
            PollFd::new(&sender, flags(&to_sender)),
            PollFd::new(&machine, flags(&to_machine)),
        ];
        match rustix::event::poll(&mut ends, Some(&WAIT)) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(error).context("cannot wait for bytes"),
        }
        for (way, from, waiting) in [
            (Way::ToMachine, sender.as_fd(), &mut to_machine),
            (Way::FromMachine, machine.as_fd(), &mut to_sender),
        ] {
            let length = moved(rustix::io::read(from, &mut chunk))?;
            if length > 0 {
                let mut seen = seen.lock().unwrap_or_else(PoisonError::into_inner);
                seen.take_note(start.elapsed(), way, &chunk[..length]);
                waiting.extend(&chunk[..length]);
            }
        }
        for (to, waiting) in [
            (machine.as_fd(), &mut to_machine),
            (sender.as_fd(), &mut to_sender),
        ] {
            if !waiting.is_empty() {
                let length = moved(rustix::io::write(to, waiting))?;
                waiting.drain(..length);
            }
        }
    }
    Ok(())
}

/// How many bytes went; none when the other end is not ready.
fn moved(result: rustix::io::Result<usize>) -> Result<usize> {
    match result {
        Ok(length) => Ok(length),
        Err(Errno::AGAIN | Errno::INTR) => Ok(0),
        Err(error) => Err(error).context("the line is broken"),
    }
}
