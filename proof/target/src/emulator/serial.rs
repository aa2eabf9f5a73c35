//! The emulator's serial line, which a thread reads at all times.
//!
//! QEMU 7.2 waits for room for each byte that the emulated port sends: in the middle of the
//! instruction, and with the lock that its other threads need. As long as it waits it hears neither
//! debuggers nor its own protocol. There is room for 278 bytes that nobody has read, as the socket
//! counts each of them as a message of 768 bytes: for less than the firmware says at its start.

use std::{
    io::{self, ErrorKind, Read, Write},
    os::{fd::OwnedFd, unix::net::UnixStream},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
        mpsc::{self, Receiver, RecvTimeoutError, Sender},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail, ensure};
use grbl_client::Lines;

/// How long QEMU may take to take bytes.
const TIMEOUT: Duration = Duration::from_secs(20);
/// Longest wait for bytes before checking whether the line was handed over.
const WAIT: Duration = Duration::from_millis(20);

/// See the module.
pub(super) struct Serial {
    stream: UnixStream,
    arrived: Receiver<io::Result<Vec<u8>>>,
    lines: Lines,
    is_over: Arc<AtomicBool>,
    reader: Option<JoinHandle<()>>,
}

impl Serial {
    /// Begins to read what QEMU sends.
    pub(super) fn new(stream: UnixStream) -> Result<Self> {
        stream.set_write_timeout(Some(TIMEOUT))?;
        stream.set_read_timeout(Some(WAIT))?;
        let (sender, arrived) = mpsc::channel();
        let is_over = Arc::new(AtomicBool::new(false));
        let (from, until) = (stream.try_clone()?, is_over.clone());
        let reader = thread::spawn(move || read(from, &sender, &until));
        Ok(Self {
            stream,
            arrived,
            lines: Lines::default(),
            is_over,
            reader: Some(reader),
        })
    }

    /// Sends bytes.
    pub(super) fn send(&mut self, bytes: &[u8]) -> Result<()> {
        let sent = self.stream.write_all(bytes);
        sent.context("the emulator's serial line is closed")
    }

    /// Receives a line, without its end; `None` when none has come in time.
    pub(super) fn receive(&mut self, patience: Duration) -> Result<Option<String>> {
        let end = Instant::now() + patience;
        loop {
            let line = self.lines.next_line();
            if line.is_some() {
                return Ok(line);
            }
            let left = end.saturating_duration_since(Instant::now());
            match self.arrived.recv_timeout(left) {
                Ok(bytes) => {
                    let bytes = bytes.context("the emulator's serial line is broken")?;
                    self.lines.push(&bytes);
                }
                Err(RecvTimeoutError::Timeout) => return Ok(None),
                Err(RecvTimeoutError::Disconnected) => bail!("QEMU has ended"),
            }
        }
    }

    /// Gives the line to another, who has to read it at all times.
    pub(super) fn hand_over(&mut self) -> Result<OwnedFd> {
        self.is_over.store(true, Relaxed);
        if let Some(reader) = self.reader.take() {
            reader.join().expect("the reader does not panic");
        }
        ensure!(
            self.lines.is_empty() && self.arrived.try_recv().is_err(),
            "bytes of the firmware would be lost"
        );
        self.stream.set_read_timeout(None)?;
        let line = self.stream.try_clone();
        Ok(line.context("the serial line cannot be shared")?.into())
    }
}

/// Reads until QEMU ends, or until it is over.
fn read(mut from: UnixStream, arrived: &Sender<io::Result<Vec<u8>>>, is_over: &AtomicBool) {
    let mut chunk = [0; 1024];
    while !is_over.load(Relaxed) {
        let taken = match from.read(&mut chunk) {
            Ok(0) => return,
            Ok(length) => Ok(chunk[..length].to_vec()),
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => continue,
                _ => Err(error),
            },
        };
        let is_broken = taken.is_err();
        if arrived.send(taken).is_err() || is_broken {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line() -> (UnixStream, Serial) {
        let (qemu, ours) = UnixStream::pair().unwrap();
        qemu.set_write_timeout(Some(TIMEOUT)).unwrap();
        (qemu, Serial::new(ours).unwrap())
    }

    #[test]
    fn qemu_never_waits_until_its_bytes_are_asked_for() {
        const LINES: usize = 1000;
        let (mut qemu, mut serial) = line();
        for byte in b"[MSG:hello]\r\n".repeat(LINES) {
            qemu.write_all(&[byte]).unwrap();
        }
        for _ in 0..LINES {
            let line = serial.receive(TIMEOUT).unwrap();
            assert_eq!(line.as_deref(), Some("[MSG:hello]"));
        }
        assert_eq!(serial.receive(Duration::ZERO).unwrap(), None);
    }

    #[test]
    fn what_came_before_the_end_of_qemu_is_received() {
        let (mut qemu, mut serial) = line();
        qemu.write_all(b"ok\r\nAL").unwrap();
        drop(qemu);
        assert_eq!(serial.receive(TIMEOUT).unwrap().as_deref(), Some("ok"));
        let end = serial.receive(TIMEOUT).unwrap_err();
        assert_eq!(end.to_string(), "QEMU has ended");
    }

    #[test]
    fn the_line_is_another_s_when_it_is_handed_over() {
        let (mut qemu, mut serial) = line();
        qemu.write_all(b"ok\r\n").unwrap();
        serial.receive(TIMEOUT).unwrap();
        let mut theirs = UnixStream::from(serial.hand_over().unwrap());
        qemu.write_all(b"<Idle>").unwrap();
        let mut bytes = [0; 6];
        theirs.read_exact(&mut bytes).unwrap();
        assert_eq!(&bytes, b"<Idle>");
    }

    #[test]
    fn a_line_with_unread_bytes_is_not_handed_over() {
        let (mut qemu, mut serial) = line();
        qemu.write_all(b"ok\r\n<Idle").unwrap();
        serial.receive(TIMEOUT).unwrap();
        assert!(serial.hand_over().is_err());
    }
}
