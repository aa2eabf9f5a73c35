//! QEMU with the firmware in it, or with a program that ends by itself.
#![allow(
    clippy::missing_errors_doc,
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    clippy::return_self_not_must_use,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

mod debugger;
mod emulator;
mod patience;
pub mod semihosting;
mod serial;

pub use debugger::Debugger;
pub use emulator::{Emulator, FIRST_USART, Pins, symbol};
pub use patience::Patience;
