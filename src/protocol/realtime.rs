//! Realtime bytes: taken out of the stream by the receive interrupt, never part of a line.
//!
//! Owned by `serial_rx`, which stores; every other task only reads or takes. A byte costs O(1) and
//! may stand inside a line. Read with Grbl 1.1 `serial.c` and the table of realtime commands.

use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering, compiler_fence};

use super::ByteWriter;
use crate::machine::Override;

/// Bytes of a line that may wait without its end.
const UNRELEASED_BYTES: u32 = 256;

/// Requests that the receiver has seen and their readers have not yet acted on.
///
/// Plain loads and stores: each flag is set by the receiver and cleared by exactly one reader.
#[derive(Debug)]
pub struct Requests {
    /// `?`: cleared by `report`.
    status: AtomicBool,
    /// `!`: cleared by `prepare`.
    hold: AtomicBool,
    /// `~`: cleared by `prepare`.
    start: AtomicBool,
    /// 0x84: cleared by `prepare`.
    door: AtomicBool,
    /// 0x85: cleared by `prepare`.
    jog_cancel: AtomicBool,
    /// The time that `prepare` asked for is over: cleared by it.
    wake: AtomicBool,
    /// Overrides: taken by `prepare`.
    overrides: OverrideRing,
    /// Counts requests to `prepare`, other than resets: it looks no further while that is the same.
    asked: AtomicU32,
    /// 0x18: counts up; a reader compares it with the reset it has acted on last.
    resets: AtomicU32,
    /// Resets that `interpret` has asked for.
    own_resets: AtomicU32,
    /// Bytes that found the queue full.
    lost: AtomicU32,
    /// What `interpret` waits for, an [`Awaited`]: whoever brings it releases the task.
    awaited: AtomicU8,
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
            door: AtomicBool::new(false),
            jog_cancel: AtomicBool::new(false),
            wake: AtomicBool::new(false),
            overrides: OverrideRing::new(),
            asked: AtomicU32::new(0),
            resets: AtomicU32::new(0),
            own_resets: AtomicU32::new(0),
            lost: AtomicU32::new(0),
            awaited: AtomicU8::new(Awaited::ALL.0),
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

    /// Takes the signal that the safety door was opened.
    #[must_use]
    pub fn take_door(&self) -> bool {
        take(&self.door)
    }

    /// Takes the request to end jogging.
    #[must_use]
    pub fn take_jog_cancel(&self) -> bool {
        take(&self.jog_cancel)
    }

    /// The time that `prepare` asked for is over; for its shell alone.
    pub fn wake(&self) {
        self.wake.store(true, Ordering::Release);
        // Whoever interrupts this counts too: the number is another one in any case.
        add_one(&self.asked);
    }

