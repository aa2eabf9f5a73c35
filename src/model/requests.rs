//! Requests in real time, from the receiver and the buttons to the tasks that act on them.
//!
//! Each field is set at one priority, which its method names; other tasks read or clear it.
//!
//! # Cost
//! Requests are plain loads and stores: each flag is set at one priority and cleared by one reader of lower priority.
//! Between the tasks of one core no barrier is needed, only the compiler's order. The receiver also runs from RAM while
//! the flash is erased, and can call nothing there: all of it is inlined.

mod losses;
mod marks;
mod override_ring;

use crate::atomic::{
    AtomicBool, AtomicU8, AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

use super::{HAS_REPRAP, Levels, Override, TOOL_CHANGE};
use losses::Losses;
pub use marks::{ReceivedPosition, ToolChangeSpan};
pub use override_ring::OVERRIDES;
use override_ring::OverrideRing;

/// Budget of one wait for [`Awaited::ENTRIES_BATCHED`].
///
/// An entry costs [`ENTRY_COST`]; after the first entry each segment costs 1. The wait ends with
/// four entries, or with 48 segments (34 ms at 0.7 ms each) after one, which bounds the delay of an
/// answer: `tests/protocol/receiving.rs`,
/// `a_wait_for_several_entries_ends_with_four_or_some_time_after_one`.
const BATCH_BUDGET: u8 = 64;
const ENTRY_COST: u8 = 16;

/// A set of events that release `interpret`, besides a change of the machine's state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Awaited(u8);

impl Awaited {
    /// The empty set.
    pub const NONE: Self = Self(0);
    /// The end of a line.
    pub const LINE: Self = Self(1);
    /// Room in the send queue.
    pub const ROOM: Self = Self(2);
    /// An entry dequeued by `prepare`.
    pub const ENTRIES: Self = Self(4);
    /// A segment made by `prepare`: the end of the known motion comes nearer.
    pub const SEGMENTS: Self = Self(8);
    /// Several entries dequeued by `prepare`, or one entry and a number of segments: with many
    /// entries to enqueue, `interpret` need not run for each.
    pub const ENTRIES_BATCHED: Self = Self(16);
    /// Every event, each as it comes: none is batched.
    pub const ALL: Self = Self(15);

    /// Returns the union of two sets.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// 0x84 and 0x85.
const DOOR: usize = 4;
const JOG_CANCEL: usize = 5;

/// The requests of the receiver and the buttons that their readers have not yet taken.
#[derive(Debug)]
pub struct Requests {
    /// `?`: cleared by `report`.
    status: AtomicBool,
    /// `!`: cleared by `prepare`.
    hold: AtomicBool,
    /// A break on the line: cleared by `interpret`.
    line_break: AtomicBool,
    /// The sender has gone, or a new one has come: cleared by `interpret`.
    link_loss: AtomicBool,
    greeting: AtomicBool,
    /// A laser is to be off: cleared by `prepare`.
    laser_off: AtomicBool,
    /// `~`: cleared by `prepare`.
    start: AtomicBool,
    /// 0x80 to 0x87, of which 0x84 and 0x85 mean something: cleared by `prepare`.
    stops: [AtomicBool; 8],
    /// The probe has made contact: cleared by `prepare`.
    contact: AtomicBool,
    /// End of the delay that `prepare` asked for: cleared by `prepare`.
    delay_end: AtomicBool,
    /// A task waits for the notice of a standstill: cleared by `prepare`.
    standstill: AtomicBool,
    /// The mark of the newest `~`.
    start_mark: AtomicU32,
    /// The mark of the newest 0xA3.
    tool_mark: AtomicU32,
    /// Overrides: dequeued by `prepare`.
    overrides: OverrideRing,
    /// A byte that has come in UTF-8, or 0, and the number of such bytes, wrapping: written by `idle`.
    form: AtomicU8,
    utf8_count: AtomicU32,
    /// Number of requests to `prepare` other than overrides, wrapping.
    count: AtomicU32,
    /// Number of resets by 0x18 and by the button, wrapping: a reader compares the number with the number of the last
    /// handled reset.
    resets: AtomicU32,
    /// Number of resets by `interpret`, wrapping.
    own_resets: AtomicU32,
    /// Bytes that are lost.
    losses: Losses,
    /// The events that release `interpret`, an [`Awaited`].
    awaited: AtomicU8,
    /// Sorting realtime bytes is left to `interpret`.
    is_deferred: AtomicBool,
    /// Number of requests to `prepare` by `interpret`, wrapping.
    own_count: AtomicU32,
    /// Clock of `interpret`, [`super::timing::TICK_MS`], wrapping.
    ticks: AtomicU32,
    /// What remains of the budget of a wait for several entries.
    batch_budget: AtomicU8,
}

impl Requests {
    /// Returns no requests.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            status: AtomicBool::new(false),
            hold: AtomicBool::new(false),
            line_break: AtomicBool::new(false),
            link_loss: AtomicBool::new(false),
            greeting: AtomicBool::new(false),
            laser_off: AtomicBool::new(false),
            start: AtomicBool::new(false),
            stops: [const { AtomicBool::new(false) }; 8],
            contact: AtomicBool::new(false),
            delay_end: AtomicBool::new(false),
            standstill: AtomicBool::new(false),
            start_mark: AtomicU32::new(0),
            tool_mark: AtomicU32::new(0),
            overrides: OverrideRing::new(),
            form: AtomicU8::new(0),
            utf8_count: AtomicU32::new(0),
            count: AtomicU32::new(0),
            resets: AtomicU32::new(0),
            own_resets: AtomicU32::new(0),
            losses: Losses::new(),
            awaited: AtomicU8::new(Awaited::ALL.0),
            is_deferred: AtomicBool::new(false),
            own_count: AtomicU32::new(0),
            ticks: AtomicU32::new(0),
            batch_budget: AtomicU8::new(BATCH_BUDGET),
        }
    }

    /// Returns whether a status report is requested.
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

    /// Takes the request of a break on the line.
    #[must_use]
    pub fn take_line_break(&self) -> bool {
        take(&self.line_break)
    }

    /// Makes the request of a break on the line; for the tasks that watch the line.
    pub fn request_line_break(&self) {
        set(&self.line_break);
    }

    /// Takes the loss of the link to the sender.
    #[must_use]
    pub fn take_link_loss(&self) -> bool {
        take(&self.link_loss)
    }

    /// Signals that the link to the sender is lost; for the receiver alone, which releases `interpret` afterwards.
    pub fn report_link_loss(&self) {
        set(&self.link_loss);
    }

    /// Takes the request for the welcome of a new sender.
    #[must_use]
    pub fn take_greeting(&self) -> bool {
        take(&self.greeting)
    }

    /// Requests the welcome of a new sender, without a reset; for the receiver alone, which releases `interpret`
    /// afterwards.
    pub fn request_greeting(&self) {
        set(&self.greeting);
    }

    /// Requests that a laser goes off; for `interpret` alone, which releases `prepare` afterwards.
    pub fn switch_laser_off(&self) {
        set(&self.laser_off);
        add_one(&self.own_count);
    }

    /// Takes the request that a laser goes off.
    #[must_use]
    pub fn take_laser_off(&self) -> bool {
        take(&self.laser_off)
    }

    /// Returns a number that differs from the last one if a byte other than `?` has come since, intact or not, or a
    /// request of another kind. `received` is the number of bytes of lines.
    #[must_use]
    #[inline]
    pub fn activity(&self, received: usize) -> u32 {
        let others = self.lost().wrapping_add(self.count());
        (received as u32).wrapping_add(others)
    }

    /// Takes the request for a cycle start.
    #[must_use]
    pub fn take_start(&self) -> bool {
        take(&self.start)
    }

    /// Takes the signal that the safety door was opened.
    #[must_use]
    pub fn take_door(&self) -> bool {
        take(&self.stops[DOOR])
    }

    /// Takes the request to end jogging.
    #[must_use]
    pub fn take_jog_cancel(&self) -> bool {
        take(&self.stops[JOG_CANCEL])
    }

    /// Signals a contact of the probe; for `inputs` alone.
    pub(crate) fn report_contact(&self) {
        set(&self.contact);
        add_one(&self.count);
    }

    /// Takes the signal that the probe has made contact.
    #[must_use]
    pub fn take_contact(&self) -> bool {
        take(&self.contact)
    }

    /// Signals the end of the delay that `prepare` asked for; for its platform alone.
    pub fn end_delay(&self) {
        set(&self.delay_end);
        // Two requests, one of which interrupts the other, may count as one: the number differs in
        // any case.
        add_one(&self.count);
    }

    /// Takes the end of the delay.
    #[must_use]
    pub fn take_delay_end(&self) -> bool {
        take(&self.delay_end)
    }

    /// Requests [`super::Notice::Standstill`], at standstill: for `interpret` alone, which releases
    /// `prepare` afterwards. A motion that begins earlier ends the request.
    pub fn watch_standstill(&self) {
        set(&self.standstill);
        add_one(&self.own_count);
    }

    /// Takes the request for the notice of a standstill.
    #[must_use]
    pub fn take_standstill(&self) -> bool {
        take(&self.standstill)
    }

    /// Returns the number of requests to `prepare`, wrapping: while it is the same, none is new.
    #[must_use]
    pub fn count(&self) -> u32 {
        let overrides = self.overrides.written();
        let own = self.own_count.load(Relaxed);
        let forms = self.utf8_count.load(Relaxed);
        let count = self.count.load(Relaxed).wrapping_add(overrides);
        let count = count.wrapping_add(own).wrapping_add(forms);
        compiler_fence(SeqCst);
        count
    }

    /// Returns where the newest `~` was received.
    #[must_use]
    pub fn start_mark(&self) -> ReceivedPosition {
        ReceivedPosition(self.start_mark.load(Relaxed))
    }

    /// Returns where the newest 0xA3 was received.
    #[must_use]
    pub fn tool_mark(&self) -> ReceivedPosition {
        ReceivedPosition(self.tool_mark.load(Relaxed))
    }

    /// Takes the bytes that may be overrides, [`super::Override::from_byte`], or [`TOOL_CHANGE`], oldest first, if there
    /// are any.
    #[must_use]
    pub fn take_overrides(&self) -> Option<impl Iterator<Item = u8> + use<>> {
        let form = self.form.load(Relaxed);
        self.form.store(0, Relaxed);
        self.overrides.dequeue_all(form)
    }

    /// Returns the number of resets so far, wrapping.
    #[must_use]
    pub fn reset_count(&self) -> u32 {
        let received = self.resets.load(Relaxed);
        let count = received.wrapping_add(self.own_resets.load(Relaxed));
        compiler_fence(SeqCst);
        count
    }

    /// Requests the reset that ends a line, as of `$RST=*`; for `interpret` alone.
    pub fn reset(&self) {
        add_one(&self.own_resets);
    }

    /// Makes the requests of the buttons whose contacts have closed; for `inputs` alone.
    ///
    /// A request interrupted by a received byte may count as one with the request of the byte: readers see a new
    /// number, and find both flags.
    pub fn press(&self, closed: Levels) {
        if !closed.has(Levels::BUTTONS) {
            return;
        }
        if closed.has(Levels::HOLD) {
            set(&self.hold);
        }
        if closed.has(Levels::RESET) {
            add_one(&self.resets);
        }
        if closed.has(Levels::START) {
            set(&self.start);
        }
        if closed.has(Levels::DOOR) {
            set(&self.stops[DOOR]);
        }
        add_one(&self.count);
    }

    /// Makes the request of a realtime byte; for the receiver alone. Returns the task to release.
    /// `received` is the number of bytes of lines before it.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "nothing in flash may be called")]
    pub(crate) fn accept(&self, byte: u8, received: usize) -> Release {
        let flag = match byte {
            b'!' => &self.hold,
            b'~' => {
                self.start_mark.store(received as u32, Relaxed);
                &self.start
            }
            0x18 => {
                add_one(&self.resets);
                return self.count_for_prepare();
            }
            _ => {
                set(&self.status);
                return Release::Report;
            }
        };
        set(flag);
        self.count_for_prepare()
    }

    /// The same for a byte of 0x80 to 0xA3.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `accept`")]
    pub(crate) fn accept_from_0x80(&self, byte: u8, received: usize) -> Release {
        if byte >= Override::FIRST {
            self.overrides.enqueue(byte);
            // No reader runs before the receiver has ended.
            if byte == TOOL_CHANGE {
                self.tool_mark.store(received as u32, Relaxed);
            }
            return Release::Prepare;
        }
        set(&self.stops[usize::from(byte % 8)]);
        self.count_for_prepare()
    }

    /// Makes the request of a byte of 0x80 to 0xA3 that has come in UTF-8; for `idle` alone, which releases `prepare`
    /// afterwards. Returns false while another one waits.
    pub(crate) fn accept_utf8(&self, byte: u8, received: usize) -> bool {
        match byte {
            0x84 => set(&self.stops[DOOR]),
            0x85 => set(&self.stops[JOG_CANCEL]),
            _ if self.form.load(Relaxed) != 0 => return false,
            _ => {
                if byte == TOOL_CHANGE {
                    self.tool_mark.store(received as u32, Relaxed);
                }
                self.form.store(byte, Relaxed);
            }
        }
        add_one(&self.utf8_count);
        true
    }

    /// Counts a request to `prepare`. Returns that task, to be released.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `accept`")]
    fn count_for_prepare(&self) -> Release {
        add_one(&self.count);
        Release::Prepare
    }

    /// Returns whether sorting realtime bytes is left to `interpret`; for the receiver alone.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `accept`")]
    pub(crate) fn is_deferred(&self) -> bool {
        HAS_REPRAP && self.is_deferred.load(Relaxed)
    }

    /// Leaves sorting realtime bytes to `interpret`, or no longer; for `interpret` alone.
    pub fn defer(&self, is_deferred: bool) {
        self.is_deferred.store(is_deferred, Relaxed);
    }

    /// Makes the request of a realtime byte other than `?` that `interpret` has sorted, or its own; for that task
    /// alone, which releases `prepare` afterwards. `received` is the number of bytes of lines before it.
    pub fn accept_from_interpret(&self, byte: u8, received: usize) {
        let flag = match byte {
            b'!' => &self.hold,
            b'~' => {
                self.start_mark.store(received as u32, Relaxed);
                &self.start
            }
            0x84 => &self.stops[DOOR],
            0x85 => &self.stops[JOG_CANCEL],
            0x18 => return self.reset(),
            0x80.. => {
                if byte == TOOL_CHANGE {
                    self.tool_mark.store(received as u32, Relaxed);
                }
                return self.overrides.enqueue(byte);
            }
            _ => return,
        };
        set(flag);
        // A count of its own: the receiver and the buttons may interrupt this.
        add_one(&self.own_count);
    }

    /// Advances the clock of `interpret`; for the timer alone, whose task releases `interpret`
    /// afterwards.
    pub fn tick(&self) {
        add_one(&self.ticks);
    }

    /// Returns the time by the clock of `interpret`, [`super::timing::TICK_MS`], wrapping.
    #[must_use]
    pub fn ticks(&self) -> u32 {
        self.ticks.load(Relaxed)
    }

    /// Notes that bytes are lost in front of the one of this number; for the receiver alone.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `accept`")]
    pub(crate) fn lose(&self, next: usize) {
        self.losses.note(next);
    }

    /// Returns the number of losses so far, wrapping: bytes that found the queue full, came too soon behind
    /// others, or were damaged.
    #[must_use]
    pub fn lost(&self) -> u32 {
        self.losses.count()
    }

    /// Returns whether bytes are lost of a line that has not been refused.
    #[inline]
    #[must_use]
    pub fn has_losses(&self) -> bool {
        self.losses.has_any()
    }

    /// Has everything that waits count as having lost bytes, where anything has: the bytes have got other
    /// numbers. For `interpret` alone; the argument tells the number of the next byte to come.
    pub fn spread_losses(&self, next: impl Fn() -> usize) {
        self.losses.spread(next);
    }

    /// Returns whether the line has lost bytes whose last byte is the one before this number; for `interpret`
    /// alone, once for each line.
    #[must_use]
    pub fn take_losses_before(&self, end: usize) -> bool {
        self.losses.take_before(end)
    }
}

