//! The serial line: every byte in both directions, and the baud rate.

use super::{Expected, Facts, Need, Parts};

/// Bits a second of sender and firmware.
const BAUD: f64 = 115_200.0;
/// What the baud rate may be off, per cent. The chip receives bytes with less than 3.3 % error in
/// all: the errors of both ends and of the edges together (RM0090 30.3.5, a divider with a
/// fraction). Other receivers are much the same: with another per cent at the other end, 1.3 % is
/// left for the edges.
const MAX_BAUD_ERROR_PERCENT: f64 = 1.0;
/// What the time of the stream may be off, per cent, by the board's own clock: a tenth of that. Else there
/// were pauses, and the rate is not that of its bits.
const MAX_PAUSE_PERCENT: f64 = 0.1;
const BITS_PER_BYTE: i64 = 10;

/// Every byte comes through, in both directions at once, and at the rate that was asked for.
pub(super) fn serial(parts: &mut Parts<'_>, expected: &Expected) {
    for (name, all, of, wrong_name, wrong) in [
        (
            "bytes to the board",
            "serial.received",
            "serial.expected",
            "wrong among those to it",
            "serial.wrong",
        ),
        (
            "bytes from the board",
            "serial.returned",
            "serial.expected",
            "wrong among those from it",
            "serial.returned_wrong",
        ),
        (
            "bytes without a pause",
            "stream.received",
            "stream.expected",
            "wrong among those without a pause",
            "stream.wrong",
        ),
    ] {
        parts.add_all(name, Need::Port, all, of);
        parts.add_number(wrong_name, Need::Port, wrong, 0);
    }
    parts.add_number("lost or damaged", Need::Port, "serial.lost", 0);
    baud_rate(parts, expected.core_hz);
}

/// Returns the rate by the divider of the USART.
fn rate_by_divider(facts: &Facts) -> Option<f64> {
    let [clock_hz, divider] = ["serial.clock_hz", "serial.divider"].map(|name| facts.get(name));
    let (clock_hz, divider) = (clock_hz?, divider?);
    (divider > 0).then(|| clock_hz as f64 / divider as f64)
}

/// Returns a rate as it is shown, and whether it is right.
fn shown(rate: f64) -> (String, bool) {
    let off = (rate - BAUD) * 100.0;
    let is_right = off.abs() <= MAX_BAUD_ERROR_PERCENT * BAUD;
    (format!("{rate:.0} baud, {:+.2} %", off / BAUD), is_right)
}

fn allowed() -> String {
    format!("{BAUD} baud, {MAX_BAUD_ERROR_PERCENT} % off at most")
}

/// The divider of the USART is the one for the rate.
pub(super) fn divider(parts: &mut Parts<'_>) {
    let name = "baud rate by the divider";
    parts.add(name, Need::Program, allowed(), |facts| {
        rate_by_divider(facts).map(shown)
    });
}

/// The rate by the clock of this computer, and by that of the board.
fn baud_rate(parts: &mut Parts<'_>, core_hz: i64) {
    let by_divider = rate_by_divider(parts.facts);
    let name = "baud rate by this computer's clock";
    let rounded = by_divider.map_or_else(|| "none".into(), |rate| format!("{rate:.0}"));
    let expected = format!("{}; {rounded} by the divider", allowed());
    parts.add(name, Need::Clock, expected, |facts| {
        Some(shown(facts.get("stream.baud")? as f64))
    });
    let expected = format!("within {MAX_PAUSE_PERCENT} % of that by the divider");
    let name = "time of the bytes without a pause";
    parts.add(name, Need::Rate, expected, |facts| {
        let bits = facts.get("stream.expected")? * BITS_PER_BYTE;
        let ideal = bits as f64 * core_hz as f64 / by_divider?;
        let off = (facts.get("stream.cycles")? as f64 / ideal - 1.0) * 100.0;
        Some((format!("{off:+.3} %"), off.abs() <= MAX_PAUSE_PERCENT))
    });
}
