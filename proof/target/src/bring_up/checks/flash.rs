//! Bytes that arrive while flash is erased and programmed, and the time that the flash needs.

use super::{Expected, Need, Parts};
use crate::bring_up::sequence::BURST;

/// Operations: what the facts call them, their names, and the longest time of an erase or of a word, µs. An erase
/// of 128 KiB takes 2 s at most, a word 100 µs (data sheet, flash memory programming, 32 bits at once), and what is
/// around it up to 10 µs.
const FLASH_OPERATIONS: [(&str, &str, i64); 3] = [
    ("flash.erase", "erase", 2_000_000),
    ("flash.program", PROGRAM_OPERATION, 110),
    ("flash.erase_again", "erase of these words", 2_000_000),
];
const PROGRAM_OPERATION: &str = "words";

/// Every byte comes through while the flash is busy, and the flash holds what it should.
pub(super) fn flash(parts: &mut Parts<'_>, expected: &Expected) {
    let cycles_per_us = expected.core_hz / 1_000_000;
    for (operation, name, most_us) in FLASH_OPERATIONS {
        let fact = |what: &str| format!("{operation}.{what}");
        let part = |what: &str| format!("{name}: {what}");
        parts.add(part("done"), Need::Port, "yes, no word wrong", |facts| {
            let [done, wrong, words] =
                ["done", "wrong_words", "words"].map(|what| facts.get(&fact(what)));
            let (done, wrong, words) = (done?, wrong?, words?);
            let said = if done == 1 { "yes" } else { "no" };
            let has_words = name != PROGRAM_OPERATION || words > 0;
            let measured = format!("{said}, {wrong} words wrong");
            Some((measured, done == 1 && wrong == 0 && has_words))
        });
        let burst = i64::from(BURST);
        let all = format!("{burst}, 0 wrong, 0 lost");
        parts.add(part("bytes"), Need::Port, all, |facts| {
            let numbers = ["received", "wrong", "lost"].map(|what| facts.get(&fact(what)));
            let [Some(received), Some(wrong), Some(lost)] = numbers else {
                return None;
            };
            let measured = format!("{received}, {wrong} wrong, {lost} lost");
            Some((measured, [received, wrong, lost] == [burst, 0, 0]))
        });
        // Otherwise nothing is shown.
        let half = format!("{} at least", burst / 2);
        parts.add(part("bytes meanwhile"), Need::ChipAtPort, half, |facts| {
            let during = facts.get(&fact("during"))?;
            Some((during.to_string(), during >= burst / 2))
        });
        let longest = format!("{most_us} µs at most");
        parts.add(part("time"), Need::ChipAtPort, longest, |facts| {
            let taken_us = facts.get(&fact("cycles"))? / cycles_per_us;
            let is_right = (1..=most_us).contains(&taken_us);
            Some((format!("{taken_us} µs"), is_right))
        });
    }
    // The firmware waits as long as the flash says that it is busy, from its second read on.
    for (operation, name, _) in &FLASH_OPERATIONS[..2] {
        let name = format!("{name}: busy at the firmware's first look");
        parts.add(name, Need::ChipAtPort, "yes", |facts| {
            let [at_once, second] =
                ["busy_at_once", "busy"].map(|what| facts.get(&format!("{operation}.{what}")));
            let [at_once, second] =
                [at_once?, second?].map(|is| if is == 1 { "yes" } else { "no" });
            let measured = format!("{second}; with the instruction after its beginning: {at_once}");
            Some((measured, second == "yes"))
        });
    }
}
