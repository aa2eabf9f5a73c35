//! The outputs of boards that energise the coils of motors themselves, as words for the ports' set/reset
//! registers. Takes the place of `pins.rs`.
//!
//! A table has, for each axis and phase, the words that energise its coils. The step interrupt adds up the words of
//! all axes for the event that comes next, and outputs them when it is due. `$2` and `$4` mean nothing here:
//! there are no pulses, and a motor that is not enabled has no coil energised.
//!
//! # Cost
//!
//! The data of the step interrupt is one block of memory, which a single address reaches; the table is part of the
//! block because flash is slow.

use core::{
    cell::UnsafeCell,
    sync::atomic::{AtomicU32, Ordering::Relaxed},
};

use leadscrew::{
    axis::AXES,
    machine::Inputs,
    settings::Settings,
    stepper::{COILS, PHASES, PhaseDrive, PhaseSteps, Phases, StepEvent, coils},
};

use super::{
    chosen,
    enable_state::EnableState,
    wiring::{PortList, write_port},
};

/// The ports of the coils, and their number.
const EVENT_PORTS: PortList = chosen::WIRING.event_ports();
const PORTS: usize = EVENT_PORTS.length;

/// Words for the ports.
type CoilWords = [u32; PORTS];

/// The words with which no coil is energised.
const RELEASED: CoilWords = {
    let mut words = [0; PORTS];
    let mut axis = 0;
    while axis < AXES {
        words = both(words, words_of(axis, 0));
        axis += 1;
    }
    words
};

/// Returns the words that energise some coils of an axis, bit 0 = IN1, and not the others.
const fn words_of(axis: usize, energised: u8) -> CoilWords {
    let mut words = [0; PORTS];
    let mut coil = 0;
    while coil < COILS {
        let pin = chosen::WIRING.motors.phases[axis][coil];
        let port = EVENT_PORTS.index(pin.port());
        words[port] |= pin.word(energised >> coil & 1 != 0);
        coil += 1;
    }
    words
}

/// Returns the words that do what two do.
const fn both(mut words: CoilWords, others: CoilWords) -> CoilWords {
    let mut port = 0;
    while port < PORTS {
        words[port] |= others[port];
        port += 1;
    }
    words
}

/// The data of the step interrupt, which other tasks change while it stands.
struct SharedMotors {
    motors: UnsafeCell<Motors>,
    /// For each axis the words of its phases. Written by [`configure`].
    energised: [[[AtomicU32; PORTS]; PHASES]; AXES],
}

/// The motors, and the words that the next event outputs.
struct Motors {
    drive: PhaseDrive,
    words: CoilWords,
}

static SHARED: SharedMotors = SharedMotors {
    motors: UnsafeCell::new(Motors {
        drive: PhaseDrive::new(),
        words: [0; PORTS],
    }),
    energised: [const { [const { [const { AtomicU32::new(0) }; PORTS] }; PHASES] }; AXES],
};

#[expect(unsafe_code, reason = "tasks use the motors in turn")]
// SAFETY: while the step interrupt may run, it alone uses them. Other tasks use them before they start it and after
// they have halted it: see `StepTimerToken`.
unsafe impl Sync for SharedMotors {}

impl SharedMotors {
    /// Calls a function with the motors, which must not call this one.
    #[inline]
    #[expect(unsafe_code, reason = "nothing else has them meanwhile")]
    fn with<R>(&self, of: impl FnOnce(&mut Motors) -> R) -> R {
        // SAFETY: as above.
        of(unsafe { &mut *self.motors.get() })
    }

    /// Returns the words that energise the coils of all motors.
    #[inline]
    fn words(&self, phases: Phases) -> CoilWords {
        let mut words = [0; PORTS];
        for (axis, energised) in self.energised.iter().enumerate() {
            for (word, energised) in words.iter_mut().zip(&energised[phases.phase(axis)]) {
                *word |= energised.load(Relaxed);
            }
        }
        words
    }
}

/// Whether coils are energised.
static ENABLED: EnableState = EnableState::new();

/// What [`configure`] has been told, as [`configuration`] returns it.
static CONFIGURATION: AtomicU32 = AtomicU32::new(0);

/// Outputs what the last [`set_next`] has set. For the step interrupt, or while it stands.
#[inline]
pub(super) fn write() {
    SHARED.with(|motors| {
        output(motors.words);
        motors.drive.output();
    });
}

/// Outputs a word for each port.
#[inline]
fn output(words: CoilWords) {
    for (index, word) in words.into_iter().enumerate() {
        write_port(EVENT_PORTS.port(index), word);
    }
}

/// The next event does nothing.
#[inline]
pub(super) fn clear_next() {
    SHARED.with(|motors| {
        motors.drive.give_up();
        motors.words = [0; PORTS];
    });
}

/// Sets what the next event does. Motors are enabled before the first event.
#[inline]
pub(super) fn set_next(event: StepEvent) {
    SHARED.with(|motors| {
        motors.words = SHARED.words(motors.drive.set_up(event));
    });
}

/// Does nothing: such motors are one to an axis.
pub(super) const fn follow_standing_order(_settings: &Settings, _inputs: &Inputs) {}

/// Applies `$3` and `$791` if they have changed. At rest only.
pub(super) fn configure_if_changed(settings: &Settings) {
    if configuration(settings) != CONFIGURATION.load(Relaxed) {
        configure(settings);
    }
}

/// Returns `$3` and `$791` in one word.
fn configuration(settings: &Settings) -> u32 {
    u32::from(settings.direction_invert) | u32::from(settings.half_steps) << 8
}

/// Applies `$3` and `$791`. The motors stay enabled or not: an axis that they hold must not fall because a
/// setting changes.
pub(super) fn configure(settings: &Settings) {
    CONFIGURATION.store(configuration(settings), Relaxed);
    let steps = PhaseSteps::new(settings.half_steps, settings.direction_invert);
    SHARED.with(|motors| {
        motors.drive.configure(steps);
        motors.words = [0; PORTS];
    });
    for (axis, energised) in SHARED.energised.iter().enumerate() {
        for (phase, row) in energised.iter().enumerate() {
            for (to, word) in row.iter().zip(words_of(axis, coils(phase))) {
                to.store(word, Relaxed);
            }
        }
    }
    ENABLED.output_again(output_enable);
}

/// Energises the coils of all motors as their phases are, or none. For `prepare`, and before tasks run.
pub(super) fn enable(on: bool) {
    ENABLED.set(on, output_enable);
}

fn output_enable(on: bool) {
    if on {
        let phases = SHARED.with(|motors| motors.drive.phases());
        output(SHARED.words(phases));
    } else {
        output(RELEASED);
    }
}
