//! A pseudo-terminal for the sender, and all that passes between it and the machine.
//!
//! One thread moves the bytes both ways as soon as they come, to the sender by whole lines, tells the
//! account of them, and keeps them for the log.

use std::{
    collections::VecDeque,
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
use simulation::pty::{Link, Pty};

use super::{account::Account, damage::Damage};

/// Longest wait for bytes before it is looked whether the tap is to end.
const WAIT: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 20_000_000,
};

/// Which way bytes went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    ToMachine,
    FromMachine,
}

/// Bytes that passed, and when.
#[derive(Clone)]
struct Passed {
    at: Duration,
    direction: Direction,
    bytes: Vec<u8>,
}

impl Passed {
    /// As text: the time in s, the way, the bytes.
    fn line(&self) -> String {
        let direction = match self.direction {
            Direction::ToMachine => '>',
            Direction::FromMachine => '<',
        };
        let (at_s, bytes) = (self.at.as_secs_f64(), self.bytes.escape_ascii());
        format!("{at_s:9.4} {direction} {bytes}")
    }
}

/// What the tap has seen.
pub(super) struct Traffic {
    pub(super) account: Box<dyn Account>,
    passed: Vec<Passed>,
}

/// The two ends of the line; dropping it ends the thread.
pub(super) struct Tap {
    seen: Arc<Mutex<Traffic>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<()>>>,
    _link: Link,
}

impl Tap {
    /// Opens a terminal at `path` for the sender, on the line to a machine. Lines may be damaged: the
    /// account is told what the machine gets and says.
    pub(super) fn open(
        path: &Path,
        machine: OwnedFd,
        account: Box<dyn Account>,
        mut damage: Option<Damage>,
    ) -> Result<Self> {
        let (pty, link) = Pty::at(path)?;
        let flags = rustix::fs::fcntl_getfl(&machine)?;
        rustix::fs::fcntl_setfl(&machine, flags | OFlags::NONBLOCK)?;
        let seen = Arc::new(Mutex::new(Traffic::new(account)));
        let is_over = Arc::new(AtomicBool::new(false));
        let thread = {
            let (seen, is_over) = (seen.clone(), is_over.clone());
            thread::spawn(move || {
                let ends = (pty.controller(), machine.as_fd());
                carry(ends, &seen, damage.as_mut(), &is_over)
            })
        };
        Ok(Self {
            seen,
            is_over,
            thread: Some(thread),
            _link: link,
        })
    }

    /// What has passed so far.
    pub(super) fn seen(&self) -> MutexGuard<'_, Traffic> {
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

impl Traffic {
    fn new(account: Box<dyn Account>) -> Self {
        Self {
            account,
            passed: Vec::new(),
        }
    }

    fn take_note(&mut self, at: Duration, direction: Direction, bytes: &[u8]) {
        match direction {
            Direction::ToMachine => self.account.sent(bytes),
            Direction::FromMachine => self.account.received(bytes),
        }
        self.passed.push(Passed {
            at,
            direction,
            bytes: bytes.to_vec(),
        });
    }

    /// Writes all that passed, one chunk per line.
    pub(super) fn write_log(&self, path: &Path) -> Result<()> {
        let mut text = String::new();
        for passed in &self.passed {
            writeln!(text, "{}", passed.line()).context("text can be written")?;
        }
        fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
    }

