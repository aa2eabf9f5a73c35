//! Effects of lines: offsets, units, arcs, program flow; and refused lines, which have none.

#![cfg(not(target_os = "none"))]

mod arcs;
#[path = "../support/cases.rs"]
mod cases;
mod codes;
mod cycles;
mod habits;
mod laws;
mod lines;
mod offsets;
mod plain;
mod refused;
mod rotation;
mod support;
mod tools;

use cases::cases;
