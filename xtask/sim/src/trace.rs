//! The step trace: every event that steps, as a table and as evenly spaced samples.

use std::{
    io::Write,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result};
use host::output::Output;
use leadscrew::{
    axis::{AXES, LETTERS},
    units::TICKS_PER_SECOND,
};

/// One event that steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Row {
    /// Time since the first step, ns.
    pub(crate) time_ns: u64,
    /// Steps of each axis after it.
    pub(crate) steps: [i32; AXES],
}

/// Timer ticks as nanoseconds, rounded down.
pub(crate) fn nanoseconds(ticks: u64) -> u64 {
    let rate = u64::from(TICKS_PER_SECOND);
    ticks / rate * 1_000_000_000 + ticks % rate * 1_000_000_000 / rate
}

/// Writes the trace as comma-separated values, as it comes.
pub(crate) struct Table<W: Write> {
    output: W,
    line: Vec<u8>,
}

impl Table<Output> {
    /// Creates a file.
    pub(crate) fn create(path: &Path) -> Result<Self> {
        Self::new(Output::create(path)?).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Where it lies until it is whole.
    pub(crate) fn partial(&self) -> Option<PathBuf> {
        self.output.partial()
    }
}

impl<W: Write> Table<W> {
    /// Writes the head of the table: `time_ns,x,y,z`.
    pub(crate) fn new(mut output: W) -> Result<Self> {
        write!(output, "time_ns")?;
        for letter in &LETTERS[..AXES] {
            write!(output, ",{}", letter.to_ascii_lowercase() as char)?;
        }
        writeln!(output)?;
        Ok(Self {
            output,
            line: Vec::new(),
        })
    }

    /// Writes one row.
    pub(crate) fn push(&mut self, row: &Row) -> Result<()> {
        self.line.clear();
        decimal(&mut self.line, i128::from(row.time_ns));
        for steps in row.steps {
            self.line.push(b',');
            decimal(&mut self.line, i128::from(steps));
        }
        self.line.push(b'\n');
        self.output
            .write_all(&self.line)
            .context("cannot write the trace")
    }

    /// Writes what is still buffered.
    pub(crate) fn finish(mut self) -> Result<W> {
        self.output.flush().context("cannot write the trace")?;
        Ok(self.output)
    }
}

/// Appends a number: several times faster than `write!`, and a trace has millions.
fn decimal(text: &mut Vec<u8>, number: i128) {
    if number < 0 {
        text.push(b'-');
    }
    let start = text.len();
    let mut rest = number.unsigned_abs() as u64;
    loop {
        text.push(b'0' + (rest % 10) as u8);
        rest /= 10;
        if rest == 0 {
            break;
        }
    }
    text[start..].reverse();
}

/// One axis between its step times.
#[derive(Debug, Clone, Default)]
struct Column {
    /// Position at each sample time, steps.
    positions: Vec<f32>,
    /// Steps after the newest event.
    steps: i32,
    /// Time of the newest step, ns, and where the axis was just then: halfway.
    newest: Option<(u64, f64)>,
    /// Time between the newest two steps, ns.
    interval: u64,
}

impl Column {
    /// Fills the samples up to `until` along a straight line.
    fn line_to(&mut self, spacing: u64, until: u64, position: f64) {
        let (start, from) = self.newest.unwrap_or((until, position));
        let length = (until - start).max(1) as f64;
        loop {
            let at = self.positions.len() as u64 * spacing;
            if at > until {
                break;
            }
            let share = at.saturating_sub(start) as f64 / length;
            let sample = from + (position - from) * share.min(1.0);
            self.positions.push(sample as f32);
        }
        self.newest = Some((until, position));
    }

