//! The blocks of memory in place of pins: a record of the outputs, and the contacts.

use core::sync::atomic::{AtomicI32, AtomicU8, AtomicU32, Ordering::Relaxed};

use leadscrew::{
    axis::AXES,
    model::{Levels, Outputs, Spindle},
    stepper::StepEvent,
};

use crate::board::pins;

/// A record of the outputs.
#[repr(C)]
struct Figures {
    /// Events that began a pulse.
    events: AtomicU32,
    /// Their hash, as [`leadscrew::sim::StepStatistics`] has it, low word first.
    hash: [AtomicU32; 2],
    /// Ticks from the first such event to the last, low word first.
    ticks: [AtomicU32; 2],
    /// Pulses of each axis.
    pulses: [AtomicU32; 6],
    /// Position of each axis, steps.
    steps: [AtomicI32; 6],
    /// Outputs that are on: bit 0 spindle, 1 counter-clockwise, 2 flood, 3 mist, 4 drivers.
    switched: AtomicU32,
    /// Duty of the PWM, 0 to [`Outputs::FULL`].
    duty: AtomicU32,
    /// The highest duty since power-up: a test may read too late for the duty that it expects.
    highest_duty: AtomicU32,
}

/// Contacts in place of input pins, which a test closes as a machine would.
#[repr(C)]
struct EmulatedContacts {
    /// Closed whatever the axes do; the bits of [`Levels`].
    closed: AtomicU32,
    /// The limit switch of an axis is closed while its position in [`FIGURES`] is at most this…
    at_most: [AtomicI32; 6],
    /// …or at least this.
    at_least: [AtomicI32; 6],
    /// The probe is closed while the position of Z is at most this.
    plate: AtomicI32,
    /// The line from the sender is low while this is not 0.
    line: AtomicU32,
}

/// Read by its symbol: by `cargo xtask qemu` and `bench`, and by `tests/firmware`.
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a symbol that a tool can find")]
static FIGURES: Figures = Figures {
    events: AtomicU32::new(0),
    hash: [AtomicU32::new(0x8422_2325), AtomicU32::new(0xcbf2_9ce4)],
    ticks: [const { AtomicU32::new(0) }; 2],
    pulses: [const { AtomicU32::new(0) }; 6],
    steps: [const { AtomicI32::new(0) }; 6],
    switched: AtomicU32::new(0),
    duty: AtomicU32::new(0),
    highest_duty: AtomicU32::new(0),
};

/// Written by its symbol, through QEMU's connection for debuggers: by `tests/firmware`.
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a symbol that a tool can find")]
static CONTACTS: EmulatedContacts = EmulatedContacts {
    closed: AtomicU32::new(0),
    at_most: [const { AtomicI32::new(i32::MIN) }; 6],
    at_least: [const { AtomicI32::new(i32::MAX) }; 6],
    plate: AtomicI32::new(i32::MIN),
    line: AtomicU32::new(0),
};

/// Time of the last event with a pulse, ticks.
static LAST_PULSE: AtomicU32 = AtomicU32::new(0);

/// The directions output last, bit 0 = X, 1 = negative.
static DIRECTIONS: AtomicU8 = AtomicU8::new(0);

/// The contacts that were closed in the last run of the handler.
static CLOSED: AtomicU32 = AtomicU32::new(0);

/// Returns the contacts that were closed in the last run of the handler.
pub(in crate::board) fn contacts() -> Levels {
    Levels(CLOSED.load(Relaxed) as u16)
}

/// Returns whether the line from the sender is low.
pub(in crate::board) fn is_line_low() -> bool {
    CONTACTS.line.load(Relaxed) != 0
}

