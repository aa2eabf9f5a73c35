//! How values are distributed: exactly, as far as they are counted, and in logarithmic classes.

use std::collections::BTreeMap;

use serde::Serialize;

/// Values and how often each has been.
#[derive(Debug, Clone, Default)]
pub(crate) struct Distribution {
    counts: BTreeMap<u64, u64>,
    count: u64,
    sum: u128,
}

/// A distribution in a few numbers; the last ones are 0 where there is no value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Summary {
    /// How many values there are.
    pub(crate) count: u64,
    pub(crate) min: u64,
    pub(crate) mean: f64,
    /// 99 % of the values are not above this.
    pub(crate) p99: u64,
    /// 99.9 % of the values are not above this.
    pub(crate) p999: u64,
    pub(crate) max: u64,
}

/// Values from one, inclusive, up to another, exclusive, and how many there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(crate) struct Class {
    pub(crate) from: u64,
    pub(crate) to: u64,
    pub(crate) count: u64,
}

impl Distribution {
    /// Adds a value.
    pub(crate) fn add(&mut self, value: u64) {
        *self.counts.entry(value).or_default() += 1;
        self.count += 1;
        self.sum += u128::from(value);
    }

    /// Its numbers.
    pub(crate) fn summary(&self) -> Summary {
        Summary {
            count: self.count,
            min: self.counts.first_key_value().map_or(0, |(value, _)| *value),
            mean: self.sum as f64 / self.count.max(1) as f64,
            p99: self.quantile(10),
            p999: self.quantile(1),
            max: self.counts.last_key_value().map_or(0, |(value, _)| *value),
        }
    }

    /// The smallest value that all but so many thousandths are not above.
    fn quantile(&self, thousandths_above: u64) -> u64 {
        let above = self.count * thousandths_above / 1000;
        let mut left = above;
        for (value, count) in self.counts.iter().rev() {
            if *count > left {
                return *value;
            }
            left -= count;
        }
        0
    }

    /// So many classes for each doubling, from the smallest value to the largest, empty ones between
    /// them included.
    pub(crate) fn classes(&self, per_doubling: u8) -> Vec<Class> {
        let scale = Scale(f64::from(per_doubling));
        let mut classes: Vec<Class> = Vec::new();
        for (&value, &count) in &self.counts {
            if classes.is_empty() {
                classes.push(scale.class(scale.index(value)));
            }
            while classes.last().is_some_and(|last| last.to <= value) {
                let next = classes.last().map_or(0, |last| last.to);
                classes.push(scale.class(scale.index(next)));
            }
            if let Some(last) = classes.last_mut() {
                last.count += count;
            }
        }
        classes
    }
}

/// A logarithmic scale, with so many classes for each doubling.
struct Scale(f64);

impl Scale {
    /// The number of the class that a value is in.
    fn index(&self, value: u64) -> i32 {
        let guess = ((value.max(1) as f64).log2() * self.0) as i32;
        // Limits are rounded, so a value next to one may be in the next class.
        if value >= self.limit(guess + 1) {
            guess + 1
        } else {
            guess
        }
    }

    /// An empty class.
    fn class(&self, mut index: i32) -> Class {
        let from = self.limit(index);
        // The smallest values have classes narrower than 1: some are left out.
        while self.limit(index + 1) == from {
            index += 1;
        }
        Class {
            from: if from == 1 { 0 } else { from },
            to: self.limit(index + 1),
            count: 0,
        }
    }

    /// Where a class begins.
    fn limit(&self, index: i32) -> u64 {
        2_f64.powf(f64::from(index) / self.0).round() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: impl IntoIterator<Item = u64>) -> Distribution {
        let mut distribution = Distribution::default();
        values.into_iter().for_each(|value| distribution.add(value));
        distribution
    }

    #[test]
    fn a_thousand_different_values_have_exact_numbers() {
        let summary = of((1..=1000).rev()).summary();
        let expected = Summary {
            count: 1000,
            min: 1,
            mean: 500.5,
            p99: 990,
            p999: 999,
            max: 1000,
        };
        assert_eq!(summary, expected);
    }

    #[test]
    fn few_values_have_their_largest_at_the_top() {
        let summary = of([5, 5, 7]).summary();
        assert_eq!((summary.p99, summary.p999, summary.max), (7, 7, 7));
        assert_eq!(of([]).summary().max, 0);
    }

    #[test]
    fn classes_have_no_gaps_and_hold_every_value() {
        for values in [
            vec![0, 1, 2, 3, 1_000_000],
            vec![90, 91, 128],
            vec![0],
            vec![46_341],
        ] {
            for per_doubling in [1, 2, 4, 8] {
                let classes = of(values.clone()).classes(per_doubling);
                let counted: u64 = classes.iter().map(|class| class.count).sum();
                assert_eq!(counted, values.len() as u64, "{values:?}");
                for pair in classes.windows(2) {
                    assert_eq!(pair[0].to, pair[1].from, "{values:?}");
                }
                for class in &classes {
                    let inside = |value: &&u64| (class.from..class.to).contains(*value);
                    let count = values.iter().filter(inside).count();
                    assert_eq!(class.count, count as u64, "{class:?}");
                }
            }
        }
        assert!(of([]).classes(2).is_empty());
    }
}
