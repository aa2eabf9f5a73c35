//! The board: pins, clocks and peripherals. A file of `boards/` chooses it, of which `build.rs` makes
//! [`chosen`]: which pin does what, and the clocks of the chip.
//!
//!  Everything that needs `unsafe` is in this folder.
//!
//! # Cost
//!
//! Flash is read without prefetch: lines that the prefetch buffer serves never enter the instruction
//! cache. Without it, interrupts that run again and again are faster, and their worst case is lower. What
//! is written to the flash's access control must be a constant: the analysis compares it.

#[cfg(feature = "emulated")]
mod emulation;
#[cfg(not(feature = "emulated"))]
#[path = "no_emulation.rs"]
mod emulation;

mod actuators;
mod backup_domain;
mod chosen;
mod clocks;
mod crystal;
mod delay_timer;
#[cfg(feature = "eeprom")]
mod eeprom;
mod fault;
#[cfg(not(feature = "eeprom"))]
mod flash;
pub(crate) mod handlers;
pub(crate) mod host_clock;
mod image_check;
mod inputs;
mod line_level;
mod outputs;
#[cfg_attr(feature = "phases", path = "phase_pins.rs")]
mod pins;
mod power_up;
mod pre_init;
mod proven;
mod pwm;
pub(crate) mod release;
mod reset_state;
mod serial;
mod serial_session;
mod stack;
mod step_output;
mod step_timer;
mod storage;
mod supply;
#[cfg(feature = "trace")]
pub(crate) mod trace;
#[cfg(not(feature = "trace"))]
#[path = "no_trace.rs"]
pub(crate) mod trace;
mod vectors;
pub(crate) mod watchdog;
mod wiring;

pub(crate) use actuators::Actuators;
pub(crate) use inputs::{InputInterrupts, InputPins};
pub(crate) use line_level::LineLevel;
pub(crate) use power_up::init;
pub(crate) use release::ChipPlatform;
pub(crate) use serial::Receiver;
pub(crate) use serial_session::SerialSession;
pub(crate) use step_output::{StepInterrupt, StepPins, StepTimerToken};
pub(crate) use stm32f4xx_hal::pac;
pub(crate) use storage::{Memory, MotionMemory, Storage};

use leadscrew::{model::Alarm, protocol::Session};

/// The clock of TIM9 and TIM10, MHz: that of the core on every chip.
const TIMERS_MHZ: u16 = (chosen::WIRING.core_hz / 1_000_000) as u16;

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
    /// The alarm with which the machine comes up.
    pub(crate) alarm: Option<Alarm>,
}

/// Sets what every write of the register has in common, as the board's chip says: wait states, and no prefetch.
fn flash_access(w: &mut pac::flash::acr::W) -> &mut pac::flash::acr::W {
    w.latency()
        .set(chosen::WIRING.flash_wait_states)
        .icen()
        .set_bit()
}

/// Sleeps until an interrupt comes; returns at once if one has come since the last call.
pub(crate) fn sleep() {
    if emulation::is_emulated() {
        emulation::idle();
    } else {
        cortex_m::asm::wfe();
    }
}
