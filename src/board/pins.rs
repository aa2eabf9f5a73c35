//! Step, direction and enable outputs, as words for the ports' set/reset registers.
//!
//! A table, indexed by [`StepEvent::pins`], holds the words with each axis's polarity. It is rebuilt
//! only at standstill.
//!
//! # Cost
//!
//! The step interrupt neither shifts nor branches. What it uses is in one block of memory, which one
//! address reaches; the words of the next event are written by two instructions and read by one, the
//! fewest cycles for each. With six axes a table of all pairs of halves would take a third of the
//! memory, so the halves have tables of their own.

use core::{
    cell::UnsafeCell,
    sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed},
};

use leadscrew::{axis::AXES, settings::Settings, stepper::StepEvent};

use super::{
    chosen, pac,
    wiring::{Pin, Wiring},
};

/// Masks of axes, and the one with all.
const MASKS: usize = 1 << AXES;
const ALL_AXES: usize = MASKS - 1;
/// The axis whose direction is in the second half of [`StepEvent::pins`]; the others' are in the
/// first.
const X: usize = 1;

/// Ports that events change: A and B, and C where a direction output has to be there.
const PORTS: usize = if chosen::WIRING.has_directions_on_c() {
    3
} else {
    2
};

/// Whether each half of [`StepEvent::pins`] has a table of its own.
const HAS_HALF_TABLES: bool = AXES == 6;
/// Rows of the table. With halves: first ones, second ones, and both of events that set directions.
const ROWS: usize = if HAS_HALF_TABLES {
    4 * MASKS
} else {
    StepEvent::PINS
};

/// Words for ports from A on.
type Words = [u32; PORTS];
type Row = [AtomicU32; PORTS];

/// What the step interrupt uses, and the tasks below change while it stands.
struct SharedWords {
    next: Next,
    /// Written at rest by [`configure`], read by the step interrupt.
    events: [Row; ROWS],
    /// To disable and to enable the drivers.
    enable: [[AtomicU32; 3]; 2],
}

static SHARED: SharedWords = SharedWords {
    next: Next(UnsafeCell::new([0; PORTS])),
    events: [const { [const { AtomicU32::new(0) }; PORTS] }; ROWS],
    enable: [const { [const { AtomicU32::new(0) }; 3] }; 2],
};

/// Returns the words of an event.
#[inline]
fn words(event: StepEvent) -> Words {
    let pins = event.pins();
    if !HAS_HALF_TABLES {
        return load(&SHARED.events[pins]);
    }
    let first = if event.sets_directions() {
        2 * MASKS
    } else {
        0
    };
    let mut words = load(&SHARED.events[first + pins % MASKS]);
    let second = load(&SHARED.events[first + MASKS + pins / MASKS % MASKS]);
    // wcet-bound: 3
    for (word, second) in words.iter_mut().zip(second) {
        *word |= second;
    }
    words
}

#[inline]
fn load(row: &Row) -> Words {
    row.each_ref().map(|word| word.load(Relaxed))
}

/// What the next event outputs.
struct Next(UnsafeCell<Words>);

#[expect(unsafe_code, reason = "what tasks take turns at")]
// SAFETY: the step interrupt alone uses it while it may run; who starts it, before that, and others
// have stopped it before: see `StepSwitch`. The emulator's handler reads it while the step interrupt
// waits for that handler.
unsafe impl Sync for Next {}

impl Next {
    #[inline]
    #[expect(unsafe_code, reason = "nothing else has it meanwhile")]
    fn get(&self) -> Words {
        // SAFETY: see above.
        unsafe { *self.0.get() }
    }

    #[inline]
    #[expect(unsafe_code, reason = "nothing else has it meanwhile")]
    fn set(&self, words: Words) {
        let first = self.0.get().cast::<u32>();
        // wcet-bound: 3
        for (port, word) in words.into_iter().enumerate() {
            // SAFETY: see above; there is a word for each port.
            unsafe { first.add(port).write_volatile(word) };
        }
    }
}

/// Whether the drivers are enabled.
static IS_ENABLED: AtomicBool = AtomicBool::new(false);

/// The polarities that the tables are made for, see [`polarity`].
static POLARITY: AtomicU32 = AtomicU32::new(0);

/// Makes outputs of the pins, with the drivers disabled. The ports' clocks must run.
pub(super) fn init(settings: &Settings) {
    // Levels first: a pin that becomes an output must not begin a pulse.
    configure(settings);
    let wiring = &chosen::WIRING;
    for (&step, &direction) in wiring.step.iter().zip(&wiring.direction).take(AXES) {
        step.make_output();
        direction.make_output();
    }
    wiring.enable.make_output();
}

/// Outputs the words of the last [`prepare`]. Called by the step interrupt, or while it is stopped.
#[inline]
pub(super) fn write() {
    let next = SHARED.next.get();
    write_a_and_b([next[0], next[1]]);
    if let Some(word) = next.get(2) {
        write_port_c(*word);
    }
}

/// The next event outputs nothing.
#[inline]
pub(super) fn clear() {
    SHARED.next.set([0; PORTS]);
}

/// Sets the words of the next event.
#[inline]
pub(super) fn prepare(event: StepEvent) {
    SHARED.next.set(words(event));
}

