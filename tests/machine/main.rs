//! The machine around the motion: switches, homing, probing, power, answers in time.
#![cfg(not(target_os = "none"))]

mod backlash;
mod core_xy;
mod damage;
mod drivers;
mod gantry;
mod hard_limits;
mod homing;
mod inputs;
mod jogs;
mod line_break;
mod lost_bytes;
mod numbers;
mod phases;
mod post_processors;
mod postponed;
mod power;
mod probed_zero;
mod probing;
mod queued_motion;
mod refused_lines;
mod spindle;
mod status;
mod stored_program;
#[path = "../support/mod.rs"]
mod support;
mod text;
mod tools;
mod unexpected_contact;
