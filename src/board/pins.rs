//! Step, direction and enable outputs, as words for the ports' set/reset registers.
//!
//! The words are looked up by axis mask in tables that already hold each axis's polarity, so the
//! step interrupt neither shifts nor decides. The tables are rebuilt only at rest.

use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering::Relaxed};

use leadscrew::{axis::AXES, settings::Settings};

use super::{
    chosen, pac,
    wiring::{Pin, Wiring},
};

/// Masks of axes.
const MASKS: usize = 1 << AXES;

/// Words for ports A and B.
type Words = [AtomicU32; 2];

/// Written at rest by [`configure`], read by the step interrupt.
struct Tables {
    /// For each pair of masks, see [`pair`].
    step: [Words; MASKS * MASKS],
    /// For each mask of axes that go in the negative direction; port C last.
    direction: [[AtomicU32; 3]; MASKS],
    /// To disable and to enable the drivers.
    enable: [[AtomicU32; 3]; 2],
}

static TABLES: Tables = Tables {
    step: [const { [const { AtomicU32::new(0) }; 2] }; MASKS * MASKS],
    direction: [const { [const { AtomicU32::new(0) }; 3] }; MASKS],
    enable: [const { [const { AtomicU32::new(0) }; 3] }; 2],
};

/// The words for pulses that begin and pulses that end.
#[inline]
fn pair(raise: u32, drop: u32) -> &'static Words {
    &TABLES.step[(raise as usize % MASKS) | (drop as usize % MASKS) << AXES]
}

/// What the next event outputs on ports A and B.
static NEXT: [AtomicU32; 2] = [const { AtomicU32::new(0) }; 2];

/// The directions output last.
static DIRECTIONS: AtomicU8 = AtomicU8::new(0);

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

/// Outputs what [`prepare`] computed last time. Only the step interrupt calls this and the two
/// after it.
#[inline]
pub(super) fn write() {
    write_a_and_b([NEXT[0].load(Relaxed), NEXT[1].load(Relaxed)]);
}

/// Looks up what the next event outputs: pulses to begin and to end, bit 0 = X.
#[inline]
pub(super) fn prepare(raise: u32, drop: u32) {
    let [a, b] = pair(raise, drop);
    NEXT[0].store(a.load(Relaxed), Relaxed);
    NEXT[1].store(b.load(Relaxed), Relaxed);
}

/// Outputs directions now, bit 0 = X, 1 = negative.
#[inline]
pub(super) fn set_directions(directions: u8) {
    DIRECTIONS.store(directions, Relaxed);
    let words = &TABLES.direction[usize::from(directions) % MASKS];
    write_a_and_b([words[0].load(Relaxed), words[1].load(Relaxed)]);
    if chosen::WIRING.uses_port_c() {
        write_port_c(words[2].load(Relaxed));
    }
}

impl Wiring {
    /// The words that drive the pins of some axes, of these the `high` ones high.
    fn words(pins: &[Pin; 6], axes: usize, high: usize) -> [u32; 3] {
        let mut words = [0; 3];
        for (axis, pin) in pins.iter().enumerate().take(AXES) {
            if axes >> axis & 1 != 0 {
                merge(&mut words, pin.word(high >> axis & 1 != 0));
            }
        }
        words
    }

    /// Whether a direction output of an axis is on port C.
    const fn uses_port_c(&self) -> bool {
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

/// Axes whose pulse begins with the next event, read back from its port words, and the directions.
#[cfg(feature = "board-netduino-plus-2")]
pub(super) fn pulses_next() -> (u32, u8) {
    let mut axes = 0;
    for axis in 0..AXES {
        let begins = pair(1 << axis, 0);
        let is_due = |port: usize| NEXT[port].load(Relaxed) & begins[port].load(Relaxed) != 0;
        axes |= u32::from(is_due(0) || is_due(1)) << axis;
    }
    (axes, DIRECTIONS.load(Relaxed))
}

/// Takes over the polarities `$2`, `$3` and `$4` if they have changed. At rest only: no pulse may
/// end by a new polarity. A call costs next to nothing when nothing has changed.
pub(crate) fn follow(settings: &Settings) {
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
    for (index, words) in TABLES.step.iter().enumerate() {
        let (raise, drop) = (index % MASKS, index >> AXES);
        let mut levels = Wiring::words(&wiring.step, raise, !active_low);
        merge(&mut levels, Wiring::words(&wiring.step, drop, active_low));
        store(words, &levels);
    }
    for (negative, words) in TABLES.direction.iter().enumerate() {
        let high = negative ^ reversed;
        store(words, &Wiring::words(&wiring.direction, MASKS - 1, high));
    }
    let [off, on] = &TABLES.enable;
    store(off, &wiring.enable.word(!settings.enable_invert));
    store(on, &wiring.enable.word(settings.enable_invert));
    let [a, b] = pair(0, u32::MAX);
    write_a_and_b([a.load(Relaxed), b.load(Relaxed)]);
    enable(IS_ENABLED.load(Relaxed));
}

/// Switches all drivers on or off.
pub(super) fn enable(on: bool) {
    IS_ENABLED.store(on, Relaxed);
    let [a, b, c] = &TABLES.enable[usize::from(on)];
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