/// Wake-ups of `interpret`: the events for which the task waits, and how those of several entries become one.
impl Requests {
    /// Sets the events that release `interpret`; for that task alone.
    ///
    /// The task awaits [`Awaited::ALL`] before looking for work, and the events that it needs afterwards: no event is
    /// lost in between.
    pub fn wake_on(&self, awaited: Awaited) {
        compiler_fence(SeqCst);
        self.awaited.store(awaited.0, Relaxed);
        compiler_fence(SeqCst);
    }

    /// Begins a wait for [`Awaited::ENTRIES_BATCHED`]; for `interpret` alone, before it looks for
    /// work.
    pub fn begin_batch(&self) {
        self.batch_budget.store(BATCH_BUDGET, Relaxed);
    }

    /// Returns whether an event releases `interpret`; for the task that causes the event alone.
    #[inline]
    #[must_use]
    pub fn awaits(&self, event: Awaited) -> bool {
        let awaited = self.awaited.load(Relaxed);
        awaited & event.0 != 0
            || awaited & Awaited::ENTRIES_BATCHED.0 != 0 && self.completes_batch(event)
    }

    /// Counts an event of a batch. Returns whether the batch is complete.
    #[inline]
    fn completes_batch(&self, event: Awaited) -> bool {
        let budget = self.batch_budget.load(Relaxed);
        let cost = match event {
            Awaited::ENTRIES => ENTRY_COST,
            Awaited::SEGMENTS if budget < BATCH_BUDGET => 1,
            _ => return false,
        };
        let remaining = budget.saturating_sub(cost);
        self.batch_budget.store(remaining, Relaxed);
        remaining == 0
    }

