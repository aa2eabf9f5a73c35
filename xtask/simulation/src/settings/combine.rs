//! Settings taken together, whatever the order of their lines.

use leadscrew::settings::{SettingError, Settings, assign};

use super::{dump::Entry, refused};

/// The number of the step pulse, which other settings are checked against, but which is never
/// refused because of others.
const STEP_PULSE: u16 = 0;

/// Settings that have been changed.
#[derive(Debug)]
pub struct Combined {
    /// The settings.
    pub settings: Settings,
    /// The changes, in an order in which a machine accepts each.
    pub order: Vec<Entry>,
}

/// A setting that is refused, and why.
#[derive(Debug)]
pub struct Refused {
    /// The setting.
    pub entry: Entry,
    /// The refusal, to read.
    pub reason: String,
}

/// What came of an order of changes.
struct Attempt {
    settings: Settings,
    accepted: Vec<Entry>,
    refused: Vec<(Entry, SettingError)>,
}

/// Changes settings to what the entries say; of two with one number the later one counts.
///
/// # Errors
/// Every entry that does not go with the others.
pub fn combine(start: &Settings, entries: &[Entry]) -> Result<Combined, Vec<Refused>> {
    let (pulse, others): (Vec<_>, Vec<_>) = last_of_each(entries)
        .into_iter()
        .partition(|entry| entry.number == STEP_PULSE);
    // A shorter pulse makes room for what follows; a longer one, once others have been lowered.
    let first = attempt(start, [&pulse[..], &others].concat());
    if first.refused.is_empty() {
        return Ok(first.into_combined());
    }
    let second = attempt(start, [&others[..], &pulse].concat());
    if second.refused.is_empty() {
        return Ok(second.into_combined());
    }
    Err(first.explain())
}

/// The entries of which no later one has the number.
pub fn last_of_each(entries: &[Entry]) -> Vec<Entry> {
    let is_last = |(index, entry): &(usize, &Entry)| {
        let later = &entries[index + 1..];
        later.iter().all(|other| other.number != entry.number)
    };
    let last = entries.iter().enumerate().filter(is_last);
    last.map(|(_, entry)| entry.clone()).collect()
}

/// Makes changes as long as one more is accepted, and checks each once more beside all others.
fn attempt(start: &Settings, entries: Vec<Entry>) -> Attempt {
    let mut settings = *start;
    let mut accepted = Vec::new();
    let mut pending = entries;
    let mut refused = loop {
        let before = pending.len();
        let mut refused = Vec::new();
        for entry in pending {
            match assign(&mut settings, entry.statement().as_bytes()) {
                Ok(()) => accepted.push(entry),
                Err(error) => refused.push((entry, error)),
            }
        }
        if refused.is_empty() || refused.len() == before {
            break refused;
        }
        pending = refused.into_iter().map(|(entry, _)| entry).collect();
    };
    accepted.retain(|entry| {
        let mut copy = settings;
        let again = assign(&mut copy, entry.statement().as_bytes());
        refused.extend(again.err().map(|error| (entry.clone(), error)));
        again.is_ok()
    });
    Attempt {
        settings,
        accepted,
        refused,
    }
}

impl Attempt {
    fn into_combined(self) -> Combined {
        Combined {
            settings: self.settings,
            order: self.accepted,
        }
    }

