//! How long QEMU is waited for: by the time that it could have used.
//!
//! On a busy machine QEMU waits for a processor, for as long as others want it. That time does not count.

use std::{
    fs,
    io::{self, ErrorKind, Read},
    os::unix::net::UnixStream,
    time::{Duration, Instant},
};

/// Time between two checks of the patience.
const CHECK_INTERVAL: Duration = Duration::from_millis(500);

/// A limit to the time that a process takes.
#[derive(Debug, Clone, Copy)]
pub struct Patience {
    process: u32,
    limit: Duration,
    start: Instant,
    /// How long it had waited for a processor at the start.
    starved: Duration,
}

impl Patience {
    /// Begins to wait for a process.
    pub fn new(process: u32, limit: Duration) -> Self {
        Self {
            process,
            limit,
            start: Instant::now(),
            starved: starved(process),
        }
    }

    /// Begins anew: the process has done something.
    pub fn restart(&mut self) {
        *self = Self::new(self.process, self.limit);
    }

    /// Returns what is left of the time.
    pub fn left(&self) -> Duration {
        let starved = starved(self.process).saturating_sub(self.starved);
        left(self.limit, self.start.elapsed(), starved)
    }

    /// Returns whether the process has taken longer.
    pub fn is_over(&self) -> bool {
        self.left().is_zero()
    }
}

fn left(limit: Duration, elapsed: Duration, starved: Duration) -> Duration {
    (limit + starved).saturating_sub(elapsed)
}

/// Returns how long the threads of a process have waited for a processor so far; where the system does
/// not tell, nothing.
fn starved(process: u32) -> Duration {
    let threads = fs::read_dir(format!("/proc/{process}/task"));
    let threads = threads.into_iter().flatten().flatten();
    let statistics =
        threads.filter_map(|thread| fs::read_to_string(thread.path().join("schedstat")).ok());
    statistics.filter_map(|text| waited(&text)).sum()
}

/// Reads the second of the statistics: time on a queue for a processor, ns.
fn waited(statistics: &str) -> Option<Duration> {
    let nanoseconds = statistics.split_whitespace().nth(1)?.parse().ok()?;
    Some(Duration::from_nanos(nanoseconds))
}

/// A connection to a process that is read with patience.
#[derive(Debug)]
pub(crate) struct Patient {
    pub(crate) stream: UnixStream,
    process: u32,
    limit: Duration,
}

impl Patient {
    pub(crate) fn new(stream: UnixStream, process: u32, limit: Duration) -> io::Result<Self> {
        stream.set_read_timeout(Some(CHECK_INTERVAL.min(limit)))?;
        stream.set_write_timeout(Some(limit))?;
        Ok(Self {
            stream,
            process,
            limit,
        })
    }
}

impl Read for Patient {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let mut patience = None;
        loop {
            let read = self.stream.read(bytes);
            let is_silent = matches!(&read, Err(error) if error.kind() == ErrorKind::WouldBlock);
            let begun = || Patience::new(self.process, self.limit);
            if !is_silent || patience.get_or_insert_with(begun).is_over() {
                return read;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::{io::Write as _, process};

    use super::*;

    #[test]
    fn a_wait_for_a_processor_does_not_count() {
        let seconds = Duration::from_secs;
        assert_eq!(left(seconds(20), seconds(5), seconds(0)), seconds(15));
        assert_eq!(left(seconds(20), seconds(300), seconds(290)), seconds(10));
        assert_eq!(left(seconds(20), seconds(300), seconds(1)), seconds(0));
        assert_eq!(
            waited("794920 5882728 3\n"),
            Some(Duration::from_nanos(5_882_728))
        );
        assert_eq!(waited(""), None);
        assert_eq!(starved(u32::MAX), seconds(0));
    }

    #[test]
    fn who_says_nothing_is_given_up_and_who_speaks_is_heard() {
        let (mut theirs, ours) = UnixStream::pair().unwrap();
        let limit = Duration::from_millis(1);
        let mut patient = Patient::new(ours, process::id(), limit).unwrap();
        let error = patient.read(&mut [0]).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::WouldBlock);
        theirs.write_all(b"1").unwrap();
        assert_eq!(patient.read(&mut [0]).unwrap(), 1);
    }
}