    fn step(&mut self, spacing: u64, time: u64, steps: i32) {
        let crossing = f64::from(self.steps + steps) / 2.0;
        let before = self.newest.map_or(time, |(newest, _)| newest);
        let gap = time - before;
        // With constant acceleration the last step before standstill is 1.37 intervals away
        // from it: (√1) / (√3 - √1). A much longer gap is a standstill on a whole step.
        let ramp = self.interval + self.interval * 3 / 8;
        if self.newest.is_some() && gap > 4 * ramp.max(1_000_000) {
            self.line_to(spacing, before + ramp, f64::from(self.steps));
            self.line_to(spacing, time - ramp, f64::from(self.steps));
            self.line_to(spacing, time, crossing);
        } else {
            self.interval = gap;
            self.line_to(spacing, time, crossing);
        }
        self.steps = steps;
    }
}

/// Positions at evenly spaced times, in bounded memory.
///
/// Between two steps of an axis its position is interpolated, so speeds come out smooth although
/// steps are whole. When there are too many samples, every second one is dropped: the spacing is
/// 1 ms for programs of up to four minutes and doubles as they get longer.
#[derive(Debug, Clone)]
pub(crate) struct Samples {
    spacing_ns: u64,
    columns: [Column; AXES],
    most: usize,
    end_ns: u64,
}

impl Default for Samples {
    fn default() -> Self {
        Self::with_capacity(1 << 18)
    }
}

impl Samples {
    fn with_capacity(most: usize) -> Self {
        Self {
            spacing_ns: 1_000_000,
            columns: std::array::from_fn(|_| Column::default()),
            most,
            end_ns: 0,
        }
    }

    /// Takes one event. Events come in the order of time.
    pub(crate) fn push(&mut self, row: &Row) {
        self.end_ns = row.time_ns;
        while row.time_ns / self.spacing_ns >= self.most as u64 {
            self.thin_out();
        }
        for (column, steps) in self.columns.iter_mut().zip(row.steps) {
            if steps != column.steps {
                column.step(self.spacing_ns, row.time_ns, steps);
            }
        }
    }

    fn thin_out(&mut self) {
        self.spacing_ns *= 2;
        for column in &mut self.columns {
            let mut index = 0;
            column.positions.retain(|_| {
                index += 1;
                index % 2 == 1
            });
        }
    }

    /// The samples: seconds between two, and for each axis its positions in mm, all of one length.
    pub(crate) fn finish(mut self, steps_per_mm: [f64; AXES]) -> Motion {
        let (spacing, end) = (self.spacing_ns, self.end_ns);
        let ends = self.columns.iter().map(|column| {
            let (newest, _) = column.newest.unwrap_or_default();
            newest + column.interval + column.interval * 3 / 8
        });
        // Until the slowest axis has come to rest.
        let end = ends.fold(end, u64::max).min(end + 20_000_000) + spacing;
        let mm = std::array::from_fn(|axis| {
            let column = &mut self.columns[axis];
            let (newest, _) = column.newest.unwrap_or_default();
            let ramp = column.interval + column.interval * 3 / 8;
            let rest = f64::from(column.steps);
            column.line_to(spacing, (newest + ramp).min(end), rest);
            column.line_to(spacing, end, rest);
            let scale = steps_per_mm[axis];
            let positions = column.positions.iter();
            positions.map(|steps| f64::from(*steps) / scale).collect()
        });
        Motion {
            spacing_s: spacing as f64 * 1e-9,
            mm,
        }
    }
}

/// A motion at evenly spaced times.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    /// Time between two samples, s.
    pub(crate) spacing_s: f64,
    /// Positions of each axis, mm.
    pub(crate) mm: [Vec<f64>; AXES],
}

