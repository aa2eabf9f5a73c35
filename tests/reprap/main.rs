//! The RepRap dialect, `$780=1`: lines, codes and answers, as hosts of 3D printers see them.

mod accessories;
mod answers;
#[path = "../support/cases.rs"]
mod cases;
mod codes;
mod damage;
mod emergencies;
#[cfg(feature = "axes-4")]
mod extruder;
mod files;
mod homing;
mod host;
mod lines;
mod pages;
mod switches;
mod times;

use cases::cases;
