//! What lines do: offsets, units, arcs, program flow, and what a refused line leaves alone.

#![cfg(not(target_os = "none"))]

mod arcs;
mod laws;
mod lines;
mod offsets;
mod plain;
mod refused;
mod support;