    /// Returns whether the end of a line releases `interpret`; for the receiver alone.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `accept`")]
    pub(crate) fn awaits_line(&self) -> bool {
        self.awaited.load(Relaxed) & Awaited::LINE.0 != 0
    }
}

impl Default for Requests {
    fn default() -> Self {
        Self::new()
    }
}

/// Sets a flag.
#[inline(always)]
#[expect(clippy::inline_always, reason = "as for `accept`")]
fn set(flag: &AtomicBool) {
    flag.store(true, Relaxed);
}

/// Clears a flag. Returns whether it was set. The flag is set at a higher priority: a request
/// between the two accesses is one with the request being taken.
fn take(flag: &AtomicBool) -> bool {
    let set = flag.load(Relaxed);
    if set {
        flag.store(false, Relaxed);
    }
    compiler_fence(SeqCst);
    set
}

/// Increments a count, after the request that it counts.
#[inline(always)]
#[expect(clippy::inline_always, reason = "as for `accept`")]
fn add_one(count: &AtomicU32) {
    compiler_fence(SeqCst);
    let next = count.load(Relaxed).wrapping_add(1);
    count.store(next, Relaxed);
}

/// The task to release after a byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Release {
    /// None: the byte is ignored, or its line is not complete.
    Nobody,
    /// `interpret`: a line, or a large part of one, has been received.
    Interpret,
    /// `report`: a status report is requested.
    Report,
    /// `prepare`: the motion has to change; `interpret` runs after it.
    Prepare,
}
