//! Why a setting is refused: the limits in numbers, and what would be accepted.

use common::text::separated;
use leadscrew::settings::{DataType, Setting, SettingError, Settings, StepRate, assign};

use super::dump::Entry;

/// The number of the resolution of X; those of the other axes follow.
pub(super) const RESOLUTION: u16 = 100;
/// The number of the largest speed of X.
pub(super) const LARGEST_SPEED: u16 = 110;
/// Shortest step pulse that can be set, µs.
const SHORTEST_PULSE_US: u8 = 3;

/// Why `entry` is refused beside the other settings; `wanted` are those that are refused with it.
pub(super) fn reason(
    settings: &Settings,
    wanted: &[&Entry],
    entry: &Entry,
    error: SettingError,
) -> String {
    let setting = entry.setting();
    let why = match error {
        SettingError::BadNumber | SettingError::BadStatement => not_a_number(&entry.value),
        SettingError::Negative | SettingError::ShortPulse | SettingError::OutOfRange => {
            format!("{} is allowed", range(&setting))
        }
        SettingError::NeedsHoming => {
            "soft limits need homing, which is off; $22=1 would do".to_owned()
        }
        SettingError::StepRate => Axis::of(settings, wanted, entry).step_rate(settings),
    };
    format!("${}: {why} ({})", entry.statement(), name(&setting))
}

/// The name of a setting: `largest speed of X`.
pub fn name(setting: &Setting) -> String {
    let name = setting.row.name;
    setting.letter().map_or_else(
        || name.to_owned(),
        |letter| format!("{name} of {}", char::from(letter)),
    )
}

fn not_a_number(value: &str) -> String {
    match value.split_once(',') {
        _ if value.is_empty() => "there is no value".into(),
        // Three digits after a comma: a thousand, or a decimal comma.
        Some((whole, rest))
            if rest.len() == 3 && rest.bytes().all(|byte| byte.is_ascii_digit()) =>
        {
            format!("a number has no comma: {whole}.{rest} or {whole}{rest}")
        }
        Some(_) => format!(
            "a number has a point, no comma: {}",
            value.replace(',', ".")
        ),
        None => format!("{value:?} is no number"),
    }
}

/// The values that a setting can have, with their unit.
fn range(setting: &Setting) -> String {
    let range = match (setting.row.kind.data_type(), setting.row.kind.range()) {
        (DataType::Boolean, _) => "0 or 1".to_owned(),
        (DataType::Bits, _) => accepted_sums(setting),
        (_, None) => "0 to 255".to_owned(),
        (_, Some(range)) => format!("{} to {}", number(range.least), number(range.most)),
    };
    format!("{range} {}", setting.row.unit).trim_end().into()
}

/// The sums of bits that a setting can have; not all bits need exist.
fn accepted_sums(setting: &Setting) -> String {
    let is_accepted = |value: &u8| {
        let statement = format!("{}={value}", setting.number());
        assign(&mut Settings::default(), statement.as_bytes()).is_ok()
    };
    let accepted: Vec<u8> = (0..=u8::MAX).filter(is_accepted).collect();
    match accepted.as_slice() {
        [others @ .., last] if others.len() < 8 => {
            let others: Vec<_> = others.iter().map(u8::to_string).collect();
            format!("{} or {last}", others.join(", "))
        }
        _ => "0 to 255".to_owned(),
    }
}

/// A limit of a range, with its digits in groups of three.
fn number(value: f32) -> String {
    if value.fract() == 0.0 {
        let sign = if value < 0.0 { "-" } else { "" };
        format!("{sign}{}", separated(value.abs() as u64))
    } else {
        value.to_string()
    }
}

/// Resolution and largest speed of an axis, of which one is to be changed.
struct Axis {
    steps_per_mm: f32,
    mm_min: f32,
    changes_speed: bool,
}

