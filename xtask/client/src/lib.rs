//! Grbl's protocol from the computer's side, for any machine that speaks it: Grbl 1.1, grblHAL, `FluidNC`, Leadscrew.
//!
//! The core is pure. [`Lines`] divides received bytes into lines. [`Line`] is the meaning of a line: the
//! [`Response`] to a statement, a status [`Report`], an alarm, an answer to a `$` statement. [`Sender`] knows when
//! the machine has room for a statement, and which statement an answer belongs to. [`Status`] keeps the fields
//! that only some reports have. Files, sockets and clocks belong to the caller: with the feature `os` to [`Link`],
//! a serial port or a TCP address, and to [`Machine`], which sends requests and waits for answers.
//!
//! Positions, offsets and feeds are in the unit of the reports: mm and mm/min, or inches and inches/min where `$13`
//! is 1; degrees for rotary axes. What only Leadscrew says is read where it comes, and never needed.
#![forbid(unsafe_code)]

pub mod answer;
pub mod catalogue;
#[cfg(feature = "serde")]
pub mod client;
mod line;
mod manual_lines;
pub mod meaning;
pub mod realtime;
mod report;
pub mod sender;
pub mod transmission;
pub mod words;

#[cfg(feature = "os")]
pub mod guard;
#[cfg(feature = "os")]
pub mod link;
#[cfg(feature = "os")]
mod machine;
#[cfg(feature = "os")]
mod port;

pub use answer::MachineAnswers;
#[cfg(feature = "serde")]
pub use client::Client;
pub use line::{Line, Lines, Response};
pub use manual_lines::ManualLines;
pub use report::{NoReport, Report, Room, Status, numbers};
pub use sender::{InFlight, Sender, WINDOW};
pub use transmission::Transmission;

#[cfg(feature = "os")]
pub use guard::JobGuard;
#[cfg(feature = "os")]
pub use link::Link;
#[cfg(feature = "os")]
pub use machine::{Answer, Machine};
