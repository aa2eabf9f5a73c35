//! The board: pins, clocks and peripherals. A file of `boards/` chooses it, of which `build.rs` makes
//! [`chosen`]: which pin does what, and the clocks of the chip.
//!
//! Everything that needs `unsafe` is in this folder. Each module uses those below it in `tests/sources/layers.rs`.
//! With the feature `qemu`, the folder of its name takes the place of the chip: see `qemu/mod.rs`.

#![cfg_attr(feature = "qemu", allow(dead_code, reason = "the chip alone uses it"))]

#[cfg_attr(feature = "qemu", path = "qemu/actuators.rs")]
mod actuators;
mod backup_domain;
pub(crate) mod bootloader;
mod chosen;
#[cfg_attr(feature = "qemu", path = "qemu/clocks.rs")]
mod clocks;
#[cfg_attr(feature = "qemu", path = "qemu/contacts.rs")]
mod contacts;
mod crystal;
mod delay_timer;
#[cfg(feature = "eeprom")]
mod eeprom;
mod enable_state;
mod fault;
mod fault_port;
#[cfg(not(feature = "eeprom"))]
#[cfg_attr(feature = "qemu", path = "qemu/flash.rs")]
mod flash;
pub(crate) mod handlers;
#[cfg_attr(feature = "qemu", path = "qemu/host_clock.rs")]
pub(crate) mod host_clock;
mod image_check;
mod inputs;
mod line_level;
#[cfg_attr(feature = "qemu", path = "qemu/motion_clock.rs")]
mod motion_clock;
#[cfg_attr(feature = "usb", path = "no_serial.rs")]
#[cfg_attr(not(feature = "usb"), path = "no_usb_link.rs")]
mod other_link;
mod outputs;
#[cfg_attr(feature = "phases", path = "phase_pins.rs")]
mod pins;
mod power_up;
mod pre_init;
mod proof_constants;
mod proven;
#[cfg_attr(feature = "qemu", path = "qemu/pwm.rs")]
mod pwm;
#[cfg(feature = "qemu")]
mod qemu;
pub(crate) mod release;
#[cfg_attr(feature = "qemu", path = "qemu/reset_state.rs")]
mod reset_state;
#[cfg_attr(feature = "usb", path = "usb_link.rs")]
mod serial;
mod serial_session;
mod stack;
mod step_output;
#[cfg_attr(feature = "qemu", path = "qemu/step_timer.rs")]
mod step_timer;
mod storage;
mod supply;
#[cfg_attr(not(feature = "trace"), path = "no_trace.rs")]
pub(crate) mod trace;
#[cfg(feature = "trace")]
#[cfg_attr(feature = "qemu", path = "qemu/trace_clock.rs")]
mod trace_clock;
pub(crate) mod vectors;
#[cfg_attr(feature = "qemu", path = "qemu/watchdog.rs")]
pub(crate) mod watchdog;
mod wiring;

pub(crate) use actuators::Actuators;
/// Sleeps until an interrupt comes; returns at once if one has come since the last call.
#[cfg(not(feature = "qemu"))]
pub(crate) use cortex_m::asm::wfe as sleep;
pub(crate) use inputs::InputPins;
pub(crate) use line_level::LineLevel;
pub(crate) use other_link::*;
pub(crate) use power_up::init;
#[cfg(feature = "qemu")]
pub(crate) use qemu::sleep;
pub(crate) use release::ChipPlatform;
#[cfg(not(feature = "usb"))]
pub(crate) use serial::Receiver;
pub(crate) use serial::Transmitter;
#[cfg(feature = "usb")]
pub(crate) use serial::{UsbControl, UsbLink, UsbMemory};
pub(crate) use serial_session::SerialSession;
pub(crate) use step_output::{StepInterrupt, StepPins, StepTimerToken};
pub(crate) use stm32f4xx_hal::pac;
pub(crate) use storage::{Memory, MotionMemory, Storage};