impl Axis {
    /// The axis of `entry`, with the values that are wanted.
    fn of(settings: &Settings, wanted: &[&Entry], entry: &Entry) -> Self {
        let changes_speed = entry.number >= LARGEST_SPEED;
        let first = if changes_speed {
            LARGEST_SPEED
        } else {
            RESOLUTION
        };
        let axis = usize::from(entry.number - first);
        let value = |first: u16| {
            let number = first + axis as u16;
            let entry = wanted.iter().find(|entry| entry.number == number)?;
            entry.value.parse().ok()
        };
        Self {
            steps_per_mm: value(RESOLUTION).unwrap_or(settings.steps_per_mm[axis].to_f32()),
            mm_min: value(LARGEST_SPEED).unwrap_or(settings.max_rate_mm_min[axis]),
            changes_speed,
        }
    }

    /// The step rate that is asked for, what there is room for, and what would do.
    fn step_rate(&self, settings: &Settings) -> String {
        let asked = separated(self.hz().round() as u64);
        let with = |pulse_us| Settings {
            step_pulse_us: pulse_us,
            ..*settings
        };
        let room = settings.greatest_step_rate_hz();
        let shortest = with(SHORTEST_PULSE_US).greatest_step_rate_hz();
        let limit = if shortest > room {
            format!("$0={} leaves room for", settings.step_pulse_us)
        } else if settings.step_rate == StepRate::Unproven {
            "without a proof the firmware makes".into()
        } else {
            "the firmware makes".into()
        };
        let limit = format!("{asked} steps/s; {limit} {}", self.at_most(room));
        let pulses = SHORTEST_PULSE_US..settings.step_pulse_us;
        let longest = pulses
            .rev()
            .find(|pulse_us| self.hz() <= with(*pulse_us).greatest_step_rate_hz());
        match longest {
            Some(pulse_us) => format!("{limit}, $0={pulse_us} would do"),
            None if shortest > room => {
                let most = self.at_most(shortest);
                format!("{limit}, $0={SHORTEST_PULSE_US} for {most}")
            }
            None => limit,
        }
    }

    /// The step rate as the firmware computes it, Hz.
    fn hz(&self) -> f32 {
        self.steps_per_mm * (self.mm_min / 60.0)
    }

    /// A step rate, and the value that makes it: `50 000 (12 000 mm/min)`.
    fn at_most(&self, room_hz: f32) -> String {
        let (value, unit) = if self.changes_speed {
            (room_hz * 60.0 / self.steps_per_mm, "mm/min")
        } else {
            (room_hz * 60.0 / self.mm_min, "step/mm")
        };
        // Whole numbers where that leaves three digits.
        let scale = if value >= 100.0 { 1.0 } else { 1000.0 };
        let mut least = (value * scale).floor();
        while least > 0.0 && self.with(least / scale).hz() > room_hz {
            least -= 1.0;
        }
        let value = number(least / scale);
        format!("{} ({value} {unit})", separated(room_hz as u64))
    }

