//! The virtual machine in real time, behind a pseudo-terminal, a TCP port or USB/IP.

mod record;
mod tcp;
mod terminal;
#[cfg(test)]
mod tests;
mod usbip;

use std::{
    os::{fd::BorrowedFd, unix::net::UnixStream},
    path::Path,
    time::{Duration, Instant},
};

use anyhow::{Context, Result};
use leadscrew::sim::Simulator;
use rustix::{
    event::{PollFd, PollFlags, Timespec, poll},
    io::Errno,
};
use simulation::{figures::Figures, machine::Machine, play::Recorder};

use self::record::Record;

pub(crate) use tcp::Tcp;
pub(crate) use terminal::Terminal;
pub(crate) use usbip::UsbIp;

/// How often a moving machine is run at most.
const PERIOD: Duration = Duration::from_millis(1);
/// Bytes that wait for the machine at most; then the sender waits, as with flow control.
const MAX_QUEUED_BYTES: usize = 4096;
/// Bytes that wait for the sender at most, as many as operating systems keep.
const MAX_UNREAD_BYTES: usize = 65_536;

/// The other end of the line.
pub(crate) trait Port {
    /// Returns the line, which never makes a program wait, if somebody is connected.
    fn line(&self) -> Option<BorrowedFd<'_>>;
    /// Returns what becomes readable when somebody wants to connect.
    fn door(&self) -> Option<BorrowedFd<'_>> {
        None
    }
    /// Lets those in who want to connect, or refuses them. Returns the bytes that nobody has read yet of a sender that
    /// has left since the last time.
    fn open_door(&mut self) -> Option<Vec<u8>> {
        None
    }
    /// Returns whether the first bytes of whoever is connected are no sender's.
    fn refuses(&mut self, _first: &[u8]) -> bool {
        false
    }
    /// Forgets who was connected, and is gone.
    fn part(&mut self) {}
}

/// A machine that is served, and what is kept of it.
pub(crate) struct Server<'a, R> {
    machine: Machine,
    record: Record<'a, R>,
    start: Instant,
    unsent: Vec<u8>,
}

impl<'a, R: Recorder> Server<'a, R> {
    /// Serves a machine that has been switched on just now.
    pub(crate) fn new(simulator: Simulator, flash: Option<&'a Path>, recorder: &'a mut R) -> Self {
        let mut machine = Machine::amid(simulator, Vec::new());
        Self {
            record: Record::new(machine.flash(), flash, recorder),
            machine,
            start: Instant::now(),
            unsent: Vec::new(),
        }
    }

    /// Moves bytes and time until something is to be read from `stop`, and returns what was done.
    pub(crate) fn serve(mut self, port: &mut dyn Port, stop: &UnixStream) -> Result<Figures> {
        let mut chunk = [0; 1024];
        loop {
            while self.reads() {
                match port.line().map(|line| rustix::io::read(line, &mut chunk)) {
                    Some(Ok(length @ 1..)) if port.refuses(&chunk[..length]) => port.part(),
                    Some(Ok(length @ 1..)) => self.machine.send(&chunk[..length]),
                    None | Some(Err(Errno::AGAIN | Errno::INTR)) => break,
                    Some(Ok(0) | Err(_)) => {
                        port.part();
                        self.machine.end_begun_line();
                        break;
                    }
                }
            }
            if let Some(bytes) = port.open_door() {
                self.machine.send(&bytes);
                self.machine.end_begun_line();
            }
            self.run()?;
            if !self.unsent.is_empty() {
                match port
                    .line()
                    .map(|line| rustix::io::write(line, &self.unsent))
                {
                    Some(Ok(length)) => drop(self.unsent.drain(..length)),
                    Some(Err(Errno::AGAIN | Errno::INTR)) => {}
                    Some(Err(_)) => {
                        port.part();
                        self.machine.end_begun_line();
                    }
                    None => self.unsent.clear(),
                }
                // Nobody reads: what a serial line does with such bytes.
                self.unsent
                    .drain(..self.unsent.len().saturating_sub(MAX_UNREAD_BYTES));
            }
            if self.wait(port, stop)? {
                return Ok(self.record.finish(self.machine.simulator()));
            }
        }
    }

    fn reads(&self) -> bool {
        self.machine.on_the_line() < MAX_QUEUED_BYTES
    }

    /// Runs the machine until now.
    fn run(&mut self) -> Result<()> {
        let now_s = self.start.elapsed().as_secs_f64();
        let record = &mut self.record;
        self.machine
            .run_until_s(now_s, &mut |edge| record.edge(edge));
        self.record.keep(self.machine.flash())?;
        for (_, byte) in self.machine.take_bytes() {
            self.record.hear(byte);
            self.unsent.push(byte);
        }
        Ok(())
    }

    /// Waits until the machine or the port has something to do. Returns whether it is to stop.
    fn wait(&self, port: &dyn Port, stop: &UnixStream) -> Result<bool> {
        let mut fds = vec![PollFd::new(stop, PollFlags::IN)];
        let (reads, writes) = (self.reads(), !self.unsent.is_empty());
        let door = port
            .door()
            .filter(|_| reads)
            .map(|door| (door, PollFlags::IN));
        let wanted = [(reads, PollFlags::IN), (writes, PollFlags::OUT)];
        let wanted = wanted.into_iter().filter(|(is_wanted, _)| *is_wanted);
        let wanted: PollFlags = wanted.map(|(_, flag)| flag).collect();
        let line = port.line().filter(|_| !wanted.is_empty());
        let ports = door.into_iter().chain(line.map(|line| (line, wanted)));
        fds.extend(ports.map(|(fd, flags)| PollFd::from_borrowed_fd(fd, flags)));
        match poll(&mut fds, self.timeout().as_ref()) {
            Ok(_) => Ok(!fds[0].revents().is_empty()),
            Err(Errno::INTR) => Ok(false),
            Err(error) => Err(error).context("cannot wait for the line"),
        }
    }

    /// How long nothing happens in the machine by itself; `None` for as long as nobody asks for it.
    fn timeout(&self) -> Option<Timespec> {
        let due = Duration::from_secs_f64(self.machine.due_s()?);
        let wait = due.saturating_sub(self.start.elapsed()).max(PERIOD);
        Some(Timespec {
            tv_sec: wait.as_secs().cast_signed(),
            tv_nsec: wait.subsec_nanos().into(),
        })
    }
}
