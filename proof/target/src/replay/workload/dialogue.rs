//! Outputs, settings, queries, and all that is no motion.

use anyhow::Result;

use super::{fast, words};
use crate::replay::driver::Driver;

/// Spindle, coolant, dwells, stops of the program, sleep.
pub(super) fn accessories(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    driver.set(&fast(step_rate_hz, 2000.0))?;
    driver.run(["$1=2", "G91G94"])?;
    let lines = [
        "M3S200",
        "G1X1F3000",
        "M4S800",
        "G4P0.02",
        "M8",
        "X-1",
        "M7",
        "M9",
        "S100X.5",
        "M5",
        "X-.5",
    ];
    for _ in 0..4 {
        driver.stream(lines, |number| match number % 4 {
            0 => b"\xa0",
            1 => b"\xa1",
            2 => b"\x9e",
            _ => b"",
        })?;
        driver.finish()?;
    }
    driver.stream(["G1X1", "M0"], |_| b"")?;
    driver.wait_for("Hold:0")?;
    driver.realtime(b"~")?;
    driver.finish()?;
    driver.stream(["G1X2", "G4P0.5"], |_| b"")?;
    driver.realtime(b"!\x9e\xa0~")?;
    driver.wait_for("Hold:0")?;
    driver.realtime(b"\x9e~")?;
    driver.finish()?;
    driver.run(["M30", "$1=25", "$1=255", "$1=0"])?;
    driver.stream(["$SLP"], |_| b"??")?;
    driver.wait_for("Sleep")
}

/// Settings, listings, offsets, check mode, lines that are refused, and a line full both ways.
pub(super) fn talk(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    driver.set(&fast(step_rate_hz, 2000.0))?;
    let long = "X".repeat(300);
    for round in 0..3 {
        let (pulse, report) = (format!("$0={}", 3 + round), format!("$10={round}"));
        let offset = format!("G10L2P{}X{round}Y1Z-1", 1 + round);
        let lines = [
            "$$",
            "$#",
            "$G",
            "$I",
            "$N",
            "$",
            pulse.as_str(),
            report.as_str(),
            offset.as_str(),
            "G10L20P1X0",
            "G28.1",
            "G30.1",
            "G92X1",
            "G92.1",
            "$N0=",
            "G1X1Y",
            "Q",
            "G33",
            "$999=1",
            "$100=-1",
            long.as_str(),
            "(a comment) G4P0",
            "G43.1Z1",
            "G49",
            "G20",
            "G21",
            "G28G91Z0",
            "%",
            "",
        ];
        driver.stream(lines, |number| if number % 2 == 0 { b"?" } else { b"" })?;
        driver.finish()?;
        // The second resets the machine.
        driver.run(["$C"])?;
        driver.run(["G1X1F100", "G2X1R5"])?;
        driver.run(["$C"])?;
        driver.reset()?;
    }
    driver.run(["G91G1F3000"])?;
    let lines: Vec<String> = (0..60).map(|number| format!("X0.{number:02}")).collect();
    driver.stream(words(&lines), |_| b"???\x91\x92?")?;
    driver.finish()?;
    driver.realtime(b"\x80\xbf\xff\x9f\xa5")?;
    driver.run(["$RST=#"])?;
    driver.run(["$RST=$"])
}
