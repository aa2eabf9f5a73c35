//! The RepRap dialect, `$780=1`: lines, codes and answers, as hosts of 3D printers see them.

mod accessories;
mod answers;
mod codes;
mod damage;
mod emergencies;
#[cfg(feature = "axes-4")]
mod extruder;
mod files;
mod homing;
mod lines;
mod machine;
mod pages;
#[path = "../support/mod.rs"]
mod support;
mod switches;
mod times;