    /// Counts requests to `prepare`, other than resets, wrapping.
    #[must_use]
    pub fn asked(&self) -> u32 {
        let asked = self.asked.load(Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
        asked
    }

    /// Takes the end of the time that was asked for.
    #[must_use]
    pub fn take_wake(&self) -> bool {
        take(&self.wake)
    }

    /// Takes the oldest override that has come.
    #[must_use]
    pub fn take_override(&self) -> Option<Override> {
        self.overrides.take()
    }

    /// Number of resets so far, wrapping.
    #[must_use]
    pub fn epoch(&self) -> u32 {
        let received = self.resets.load(Ordering::Relaxed);
        let epoch = received.wrapping_add(self.own_resets.load(Ordering::Relaxed));
        // Between the tasks of one core no barrier is needed, but the compiler's order.
        compiler_fence(Ordering::SeqCst);
        epoch
    }

    /// A reset that a line asks for; for `interpret` alone.
    pub fn reset(&self) {
        add_one(&self.own_resets);
    }

    /// A button, or a byte that does the same; for tasks of the receiver's priority alone.
    pub fn press(&self, button: Button) {
        match button {
            Button::Hold => self.hold.store(true, Ordering::Release),
            Button::Start => self.start.store(true, Ordering::Release),
            Button::Reset => add_one(&self.resets),
            Button::Door => self.door.store(true, Ordering::Release),
        }
        add_one(&self.asked);
    }

    /// Says what releases `interpret` from now on; for that task alone.
    ///
    /// Before it looks for work it awaits all, and then, if it finds none, what it has looked for:
    /// so nothing that comes meanwhile is missed.
    pub fn heed(&self, awaited: Awaited) {
        compiler_fence(Ordering::SeqCst);
        self.awaited.store(awaited.0, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
    }

    /// Whether `interpret` waits for this.
    #[must_use]
    pub fn awaits(&self, awaited: Awaited) -> bool {
        self.awaited.load(Ordering::Relaxed) & awaited.0 != 0
    }

    /// Bytes lost so far because nobody had taken the earlier ones.
    #[must_use]
    pub fn lost(&self) -> u32 {
        self.lost.load(Ordering::Relaxed)
    }
}

impl Requests {
    /// Whether a byte of a line releases `interpret`, if it waits for one: the end of the line does,
    /// and so much of a line that the queue must not be left to fill up with it.
    fn line_part(&self, byte: u8) -> Release {
        let unreleased = self.unreleased.load(Ordering::Relaxed).wrapping_add(1);
        let is_release = byte == b'\n' || byte == b'\r' || unreleased >= UNRELEASED_BYTES;
        let unreleased = if is_release { 0 } else { unreleased };
        self.unreleased.store(unreleased, Ordering::Relaxed);
        if is_release && self.awaits(Awaited::LINE) {
            Release::Interpret
        } else {
            Release::Nobody
        }
    }
}

impl Default for Requests {
    fn default() -> Self {
        Self::new()
    }
}

/// What releases `interpret`, besides a change of the machine's state: a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Awaited(u8);

impl Awaited {
    /// Nothing.
    pub const NONE: Self = Self(0);
    /// The end of a line.
    pub const LINE: Self = Self(1);
    /// Room for what is to be sent.
    pub const ROOM: Self = Self(2);
    /// Entries that `prepare` takes.
    pub const ENTRIES: Self = Self(4);
    /// Everything.
    pub const ALL: Self = Self(7);

    /// Both.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
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

/// Counts up; nobody else writes the number.
fn add_one(count: &AtomicU32) {
    let next = count.load(Ordering::Relaxed).wrapping_add(1);
    count.store(next, Ordering::Release);
}

/// What a button at the machine can ask for, or a byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Button {
    /// Feed hold.
    Hold,
    /// Cycle start.
    Start,
    /// Soft reset.
    Reset,
    /// The safety door has been opened.
    Door,
}

/// Overrides on their way to `prepare`, oldest first.
///
/// `prepare` runs after each of them, so there is always room; one that found none is dropped.
#[derive(Debug, Default)]
struct OverrideRing {
    bytes: [AtomicU8; OVERRIDES],
    written: AtomicU32,
    read: AtomicU32,
}

/// Overrides that may wait: more than bytes come in 1 ms.
pub const OVERRIDES: usize = 16;

impl OverrideRing {
    const fn new() -> Self {
        Self {
            bytes: [const { AtomicU8::new(0) }; OVERRIDES],
            written: AtomicU32::new(0),
            read: AtomicU32::new(0),
        }
    }

    fn put(&self, command: Override) {
        let number = self.written.load(Ordering::Relaxed);
        if number.wrapping_sub(self.read.load(Ordering::Acquire)) < OVERRIDES as u32 {
            if let Some(place) = self.bytes.get(number as usize % OVERRIDES) {
                place.store(command as u8, Ordering::Relaxed);
            }
            self.written
                .store(number.wrapping_add(1), Ordering::Release);
        }
    }

    fn take(&self) -> Option<Override> {
        let number = self.read.load(Ordering::Relaxed);
        if number == self.written.load(Ordering::Acquire) {
            return None;
        }
        let byte = self.bytes.get(number as usize % OVERRIDES)?;
        let command = Override::of(byte.load(Ordering::Relaxed));
        self.read.store(number.wrapping_add(1), Ordering::Release);
        command
    }
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
#[inline]
pub fn receive(byte: u8, requests: &Requests, line: &mut ByteWriter<'_>) -> Release {
    // Most bytes are letters, digits, signs and dots: two comparisons instead of five.
    if matches!(byte, b'@'..=b'}' | b'"'..=b'>') {
        put(byte, requests, line)
    } else {
        sort(byte, requests, line)
    }
}

fn sort(byte: u8, requests: &Requests, line: &mut ByteWriter<'_>) -> Release {
    match byte {
        b'?' => {
            requests.status.store(true, Ordering::Release);
            Release::Report
        }
        b'!' => press(requests, Button::Hold),
        b'~' => press(requests, Button::Start),
        0x18 => press(requests, Button::Reset),
        0x84 => press(requests, Button::Door),
        0x85 => {
            requests.jog_cancel.store(true, Ordering::Release);
            add_one(&requests.asked);
            Release::Prepare
        }
        // The first byte of the UTF-8 form of a realtime command is one of those without a meaning.
        0x80.. => match Override::of(byte) {
            Some(command) => {
                requests.overrides.put(command);
                add_one(&requests.asked);
                Release::Prepare
            }
            None => Release::Nobody,
        },
        _ => put(byte, requests, line),
    }
}

/// Queues a byte of a line.
#[inline]
fn put(byte: u8, requests: &Requests, line: &mut ByteWriter<'_>) -> Release {
    if line.enqueue(byte).is_err() {
        let lost = requests.lost.load(Ordering::Relaxed).wrapping_add(1);
        requests.lost.store(lost, Ordering::Relaxed);
    }
    requests.line_part(byte)
}

fn press(requests: &Requests, button: Button) -> Release {
    requests.press(button);
    Release::Prepare
}
