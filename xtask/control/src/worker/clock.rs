//! The clock of the client and its line: the computer's, or a faster one for the virtual machine.

use serde::{Deserialize, Serialize};

/// The longest time that passes at once where the clock is fast, ms: so often the machine gets new lines.
const INTERVAL_MS: u64 = 20;
/// A worker that was asleep for longer does not make a fast clock hurry, ms.
const LONGEST_SLEEP_MS: u64 = 200;

/// How many seconds of the virtual machine a second takes, at least 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TimeFactor(pub u32);

impl Default for TimeFactor {
    fn default() -> Self {
        Self(1)
    }
}

/// The clock.
#[derive(Debug, Default)]
pub(super) struct ClientClock {
    now_ms: u64,
    computer_ms: u64,
    pub(super) time_factor: TimeFactor,
}

impl ClientClock {
    /// The computer's clock, as it is now.
    pub(super) fn at(computer_ms: u64) -> Self {
        Self {
            now_ms: computer_ms,
            computer_ms,
            time_factor: TimeFactor::default(),
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
        let (passed_ms, interval_ms) = match self.time_factor {
            TimeFactor(0 | 1) => (passed_ms, passed_ms),
            TimeFactor(times) => (
                passed_ms.min(LONGEST_SLEEP_MS) * u64::from(times),
                INTERVAL_MS,
            ),
        };
        let begin_ms = self.now_ms;
        self.now_ms += passed_ms;
        let whole = passed_ms.checked_div(interval_ms).unwrap_or_default();
        let between = (1..whole).map(move |count| begin_ms + count * interval_ms);
        between.chain([self.now_ms])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fast_clock_goes_in_short_steps_and_never_hurries() {
        let mut clock = ClientClock::at(1000);
        let times: Vec<_> = clock.advance(1020).chain(clock.advance(6020)).collect();
        assert_eq!(times, [1020, 6020]);
        clock.time_factor = TimeFactor(5);
        let times: Vec<_> = clock.advance(6037).collect();
        assert_eq!(times, [6040, 6060, 6080, 6105]);
        let times: Vec<_> = clock.advance(100_000).collect();
        assert_eq!((times.len(), times.last()), (50, Some(&7105)));
        clock.time_factor = TimeFactor::default();
        assert_eq!(clock.advance(100_010).collect::<Vec<_>>(), [7115]);
    }
}
