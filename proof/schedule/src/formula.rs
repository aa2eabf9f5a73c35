//! Formulas of `schedule.toml`: times and counts from what the analysis is asked for.
//!
//! Times are core cycles: a number with a unit is a number of cycles. Rates are per second: a time
//! from a rate is `10s / baud`, and a count from a rate is `step_rate * 2ms / 1s`.

use std::{collections::BTreeMap, fmt};

use serde::Deserialize;
use syn::{BinOp, Expr, ExprBinary, ExprLit, Lit, Path};

/// A number, or an expression.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Formula {
    /// The number.
    Number(f64),
    /// The expression.
    Text(String),
}

impl Default for Formula {
    fn default() -> Self {
        Self::Number(0.0)
    }
}

impl fmt::Display for Formula {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number}"),
            Self::Text(text) => f.write_str(text),
        }
    }
}

/// The values of names.
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
            Self::Text(text) => syn::parse_str(text)
                .map_err(|error| error.to_string())
                .and_then(|expression| names.value(&expression, depth))
                .map_err(|error| format!("{error} in the formula `{text}`")),
        }
    }
}

impl Names<'_> {
    /// The value of an expression, which is written as in Rust.
    fn value(&self, expression: &Expr, depth: usize) -> Result<f64, String> {
        let value = |expression| self.value(expression, depth);
        match expression {
            Expr::Paren(inner) => value(&inner.expr),
            Expr::Lit(ExprLit {
                lit: Lit::Int(int), ..
            }) => self.number(int.base10_digits(), int.suffix()),
            Expr::Lit(ExprLit {
                lit: Lit::Float(float),
                ..
            }) => self.number(float.base10_digits(), float.suffix()),
            Expr::Binary(ExprBinary {
                left, op, right, ..
            }) => {
                let (left, right) = (value(left)?, value(right)?);
                match op {
                    BinOp::Add(_) => Ok(left + right),
                    BinOp::Sub(_) => Ok(left - right),
                    BinOp::Mul(_) => Ok(left * right),
                    BinOp::Div(_) => Ok(left / right),
                    _ => Err("an operator other than + - * /".to_owned()),
                }
            }
            Expr::Path(path) => self.named(&name(&path.path)?, depth),
            Expr::Call(call) => {
                let Expr::Path(path) = &*call.func else {
                    return Err("a call of what is no function".to_owned());
                };
                let given: Vec<f64> = call.args.iter().map(value).collect::<Result<_, _>>()?;
                match (name(&path.path)?.as_str(), &given[..]) {
                    ("ceil", [one]) => Ok(one.ceil()),
                    ("floor", [one]) => Ok(one.floor()),
                    ("min", [first, others @ ..]) => {
                        Ok(others.iter().copied().fold(*first, f64::min))
                    }
                    ("max", [first, others @ ..]) => {
                        Ok(others.iter().copied().fold(*first, f64::max))
                    }
                    (function, _) => Err(format!("the function `{function}` is not known so")),
                }
            }
            _ => Err("neither a number nor a name, a sum or a call".to_owned()),
        }
    }

    /// A number, with a unit or without.
    fn number(&self, digits: &str, unit: &str) -> Result<f64, String> {
        let number: f64 = digits
            .parse()
            .map_err(|_| format!("`{digits}` is no number"))?;
        let (core_hz, timer_hz) = self.clocks;
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

    fn named(&self, name: &str, depth: usize) -> Result<f64, String> {
        if let Some(value) = self.values.get(name) {
            return Ok(*value);
        }
        let formula = self.formulas.get(name);
        let formula = formula.ok_or_else(|| format!("the name `{name}` is not known"))?;
        if depth == DEPTH {
            return Err(format!("`{name}` is defined by itself"));
        }
        formula.at_depth(self, depth + 1)
    }
}

fn name(path: &Path) -> Result<String, String> {
    let name = path.get_ident().ok_or("a path is no name")?;
    Ok(name.to_string())
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
        let error = value("126 ticks").unwrap_err();
        assert!(error.ends_with(" in the formula `126 ticks`"), "{error}");
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
        for text in [
            "", "1 +", "1 2", "(1", "3 parsec", "3parsec", "sin(1)", "max()", "a::b", "1 % 2", "#",
        ] {
            assert!(value(text).is_err(), "{text}");
        }
    }
}
