//! Requests in real time, from the receiver and the buttons to the tasks that act on them.
//!
//! Written by `serial_rx` and `inputs`; every other task only reads or takes.

use core::sync::atomic::{
    AtomicBool, AtomicU8, AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

use super::{Levels, Override};

/// Four entries taken, or one and 48 segments made after it, end the wait for [`Awaited::PLACES`].
const PATIENCE: u8 = 64;
const ENTRY_PATIENCE: u8 = 16;

/// Requests that the receiver has seen and their readers have not yet acted on.
///
/// Plain loads and stores: each flag is set by the receiver and cleared by exactly one reader. Between
/// the tasks of one core no barrier is needed, but the compiler's order.
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
    /// Counts requests to `prepare`, other than overrides.
    asked: AtomicU32,
    /// 0x18: counts up; a reader compares it with the reset it has acted on last.
    resets: AtomicU32,
    /// Resets that `interpret` has asked for.
    own_resets: AtomicU32,
    /// Bytes that found the queue full.
    lost: AtomicU32,
    /// What `interpret` waits for, an [`Awaited`]: whoever brings it releases the task.
    awaited: AtomicU8,
    /// How much longer it waits for more than one place to become free; below [`PATIENCE`], one is.
    patience: AtomicU8,
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
            patience: AtomicU8::new(PATIENCE),
        }
    }

    /// Whether a status report is requested.
    #[must_use]
    pub fn wants_status(&self) -> bool {
        self.status.load(Relaxed)
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
        set(&self.wake);
        // Whoever interrupts this counts too: the number is another one in any case.
        add_one(&self.asked);
    }

    /// Counts requests to `prepare`, wrapping: it looks no further while that is the same.
    #[must_use]
    pub fn asked(&self) -> u32 {
        let overrides = self.overrides.written.load(Relaxed);
        let asked = self.asked.load(Relaxed).wrapping_add(overrides);
        compiler_fence(SeqCst);
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
    pub fn reset_count(&self) -> u32 {
        let received = self.resets.load(Relaxed);
        let epoch = received.wrapping_add(self.own_resets.load(Relaxed));
        compiler_fence(SeqCst);
        epoch
    }

    /// A reset that a line asks for; for `interpret` alone.
    pub fn reset(&self) {
        add_one(&self.own_resets);
    }

    /// A button, or a byte that does the same; for tasks above the readers alone.
    ///
    /// When one of them interrupts another here, two requests may count as one: readers see that
    /// the number is another one, and find all that is asked.
    pub fn press(&self, button: Button) {
        self.raise(button);
        add_one(&self.asked);
    }

    #[inline]
    fn raise(&self, button: Button) {
        match button {
            Button::Hold => set(&self.hold),
            Button::Start => set(&self.start),
            Button::Reset => add_one(&self.resets),
            Button::Door => set(&self.door),
        }
    }

    /// The buttons whose contact has closed; for the input interrupt alone.
    pub(crate) fn press_all(&self, closed: Levels) {
        if !closed.has(Levels::BUTTONS) {
            return;
        }
        // wcet-bound: 4
        for (input, button) in [
            (Levels::HOLD, Button::Hold),
            (Levels::RESET, Button::Reset),
            (Levels::START, Button::Start),
            (Levels::DOOR, Button::Door),
        ] {
            if closed.has(input) {
                self.raise(button);
            }
        }
        add_one(&self.asked);
    }

    /// Requests what a realtime byte asks for; for the receiver alone. Returns who has to run.
    ///
    /// Also runs from RAM, where it can call nothing: all of it is inlined, and looks nothing up in a
    /// table. The first byte of the UTF-8 form of a realtime command is one of those without a meaning.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "nothing in flash may be called")]
    pub(crate) fn accept(&self, byte: u8) -> Release {
        let flag = match byte {
            b'?' => {
                set(&self.status);
                return Release::Report;
            }
            b'!' => &self.hold,
            b'~' => &self.start,
            0x84 => &self.door,
            0x85 => &self.jog_cancel,
            0x18 => {
                add_one(&self.resets);
                return self.release();
            }
            _ if Override::is(byte) => {
                self.overrides.put(byte);
                return Release::Prepare;
            }
            _ => return Release::Nobody,
        };
        set(flag);
        self.release()
    }

    /// Something has been asked of `prepare`.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `accept`")]
    fn release(&self) -> Release {
        add_one(&self.asked);
        Release::Prepare
    }

    /// Counts a byte that is lost; for the receiver alone.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `accept`")]
    pub(crate) fn lose(&self) {
        self.lost.store(self.lost().wrapping_add(1), Relaxed);
    }

    /// Says what releases `interpret` from now on; for that task alone.
    ///
    /// Before it looks for work it awaits all, and then, if it finds none, what it has looked for:
    /// so nothing that comes meanwhile is missed.
    pub fn wake_on(&self, awaited: Awaited) {
        compiler_fence(SeqCst);
        self.awaited.store(awaited.0, Relaxed);
        compiler_fence(SeqCst);
    }

    /// Begins to wait for [`Awaited::PLACES`]; for `interpret` alone, before it looks for work.
    pub fn coalesce(&self) {
        self.patience.store(PATIENCE, Relaxed);
    }

    /// Whether `interpret` waits for this, which has come; for the task that brings it alone.
    #[inline]
    #[must_use]
    pub fn awaits(&self, brought: Awaited) -> bool {
        let awaited = self.awaited.load(Relaxed);
        awaited & brought.0 != 0
            || awaited & Awaited::ENTRIES_BATCHED.0 != 0 && self.ends_patience(brought)
    }

    /// Whether there are several free places, or one for a while.
    #[inline]
    fn ends_patience(&self, brought: Awaited) -> bool {
        let patience = self.patience.load(Relaxed);
        let cost = match brought {
            Awaited::ENTRIES => ENTRY_PATIENCE,
            Awaited::SEGMENTS if patience < PATIENCE => 1,
            _ => return false,
        };
        let left = patience.saturating_sub(cost);
        self.patience.store(left, Relaxed);
        left == 0
    }

    /// As [`Self::awaits`], for the receiver: in few instructions.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `accept`")]
    pub(crate) fn awaits_line(&self) -> bool {
        self.awaited.load(Relaxed) & Awaited::LINE.0 != 0
    }

    /// Bytes lost so far because nobody had taken the earlier ones.
    #[must_use]
    pub fn lost(&self) -> u32 {
        self.lost.load(Relaxed)
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
    /// Segments that `prepare` makes: the end of the motion that it knows of comes nearer.
    pub const SEGMENTS: Self = Self(8);
    /// A few entries that `prepare` takes, or one and then some time: who has many to give need not
    /// run for each.
    pub const ENTRIES_BATCHED: Self = Self(16);
    /// Everything.
    pub const ALL: Self = Self(15);

    /// Both.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// Sets a flag.
#[inline(always)]
#[expect(clippy::inline_always, reason = "as for `accept`")]
fn set(flag: &AtomicBool) {
    flag.store(true, Relaxed);
}

/// Clears a flag and tells whether it was set. Its setter runs at a higher priority: a request
/// that arrives between the two accesses is one with the request that is being taken.
fn take(flag: &AtomicBool) -> bool {
    let set = flag.load(Relaxed);
    if set {
        flag.store(false, Relaxed);
    }
    compiler_fence(SeqCst);
    set
}

/// Counts up, after what it counts.
#[inline(always)]
#[expect(clippy::inline_always, reason = "as for `accept`")]
fn add_one(count: &AtomicU32) {
    compiler_fence(SeqCst);
    let next = count.load(Relaxed).wrapping_add(1);
    count.store(next, Relaxed);
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

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `accept`")]
    fn put(&self, byte: u8) {
        let number = self.written.load(Relaxed);
        if number.wrapping_sub(self.read.load(Relaxed)) < OVERRIDES as u32 {
            if let Some(place) = self.bytes.get(number as usize % OVERRIDES) {
                place.store(byte, Relaxed);
            }
            compiler_fence(SeqCst);
            self.written.store(number.wrapping_add(1), Relaxed);
        }
    }

    fn take(&self) -> Option<Override> {
        let number = self.read.load(Relaxed);
        if number == self.written.load(Relaxed) {
            return None;
        }
        compiler_fence(SeqCst);
        let byte = self.bytes.get(number as usize % OVERRIDES)?;
        let command = Override::of(byte.load(Relaxed));
        compiler_fence(SeqCst);
        self.read.store(number.wrapping_add(1), Relaxed);
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
