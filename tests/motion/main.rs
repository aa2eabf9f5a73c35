//! Motion as the step pins show it: counts, paths, limits, and the time that segments take.
#![cfg(not(target_os = "none"))]

mod arc_jerk;
mod arcs;
mod arithmetic;
mod backlash;
mod contours;
mod core_xy;
mod experiment_arcs;
mod extremes;
mod faults;
mod integer_arcs;
mod jerk;
mod lookahead;
mod moves;
mod numerics;
mod path_control;
mod playback;
#[cfg(feature = "axes-4")]
mod rotary;
mod rounding;
mod rounding_time;
mod segments;
mod step_arcs;
#[path = "../support/mod.rs"]
mod support;
