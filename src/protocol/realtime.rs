//! Realtime bytes: taken out of the stream by the receive interrupt, never part of a line.
//!
//! Owned by `serial_rx`, which stores; every other task only reads or takes. A byte costs O(1) and
//! may stand inside a line. Read with Grbl 1.1 `serial.c` and the table of realtime commands.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use heapless::spsc::Producer;

/// Bytes of a line that may wait without its end.
const UNRELEASED_BYTES: u32 = 256;

/// Requests that the receiver has seen and their readers have not yet acted on.
///
/// Plain loads and stores: each flag is set by the receiver and cleared by exactly one reader.
#[derive(Debug, Default)]
pub struct Requests {
    /// `?`: cleared by `report`.
    status: AtomicBool,
    /// `!`: cleared by `prepare`.
    hold: AtomicBool,
    /// `~`: cleared by `prepare`.
    start: AtomicBool,
    /// 0x18: counts up; a reader compares it with the reset it has acted on last.
    epoch: AtomicU32,
    /// Bytes that found the queue full.
    lost: AtomicU32,
    /// Bytes of a line since `interpret` was released last; for the receiver alone.
    unreleased: AtomicU32,
}

impl Requests {
    /// Nothing requested.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            status: AtomicBool::new(false),
            hold: AtomicBool::new(false),
            start: AtomicBool::new(false),
            epoch: AtomicU32::new(0),
            lost: AtomicU32::new(0),
            unreleased: AtomicU32::new(0),
        }
    }

    /// Whether a status report is requested.
    #[must_use]
    pub fn wants_status(&self) -> bool {
        self.status.load(Ordering::Relaxed)
    }

    /// Takes the request for a status report.
    #[must_use]
    pub fn take_status(&self) -> bool {
        take(&self.status)
    }

    /// Takes the request for a feed hold.
    #[must_use]
    pub fn take_hold(&self) -> bool {
        take(&self.hold)
    }

    /// Takes the request for a cycle start.
    #[must_use]
    pub fn take_start(&self) -> bool {
        take(&self.start)
    }

    /// Number of resets so far.
    #[must_use]
    pub fn epoch(&self) -> u32 {
        self.epoch.load(Ordering::Acquire)
    }

    /// Bytes lost so far because nobody had taken the earlier ones.
    #[must_use]
    pub fn lost(&self) -> u32 {
        self.lost.load(Ordering::Relaxed)
    }
}

impl Requests {
    /// Whether a byte of a line releases `interpret`: the end of the line does, and so much of a
    /// line that the queue must not be left to fill up with it.
    fn line_part(&self, byte: u8) -> Release {
        let unreleased = self.unreleased.load(Ordering::Relaxed).wrapping_add(1);
        let is_release = byte == b'\n' || byte == b'\r' || unreleased >= UNRELEASED_BYTES;
        let unreleased = if is_release { 0 } else { unreleased };
        self.unreleased.store(unreleased, Ordering::Relaxed);
        if is_release {
            Release::Interpret
        } else {
            Release::Nobody
        }
    }
}

/// Clears a flag and tells whether it was set. Its setter runs at a higher priority: a request
/// that arrives between the two accesses is one with the request that is being taken.
fn take(flag: &AtomicBool) -> bool {
    let set = flag.load(Ordering::Acquire);
    if set {
        flag.store(false, Ordering::Release);
    }
    set
}

/// Who has to run after a byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Release {
    /// The byte was dropped, or its line goes on.
    Nobody,
    /// `interpret`: a line has come, or much of one.
    Interpret,
    /// `report`: a status report is wanted.
    Report,
    /// `prepare`: the motion has to change; and `interpret` after it.
    Prepare,
}

/// Sorts one received byte.
pub fn receive(byte: u8, requests: &Requests, line: &mut Producer<'_, u8>) -> Release {
    match byte {
        b'?' => {
            requests.status.store(true, Ordering::Release);
            Release::Report
        }
        b'!' => {
            requests.hold.store(true, Ordering::Release);
            Release::Prepare
        }
        b'~' => {
            requests.start.store(true, Ordering::Release);
            Release::Prepare
        }
        0x18 => {
            let next = requests.epoch.load(Ordering::Relaxed).wrapping_add(1);
            requests.epoch.store(next, Ordering::Release);
            Release::Prepare
        }
        // Bytes of realtime commands that are not known, and UTF-8 forms of any.
        0x80.. => Release::Nobody,
        _ => {
            if line.enqueue(byte).is_err() {
                let lost = requests.lost.load(Ordering::Relaxed).wrapping_add(1);
                requests.lost.store(lost, Ordering::Relaxed);
            }
            requests.line_part(byte)
        }
    }
}
