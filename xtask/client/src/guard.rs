//! A process beside a tool that streams a program: it holds the machine when the tool is killed.
//!
//! Without the hold, a machine would execute what it has been sent, and stand still with its spindle on.

use std::{
    env, io,
    io::{Read as _, Write as _},
    os::{fd::AsFd, unix::process::CommandExt as _},
    process::{self, Child, Command, Stdio},
    sync::Arc,
    time::{Duration, Instant},
};

use anyhow::{Context as _, Result};
use rustix::{event::PollFlags, io::Errno};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};

use crate::{Link, link, realtime};

/// The argument with which a tool starts itself as a guard.
const ARGUMENT: &str = "guard-of-a-job";
/// What a guard reads before the end of its input where the machine is to be left alone.
const DISMISSED: &[u8] = b"dismissed";
/// How long a line that takes no bytes is tried.
const PATIENCE: Duration = Duration::from_secs(10);
/// How long the other end of a connection may take for the hold.
const LINGER: Duration = Duration::from_secs(2);

/// The guard of a job. Dropped before it is [dismissed](Self::dismiss), it holds the machine.
#[derive(Debug)]
pub struct JobGuard(Child);

impl JobGuard {
    /// Begins to guard what is sent over a line.
    ///
    /// # Errors
    /// There can be no further process.
    pub fn of(link: &Link) -> Result<Self> {
        let start = || {
            Command::new(env::current_exe()?)
                .arg(ARGUMENT)
                .stdin(Stdio::piped())
                .stdout(link.as_fd().try_clone_to_owned()?)
                .stderr(Stdio::null())
                // What a terminal sends to the tool, such as Ctrl-C, is not for the guard.
                .process_group(0)
                .spawn()
        };
        start()
            .map(Self)
            .context("cannot start what holds the machine if this program is killed")
    }

    /// Ends the guard and leaves the machine alone: the job is over, or has been stopped.
    pub fn dismiss(&mut self) {
        if let Some(mut input) = self.0.stdin.take() {
            let _ = input.write_all(DISMISSED);
        }
    }
}

impl JobGuard {
    /// Holds the machine now; returns whether the hold has been sent.
    #[must_use]
    pub fn hold(mut self) -> bool {
        drop(self.0.stdin.take());
        self.0.wait().is_ok_and(|status| status.success())
    }
}

impl Drop for JobGuard {
    fn drop(&mut self) {
        drop(self.0.stdin.take());
        let _ = self.0.wait();
    }
}

/// Makes the process a guard, if it was started as one, and does not return then: for the beginning of a program that
/// uses [`JobGuard`].
pub fn become_guard_if_asked() {
    if env::args_os().nth(1).is_none_or(|word| word != ARGUMENT) {
        return;
    }
    // Whoever ends all programs of the tool's name means the tool.
    for signal in [SIGHUP, SIGINT, SIGQUIT, SIGTERM] {
        let _ = signal_hook::flag::register(signal, Arc::default());
    }
    let mut word = Vec::new();
    let _ = io::stdin().read_to_end(&mut word);
    let is_done = word == DISMISSED || hold();
    process::exit(i32::from(!is_done));
}

/// Sends the hold, as soon as the line takes a byte. Returns whether the byte has gone.
fn hold() -> bool {
    let line = io::stdout();
    let since = Instant::now();
    while since.elapsed() < PATIENCE {
        match rustix::io::write(&line, &[realtime::HOLD]) {
            Ok(1) => {
                linger(&line);
                return true;
            }
            Ok(_) | Err(Errno::AGAIN | Errno::INTR) => {
                let _ = link::wait(&[(line.as_fd(), PollFlags::OUT)], PATIENCE);
            }
            Err(_) => return false,
        }
    }
    false
}

/// Reads on until the other end has taken the hold: a connection that is closed with unread bytes is reset, and what was
/// on its way is lost.
fn linger(line: &impl AsFd) {
    if rustix::net::shutdown(line, rustix::net::Shutdown::Write).is_err() {
        // No connection, but a serial port.
        return;
    }
    let since = Instant::now();
    while since.elapsed() < LINGER {
        let _ = link::wait(&[(line.as_fd(), PollFlags::IN)], LINGER);
        match rustix::io::read(line, &mut [0; 256]) {
            Ok(1..) | Err(Errno::AGAIN | Errno::INTR) => {}
            _ => return,
        }
    }
}