impl Motion {
    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        self.mm[0].len()
    }

    /// Length of the motion, s.
    pub(crate) fn duration_s(&self) -> f64 {
        self.len().saturating_sub(1) as f64 * self.spacing_s
    }

    /// Speed and acceleration of one axis at each sample, mm/s and mm/s²: a parabola is fitted to
    /// the samples within `reach` of each (least squares, Savitzky and Golay 1964).
    pub(crate) fn derivatives(&self, axis: usize, reach: usize) -> (Vec<f64>, Vec<f64>) {
        let reach = i32::try_from(reach.max(1)).unwrap_or(i32::MAX / 2);
        let mm = &self.mm[axis];
        let [s2, s4] = (-reach..=reach).fold([0.0; 2], |[squares, fourths], k| {
            let square = f64::from(k).powi(2);
            [squares + square, fourths + square * square]
        });
        let n = f64::from(2 * reach + 1);
        let last = mm.len().saturating_sub(1);
        let at = |index: usize, k: i32| mm[index.saturating_add_signed(k as isize).min(last)];
        let fit = |index: usize| {
            let (mut odd, mut even, mut all) = (0.0, 0.0, 0.0);
            for k in -reach..=reach {
                let value = at(index, k) - mm[index];
                odd += f64::from(k) * value;
                even += f64::from(k).powi(2) * value;
                all += value;
            }
            let curvature = (n * even - s2 * all) / (n * s4 - s2 * s2);
            let spacing = self.spacing_s;
            (odd / s2 / spacing, 2.0 * curvature / (spacing * spacing))
        };
        (0..mm.len()).map(fit).unzip()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(time_ns: u64, x: i32) -> Row {
        let mut steps = [0; AXES];
        steps[0] = x;
        Row { time_ns, steps }
    }

    #[test]
    fn ticks_become_nanoseconds_without_drift() {
        assert_eq!(nanoseconds(84), 1_000);
        assert_eq!(nanoseconds(1), 11);
        assert_eq!(nanoseconds(84_000_000 * 100_000), 100_000_000_000_000);
    }

    #[test]
    fn the_table_has_one_row_per_event() {
        let mut table = Table::new(Vec::new()).unwrap();
        table.push(&row(0, 1)).unwrap();
        table.push(&row(12_345, -2)).unwrap();
        let text = String::from_utf8(table.finish().unwrap()).unwrap();
        let rest = ",0".repeat(AXES - 1);
        let (_, rows) = text.split_once('\n').unwrap();
        assert!(text.starts_with("time_ns,x,y,z"));
        assert_eq!(rows, format!("0,1{rest}\n12345,-2{rest}\n"));
    }

    /// A move from rest to rest: 50 mm/s reached with 1000 mm/s², 80 steps/mm.
    fn trapezoid() -> (Vec<Row>, f64) {
        let (speed, acceleration, scale, steps) = (50.0_f64, 1000.0, 80.0, 1600);
        let length = f64::from(steps) / scale;
        let ramp = speed * speed / 2.0 / acceleration;
        let total = 2.0 * speed / acceleration + (length - 2.0 * ramp) / speed;
        let time_at = |mm: f64| {
            if mm < ramp {
                (2.0 * mm / acceleration).sqrt()
            } else if mm <= length - ramp {
                speed / acceleration + (mm - ramp) / speed
            } else {
                total - (2.0 * (length - mm) / acceleration).sqrt()
            }
        };
        let first = time_at(0.5 / scale);
        let rows = (1..=steps).map(|step| {
            let time = time_at((f64::from(step) - 0.5) / scale) - first;
            row((time * 1e9) as u64, step)
        });
        (rows.collect(), total)
    }

    #[test]
    fn speed_and_acceleration_of_a_trapezoid_are_found() {
        let (rows, total) = trapezoid();
        let mut samples = Samples::default();
        for row in &rows {
            samples.push(row);
        }
        let motion = samples.finish([80.0; AXES]);
        assert!((motion.duration_s() - total).abs() < 0.02);
        let (speeds, accelerations) = motion.derivatives(0, 4);
        let fastest = speeds.iter().copied().fold(0.0, f64::max);
        assert!((fastest - 50.0).abs() < 0.1, "{fastest}");
        for time in [0.015, 0.025, 0.035] {
            let acceleration = accelerations[(time / motion.spacing_s) as usize];
            assert!((acceleration - 1000.0).abs() < 30.0, "{acceleration}");
        }
        let middle = accelerations[accelerations.len() / 2];
        assert!(middle.abs() < 5.0, "{middle}");
    }

    #[test]
    fn a_long_program_takes_bounded_memory() {
        let mut samples = Samples::with_capacity(1000);
        for step in 0..100_000 {
            samples.push(&row(step as u64 * 1_000_000, step));
        }
        let motion = samples.finish([1.0; AXES]);
        assert!(motion.len() <= 1001);
        assert!((motion.duration_s() - 100.0).abs() < 0.5);
        let (speeds, _) = motion.derivatives(0, 1);
        assert!((speeds[500] - 1000.0).abs() < 1.0);
    }

    #[test]
    fn a_pause_is_no_slow_motion() {
        let mut samples = Samples::default();
        for step in 0..100 {
            samples.push(&row(step * 1_000_000, step as i32 + 1));
        }
        samples.push(&row(2_000_000_000, 101));
        let motion = samples.finish([1.0; AXES]);
        let (speeds, _) = motion.derivatives(0, 2);
        assert!(speeds[1000].abs() < 1e-9);
        assert!((motion.mm[0][1000] - 100.0).abs() < 1e-9);
    }
}
