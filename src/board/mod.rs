//! The board: pins, clocks and peripherals. Exactly one `board-*` feature chooses it.
//!
//! A board module says which pins the machine is wired to and sets up the clocks; what the boards
//! have in common is here. Everything that needs `unsafe` is in this folder.
//!
//! # Cost
//!
//! Flash is read without prefetch: lines that the prefetch buffer serves never enter the instruction
//! cache. Without it, interrupts that run again and again are faster, and their worst case is lower. What
//! is written to the flash's access control must be a constant: the analysis compares it.

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
mod delay_timer;
mod flash;
pub(crate) mod host_clock;
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
mod vectors;
mod wiring;

pub(crate) use actuators::Actuators;
pub(crate) use inputs::{InputInterrupts, InputPins};
pub(crate) use release::ChipPlatform;
pub(crate) use serial::Receiver;
pub(crate) use serial_session::SerialSession;
pub(crate) use step_output::{StepInterrupt, StepPins, StepTimerToken};
pub(crate) use stm32f4xx_hal::pac;
pub(crate) use storage::{Memory, Storage};

use leadscrew::{model::HAS_REPRAP, protocol::Session, units::TICKS_PER_SECOND};
use stm32f4xx_hal::rcc::{Config, Enable, Rcc, RccExt};

/// The peripherals the tasks drive.
pub(crate) struct Board {
    /// Step and direction pins, and their timer.
    pub(crate) output: StepPins,
    /// Token of the tasks that start and stop that timer.
    pub(crate) step_timer: StepTimerToken,
    /// Receiving half of the sender's USART.
    pub(crate) receiver: Receiver,
    /// Switches, probe and buttons.
    pub(crate) inputs: InputInterrupts,
    /// Spindle, coolant and drivers, and the timer that releases `prepare`.
    pub(crate) actuators: Actuators,
    /// The journal in flash.
    pub(crate) storage: &'static mut Storage,
    /// The session, with the contents of the journal.
    pub(crate) session: &'static mut Session,
}

/// Sets the clocks to those of `config`, and reads flash without prefetch.
///
/// # Panics
///
/// If the core does not count half ticks, or the slower timers do not count ticks: every time would be
/// wrong.
fn start_clocks(rcc: pac::RCC, flash: &pac::FLASH, config: Config) -> Rcc {
    let rcc = rcc.freeze(config);
    let (core_hz, timers_hz) = (rcc.clocks.hclk().raw(), rcc.clocks.timclk1().raw());
    assert!(
        emulation::is_emulated()
            || core_hz == 2 * TICKS_PER_SECOND && timers_hz == TICKS_PER_SECOND,
        "the step timer counts half ticks, and TIM6, TIM7 and the PWM count ticks"
    );
    flash.acr().write(|w| flash_access(w).dcen().set_bit());
    rcc
}

/// Sets what every write of the register has in common, as the clock in `schedule.toml` says: wait states
/// at 168 MHz, and no prefetch.
fn flash_access(w: &mut pac::flash::acr::W) -> &mut pac::flash::acr::W {
    w.latency().ws5().icen().set_bit()
}

/// Starts the clocks of the peripherals that all boards use. Those of the GPIO ports run already.
fn enable_clocks(rcc: &mut Rcc) {
    pac::TIM6::enable(rcc);
    pac::TIM7::enable(rcc);
    if HAS_REPRAP {
        pac::TIM4::enable(rcc);
    }
    pac::SYSCFG::enable(rcc);
}

/// Sleeps until an interrupt comes; returns at once if one has come since the last call.
pub(crate) fn sleep() {
    if emulation::is_emulated() {
        emulation::idle();
    } else {
        cortex_m::asm::wfe();
    }
}

// Makes Cargo relink when the memory map changes; there is no build script to say so.
const _: &[u8] = include_bytes!("../../memory.x");