    /// The last lines that passed, the oldest first; a line that came in pieces is joined.
    pub(super) fn last(&self, count: usize) -> Vec<String> {
        let mut lines: VecDeque<Passed> = VecDeque::new();
        for passed in self.passed.iter().rev() {
            let are_enough = lines.len() == count;
            match lines.front_mut() {
                Some(next)
                    if next.direction == passed.direction && !passed.bytes.ends_with(b"\n") =>
                {
                    next.at = passed.at;
                    next.bytes.splice(0..0, passed.bytes.iter().copied());
                }
                _ if are_enough => break,
                _ => lines.push_front(passed.clone()),
            }
        }
        lines.iter().map(Passed::line).collect()
    }
}

/// Moves bytes until it is told to end; to the sender, line by line.
///
/// A machine that a busy host has stopped within a line is silent as no serial line is. bCNC takes what
/// comes before a tenth of a second of silence for a line.
fn carry(
    (sender, machine): (impl AsFd, impl AsFd),
    seen: &Mutex<Traffic>,
    mut damage: Option<&mut Damage>,
    is_over: &AtomicBool,
) -> Result<()> {
    let start = Instant::now();
    let (mut to_machine, mut to_sender) = (Vec::new(), Vec::new());
    let mut chunk = [0; 1024];
    let mut is_done = false;
    while !is_done {
        // What has come before the end still counts.
        is_done = is_over.load(Ordering::Relaxed);
        let flags = |ready| {
            let out = if ready == 0 {
                PollFlags::empty()
            } else {
                PollFlags::OUT
            };
            PollFlags::IN | out
        };
        let mut ends = [
            PollFd::new(&sender, flags(whole_lines(&to_sender))),
            PollFd::new(&machine, flags(to_machine.len())),
        ];
        match rustix::event::poll(&mut ends, Some(&WAIT)) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(error).context("cannot wait for bytes"),
        }
        for (direction, from, waiting) in [
            (Direction::ToMachine, sender.as_fd(), &mut to_machine),
            (Direction::FromMachine, machine.as_fd(), &mut to_sender),
        ] {
            let length = moved(rustix::io::read(from, &mut chunk))?;
            if length > 0 {
                is_done = false;
                let bytes = match (&mut damage, direction) {
                    (Some(damage), Direction::ToMachine) => damage.sent(&chunk[..length]),
                    _ => chunk[..length].to_vec(),
                };
                let mut seen = seen.lock().unwrap_or_else(PoisonError::into_inner);
                seen.take_note(start.elapsed(), direction, &bytes);
                drop(seen);
                match (&mut damage, direction) {
                    (Some(damage), Direction::FromMachine) => damage.received(&bytes, waiting),
                    _ => waiting.extend(bytes),
                }
            }
        }
        let (all, whole) = (to_machine.len(), whole_lines(&to_sender));
        for (to, waiting, ready) in [
            (machine.as_fd(), &mut to_machine, all),
            (sender.as_fd(), &mut to_sender, whole),
        ] {
            if ready > 0 {
                let length = moved(rustix::io::write(to, &waiting[..ready]))?;
                waiting.drain(..length);
            }
        }
    }
    Ok(())
}

/// How many bytes the whole lines are that wait.
fn whole_lines(waiting: &[u8]) -> usize {
    let end = waiting.iter().rposition(|byte| *byte == b'\n');
    end.map_or(0, |end| end + 1)
}

/// How many bytes went; none when the other end is not ready.
fn moved(result: rustix::io::Result<usize>) -> Result<usize> {
    match result {
        Ok(length) => Ok(length),
        Err(Errno::AGAIN | Errno::INTR) => Ok(0),
        Err(error) => Err(error).context("the line is broken"),
    }
}

#[cfg(test)]
mod tests {
    use super::{super::grbl::Grbl, *};

    #[test]
    fn the_last_lines_are_reported_with_their_pieces_together() {
        let mut seen = Traffic::new(Box::<Grbl>::default());
        for (ms, direction, bytes) in [
            (1, Direction::ToMachine, "G0\n"),
            (2, Direction::FromMachine, "o"),
            (3, Direction::FromMachine, "k\r\n"),
            (4, Direction::ToMachine, "?"),
            (5, Direction::FromMachine, "<Id"),
            (6, Direction::FromMachine, "le"),
        ] {
            seen.take_note(Duration::from_millis(ms), direction, bytes.as_bytes());
        }
        let last = seen.last(3);
        assert_eq!(
            last,
            ["   0.0020 < ok\\r\\n", "   0.0040 > ?", "   0.0050 < <Idle"]
        );
        assert_eq!(seen.last(9).len(), 4);
    }
    #[test]
    fn only_whole_lines_go_on() {
        assert_eq!(whole_lines(b""), 0);
        assert_eq!(whole_lines(b"<Idle|MPos:0."), 0);
        assert_eq!(whole_lines(b"ok\r\nok\r\n<Id"), 8);
    }
}
