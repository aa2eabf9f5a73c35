//! The workload of the replay: as much as the firmware can do at once.
//!
//! Scenes of one kind of stress each. None depends on the time: what is pressed or asked in motion
//! comes after so many lines, wherever the machine is by then.

mod contacts;
mod dialogue;
mod motion;

use anyhow::{Context, Result};
use common::ui;

use super::driver::Driver;

/// A scene: a machine that plays so many steps per second is made to do something.
type Scene = fn(&mut Driver, u32) -> Result<()>;

/// All scenes. Each begins at rest and unlocked. Up to homing the machine's zero is where it was
/// switched on, as contacts count.
const SCENES: [(&str, Scene); 15] = [
    ("axes at their full rates", motion::full_rates),
    ("segments as long as they get", motion::long_segments),
    ("short lines under a beam", motion::short_lines),
    ("lines of a few steps", motion::tiny_lines),
    ("arcs and helices", motion::arcs),
    ("holds and overrides", motion::holds),
    ("limits of jerk", motion::limits_of_jerk),
    ("jogs", motion::jogs),
    ("resets in motion", motion::resets),
    ("probing", contacts::probing),
    ("contacts late in a segment", contacts::late),
    ("homing", contacts::homing),
    ("limit switches, door and buttons", contacts::switches),
    ("spindle, coolant and dwells", dialogue::accessories),
    ("settings, queries and nonsense", dialogue::talk),
];

/// Has the firmware do everything.
pub(super) fn run(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    for (name, scene) in SCENES {
        ui::status("Replaying", name);
        let result = scene(driver, step_rate_hz).and_then(|()| driver.reset());
        result.with_context(|| format!("in the scene {name:?}"))?;
    }
    Ok(())
}

/// Settings of a machine of 1000 steps/mm whose axes each may take all the steps there are.
fn fast(step_rate_hz: u32, acceleration: f64) -> Vec<String> {
    /// The highest rate of one axis with a pulse of 3 µs and an equal pause, Hz.
    const AXIS_HZ: u32 = 100_000;
    // A whole number of mm/s, so that the product is below the limit for certain.
    let speed_mm_min = 60 * (step_rate_hz.min(AXIS_HZ) / 1000);
    let mut lines = vec!["$0=3".into(), "$1=255".into(), "$11=0.01".into()];
    for axis in 0..3 {
        lines.push(format!("${}=10", 110 + axis));
        lines.push(format!("${}=1000", 100 + axis));
        lines.push(format!("${}={speed_mm_min}", 110 + axis));
        lines.push(format!("${}={acceleration}", 120 + axis));
        lines.push(format!("${}=1000", 130 + axis));
        lines.push(format!("${}=0", 800 + axis));
    }
    lines
}

/// The same, with an acceleration that takes a time to be there.
fn smooth(step_rate_hz: u32, acceleration: f64, seconds: f64) -> Vec<String> {
    let jerk = acceleration / seconds;
    let jerks = (0..3).map(|axis| format!("${}={jerk}", 800 + axis));
    fast(step_rate_hz, acceleration)
        .into_iter()
        .chain(jerks)
        .collect()
}

/// Lines as the driver takes them.
fn words(lines: &[String]) -> impl Iterator<Item = &str> {
    lines.iter().map(String::as_str)
}