impl Wiring {
    /// Returns the words that drive the pins of some axes, of these the `high` ones high.
    fn words(pins: &[Pin; 6], axes: usize, high: usize) -> [u32; 3] {
        let mut words = [0; 3];
        for (axis, pin) in pins.iter().enumerate().take(AXES) {
            if axes >> axis & 1 != 0 {
                merge(&mut words, pin.word(high >> axis & 1 != 0));
            }
        }
        words
    }

    /// Returns whether a direction output of an axis is on port C.
    const fn has_directions_on_c(&self) -> bool {
        let mut axis = 0;
        while axis < AXES {
            if matches!(self.direction[axis], Pin::C(_)) {
                return true;
            }
            axis += 1;
        }
        false
    }
}

/// Returns what the next event outputs, read back from its port words: axes whose pulse begins, and the
/// directions, those of before for axes whose output does not change.
#[cfg(feature = "emulated")]
pub(super) fn read_next(before: u8) -> (u32, u8) {
    let next = SHARED.next.get();
    let (mut axes, mut directions) = (0, before);
    let has = |event: StepEvent, but: StepEvent| {
        let mut ports = next.into_iter().zip(words(event)).zip(words(but));
        ports.any(|((next, word), but)| next & word & !but != 0)
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

/// Takes over the polarities `$2`, `$3` and `$4` if they have changed. At rest only: no pulse may
/// end by a new polarity.
pub(super) fn configure_if_changed(settings: &Settings) {
    if polarity(settings) != POLARITY.load(Relaxed) {
        configure(settings);
    }
}

/// `$2`, `$3` and `$4` in one word.
fn polarity(settings: &Settings) -> u32 {
    let [step, direction] = [settings.step_invert, settings.direction_invert].map(u32::from);
    step | direction << 8 | u32::from(settings.enable_invert) << 16
}

/// Makes the tables and outputs the levels of standstill. The drivers stay enabled or disabled: an
/// axis that is held must not fall because a setting changes.
fn configure(settings: &Settings) {
    POLARITY.store(polarity(settings), Relaxed);
    let wiring = &chosen::WIRING;
    let active_low = usize::from(settings.step_invert);
    let reversed = usize::from(settings.direction_invert);
    let direct = |axes: usize, negative: u8| {
        let high = usize::from(negative) ^ reversed;
        Wiring::words(&wiring.direction, axes, high)
    };
    let pulse = |raise: usize, drop: usize| {
        let mut levels = Wiring::words(&wiring.step, raise, !active_low);
        merge(&mut levels, Wiring::words(&wiring.step, drop, active_low));
        levels
    };
    for (row, words) in SHARED.events.iter().enumerate() {
        let mask = row % MASKS;
        let levels = match (HAS_HALF_TABLES, row / MASKS) {
            (true, 0) => pulse(mask, 0),
            (true, 1) => pulse(0, mask),
            (true, 2) => direct(ALL_AXES & !X, mask as u8),
            (true, _) => direct(X, mask as u8 >> 1),
            (false, _) => {
                let event = StepEvent::from_bits(row as u32);
                let [raise, drop] = [event.raise(), event.drop()].map(|axes| axes as usize);
                let change = event
                    .directions()
                    .map(|directions| direct(ALL_AXES, directions));
                change.unwrap_or_else(|| pulse(raise, drop))
            }
        };
        store(words, &levels);
    }
    let [off, on] = &SHARED.enable;
    store(off, &wiring.enable.word(!settings.enable_invert));
    store(on, &wiring.enable.word(settings.enable_invert));
    let low = words(StepEvent::new(0, 0, u32::MAX));
    write_a_and_b([low[0], low[1]]);
    enable(IS_ENABLED.load(Relaxed));
}

/// Switches all drivers on or off.
pub(super) fn enable(on: bool) {
    IS_ENABLED.store(on, Relaxed);
    let [a, b, c] = &SHARED.enable[usize::from(on)];
    write_a_and_b([a.load(Relaxed), b.load(Relaxed)]);
    write_port_c(c.load(Relaxed));
}

fn merge(words: &mut [u32; 3], with: [u32; 3]) {
    for (word, with) in words.iter_mut().zip(with) {
        *word |= with;
    }
}

fn store(to: &[AtomicU32], words: &[u32; 3]) {
    for (to, word) in to.iter().zip(words) {
        to.store(*word, Relaxed);
    }
}

/// Sets and resets pins of ports A and B.
#[inline]
#[expect(unsafe_code, reason = "raw words for the ports' set/reset registers")]
pub(super) fn write_a_and_b([a, b]: [u32; 2]) {
    // SAFETY: a write to BSRR is atomic and changes only the pins whose bits are set; the words
    // hold pins of `WIRING` only, which nothing else drives.
    unsafe {
        (*pac::GPIOA::ptr()).bsrr().write(|w| w.bits(a));
        (*pac::GPIOB::ptr()).bsrr().write(|w| w.bits(b));
    }
}

/// Sets and resets pins of port C.
#[inline]
#[expect(unsafe_code, reason = "raw words for the port's set/reset register")]
pub(super) fn write_port_c(word: u32) {
    // SAFETY: as in `write_a_and_b`.
    unsafe {
        (*pac::GPIOC::ptr()).bsrr().write(|w| w.bits(word));
    }
}
