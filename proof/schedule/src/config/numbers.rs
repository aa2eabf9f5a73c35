//! The values of the formulas of `schedule.toml`.

use std::collections::{BTreeMap, BTreeSet};

use super::Config;
use crate::{Clock, Formula, Image, formula::Names, system::calls_name};

/// What the names of symbols begin with whose addresses are constants of the program.
const CONSTANT_PREFIX: &str = "_constant_";
/// Bits between two bytes of a USART, from the middle of one stop bit, where the USART reports the byte and looks for the
/// next start bit, to the middle of the next, which may be shorter by half a bit: RM0090 30.3.3.
const RECEIVED_BYTE_BITS: f64 = 9.5;

/// Constants of a program, and the numbers of `schedule.toml` that are made of constants alone.
#[derive(Debug, Clone, Default)]
pub struct ProgramNumbers {
    /// The constants by their names.
    pub(crate) constants: BTreeMap<String, f64>,
    /// Clock of the core and of the step timer, Hz.
    clocks: (f64, f64),
    /// The baud rate of the program.
    pub baud: u32,
    /// Bytes at the end of the stack that must not be touched.
    pub stack_guard_bytes: u64,
    /// Step rate above which no proof is tried, a second.
    pub highest_step_rate_hz: Option<u32>,
    /// How long the watchdog waits at least, µs.
    pub watchdog_us: Option<f64>,
}

/// The rates for which formulas are computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Pulses of all axes together, per second.
    pub step_rate_hz: f64,
    /// Bits per second.
    pub baud: f64,
    /// Axes that the firmware has.
    pub axes: u8,
}

impl Config {
    /// The file for a program, whose constants are absolute symbols.
    ///
    /// # Errors
    ///
    /// Tells which formula is wrong.
    pub fn of_program(mut self, image: &Image, clock: &Clock) -> Result<Self, String> {
        let constants = image.symbols().filter_map(|(name, value)| {
            let name = name.strip_prefix(CONSTANT_PREFIX)?;
            Some((name.to_owned(), value.into()))
        });
        self.program.constants = constants.collect();
        self.program.clocks = (clock.hclk_hz as f64, clock.timer_hz as f64);
        let value = |formula: &Formula| self.constant(formula);
        let highest = self.limits.step_rate_hz.as_ref().map(value).transpose()?;
        let period = self.watchdog.as_ref().map(|it| value(&it.period));
        let watchdog_us = period
            .transpose()?
            .map(|it| it * 1e6 / clock.hclk_hz as f64);
        let baud = value(&self.table.baud)? as u32;
        let stack_guard_bytes = value(&self.limits.stack_guard_bytes)? as u64;
        self.program = ProgramNumbers {
            baud,
            stack_guard_bytes,
            highest_step_rate_hz: highest.map(|rate| rate as u32),
            watchdog_us,
            ..self.program
        };
        Ok(self)
    }

    fn constants(&self) -> impl Iterator<Item = (&str, f64)> {
        let constants = self.program.constants.iter();
        constants.map(|(name, value)| (name.as_str(), *value))
    }

    /// The value of a formula of constants alone.
    ///
    /// # Errors
    ///
    /// Tells what is wrong with it.
    pub(crate) fn constant(&self, formula: &Formula) -> Result<f64, String> {
        let names = Names {
            values: self.constants().collect(),
            formulas: BTreeMap::new(),
            clocks: self.program.clocks,
        };
        let value = formula.value(&names);
        value.map_err(|error| format!("schedule.toml: {error}"))
    }

    /// The values of the names in its formulas.
    pub fn names(&self, clock: &Clock, point: Point) -> Names<'_> {
        let formulas = self.bounds.iter();
        let of_point = [
            ("step_rate", point.step_rate_hz),
            ("baud", point.baud),
            ("axes", f64::from(point.axes)),
            (
                "received_byte",
                RECEIVED_BYTE_BITS * clock.hclk_hz as f64 / point.baud,
            ),
        ];
        Names {
            values: self.constants().chain(of_point).collect(),
            formulas: formulas.map(|(name, formula)| (&**name, formula)).collect(),
            clocks: (clock.hclk_hz as f64, clock.timer_hz as f64),
        }
    }

    /// The named bounds, rounded up.
    ///
    /// # Errors
    ///
    /// Tells which formula is wrong.
    pub fn numbers(&self, clock: &Clock, point: Point) -> Result<BTreeMap<String, u64>, String> {
        self.evaluate(&self.names(clock, point))
    }

    /// The named bounds with one of them set to 0, and the bounds computed from that one.
    ///
    /// # Errors
    ///
    /// Tells which formula is wrong.
    pub fn numbers_without(
        &self,
        clock: &Clock,
        point: Point,
        without: &str,
    ) -> Result<BTreeMap<String, u64>, String> {
        let mut names = self.names(clock, point);
        names.formulas.remove(without);
        names.values.insert(without, 0.0);
        self.evaluate(&names)
    }

    /// A named bound and all whose formulas name it, directly or not.
    pub(crate) fn following(&self, bound: &str) -> BTreeSet<String> {
        let mut found = BTreeSet::from([bound.to_owned()]);
        loop {
            let names = |formula: &Formula| {
                let text = formula.to_string();
                let mut words = text.split(|c: char| !c.is_alphanumeric() && c != '_');
                words.any(|word| found.contains(word))
            };
            let more: Vec<String> = self
                .bounds
                .iter()
                .filter(|(name, formula)| !found.contains(*name) && names(formula))
                .map(|(name, _)| name.clone())
                .collect();
            if more.is_empty() {
                return found;
            }
            found.extend(more);
        }
    }

    fn evaluate(&self, names: &Names<'_>) -> Result<BTreeMap<String, u64>, String> {
        let rounded = |name: String, formula: &Formula| {
            let value = formula.value(names)?;
            Ok((name, value.max(0.0).ceil() as u64))
        };
        let bounds = self.bounds.iter();
        let bounds = bounds.filter(|(name, _)| names.formulas.contains_key(name.as_str()));
        let bounds = bounds.map(|(name, formula)| rounded(name.clone(), formula));
        let calls = self.calls.iter();
        let calls = calls.map(|(function, formula)| rounded(calls_name(function), formula));
        let given = names.values.iter();
        let given = given.map(|(name, value)| Ok(((*name).to_owned(), value.ceil() as u64)));
        bounds.chain(calls).chain(given).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_computed_from_a_bound_goes_with_it() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../schedule.toml");
        let mut config = Config::parse(&std::fs::read_to_string(file).unwrap()).unwrap();
        let formula = |text: &str| Formula::Text(text.to_owned());
        config.bounds = BTreeMap::from([
            ("steps".to_owned(), formula("step_rate * 2ms / 1s + axes")),
            ("events".to_owned(), formula("2 * steps + 4")),
        ]);
        let point = Point {
            step_rate_hz: 1000.0,
            baud: 1.0,
            axes: 3,
        };
        let clock = crate::testing::CLOCK;
        let all = config.numbers(&clock, point).unwrap();
        assert_eq!((all["steps"], all["events"]), (5, 14));
        let none = config.numbers_without(&clock, point, "steps").unwrap();
        assert_eq!((none["steps"], none["events"]), (0, 4));
    }
}
