//! What the machine's outputs and the switches do over time.

use leadscrew::model::{Outputs, Spindle};
use serde::{Deserialize, Serialize};

/// A signal that has changed: when, s; its name; to what level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event(
    /// When, s.
    pub f64,
    /// Which.
    pub String,
    /// To what.
    pub i64,
);

/// The outputs as they were last, and every change so far.
#[derive(Debug, Default)]
pub(super) struct Signals {
    last: Vec<i64>,
    events: Vec<Event>,
}

/// The outputs' names, in the order of [`values`].
const NAMES: [&str; 6] = [
    "spindle_pwm_value",
    "spindle_pwm_enabled",
    "spindle_dir_ccw",
    "coolant_flood",
    "coolant_mist",
    "steppers_disabled",
];

/// What the outputs are, as Grbl's board has them: its PWM has 8 bits.
fn values(outputs: Outputs) -> [i64; 6] {
    let duty = i64::from(outputs.duty);
    let full = i64::from(Outputs::FULL);
    [
        duty * 255 / full,
        i64::from(duty > 0),
        i64::from(outputs.spindle == Spindle::CounterClockwise),
        i64::from(outputs.coolant.flood),
        i64::from(outputs.coolant.mist),
        i64::from(!outputs.drivers),
    ]
}

impl Signals {
    /// Notes what has changed at `time_s`: the outputs, and the switches in their order.
    pub(super) fn note(
        &mut self,
        time_s: f64,
        outputs: Outputs,
        switches: impl Iterator<Item = bool>,
    ) {
        let now = values(outputs).into_iter().chain(switches.map(i64::from));
        for (index, value) in now.enumerate() {
            let last = self.last.get_mut(index);
            if last.as_deref() == Some(&value) {
                continue;
            }
            match last {
                Some(last) => *last = value,
                None => self.last.push(value),
            }
            let name = match NAMES.get(index) {
                Some(name) => (*name).to_owned(),
                None => format!("switch{}_closed", index - NAMES.len()),
            };
            self.events.push(Event(time_s, name, value));
        }
    }

    /// Every change so far; the first of each signal is its level at power-up.
    pub(super) fn events(&self) -> &[Event] {
        &self.events
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_changes_are_noted() {
        let mut signals = Signals::default();
        let mut outputs = Outputs::default();
        signals.note(0.0, outputs, [false].into_iter());
        assert_eq!(signals.events().len(), NAMES.len() + 1);
        signals.note(0.1, outputs, [false].into_iter());
        assert_eq!(signals.events().len(), NAMES.len() + 1);
        outputs.duty = 512;
        outputs.drivers = true;
        signals.note(0.2, outputs, [true].into_iter());
        let new: Vec<_> = signals.events()[NAMES.len() + 1..]
            .iter()
            .map(|Event(time, name, value)| (*time, name.as_str(), *value))
            .collect();
        assert_eq!(
            new,
            [
                (0.2, "spindle_pwm_value", 128),
                (0.2, "spindle_pwm_enabled", 1),
                (0.2, "steppers_disabled", 0),
                (0.2, "switch0_closed", 1),
            ]
        );
    }
}