/// Reads the contacts. Returns whether they have changed since the last time.
pub(super) fn have_contacts_changed() -> bool {
    let mut closed = CONTACTS.closed.load(Relaxed);
    for axis in 0..AXES {
        let position = FIGURES.steps[axis].load(Relaxed);
        let is_closed = position <= CONTACTS.at_most[axis].load(Relaxed)
            || position >= CONTACTS.at_least[axis].load(Relaxed);
        closed |= u32::from(is_closed) << axis;
    }
    if FIGURES.steps[leadscrew::axis::Z].load(Relaxed) <= CONTACTS.plate.load(Relaxed) {
        closed |= u32::from(Levels::PROBE.0);
    }
    let has_changed = closed != CLOSED.load(Relaxed);
    CLOSED.store(closed, Relaxed);
    has_changed
}

/// Records the outputs but the duty.
pub(in crate::board) fn record_outputs(outputs: &Outputs) {
    let bits = [
        outputs.spindle != Spindle::Off,
        outputs.spindle == Spindle::CounterClockwise,
        outputs.coolant.flood,
        outputs.coolant.mist,
        outputs.drivers,
    ];
    let word = (0..).zip(bits).map(|(bit, is_on)| u32::from(is_on) << bit);
    FIGURES.switched.store(word.sum(), Relaxed);
}

/// Records the duty.
pub(in crate::board) fn record_duty(duty: u32) {
    FIGURES.duty.store(duty, Relaxed);
    if duty > FIGURES.highest_duty.load(Relaxed) {
        FIGURES.highest_duty.store(duty, Relaxed);
    }
}

/// Records the next event, which is due at a time in ticks.
pub(super) fn record(due: u32) {
    let (axes, directions) = read_next(DIRECTIONS.load(Relaxed));
    DIRECTIONS.store(directions, Relaxed);
    if axes == 0 {
        return;
    }
    let elapsed = if FIGURES.events.load(Relaxed) == 0 {
        0
    } else {
        due.wrapping_sub(LAST_PULSE.load(Relaxed))
    };
    LAST_PULSE.store(due, Relaxed);
    add(&FIGURES.events, 1);
    store(
        &FIGURES.ticks,
        load(&FIGURES.ticks).wrapping_add(elapsed.into()),
    );
    let mut hash = load(&FIGURES.hash);
    for word in [elapsed, axes, directions.into()] {
        hash = (hash ^ u64::from(word)).wrapping_mul(0x0100_0000_01b3);
    }
    store(&FIGURES.hash, hash);
    for axis in 0..AXES {
        if axes & 1 << axis != 0 {
            add(&FIGURES.pulses[axis], 1);
            let step = if directions & 1 << axis != 0 { -1 } else { 1 };
            let steps = FIGURES.steps[axis].load(Relaxed);
            FIGURES.steps[axis].store(steps.wrapping_add(step), Relaxed);
        }
    }
}

/// Returns the outputs of the next event, from its words: the axes whose pulse begins, and the
/// directions; those of `before` for axes whose direction does not change.
fn read_next(before: u8) -> (u32, u8) {
    let next = pins::next_words();
    let (mut axes, mut directions) = (0, before);
    let has = |event: StepEvent, but: StepEvent| {
        let words = pins::words(event).into_iter().zip(pins::words(but));
        next.into_iter()
            .zip(words)
            .any(|(next, (word, but))| next & word & !but != 0)
    };
    let none = StepEvent::default();
    let forwards = StepEvent::set_directions(0, 0);
    for axis in 0..AXES {
        let is_due = has(StepEvent::new(0, 1 << axis, 0), none);
        axes |= u32::from(is_due) << axis;
        let backwards = StepEvent::set_directions(0, 1 << axis);
        if has(backwards, forwards) {
            directions |= 1 << axis;
        } else if has(forwards, backwards) {
            directions &= !(1 << axis);
        }
    }
    (axes, directions)
}

fn add(word: &AtomicU32, value: u32) {
    word.store(word.load(Relaxed).wrapping_add(value), Relaxed);
}

fn load([low, high]: &[AtomicU32; 2]) -> u64 {
    u64::from(high.load(Relaxed)) << 32 | u64::from(low.load(Relaxed))
}

fn store([low, high]: &[AtomicU32; 2], value: u64) {
    low.store(value as u32, Relaxed);
    high.store((value >> 32) as u32, Relaxed);
}
