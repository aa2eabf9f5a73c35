//! Motion: rates, short blocks, arcs, and what interrupts them.

use std::f64::consts::TAU;

use anyhow::Result;
use leadscrew::{model::timing::EVENT_SPACING_TICKS, units::TICKS_PER_SECOND};

use super::{fast, smooth, words};
use crate::replay::driver::Driver;

/// An acceleration that changes the speed with every step, and an acceleration that never reaches
/// the speed, mm/s².
pub(super) const EXTREME: f64 = 1_000_000.0;
const SLOW: f64 = 400.0;
/// Less than the longest segment, which is 1.5 ms when a block ends with it.
const SEGMENT_US: u32 = 1490;

/// One axis, two and three at the highest rate, back and forth, at rates that share no period.
pub(super) fn full_rates(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    for acceleration in [EXTREME, 20_000.0] {
        driver.set(&fast(step_rate_hz, acceleration))?;
        driver.run([
            "G91G94",
            "G1X5F1000000",
            "X-5",
            "Y3Z-2.1",
            "X2.7Y1.97Z1.38",
            "X-2.7Y-1.97Z-1.38",
            "X2.3Y2.29Z2.28",
            "X-2.3Y-2.29Z-2.28",
            "G0X1.003Y.999Z.001",
            "X-1.003Y-.999Z-.001",
            "G93X1Y1Z1F1000",
            "G94F1000000",
        ])?;
        let back_and_forth: Vec<String> = (1..60)
            .map(|number| {
                let sign = if number % 2 == 0 { "-" } else { "" };
                let tenths = number % 17;
                format!("G1X{sign}0.{tenths:02}Y{sign}0.0{tenths}Z{sign}0.03{tenths}")
            })
            .collect();
        driver.run(words(&back_and_forth))?;
        driver.come_to_rest()?;
    }
    Ok(())
}

/// Lines of just one segment each at the highest rate of all axes together: the longest segment is
/// one and a half times as long as others, and its steps are staggered.
pub(super) fn long_segments(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    driver.set(&fast(step_rate_hz, EXTREME))?;
    segments(driver, step_rate_hz)?;
    staggered(driver, step_rate_hz, 0.985, fast)
}

fn segments(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    driver.run(["G91G94", "G1F1000000"])?;
    for shares in [[45, 33, 22], [40, 33, 27], [34, 33, 33], [60, 30, 10]] {
        let steps = step_rate_hz / 1000 * SEGMENT_US / 1000;
        let [x, y, z] = shares.map(|percent| steps * percent / 100);
        let line = |sign: &str| format!("X{sign}.{x:03}Y{sign}.{y:03}Z{sign}.{z:03}");
        let lines = [vec![line(""); 40], vec![line("-"); 40]].concat();
        driver.stream(words(&lines), |_| b"")?;
        driver.finish()?;
        driver.come_to_rest()?;
    }
    Ok(())
}

/// A segment of the highest cost: the steps of three axes are staggered, so that each step of X has
/// as many neighbours as possible, and the speed changes all the time, so that every time has to be
/// solved for. `low`: the lower of two speeds, as a part of the higher.
fn staggered(
    driver: &mut Driver,
    step_rate_hz: u32,
    low: f64,
    settings: impl Fn(u32, f64) -> Vec<String>,
) -> Result<()> {
    const LINES: usize = 200;
    let speed_mm_s = f64::from(step_rate_hz) / 3000.0;
    let change_mm_s2 = speed_mm_s * (1.0 - low) / (f64::from(SEGMENT_US) * 1e-6);
    driver.set(&settings(step_rate_hz, change_mm_s2))?;
    // As many lines as there is room for wait after a slow one.
    driver.run([stagger(step_rate_hz).as_str(), "G1X-.02F1"])?;
    let steps = segment_steps(step_rate_hz);
    let lines: Vec<String> = (0..LINES)
        .map(|number| {
            let share = if number % 3 == 2 { low } else { 1.0 };
            let feed = full_feed_mm_min(step_rate_hz) * share;
            format!("X.{steps:03}Y.{steps:03}Z.{steps:03}F{feed:.0}")
        })
        .collect();
    driver.stream(words(&lines), |_| b"")?;
    driver.finish()?;
    driver.come_to_rest()
}

/// Steps of each of three axes in the longest segment, when they have equal shares.
pub(super) const fn segment_steps(step_rate_hz: u32) -> u32 {
    step_rate_hz / 1000 * SEGMENT_US / 3000
}

