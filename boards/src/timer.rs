//! Timers whose outputs can be the PWM of the spindle.

use crate::{Clocks, Pin};

/// A timer's output on a pin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PwmOutput {
    /// Number of the timer.
    pub timer: u8,
    /// Its channel, 1 to 4.
    pub channel: u8,
}

/// Periods of the PWM in a second, about; and its steps in a period, `Outputs::FULL` in `src/model/outputs.rs`.
const PWM_HZ: u32 = 5147;
const STEPS: u32 = 1020;

/// The pins of each timer's channels: data sheets, alternate function mapping, the same on all F4.
const PINS: [(u8, u8, &[&str]); 26] = [
    (1, 1, &["A8", "E9"]),
    (1, 2, &["A9", "E11"]),
    (1, 3, &["A10", "E13"]),
    (1, 4, &["A11", "E14"]),
    (2, 1, &["A0", "A5", "A15"]),
    (2, 2, &["A1", "B3"]),
    (2, 3, &["A2", "B10"]),
    (2, 4, &["A3", "B11"]),
    (3, 1, &["A6", "B4", "C6"]),
    (3, 2, &["A7", "B5", "C7"]),
    (3, 3, &["B0", "C8"]),
    (3, 4, &["B1", "C9"]),
    (4, 1, &["B6", "D12"]),
    (4, 2, &["B7", "D13"]),
    (4, 3, &["B8", "D14"]),
    (4, 4, &["B9", "D15"]),
    (5, 1, &["A0"]),
    (5, 2, &["A1"]),
    (5, 3, &["A2"]),
    (5, 4, &["A3"]),
    (8, 1, &["C6"]),
    (8, 2, &["C7"]),
    (8, 3, &["C8"]),
    (8, 4, &["C9"]),
    (12, 1, &["B14"]),
    (12, 2, &["B15"]),
];
/// The timers with one channel.
const SINGLE: [(u8, u8, &[&str]); 2] = [(13, 1, &["A6", "F8"]), (14, 1, &["A7", "F9"])];

/// Timers that the firmware uses itself: 2 in the emulator, 4 for the clock of the RepRap dialect, 5 for the clock of the
/// motion, 9 and 10 for `prepare` and `inputs`.
const USED: [u8; 5] = [2, 4, 5, 9, 10];

impl PwmOutput {
    /// Returns the output that a pin can be on a chip with some timers: of the timers that the firmware leaves
    /// free the one with the highest number, so that those with most channels stay free.
    pub(crate) fn of(pin: Pin, timers: &[u8]) -> Option<Self> {
        let outputs = PINS.iter().chain(&SINGLE).filter(|(timer, _, pins)| {
            let is_there = pins.iter().any(|name| name.parse() == Ok(pin));
            is_there && timers.contains(timer) && !USED.contains(timer)
        });
        let outputs = outputs.map(|&(timer, channel, _)| Self { timer, channel });
        outputs.max_by_key(|output| output.timer)
    }

    /// Returns the pins that can be an output on a chip with some timers, of those that a package has, for an error.
    pub(crate) fn pins(timers: &[u8], is_there: impl Fn(Pin) -> bool) -> String {
        let names = PINS.iter().chain(&SINGLE).flat_map(|(.., names)| *names);
        let mut pins: Vec<Pin> = names.filter_map(|name| name.parse().ok()).collect();
        pins.retain(|pin| is_there(*pin) && Self::of(*pin, timers).is_some());
        pins.sort_unstable();
        pins.dedup();
        let names: Vec<_> = pins.iter().map(ToString::to_string).collect();
        names.join(", ")
    }

    /// Returns the address of the timer's registers: RM0090 2.3.
    pub fn base(self) -> u32 {
        match self.timer {
            1 => 0x4001_0000,
            8 => 0x4001_0400,
            timer @ 2..=5 => 0x4000_0000 + 0x400 * (u32::from(timer) - 2),
            timer => 0x4000_1800 + 0x400 * (u32::from(timer) - 12),
        }
    }

    /// Returns the number of the pin's alternate function.
    pub(crate) fn alternate_function(self) -> u8 {
        match self.timer {
            1 | 2 => 1,
            3..=5 => 2,
            8 => 3,
            _ => 9,
        }
    }

    /// Returns whether the outputs wait for the register that releases them all: RM0090 17.4.18.
    pub(crate) fn has_break(self) -> bool {
        matches!(self.timer, 1 | 8)
    }

    /// Returns the divider of the timer's clock.
    pub(crate) fn prescaler(self, clocks: Clocks) -> u32 {
        let mhz = match self.timer {
            1 | 8 => clocks.apb2_timers_mhz(),
            _ => clocks.apb1_timers_mhz(),
        };
        let hz = mhz * 1_000_000;
        (hz + STEPS * PWM_HZ / 2) / (STEPS * PWM_HZ)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pins_of_both_shields_are_outputs_of_the_timers_named_there() {
        let all: Vec<u8> = (1..=14).collect();
        let output = |pin: &str, timers: &[u8]| PwmOutput::of(pin.parse().unwrap(), timers);
        let (timer, channel) = (12, 2);
        assert_eq!(output("B15", &all), Some(PwmOutput { timer, channel }));
        let (timer, channel) = (14, 1);
        assert_eq!(output("A7", &all), Some(PwmOutput { timer, channel }));
        let (timer, channel) = (3, 2);
        assert_eq!(
            output("A7", &[1, 3, 4, 9, 10]),
            Some(PwmOutput { timer, channel })
        );
        assert_eq!(output("A0", &all), None, "timers 2 and 5 are used");
        assert_eq!(output("D3", &all), None, "no timer is on that pin");
    }

    #[test]
    fn the_pwm_has_the_frequency_of_before() {
        let clocks = Clocks {
            core_mhz: 168,
            flash_wait_states: 5,
            apb1_divider: 4,
            apb2_divider: 2,
        };
        let of = |timer| PwmOutput { timer, channel: 1 }.prescaler(clocks);
        assert_eq!((of(12), of(1)), (16, 32));
    }
}
