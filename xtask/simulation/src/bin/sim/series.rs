//! A quantity over time in bounded memory: its least and greatest value in each of some stretches.

/// Most stretches.
const MOST: usize = 2400;

/// Least and greatest values over time.
#[derive(Debug, Clone)]
pub(crate) struct Series {
    /// Length of a stretch, s.
    stretch_s: f64,
    values: Vec<Option<(f64, f64)>>,
}

impl Default for Series {
    fn default() -> Self {
        Self {
            stretch_s: 0.000_5,
            values: Vec::new(),
        }
    }
}

impl Series {
    /// A value that holds from one time to another.
    pub(crate) fn push(&mut self, from_s: f64, to_s: f64, value: f64) {
        while to_s / self.stretch_s >= MOST as f64 {
            self.stretch_s *= 2.0;
            let pairs = self.values.chunks(2);
            let merged = pairs.map(|pair| pair.iter().copied().reduce(merge).flatten());
            self.values = merged.collect();
        }
        let index = |seconds: f64| (seconds.max(0.0) / self.stretch_s) as usize;
        let (first, last) = (index(from_s), index(to_s));
        if self.values.len() <= last {
            self.values.resize(last + 1, None);
        }
        for place in &mut self.values[first..=last] {
            *place = merge(*place, Some((value, value)));
        }
    }

    /// The greatest value around a time.
    pub(crate) fn greatest_at(&self, seconds: f64) -> Option<f64> {
        let index = (seconds.max(0.0) / self.stretch_s) as usize;
        self.values.get(index)?.map(|(_, greatest)| greatest)
    }

    /// The greatest value, without its sign.
    pub(crate) fn greatest(&self) -> f64 {
        let values = self.values.iter().flatten();
        values.fold(0.0, |most, (least, greatest)| {
            most.max(greatest.abs()).max(least.abs())
        })
    }

    /// Returns runs of what is known, each with times, s, and the least and greatest values there.
    pub(crate) fn runs(&self) -> Vec<Vec<(f64, f64, f64)>> {
        let seconds = |index: usize| (index as f64 + 0.5) * self.stretch_s;
        let values: Vec<_> = self.values.iter().enumerate().collect();
        let runs = values.chunk_by(|a, b| a.1.is_some() == b.1.is_some());
        let known = |run: &[(usize, &Range)]| -> Option<Vec<_>> {
            let values = run.iter().map(|(index, value)| {
                value.map(|(least, greatest)| (seconds(*index), least, greatest))
            });
            values.collect()
        };
        runs.filter_map(known).collect()
    }
}

type Range = Option<(f64, f64)>;

fn merge(a: Range, b: Range) -> Range {
    match (a, b) {
        (Some((least, greatest)), Some((low, high))) => Some((least.min(low), greatest.max(high))),
        (one, other) => one.or(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_series_keeps_its_extremes_in_bounded_memory() {
        let mut series = Series::default();
        for index in 0..100_000 {
            let value = if index == 54_321 { -9.0 } else { 1.0 };
            let seconds = f64::from(index) * 0.01;
            series.push(seconds, seconds + 0.01, value);
        }
        assert!(series.values.len() <= MOST);
        assert_eq!(series.greatest(), 9.0);
        assert_eq!(series.greatest_at(543.215), Some(1.0));
        let runs = series.runs();
        assert_eq!(runs.len(), 1);
        assert!(
            runs[0]
                .iter()
                .any(|value| (value.1, value.2) == (-9.0, 1.0))
        );
    }

    #[test]
    fn what_is_unknown_ends_a_run() {
        let mut series = Series::default();
        series.push(0.0, 0.1, 1.0);
        series.push(0.3, 0.4, 2.0);
        assert_eq!(series.runs().len(), 2);
        assert_eq!(series.greatest_at(0.2), None);
    }
}
