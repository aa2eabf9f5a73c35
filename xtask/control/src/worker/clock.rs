//! The clock of the client and its line: the computer's, or a faster one for the virtual machine.

use serde::{Deserialize, Serialize};

/// The longest time that passes at once where the clock is fast, ms: so often the machine gets new lines.
const STEP_MS: u64 = 20;
/// A worker that was asleep for longer does not make a fast clock hurry, ms.
const LONGEST_MS: u64 = 200;

/// How many seconds of the virtual machine a second takes, at least 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Speed(pub u32);

impl Default for Speed {
    fn default() -> Self {
        Self(1)
    }
}

/// The clock.
#[derive(Debug, Default)]
pub(super) struct Clock {
    now_ms: u64,
    computer_ms: u64,
    pub(super) speed: Speed,
}

impl Clock {
    /// The computer's clock, as it is now.
    pub(super) fn at(computer_ms: u64) -> Self {
        Self {
            now_ms: computer_ms,
            computer_ms,
            speed: Speed::default(),
        }
    }

    /// The time, ms.
    pub(super) fn now_ms(&self) -> u64 {
        self.now_ms
    }

    /// Goes on to a time of the computer. Returns the times at which the client and its line have to go on, ms.
    pub(super) fn advance(&mut self, computer_ms: u64) -> impl Iterator<Item = u64> + use<> {
        let passed_ms = computer_ms.saturating_sub(self.computer_ms);
        self.computer_ms = computer_ms;
        let (passed_ms, step_ms) = match self.speed {
            Speed(0 | 1) => (passed_ms, passed_ms),
            Speed(times) => (passed_ms.min(LONGEST_MS) * u64::from(times), STEP_MS),
        };
        let begin_ms = self.now_ms;
        self.now_ms += passed_ms;
        let whole = passed_ms.checked_div(step_ms).unwrap_or_default();
        let between = (1..whole).map(move |step| begin_ms + step * step_ms);
        between.chain([self.now_ms])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fast_clock_goes_in_short_steps_and_never_hurries() {
        let mut clock = Clock::at(1000);
        let times: Vec<_> = clock.advance(1020).chain(clock.advance(6020)).collect();
        assert_eq!(times, [1020, 6020]);
        clock.speed = Speed(5);
        let times: Vec<_> = clock.advance(6037).collect();
        assert_eq!(times, [6040, 6060, 6080, 6105]);
        let times: Vec<_> = clock.advance(100_000).collect();
        assert_eq!((times.len(), times.last()), (50, Some(&7105)));
        clock.speed = Speed::default();
        assert_eq!(clock.advance(100_010).collect::<Vec<_>>(), [7115]);
    }
}