/// Their speed along the path.
pub(super) fn full_feed_mm_min(step_rate_hz: u32) -> f64 {
    f64::from(step_rate_hz) / 3000.0 * 3_f64.sqrt() * 60.0
}

/// A line that moves Y and Z by parts of a step: from then on they are two slots and one ahead of X
/// at the full rate.
pub(super) fn stagger(step_rate_hz: u32) -> String {
    let slot_s = f64::from(EVENT_SPACING_TICKS) / f64::from(TICKS_PER_SECOND);
    let slot_mm = slot_s * f64::from(step_rate_hz) / 3000.0;
    format!("G91G94G1F1000Y{:.7}Z{slot_mm:.7}", 2.0 * slot_mm)
}

/// Short lines as CAM programs have them, each with another power of the beam.
pub(super) fn short_lines(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    const LINES: u32 = 160;
    driver.set(&fast(step_rate_hz, 5000.0))?;
    driver.run(["$32=1", "$30=1000", "G90G94", "M4S1", "G1F1000000"])?;
    let knot: Vec<String> = (1..=LINES)
        .map(|number| {
            let turn = f64::from(number) * TAU / 60.0;
            let wave = |frequency: f64, phase: f64| 3.2 * (frequency * turn + phase).sin();
            let (x, y, z) = (wave(1.0, 0.0), wave(1.0, TAU / 4.0), wave(0.37, 1.0));
            let power = number * 37 % 1001;
            format!("X{x:.3}Y{y:.3}Z{z:.3}S{power}")
        })
        .collect();
    let ask = |number: usize| -> &[u8] {
        match number % 23 {
            0 => b"?",
            11 => b"??",
            _ => b"",
        }
    };
    driver.stream(words(&knot), ask)?;
    driver.stream(["M3S500", "X1Y1Z1S900F500", "X.9S10", "G0X2", "M5"], ask)?;
    driver.finish()?;
    driver.run(["$32=0"])
}

/// Blocks so short that the look-ahead is full and its whole length decides about the speed.
pub(super) fn tiny_lines(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    for (acceleration, count) in [(SLOW, 500_u32), (50.0, 300), (EXTREME, 300)] {
        driver.set(&fast(step_rate_hz, acceleration))?;
        driver.run(["G91G94", "G1F1000000"])?;
        let lines: Vec<String> = (0..count)
            .map(|number| match number % 50 {
                49 => "X-.002Y.001".into(),
                48 => "G4P0".into(),
                step => format!("X.00{}Y.00{}Z.001", 1 + step % 9, 1 + step % 4),
            })
            .collect();
        driver.stream(words(&lines), |_| b"")?;
        driver.finish()?;
        driver.come_to_rest()?;
    }
    driver.run(["$100=1.5", "$101=0.7", "G1X4Y3F2000", "X-4Y-3F1", "G0X2"])
}

/// Arcs of all planes and sizes, with and without a third axis.
pub(super) fn arcs(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    for acceleration in [5000.0, EXTREME] {
        round(driver, &fast(step_rate_hz, acceleration))?;
    }
    tiny_arcs(driver, step_rate_hz)
}

/// Arcs so short and so flat that each arc changes the speeds of all arcs before.
fn tiny_arcs(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    const ARCS: usize = 200;
    driver.set(&fast(step_rate_hz, 50.0))?;
    // As many as there is room for wait after a slow line.
    driver.run(["G91G94", "G1X-.02F1"])?;
    driver.stream(["G17G2X.1R100F1000000"; ARCS], |_| b"")?;
    driver.finish()?;
    driver.come_to_rest()
}

fn round(driver: &mut Driver, settings: &[String]) -> Result<()> {
    driver.set(settings)?;
    driver.run(["G91G94", "F1000000"])?;
    let mut lines = Vec::new();
    for plane in ["G17", "G18", "G19"] {
        let (from, to, along) = match plane {
            "G17" => ("I", "J", "Z"),
            "G18" => ("I", "K", "Y"),
            _ => ("J", "K", "X"),
        };
        for radius in ["1", "0.3", "0.02", "0.003"] {
            lines.push(format!("{plane}G2{from}{radius}"));
            lines.push(format!("G3{to}-{radius}{along}0.7P2"));
            lines.push(format!("G2{from}-{radius}{along}-0.7"));
        }
    }
    lines.push("G17G2X1Y1R1.2".into());
    lines.push("G3X-1Y-1R-1.2Z.1".into());
    driver.stream(
        words(&lines),
        |number| if number % 5 == 0 { b"?" } else { b"" },
    )?;
    driver.finish()?;
    driver.come_to_rest()
}

