//! The costs of the firmware: instructions and modelled Cortex-M4 cycles, counted in QEMU.
//!
//! ```text
//!  instruction ──decode──▶ Instruction ──table──▶ cycles ──profile──▶ task, function, site ──report──▶ JSON
//! ```
//!
//! QEMU counts instructions exactly but knows no time, so each executed instruction is charged from
//! a table of the processor's manual ([`table::MODEL`] says which, and how it was checked). A task
//! is an exception handler of the vector table: it begins when its first instruction is reached
//! other than by a branch, and ends with its exception return. A preemption is charged to the
//! preempting task. Everything outside handlers is the task `thread`.
//!
//! An instruction that the decoder does not know is reported with its address and encoding; whoever
//! reads the report must then distrust it.
#![allow(clippy::must_use_candidate, reason = "a library of its own tests")]

pub mod decode;
pub mod elf;
mod follow;
mod observer;
mod plugin;
pub mod profile;
mod report;
pub mod table;