    /// Why each refused entry is refused; one reason for the resolution and the speed of an axis.
    fn explain(mut self) -> Vec<Refused> {
        self.refused.sort_by_key(|(entry, _)| entry.line);
        let wanted: Vec<_> = self.refused.iter().map(|(entry, _)| entry).collect();
        let has_speed = |entry: &Entry| {
            let speed = entry.number + (refused::LARGEST_SPEED - refused::RESOLUTION);
            wanted.iter().any(|other| other.number == speed)
        };
        self.refused
            .iter()
            .filter(|(entry, error)| *error != SettingError::StepRate || !has_speed(entry))
            .map(|(entry, error)| Refused {
                entry: entry.clone(),
                reason: refused::reason(&self.settings, &wanted, entry, *error),
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use leadscrew::settings::StepRate;
    use proptest::prelude::*;

    use super::{super::dump::Dump, *};

    const RATE: StepRate = StepRate::Proven(200_000);

    fn combined(start: &Settings, text: &str) -> Result<Combined, Vec<String>> {
        let entries = Dump::read(text).entries;
        let refused = |all: Vec<Refused>| all.into_iter().map(|one| one.reason).collect();
        combine(start, &entries).map_err(refused)
    }

    #[test]
    fn the_order_of_lines_does_not_matter() {
        let start = Settings::new(RATE);
        for (text, order) in [
            ("$20=1\n$22=1", "22=1 20=1"),
            ("$110=20000\n$0=3", "0=3 110=20000"),
            ("$110=30000\n$100=80", "100=80 110=30000"),
            ("$110=1\n$110=400", "110=400"),
        ] {
            let result = combined(&start, text).unwrap();
            let accepted: Vec<_> = result.order.iter().map(Entry::statement).collect();
            assert_eq!(accepted.join(" "), order);
        }
    }

    #[test]
    fn a_longer_pulse_may_come_after_what_it_leaves_room_for() {
        let mut start = Settings::new(RATE);
        start = combined(&start, "$0=3\n$110=25000").unwrap().settings;
        let result = combined(&start, "$0=20\n$100=90\n$110=9000").unwrap();
        assert_eq!(result.order.last().unwrap().number, 0);
        assert_eq!(result.settings.step_pulse_us, 20);
    }

    #[test]
    fn what_does_not_go_together_is_refused_in_any_order() {
        let homed = combined(&Settings::new(RATE), "$22=1").unwrap().settings;
        for start in [Settings::new(RATE), homed] {
            for text in ["$20=1\n$22=0", "$22=0\n$20=1"] {
                let refused = combined(&start, text).unwrap_err();
                assert_eq!(refused.len(), 1, "{refused:?}");
                assert!(refused[0].contains("$22=1 would do"), "{refused:?}");
            }
        }
        for text in ["$110=14000\n$0=20", "$0=20\n$110=14000"] {
            let refused = combined(&Settings::new(RATE), text).unwrap_err();
            assert_eq!(refused.len(), 1, "{refused:?}");
            assert!(
                refused[0].starts_with("$110=14000: 58 333 steps/s"),
                "{refused:?}"
            );
        }
    }

    #[test]
    fn one_reason_is_given_for_both_factors_of_a_step_rate() {
        let refused = combined(&Settings::new(RATE), "$100=90000\n$110=90000").unwrap_err();
        assert_eq!(refused.len(), 1, "{refused:?}");
        assert!(
            refused[0].starts_with("$110=90000: 135 000 000 steps/s"),
            "{refused:?}"
        );
    }

    proptest! {
        #![proptest_config(crate::cases(64))]

        #[test]
        fn an_order_that_is_found_is_one_that_the_machine_accepts(
            pulse in 3..=40_u8,
            resolution in 1..2000_u32,
            speed in 1..40_000_u32,
            soft in 0..=1_u8,
            homing in 0..=1_u8,
            old in (3..=40_u8, 1..2000_u32, 1..40_000_u32, 0..=1_u8),
        ) {
            let text = |(pulse, resolution, speed, homing): (u8, u32, u32, u8)| format!(
                "$0={pulse}\n$100={resolution}\n$110={speed}\n$22={homing}"
            );
            let Ok(start) = combined(&Settings::new(RATE), &text(old)) else {
                return Ok(());
            };
            let wanted = text((pulse, resolution, speed, homing)) + &format!("\n$20={soft}");
            let rate = f64::from(resolution) * f64::from(speed) / 60.0;
            let mut ideal = Settings::new(RATE);
            ideal.step_pulse_us = pulse;
            let room = f64::from(ideal.greatest_step_rate_hz());
            prop_assume!((rate / room - 1.0).abs() > 1e-5);
            let result = combined(&start.settings, &wanted);
            let fits = rate < room && soft <= homing;
            prop_assert_eq!(result.is_ok(), fits, "{:?}", result);
            if let Ok(result) = result {
                let mut machine = start.settings;
                for entry in &result.order {
                    let answer = assign(&mut machine, entry.statement().as_bytes());
                    prop_assert_eq!(answer, Ok(()), "{}", entry.statement());
                }
                prop_assert_eq!(machine, result.settings);
                prop_assert_eq!(machine.step_pulse_us, pulse);
                prop_assert_eq!(machine.max_rate_mm_min[0], speed as f32);
            }
        }
    }
}
