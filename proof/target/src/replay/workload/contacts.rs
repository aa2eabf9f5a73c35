//! Contacts: switches, probe, door and buttons.

use anyhow::Result;
use leadscrew::{axis::AXES, model::Levels};
use simulation::machine::SwitchPositions;

use super::{
    fast,
    motion::{EXTREME, full_feed_mm_min, segment_steps, stagger},
};
use crate::replay::driver::Driver;

/// Nothing is mounted.
const NO_SWITCHES: SwitchPositions = SwitchPositions {
    low: [i32::MIN; AXES],
    high: [i32::MAX; AXES],
    plate: i32::MIN,
    block: None,
};

/// Homing with both orders of the axes, without a switch, and with the door opened meanwhile.
pub(super) fn homing(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    driver.set(&fast(step_rate_hz, 5000.0))?;
    driver.run([
        "$130=6", "$131=6", "$132=6", "$22=1", "$24=300", "$25=6000", "$26=1", "$27=1",
    ])?;
    let mut ends = NO_SWITCHES;
    ends.low = [-2500; AXES];
    ends.high = [2500; AXES];
    driver.mount(&ends)?;
    for direction in ["$23=0", "$23=7", "$23=1"] {
        driver.run([direction, "$H", "G53G0X-3Y-3Z-3"])?;
        driver.run(["$HX"])?;
    }
    driver.mount(&NO_SWITCHES)?;
    driver.stream(["$H"], |_| b"?")?;
    driver.finish()?;
    driver.reset()?;
    driver.stream(["$H"], |_| b"??")?;
    driver.close(Levels::DOOR.0)?;
    driver.finish()?;
    driver.mount(&NO_SWITCHES)?;
    driver.reset()?;
    driver.run(["$22=0"])
}

/// Probes that touch, that miss, towards and away, at speed.
pub(super) fn probing(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    driver.set(&fast(step_rate_hz, 5000.0))?;
    for (plate, speed) in [(-321, 600), (-567, 6000), (-800, 100_000)] {
        let mut ends = NO_SWITCHES;
        ends.plate = plate;
        driver.run(["G90G54G0Z0"])?;
        driver.come_to_rest()?;
        driver.mount(&ends)?;
        let (towards, away) = (format!("G38.2Z-2F{speed}"), format!("G38.4Z0F{speed}"));
        driver.run([
            towards.as_str(),
            away.as_str(),
            "G38.3X.1Y.1Z-.1F500",
            "G38.5Z-.2F500",
        ])?;
        driver.stream(["G90G1Z0F6000", "X.1Y.1Z-.1", "G38.3X0Y0Z-2"], |_| b"?")?;
        driver.finish()?;
        driver.mount(&NO_SWITCHES)?;
        driver.stream(["G38.2Z-.8F6000"], |_| b"!~?")?;
        driver.finish()?;
        driver.reset()?;
    }
    Ok(())
}

/// Contacts late in segments that are as full as they get: what has been played of these is counted.
/// A probe's slows the machine down, that of a switch stops it.
pub(super) fn late(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    let feed = full_feed_mm_min(step_rate_hz);
    let stagger = stagger(step_rate_hz);
    driver.set(&fast(step_rate_hz, EXTREME))?;
    let begin = |driver: &mut Driver| {
        driver.mount(&NO_SWITCHES)?;
        driver.run(["G90G0X0Y0Z0", stagger.as_str()])?;
        driver.come_to_rest()
    };
    // The segments of a line take 1 ms, but its last one takes the rest: after 1 ms of this line.
    let steps = f64::from(step_rate_hz) / 3000.0;
    let distance_mm = steps * 2.3 / 1000.0;
    for hundredths in (190..230).step_by(4) {
        begin(driver)?;
        let played = steps * f64::from(hundredths) / 100.0;
        driver.mount(&SwitchPositions {
            plate: -(played as i32),
            ..NO_SWITCHES
        })?;
        driver.run([format!(
            "G38.3X{distance_mm:.3}Y{distance_mm:.3}Z-{distance_mm:.3}F{feed:.0}"
        )
        .as_str()])?;
    }
    driver.run(["$21=1"])?;
    let steps = segment_steps(step_rate_hz);
    let line = format!("G1X.{steps:03}Y.{steps:03}Z-.{steps:03}F{feed:.0}");
    for before in (0..steps.cast_signed()).step_by(6) {
        begin(driver)?;
        let mut ends = NO_SWITCHES;
        ends.low[2] = before - 4 * steps.cast_signed();
        driver.mount(&ends)?;
        // The lines wait after a slow one.
        driver.run(["G1X-.02F1"])?;
        driver.stream([line.as_str(); 8], |_| b"")?;
        driver.come_to_rest()?;
        driver.mount(&NO_SWITCHES)?;
        driver.reset()?;
    }
    driver.run(["$21=0"])
}

/// Hard limits, the door with and without parking, and the buttons, in motion.
pub(super) fn switches(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    driver.set(&fast(step_rate_hz, 2000.0))?;
    driver.run(["$21=1", "$10=3"])?;
    for round in 0..4 {
        driver.stream(["G91G1X8Y5F60000", "X-8Y-5Z1"], |_| b"?")?;
        driver.close(Levels::limits(1 << (round % 3)).0)?;
        driver.finish()?;
        driver.close(Levels::NONE.0)?;
        driver.reset()?;
    }
    driver.run(["$21=0"])?;
    for parking in ["$41=0", "$41=1"] {
        driver.run([
            parking, "$56=0.5", "$57=600", "$58=-1", "$59=6000", "G91", "M3S400", "M8",
        ])?;
        for _ in 0..3 {
            driver.stream(["G1X2Y1F6000", "X-2Z.2", "G2I.2", "Y-1Z-.2"], |_| b"?")?;
            driver.close(Levels::DOOR.0)?;
            driver.wait_for("Door")?;
            driver.close(Levels::NONE.0)?;
            driver.wait_for("Door:0")?;
            driver.realtime(b"~")?;
            driver.stream(["G1X.5", "X-.5"], |_| b"\x84")?;
            driver.wait_for("Door:0")?;
            driver.realtime(b"~")?;
            driver.finish()?;
        }
    }
    driver.stream(["G1X9F6000", "X-9"], |_| b"")?;
    for button in [
        Levels::HOLD,
        Levels::START,
        Levels::HOLD,
        Levels::START,
        Levels::RESET,
    ] {
        driver.close(button.0)?;
        driver.realtime(b"?")?;
        driver.close(Levels::NONE.0)?;
    }
    driver.reset()?;
    driver.run(["$5=1", "$6=1", "$5=0", "$6=0", "$41=0"])
}
