//! The board: pins, clocks and peripherals. Exactly one `board-*` feature chooses it.
//!
//! A board module says which pins the machine is wired to and sets up the clocks; what the boards
//! have in common is here. Everything that needs `unsafe` is in this folder.

#[cfg(feature = "emulated")]
mod emulation;
#[cfg(feature = "board-netduino-plus-2")]
mod netduino_plus_2;
#[cfg(feature = "board-netduino-plus-2")]
use netduino_plus_2 as chosen;
#[cfg(feature = "board-netduino-plus-2")]
pub(crate) use netduino_plus_2::init;

#[cfg(not(feature = "emulated"))]
#[path = "no_emulation.rs"]
mod emulation;
#[cfg(feature = "board-nucleo-f446re")]
mod nucleo_f446re;
#[cfg(feature = "board-nucleo-f446re")]
use nucleo_f446re as chosen;
#[cfg(feature = "board-nucleo-f446re")]
pub(crate) use nucleo_f446re::init;

mod actuators;

mod flash;
mod inputs;
mod outputs;
mod panic;
mod pins;
mod proven;
pub(crate) mod release;
mod serial;
mod serial_session;
mod stack;
mod step_output;
mod step_timer;
mod storage;
#[cfg(feature = "trace")]
pub(crate) mod trace;
#[cfg(not(feature = "trace"))]
#[path = "no_trace.rs"]
pub(crate) mod trace;
mod wake;
mod wiring;

pub(crate) use actuators::Actuators;
pub(crate) use inputs::{InputPins, InputTimer};
pub(crate) use release::ChipPlatform;
pub(crate) use serial::Receiver;
pub(crate) use serial_session::{SerialSession, power_up};
pub(crate) use step_output::{StepInterrupt, StepPins, StepSwitch};
pub(crate) use stm32f4xx_hal::pac;
pub(crate) use storage::Storage;

use leadscrew::settings::Loaded;
use stm32f4xx_hal::rcc::{Config, Enable, Rcc, RccExt};

/// The peripherals the tasks drive.
pub(crate) struct Board {
    /// Step and direction pins, and their timer.
    pub(crate) output: StepPins,
    /// What starts and stops that.
    pub(crate) step: StepSwitch,
    /// What comes from the sender.
    pub(crate) receiver: Receiver,
    /// Switches, probe and buttons.
    pub(crate) inputs: InputTimer,
    /// Spindle, coolant and drivers, and what releases `prepare` after a time.
    pub(crate) actuators: Actuators,
    /// Where settings are stored, and what is stored there.
    pub(crate) storage: Storage,
    pub(crate) loaded: Loaded,
}

/// Runs the core at the clock that `config` asks for, and flash without prefetch.
///
/// Lines that the prefetch buffer serves never enter the instruction cache, so without it code is
/// faster where it counts, in interrupts that run again and again, and its worst case is lower.
fn start_clocks(rcc: pac::RCC, flash: &pac::FLASH, config: Config) -> Rcc {
    let rcc = rcc.freeze(config);
    flash.acr().modify(|_, w| w.prften().clear_bit());
    rcc
}

/// Lets the clocks of what all boards use run. Ports have theirs already.
fn enable_clocks(rcc: &mut Rcc) {
    pac::TIM6::enable(rcc);
    pac::TIM7::enable(rcc);
    pac::SYSCFG::enable(rcc);
}

/// Sleeps until an interrupt has come since this was called last.
pub(crate) fn sleep() {
    if emulation::is_emulated() {
        emulation::idle();
    } else {
        cortex_m::asm::wfe();
    }
}

// Makes Cargo relink when the memory map changes; there is no build script to say so.
const _: &[u8] = include_bytes!("../../memory.x");
