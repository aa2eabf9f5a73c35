//! Formulas of `schedule.toml`: times and counts from what the analysis is asked for.
//!
//! Times are core cycles, so a number with a unit is a number of cycles; rates are per second, so a
//! time from a rate is `10s / baud` and a count from a rate is `step_rate * 2ms / 1s`.

use std::{collections::BTreeMap, fmt};

use serde::Deserialize;

/// A number, or an expression.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Formula {
    /// The number.
    Number(f64),
    /// The expression.
    Text(String),
}

impl fmt::Display for Formula {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number}"),
            Self::Text(text) => f.write_str(text),
        }
    }
}

/// What names mean.
#[derive(Debug, Clone, Default)]
pub struct Names<'a> {
    /// Names with a value.
    pub values: BTreeMap<&'a str, f64>,
    /// Names with a formula.
    pub formulas: BTreeMap<&'a str, &'a Formula>,
    /// Clock of the core and of the step timer, Hz.
    pub clocks: (f64, f64),
}

/// Most names within names: more is a circle.
const DEPTH: usize = 16;

impl Formula {
    /// Its value.
    ///
    /// # Errors
    ///
    /// Tells what is wrong with it.
    pub fn value(&self, names: &Names<'_>) -> Result<f64, String> {
        self.at_depth(names, 0)
    }

    fn at_depth(&self, names: &Names<'_>, depth: usize) -> Result<f64, String> {
        match self {
            Self::Number(number) => Ok(*number),
            Self::Text(text) => {
                let mut parser = Parser {
                    rest: text,
                    names,
                    depth,
                };
                let value = parser.sum();
                let value = match parser.peek() {
                    Some(char) if value.is_ok() => Err(format!("unexpected `{char}`")),
                    _ => value,
                };
                value.map_err(|error| format!("{error} in the formula `{text}`"))
            }
        }
    }
}

struct Parser<'a> {
    rest: &'a str,
    names: &'a Names<'a>,
    depth: usize,
}

impl<'a> Parser<'a> {
    fn peek(&mut self) -> Option<char> {
        self.rest = self.rest.trim_start();
        self.rest.chars().next()
    }

    fn accept(&mut self, char: char) -> bool {
        let is_there = self.peek() == Some(char);
        if is_there {
            self.rest = &self.rest[char.len_utf8()..];
        }
        is_there
    }

    /// What comes next as long as its characters belong to it.
    fn take(&mut self, belongs: impl Fn(char) -> bool) -> &'a str {
        let rest = self.rest;
        let end = rest.find(|char| !belongs(char)).unwrap_or(rest.len());
        self.rest = &rest[end..];
        &rest[..end]
    }

    fn sum(&mut self) -> Result<f64, String> {
        let mut value = self.product()?;
        loop {
            if self.accept('+') {
                value += self.product()?;
            } else if self.accept('-') {
                value -= self.product()?;
            } else {
                return Ok(value);
            }
        }
    }

    fn product(&mut self) -> Result<f64, String> {
        let mut value = self.factor()?;
        loop {
            if self.accept('*') {
                value *= self.factor()?;
            } else if self.accept('/') {
                value /= self.factor()?;
            } else {
                return Ok(value);
            }
        }
    }

    fn factor(&mut self) -> Result<f64, String> {
        match self.peek() {
            Some('(') => {
                self.accept('(');
                let value = self.sum()?;
                self.close()?;
                Ok(value)
            }
            Some(char) if char.is_ascii_digit() => self.number(),
            Some(char) if char.is_ascii_alphabetic() => self.name(),
            Some(char) => Err(format!("unexpected `{char}`")),
            None => Err("something is missing at the end".to_owned()),
        }
    }

    fn close(&mut self) -> Result<(), String> {
        if self.accept(')') {
            Ok(())
        } else {
            Err("a `)` is missing".to_owned())
        }
    }

    fn number(&mut self) -> Result<f64, String> {
        let text = self.take(|char| char.is_ascii_digit() || matches!(char, '.' | '_'));
        let text = text.replace('_', "");
        let number: f64 = text.parse().map_err(|_| format!("`{text}` is no number"))?;
        let (core_hz, timer_hz) = self.names.clocks;
        let unit = self.take(|char| char.is_ascii_alphabetic());
        let cycles = match unit {
            "" | "cycles" => 1.0,
            "s" => core_hz,
            "ms" => core_hz / 1e3,
            "us" => core_hz / 1e6,
            "ns" => core_hz / 1e9,
            "ticks" => core_hz / timer_hz,
            _ => return Err(format!("`{unit}` is no unit")),
        };
        Ok(number * cycles)
    }

    fn name(&mut self) -> Result<f64, String> {
        let name = self.take(|char| char.is_ascii_alphanumeric() || char == '_');
        if self.accept('(') {
            return self.call(name);
        }
        if let Some(value) = self.names.values.get(name) {
            return Ok(*value);
        }
        let formula = self.names.formulas.get(name);
        let formula = formula.ok_or_else(|| format!("the name `{name}` is not known"))?;
        if self.depth == DEPTH {
            return Err(format!("`{name}` is defined by itself"));
        }
        formula.at_depth(self.names, self.depth + 1)
    }

    fn call(&mut self, function: &str) -> Result<f64, String> {
        let mut value = self.sum()?;
        match function {
            "ceil" => value = value.ceil(),
            "floor" => value = value.floor(),
            "min" | "max" => {
                while self.accept(',') {
                    let other = self.sum()?;
                    value = if function == "min" {
                        value.min(other)
                    } else {
                        value.max(other)
                    };
                }
            }
            _ => return Err(format!("the function `{function}` is not known")),
        }
        self.close()?;
        Ok(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> Result<f64, String> {
        let twice = Formula::Text("2 * step_rate".to_owned());
        let circle = Formula::Text("circle + 1".to_owned());
        let names = Names {
            values: BTreeMap::from([("step_rate", 150e3), ("baud", 115_200.0)]),
            formulas: BTreeMap::from([("twice", &twice), ("circle", &circle)]),
            clocks: (168e6, 84e6),
        };
        Formula::Text(text.to_owned()).value(&names)
    }

    #[test]
    fn times_are_cycles() {
        assert_eq!(value("1.5us"), Ok(252.0));
        assert_eq!(
            value("126 ticks"),
            Err("unexpected `t` in the formula `126 ticks`".into())
        );
        assert_eq!(value("126ticks"), Ok(252.0));
        assert_eq!(value("10s / baud").map(f64::floor), Ok(14583.0));
        assert_eq!(value("2_000cycles"), Ok(2000.0));
    }

    #[test]
    fn operators_bind_as_usual() {
        assert_eq!(value("1 + 2 * 3 - 4 / 2"), Ok(5.0));
        assert_eq!(value("(1 + 2) * 3"), Ok(9.0));
        assert_eq!(value("10 - 2 - 3"), Ok(5.0));
        assert_eq!(
            value("ceil(7 / 2) + max(1, 3, 2) + min(4, 2) + floor(1.9)"),
            Ok(10.0)
        );
    }

    #[test]
    fn names_may_be_formulas_but_not_of_themselves() {
        assert_eq!(value("twice * 2ms / 1s"), Ok(600.0));
        assert!(value("circle").is_err_and(|error| error.contains("defined by itself")));
        assert!(value("speed").is_err_and(|error| error.contains("`speed` is not known")));
    }

    #[test]
    fn what_is_no_formula_is_refused() {
        for text in ["", "1 +", "1 2", "(1", "3 parsec", "3parsec", "sin(1)", "#"] {
            assert!(value(text).is_err(), "{text}");
        }
    }
}
