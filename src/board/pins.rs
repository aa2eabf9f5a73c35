//! Step, direction and enable outputs, as words for the ports' set/reset registers.
//!
//! A table, indexed by [`StepEvent::output_index`], holds the words with the polarity of each axis. It is
//! made anew only at standstill. A second motor is two more bits in the words of its axis: the step interrupt
//! does the same for one motor and for two.
//!
//! # Cost
//!
//! The step interrupt neither shifts nor branches. Its data is one block of memory, which a single address reaches; the
//! words of the next event are written by two instructions and read by one, the fewest cycles for each. With six axes a
//! table of all pairs of halves would take a third of the memory, so each half has a table of its own.

use core::{
    cell::UnsafeCell,
    sync::atomic::{AtomicU32, Ordering::Relaxed},
};

use leadscrew::{
    axis::AXES, machine::Inputs, model::StandingMotors, settings::Settings, stepper::StepEvent,
};

use super::{
    chosen,
    enable_state::EnableState,
    wiring::{MotorPins, Pin, PortList, write_port},
};

/// Number of masks of axes, and the mask of all axes.
const MASKS: usize = 1 << AXES;
const ALL_AXES: usize = MASKS - 1;
/// Mask of the axis whose direction is in the second half of [`StepEvent::output_index`]: X. The directions
/// of the others are in the first half.
const X_MASK: usize = 1;

/// The ports that events change, and their number.
const EVENT_PORTS: PortList = chosen::WIRING.event_ports();
const PORTS: usize = EVENT_PORTS.length;
/// The ports of the enable outputs, and their number.
const ENABLE_PORTS: PortList = chosen::WIRING.enable_ports();

/// Whether each half of [`StepEvent::output_index`] has a table of its own: where one table would take more
/// than 24 KiB.
const HAS_HALF_TABLES: bool = StepEvent::OUTPUTS * PORTS * 4 > 24 * 1024;
/// Rows of the table. With half tables: first and second halves of pulses, then of changes of
/// direction.
const ROWS: usize = if HAS_HALF_TABLES {
    4 * MASKS
} else {
    StepEvent::OUTPUTS
};

/// Words for the ports of events.
pub(super) type Words = [u32; PORTS];
type Row = [AtomicU32; PORTS];

/// The data of the step interrupt, which other tasks change while it stands.
struct SharedWords {
    next: NextWords,
    /// Written at rest by [`configure`], read by the step interrupt.
    events: [Row; ROWS],
    /// The words that disable and enable the drivers.
    enable: [[AtomicU32; ENABLE_PORTS.length]; 2],
}

static SHARED: SharedWords = SharedWords {
    next: NextWords(UnsafeCell::new([0; PORTS])),
    events: [const { [const { AtomicU32::new(0) }; PORTS] }; ROWS],
    enable: [const { [const { AtomicU32::new(0) }; ENABLE_PORTS.length] }; 2],
};

/// Returns the words of an event.
pub(super) fn words(event: StepEvent) -> Words {
    let index = event.output_index();
    if !HAS_HALF_TABLES {
        return load(&SHARED.events[index]);
    }
    let first = if event.sets_directions() {
        2 * MASKS
    } else {
        0
    };
    let mut words = load(&SHARED.events[first + index % MASKS]);
    let second = load(&SHARED.events[first + MASKS + index / MASKS % MASKS]);
    for (word, second) in words.iter_mut().zip(second) {
        *word |= second;
    }
    words
}

fn load(row: &Row) -> Words {
    row.each_ref().map(|word| word.load(Relaxed))
}

/// The words that the next event outputs.
struct NextWords(UnsafeCell<Words>);

#[expect(unsafe_code, reason = "tasks use the words in turn")]
// SAFETY: while the step interrupt may run, it alone uses the words. Other tasks use them before
// they start it and after they have halted it: see `StepTimerToken`. A handler may read the words while
// the step interrupt waits for that handler.
unsafe impl Sync for NextWords {}

impl NextWords {
    #[expect(unsafe_code, reason = "nothing else has it meanwhile")]
    fn get(&self) -> Words {
        // SAFETY: as above.
        unsafe { *self.0.get() }
    }

    #[expect(unsafe_code, reason = "nothing else has it meanwhile")]
    fn set(&self, words: Words) {
        let first = self.0.get().cast::<u32>();
        for (port, word) in words.into_iter().enumerate() {
            // SAFETY: as above; there is a word for each port.
            unsafe { first.add(port).write_volatile(word) };
        }
    }
}

/// Whether the drivers are enabled.
static ENABLED: EnableState = EnableState::new();

/// The polarities of the tables, as [`polarity`] returns them.
static POLARITY: AtomicU32 = AtomicU32::new(0);

/// Outputs the words of the last [`set_next`]. For the step interrupt, or while it stands.
pub(super) fn write() {
    write_events(next_words());
}

/// Returns the words that the next event outputs.
pub(super) fn next_words() -> Words {
    SHARED.next.get()
}

/// Outputs a word for each port of events.
fn write_events(words: Words) {
    for (index, word) in words.into_iter().enumerate() {
        write_port(EVENT_PORTS.port(index), word);
    }
}

/// Clears the words of the next event: it outputs nothing.
pub(super) fn clear_next() {
    SHARED.next.set([0; PORTS]);
}

/// Sets the words of the next event.
pub(super) fn set_next(event: StepEvent) {
    SHARED.next.set(words(event));
}