/// Lines, arcs, and what interrupts them, where acceleration is continuous.
pub(super) fn limits_of_jerk(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    driver.set(&smooth(step_rate_hz, EXTREME, 0.1))?;
    segments(driver, step_rate_hz)?;
    // At the lower speed, too, a line is one segment.
    for (factor, seconds) in [(5.0, 0.002), (20.0, 0.002), (20.0, 0.006)] {
        staggered(driver, step_rate_hz, 0.992, |rate, acceleration| {
            smooth(rate, factor * acceleration, seconds)
        })?;
    }
    round(driver, &smooth(step_rate_hz, 20_000.0, 0.004))?;
    hold(driver, &smooth(step_rate_hz, SLOW, 0.05), false)
}

/// Feed holds, resumes and overrides at all phases of motion.
pub(super) fn holds(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    for (acceleration, is_beam) in [(SLOW, false), (20_000.0, true)] {
        hold(driver, &fast(step_rate_hz, acceleration), is_beam)?;
    }
    Ok(())
}

fn hold(driver: &mut Driver, settings: &[String], is_beam: bool) -> Result<()> {
    const OVERRIDES: [&[u8]; 12] = [
        &[0x91],
        &[0x91, 0x91],
        &[0x92],
        &[0x93, 0x94],
        &[0x90],
        &[0x95],
        &[0x96],
        &[0x97],
        &[0x9a, 0x9b],
        &[0x9c, 0x9d],
        &[0x99],
        &[0x9e],
    ];
    driver.set(settings)?;
    let beam = if is_beam {
        ["$32=1", "M4S300"]
    } else {
        ["$32=0", "M3S300"]
    };
    driver.run(beam)?;
    driver.run(["G91G94", "G1F6000"])?;
    for round in 0..12_usize {
        driver.stream(
            ["X1.7Y.3Z-.2", "X-1.7Y.2", "G0Z.2", "G1Y-.5X.5", "G2X.2I.3"],
            |number| {
                if number % 2 == 1 {
                    OVERRIDES[round % 12]
                } else {
                    b""
                }
            },
        )?;
        driver.wait_for("Run")?;
        driver.realtime(b"!")?;
        driver.wait_for("Hold:0")?;
        driver.realtime(OVERRIDES[(round + 5) % 12])?;
        driver.realtime(b"?~?")?;
        driver.stream(["G1X1", "X-1"], |_| b"!~")?;
        // Whether these end in a hold depends on when each byte comes; one that is left would keep the next lines.
        driver.come_to_rest()?;
    }
    driver.realtime(&[0x90, 0x95, 0x99])?;
    driver.run(["M5"])?;
    driver.come_to_rest()?;
    driver.run(["$32=0"])
}

/// Jogs, alone and in a row, cancelled by 0x85 and by a hold.
pub(super) fn jogs(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    driver.set(&fast(step_rate_hz, 2000.0))?;
    for cancel in [b"\x85", b"!", b"\x85"] {
        driver.stream(["$J=G91X.3Y.1F6000"; 9], |_| b"")?;
        driver.stream(["$J=G91X50Y30Z7F60000"; 3], |_| b"?")?;
        driver.wait_for("Jog")?;
        driver.realtime(cancel)?;
        driver.finish()?;
        driver.wait_for("Idle")?;
    }
    driver.run(["$J=G90X1F100000", "$J=G53G90X0F100000", "$J=X1", "$J=F1"])?;
    driver.come_to_rest()
}

/// Resets at all phases of motion.
pub(super) fn resets(driver: &mut Driver, step_rate_hz: u32) -> Result<()> {
    driver.set(&fast(step_rate_hz, 3000.0))?;
    for round in 0..12 {
        driver.run(["G91G94"])?;
        let lines = ["G1X3Y1F100000", "X-3Z1", "G2I.3", "G0Y-1Z-1"];
        driver.stream(lines.into_iter().take(1 + round % 4), |_| b"?")?;
        if round % 3 == 0 {
            driver.wait_for("Run")?;
        }
        if round % 5 == 0 {
            driver.realtime(b"!")?;
        }
        driver.reset()?;
    }
    Ok(())
}
