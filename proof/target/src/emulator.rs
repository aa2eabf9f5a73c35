//! QEMU with the firmware in it, or with a program that ends by itself.

mod debugger;
mod patience;
mod process;
pub mod semihosting;
mod serial;

pub use debugger::Debugger;
pub use patience::Patience;
pub use process::{Emulator, FIRST_USART, Pins, symbol};
