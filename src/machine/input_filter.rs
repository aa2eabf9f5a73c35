//! The digital filter of the inputs: a level counts when it has held for four samples.
//!
//! Owned by `inputs`. A change starts the samples, [`SAMPLE_TICKS`] apart; the count of an input
//! that returns to its level in between starts anew. So a pulse shorter than three intervals (0.75
//! ms) never counts, and a pulse longer than four (1 ms) always does. All inputs are filtered at
//! once: two words hold the two bits of each input's count.

use crate::{model::Levels, units::TICKS_PER_US};

/// Time from one sample to the next, ticks: 250 µs.
pub const SAMPLE_TICKS: u32 = 250 * TICKS_PER_US;

/// Equal samples after which a level counts: one more than a count of two bits holds.
pub const SAMPLES: u32 = 4;

/// The filter of all inputs.
#[derive(Debug)]
pub struct Filter {
    /// The levels that count.
    stable: Levels,
    /// Bits 0 and 1 of each input's number of samples that differed from its level.
    counts: [Levels; 2],
}

impl Filter {
    /// Returns a filter in which these levels count.
    #[must_use]
    pub const fn new(closed: Levels) -> Self {
        Self {
            stable: closed,
            counts: [Levels::NONE; 2],
        }
    }

    /// Returns the levels that count.
    #[must_use]
    pub const fn stable(&self) -> Levels {
        self.stable
    }

    /// Restarts the counts of inputs that have returned to their level. Returns whether samples are
    /// needed.
    pub fn change(&mut self, raw: Levels) -> bool {
        let differing = raw ^ self.stable;
        let [low, high] = self.counts;
        self.counts = [low & differing, high & differing];
        differing != Levels::NONE
    }

    /// Takes a sample. Returns the inputs whose new level counts from now on.
    pub fn sample(&mut self, raw: Levels) -> Levels {
        let differing = raw ^ self.stable;
        let [low, high] = self.counts;
        let changed = differing & low & high;
        let counting = differing & !changed;
        self.counts = [!low & counting, (high ^ low) & counting];
        self.stable = self.stable ^ changed;
        changed
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Plays the level of the probe over time, µs: the times at which it changes. Returns when the
    /// filter changed.
    fn play(changes: &[u32]) -> std::vec::Vec<u32> {
        let mut filter = Filter::new(Levels::NONE);
        let mut changes = changes.iter().copied().peekable();
        let (mut raw, mut due) = (Levels::NONE, None::<u32>);
        let mut seen = std::vec::Vec::new();
        loop {
            let now = match (changes.peek().copied(), due) {
                (Some(change), Some(sample)) => change.min(sample),
                (Some(change), None) => change,
                (None, Some(sample)) => sample,
                (None, None) => return seen,
            };
            if changes.next_if_eq(&now).is_some() {
                raw = raw ^ Levels::PROBE;
                if filter.change(raw) && due.is_none() {
                    due = Some(now + SAMPLE_TICKS / TICKS_PER_US);
                }
            } else {
                if filter.sample(raw) != Levels::NONE {
                    seen.push(now);
                }
                let again = filter.change(raw);
                due = again.then_some(now + SAMPLE_TICKS / TICKS_PER_US);
            }
        }
    }

    #[test]
    fn a_level_counts_with_its_fourth_equal_sample() {
        for (changes, seen) in [
            (&[1000][..], &[2000][..]),
            (&[1000, 1749], &[]),
            (&[1000, 2001], &[2000, 3001]),
            // Bouncing: the count starts anew, the sampling goes on.
            (&[1000, 1100, 1170], &[2000]),
            (&[1000, 1350, 1370], &[2250]),
            (&[1000, 1850, 1990], &[2750]),
        ] {
            assert_eq!(play(changes), seen, "{changes:?}");
        }
    }

    #[test]
    fn each_input_has_its_own_count() {
        let mut filter = Filter::new(Levels::DOOR);
        let both = Levels::DOOR | Levels::HOLD;
        assert!(!filter.change(Levels::DOOR));
        for (raw, changed) in [
            (both, Levels::NONE),
            (both, Levels::NONE),
            (Levels::HOLD, Levels::NONE),
            (Levels::HOLD, Levels::HOLD),
            (Levels::HOLD, Levels::NONE),
            (Levels::HOLD, Levels::DOOR),
        ] {
            assert_eq!(filter.sample(raw), changed);
        }
        assert_eq!(filter.stable(), Levels::HOLD);
    }

    proptest! {
        #![proptest_config(crate::cases(64))]

        #[test]
        fn short_pulses_never_get_through(
            pulses in prop::collection::vec((0_u32..750, 1_u32..2000), 1..40),
        ) {
            let mut changes = std::vec::Vec::new();
            let mut time = 0;
            for (length, gap) in pulses {
                if length > 0 {
                    changes.extend([time + gap, time + gap + length]);
                }
                time += gap + length;
            }
            prop_assert_eq!(play(&changes), std::vec::Vec::<u32>::new());
        }

        #[test]
        fn long_levels_always_get_through(
            levels in prop::collection::vec(1001_u32..3000, 1..40),
        ) {
            let mut changes = std::vec::Vec::new();
            let mut time = 0;
            for length in &levels {
                time += length;
                changes.push(time);
            }
            let seen = play(&changes);
            prop_assert_eq!(seen.len(), changes.len());
            for (seen, change) in seen.iter().zip(&changes) {
                prop_assert!((750..=1000).contains(&(seen - change)));
            }
        }
    }
}
