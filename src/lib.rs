//! Motion control without hardware: the same code runs in the firmware, the simulator and the tests.
//!
//! The firmware (`src/app.rs`, `src/board/`) binds this library to a chip, [`sim`] to a virtual clock. Nothing in it
//! allocates, waits or panics, and nothing is `unsafe`.
//!
//! # How a move goes
//!
//! `G1 X10 F600` passes through five tasks (and `wake`, which only wakes `interpret`). Each has a fixed priority, owns its part of the state, and hands the rest
//! on through a queue with one writer and one reader. Their bodies are the functions of [`tasks`].
//!
//! **Bytes.** [`tasks::serial_rx`] takes each byte from the port. [`protocol::realtime::receive`] decides what it is:
//! a realtime command such as `?`, `!` or `~` becomes a request in [`model::Requests`], which any task may read; a
//! byte of a line goes to the queue [`protocol::Incoming`].
//!
//! **Lines.** [`tasks::interpret`] runs [`protocol::Session::run`], the conversation with the sender: each line gets
//! one answer, in order. A `$` statement is read by [`protocol::Dollar`]; anything else by the
//! [`gcode::interpreter::Interpreter`], which checks the whole line before it changes anything. It keeps the modes
//! ([`gcode::Modal`]), the offsets and the programmed position in nanometres ([`units::Nm`]), so that no sum of
//! moves drifts. Out come values of [`model::Command`]: a line or an arc to an exact target, a dwell, a speed of the
//! spindle.
//!
//! **Blocks.** Commands become entries of the queue to the next task ([`path::Entry`]). [`path::Router`] makes blocks of
//! moves: the steps of each motor, the speed that all axes allow along the path, and the speed of the junction with
//! the block before. Between the two stand, where a program asks for them, [`path::Compensator`] (`G41`, `G42`) and
//! [`path::Blender`] (`G64`).
//!
//! **Segments.** [`tasks::prepare`] runs [`motion::Motion::run`], one bounded piece of work at a time. The look-ahead
//! plans the speeds of all known blocks, backwards from a stop at the end of the last one. From the block in execution,
//! `Motion` makes a segment: a millisecond or so of motion with constant acceleration, which with limits of jerk
//! changes from segment to segment. It also owns the state of the machine ([`machine::Control`]): holds, the safety door, homing, probing, alarms.
//!
//! **Steps.** A [`stepper`] generator computes at which tick of the step timer each motor of the segment steps, and
//! pushes these events to [`stepper::EventRing`]. The most urgent task, [`tasks::step`], outputs the event that is due, sets up
//! the next, and loads the time of the event after that into the timer. When an event begins a segment, [`tasks::segment_start`] records that
//! in [`stepper::SegmentRing`], from which `prepare` knows what has been played.
//!
//! Two more tasks stand beside the stream: [`tasks::inputs`] filters switches, probe and buttons
//! ([`machine::Watch`]) and latches the position at a contact; [`tasks::report`] answers `?` from a copy of the state
//! that `prepare` publishes ([`machine::Snapshot`]).
//!
//! # Where to go on
//!
//! | to find | begin at |
//! |---|---|
//! | a setting, and what is stored | [`settings::Settings`], [`settings::Stored`], [`settings::Journal`] |
//! | what a G-code word does | [`gcode::codes`], then [`gcode::interpreter`] |
//! | why a line is refused, why a machine is locked | [`gcode::LineError`], [`model::Alarm`] |
//! | how fast a move is | [`path::Router`] for one block, [`motion`] for all of them |
//! | an arc in whole steps | [`stepper::StepArc`] |
//! | homing, probing, parking | [`motion`] |
//! | texts to the sender | [`protocol::report`], [`protocol::listing`], [`protocol::replies`] |
//! | queue sizes, and times that tasks share | [`model::queues`], [`model::timing`] |
//!
//! A program on the virtual machine, with each edge of its pins, takes a few lines:
//!
//! ```
//! use leadscrew::{
//!     settings::Settings,
//!     sim::{Edge, Simulator, Stream, Watcher},
//! };
//!
//! /// Counts the steps of X.
//! struct Counter(u32);
//!
//! impl Watcher for Counter {
//!     fn edge(&mut self, edge: &Edge) {
//!         self.0 += u32::from(edge.raise & 1);
//!     }
//!     fn answer(&mut self, _line: u64, answer: &[u8]) {
//!         assert_eq!(answer, b"ok");
//!     }
//!     fn message(&mut self, _: &Simulator, _answers: u64, _message: &[u8]) {}
//! }
//!
//! let mut simulator = Simulator::new(&Settings::default());
//! let mut counter = Counter(0);
//! Stream::new(&mut simulator, b"G1 X10 F600\n".iter().copied(), 115_200).run(&mut counter);
//! assert_eq!(counter.0, 2_500);
//! ```
//!
//! # Layers
//!
//! Modules are listed from the bottom up: each uses those above it in this list, and none below
//! (`tests/sources/layers.rs`).
#![no_std]
#![forbid(unsafe_code)]
#![warn(clippy::unwrap_used)]

#[cfg(test)]
extern crate std;

#[cfg(test)]
#[path = "../tests/support/cases.rs"]
mod cases;
#[cfg(test)]
use cases::cases;

/// Atomics of the tasks: those of `core`, or of a test that lets tasks interrupt each other at each access.
#[cfg(not(feature = "interleave"))]
pub(crate) use core::sync::atomic;
#[cfg(feature = "interleave")]
#[path = "../tests/interleave/atomics.rs"]
pub mod atomic;

pub mod axis;
pub mod decimal;
pub mod math;
pub mod units;

pub mod model;

pub mod settings;

pub mod gcode;
pub mod stepper;

pub mod path;

pub mod machine;

pub mod motion;

pub mod protocol;

pub mod tasks;

#[cfg(feature = "usb")]
pub mod usb;

pub mod sim;