/// Returns the words that drive the pins of some axes: high for axes in `high`, otherwise low.
fn words_of(pins: &[Pin; AXES], axes: usize, high: usize) -> Words {
    let mut words = [0; PORTS];
    for (axis, pin) in pins.iter().enumerate() {
        if axes >> axis & 1 != 0 {
            add(&mut words, &EVENT_PORTS, *pin, high >> axis & 1 != 0);
        }
    }
    words
}

/// The same of step outputs, but for those of motors that stand.
fn step_words(axes: usize, high: usize, standing: StandingMotors) -> Words {
    let MotorPins { step, second, .. } = &chosen::WIRING.motors;
    let mut words = words_of(step, axes & !usize::from(standing.first), high);
    for motor in *second {
        if (axes & !usize::from(standing.second)) >> motor.axis & 1 != 0 {
            add(
                &mut words,
                &EVENT_PORTS,
                motor.step,
                high >> motor.axis & 1 != 0,
            );
        }
    }
    words
}

/// The same of direction outputs.
fn direction_words(axes: usize, high: usize) -> Words {
    let MotorPins {
        direction, second, ..
    } = &chosen::WIRING.motors;
    let mut words = words_of(direction, axes, high);
    for motor in *second {
        if axes >> motor.axis & 1 != 0 {
            let is_high = high >> motor.axis & 1 != 0;
            add(
                &mut words,
                &EVENT_PORTS,
                motor.direction,
                is_high ^ motor.is_reversed,
            );
        }
    }
    words
}

/// Adds to the words of some ports that which drives a pin.
fn add(words: &mut [u32], ports: &PortList, pin: Pin, high: bool) {
    for (index, word) in words.iter_mut().enumerate() {
        if ports.port(index) == pin.port() {
            *word |= pin.word(high);
        }
    }
}

/// Makes the table anew if `prepare` has ordered that other motors stand. It makes no step before that is done: the
/// step interrupt meanwhile plays events without pins, whose words stay 0.
pub(super) fn follow_standing_order(settings: &Settings, inputs: &Inputs) {
    if let Some(standing) = inputs.standing_order() {
        make_table(settings, standing);
        inputs.carry_out(standing);
    }
}

/// Applies the polarities `$2`, `$3` and `$4` if they have changed. At rest only: a new polarity
/// must not end a pulse.
pub(super) fn configure_if_changed(settings: &Settings) {
    if polarity(settings) != POLARITY.load(Relaxed) {
        configure(settings);
    }
}

/// Returns `$2`, `$3` and `$4` in one word.
fn polarity(settings: &Settings) -> u32 {
    let [step, direction] = [settings.step_invert, settings.direction_invert].map(u32::from);
    step | direction << 8 | u32::from(settings.enable_invert) << 16
}

/// Makes the tables and outputs the levels of standstill. The drivers stay enabled or disabled: an
/// axis that they hold must not fall because a setting changes.
pub(super) fn configure(settings: &Settings) {
    POLARITY.store(polarity(settings), Relaxed);
    make_table(settings, StandingMotors::NONE);
    for (words, on) in SHARED.enable.iter().zip([false, true]) {
        let mut levels = [0; ENABLE_PORTS.length];
        for output in chosen::WIRING.enable {
            let high = on ^ output.is_active_low ^ settings.enable_invert;
            add(&mut levels, &ENABLE_PORTS, output.pin, high);
        }
        store(words, &levels);
    }
    write_events(words(StepEvent::new(0, 0, u32::MAX)));
    ENABLED.output_again(output_enable);
}

/// Makes the table, in which some motors stand.
fn make_table(settings: &Settings, standing: StandingMotors) {
    let active_low = usize::from(settings.step_invert);
    let reversed = usize::from(settings.direction_invert);
    let directions =
        |axes: usize, negative: u8| direction_words(axes, usize::from(negative) ^ reversed);
    let pulse = |raise: usize, drop: usize| {
        let mut levels = step_words(raise, !active_low, standing);
        let dropped = step_words(drop, active_low, standing);
        for (word, dropped) in levels.iter_mut().zip(dropped) {
            *word |= dropped;
        }
        levels
    };
    for (row, words) in SHARED.events.iter().enumerate() {
        let mask = row % MASKS;
        let levels = match (HAS_HALF_TABLES, row / MASKS) {
            (true, 0) => pulse(mask, 0),
            (true, 1) => pulse(0, mask),
            (true, 2) => directions(ALL_AXES & !X_MASK, mask as u8),
            (true, _) => directions(X_MASK, mask as u8 >> 1),
            (false, _) => {
                let event = StepEvent::from_bits(row as u32);
                let [raise, drop] = [event.raise(), event.drop()].map(|axes| axes as usize);
                let change = event
                    .directions()
                    .map(|negative| directions(ALL_AXES, negative));
                change.unwrap_or_else(|| pulse(raise, drop))
            }
        };
        store(words, &levels);
    }
}

/// Enables or disables all drivers. For `prepare`, and before tasks run.
pub(super) fn enable(on: bool) {
    ENABLED.set(on, output_enable);
}

fn output_enable(on: bool) {
    for (index, word) in SHARED.enable[usize::from(on)].iter().enumerate() {
        write_port(ENABLE_PORTS.port(index), word.load(Relaxed));
    }
}

fn store(to: &[AtomicU32], words: &[u32]) {
    for (to, word) in to.iter().zip(words) {
        to.store(*word, Relaxed);
    }
}
