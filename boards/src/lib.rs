//! The boards and chips that the firmware is built for, as files of data.
//!
//! `boards/*.toml` say which pin does what; `boards/chips/*.toml` what each chip has. The firmware's build
//! script makes Rust of a board ([`rust`]), the tools read its chip, clocks and memory, and the tables of
//! `docs/wiring.md` are made of it. `docs/boards.md` explains the files.
#![forbid(unsafe_code)]
#![allow(
    clippy::missing_errors_doc,
    clippy::must_use_candidate,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

mod board;
mod chip;
mod entries;
#[cfg(feature = "klipper")]
mod klipper;
mod memory;
mod pin;
mod rust;
mod serial;
mod timer;
mod wiring;

pub use board::{Board, EEPROM, MOST_AXES, PHASES, SMALL_EEPROM, USB};
pub use chip::{Chip, Clocks, Part};
pub use entries::{Fault, Place};
#[cfg(feature = "klipper")]
pub use klipper::board_file;
pub use memory::{FlashSector, MemoryLayout};
pub use pin::{Pin, Pull, SignedPin};
pub use rust::{FINGERPRINT, fingerprint, rust};
pub use serial::SerialPins;
pub use timer::PwmOutput;
pub use wiring::{AXES as AXIS_LETTERS, EepromPins, Input, SecondMotor, Wiring};

/// Folder of the boards, from the project's root.
pub const FOLDER: &str = "boards";
/// Variable that names the board of a build: a board's name, or the path of a file.
pub const BOARD: &str = "LEADSCREW_BOARD";
/// The board of a build that names none.
pub const DEFAULT: &str = "netduino-plus-2";