    /// The axis with another value of what is to be changed.
    fn with(&self, value: f32) -> Self {
        let changed = if self.changes_speed {
            (self.steps_per_mm, value)
        } else {
            (value, self.mm_min)
        };
        Self {
            steps_per_mm: changed.0,
            mm_min: changed.1,
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {

    use super::*;

    fn refused(settings: &Settings, statement: &str) -> String {
        let (number, value) = statement.split_once('=').unwrap();
        let entry = Entry {
            number: number.parse().unwrap(),
            value: value.into(),
            line: None,
        };
        let error = assign(&mut settings.clone(), statement.as_bytes()).unwrap_err();
        reason(settings, &[&entry], &entry, error)
    }

    #[test]
    fn a_refusal_names_the_limits_and_what_would_do() {
        let settings = Settings::new(StepRate::Proven(200_000));
        for (statement, text) in [
            (
                "110=fast",
                "$110=fast: \"fast\" is no number (largest speed of X)",
            ),
            (
                "110=1e4",
                "$110=1e4: \"1e4\" is no number (largest speed of X)",
            ),
            ("110=", "$110=: there is no value (largest speed of X)"),
            (
                "110=0,5",
                "$110=0,5: a number has a point, no comma: 0.5 (largest speed of X)",
            ),
            (
                "110=5,000",
                "$110=5,000: a number has no comma: 5.000 or 5000 (largest speed of X)",
            ),
            (
                "100=0",
                "$100=0: 0.001 to 100 000 step/mm is allowed (resolution of X)",
            ),
            (
                "111=-5",
                "$111=-5: 0.001 to 10 000 000 mm/min is allowed (largest speed of Y)",
            ),
            (
                "58=99999999",
                "$58=99999999: -10 000 000 to 10 000 000 mm is allowed (parking: machine coordinate of Z)",
            ),
            ("0=2", "$0=2: 3 to 255 µs is allowed (step pulse)"),
            ("13=256", "$13=256: 0 or 1 is allowed (reports in inches)"),
            ("3=300", "$3=300: 0 to 255 is allowed (inverted directions)"),
            (
                "20=1",
                "$20=1: soft limits need homing, which is off; $22=1 would do (soft limits)",
            ),
            (
                "110=20000",
                "$110=20000: 83 333 steps/s; $0=10 leaves room for 59 659 (14 318 mm/min), $0=4 would do \
                 (largest speed of X)",
            ),
            (
                "110=50000",
                "$110=50000: 208 333 steps/s; $0=10 leaves room for 59 659 (14 318 mm/min), \
                 $0=3 for 109 375 (26 250 mm/min) (largest speed of X)",
            ),
            (
                "102=10000",
                "$102=10000: 83 333 steps/s; $0=10 leaves room for 59 659 (7 159 step/mm), $0=4 would do \
                 (resolution of Z)",
            ),
        ] {
            assert_eq!(refused(&settings, statement), text);
        }
    }

    #[test]
    fn a_sum_of_bits_of_which_some_do_not_exist_is_refused_with_those_that_do() {
        for (statement, values) in [("22=15", "0, 1 or 9"), ("10=256", "0 to 255")] {
            let text = refused(&Settings::default(), statement);
            let begin = format!("${statement}: {values} is allowed (");
            assert!(text.starts_with(&begin), "{text}");
        }
    }

    #[test]
    fn a_limit_that_the_proof_sets_is_named() {
        let unproven = refused(&Settings::default(), "110=7300");
        let part = "30 417 steps/s; without a proof the firmware makes 30 000 (7 200 mm/min)";
        assert!(unproven.contains(part), "{unproven}");
        let proven = refused(&Settings::new(StepRate::Proven(50_000)), "110=20000");
        let part = "83 333 steps/s; the firmware makes 50 000 (12 000 mm/min)";
        assert!(proven.contains(part), "{proven}");
    }

    #[test]
    fn the_promised_remedy_works_and_the_next_value_does_not() {
        let mut settings = Settings::new(StepRate::Proven(200_000));
        assign(&mut settings, b"100=157.48").unwrap();
        let text = refused(&settings, "110=40000");
        let (_, rest) = text.split_once('(').unwrap();
        let (most, _) = rest.split_once(" mm/min").unwrap();
        let most: u32 = most.replace(' ', "").parse().unwrap();
        assert!(assign(&mut settings, format!("110={most}").as_bytes()).is_ok());
        assert!(assign(&mut settings, format!("110={}", most + 1).as_bytes()).is_err());
        let (_, pulse) = text.split_once(", $0=").unwrap();
        let (pulse, _) = pulse.split_once(' ').unwrap();
        settings.step_pulse_us = pulse.parse().unwrap();
        assert!(text.contains("would do"), "{text}");
        assert!(assign(&mut settings.clone(), b"110=40000").is_ok());
        settings.step_pulse_us += 1;
        assert!(assign(&mut settings, b"110=40000").is_err());
    }
}
