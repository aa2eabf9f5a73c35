//! The workloads of the benchmark.

use std::f64::consts::TAU;

/// How much of a workload is run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// The settings alone: what they cost is not the program's.
    Settings,
    /// Settings and program.
    Whole,
}

/// A program and what it stands for.
pub(super) struct Workload {
    pub(super) name: &'static str,
    pub(super) settings: &'static [&'static str],
    pub(super) program: Vec<String>,
    /// Machine position at the end, mm.
    pub(super) end_mm: [f64; 3],
    /// How long it moves when the look-ahead never runs dry, seconds.
    pub(super) motion_s: f64,
    /// The divisor of its cost: steps, periods of the fastest axis, or lines.
    pub(super) count: u64,
}

/// One axis at 100 kHz for two seconds: 1000 steps/mm at 100 mm/s. Per step.
pub(super) fn one_axis() -> Workload {
    Workload {
        name: "1 axis, 100 kHz",
        settings: &["$0=3", "$100=1000", "$110=6000", "$120=5000"],
        program: vec!["G1X200F6000".into()],
        end_mm: [200.0, 0.0, 0.0],
        motion_s: 2.0 + 0.02,
        count: 200_000,
    }
}

/// Three axes at 100, 73 and 51 kHz for two seconds. Per step of the fastest.
pub(super) fn three_axes() -> Workload {
    // The path is sqrt(100² + 73² + 51²) / 100 times as long as its part in X.
    Workload {
        name: "3 axes, 100, 73, 51 kHz",
        settings: &[
            "$0=3",
            "$100=1000",
            "$101=1000",
            "$102=1000",
            "$110=6500",
            "$111=6500",
            "$112=6500",
            "$120=5000",
            "$121=5000",
            "$122=5000",
        ],
        program: vec!["G1X200Y146Z102F8034".into()],
        end_mm: [200.0, 146.0, 102.0],
        motion_s: 2.0 + 0.02,
        count: 200_000,
    }
}

/// Short lines: 24 characters each with its end, 0.3 to 0.45 mm, X Y and Z, at speed. Per line.
pub(super) fn short_lines() -> Workload {
    const LINES: u32 = 1200;
    // A knot in a cube of 8 mm: one coordinate has one digit before the point, so each line has
    // the same length.
    let at = |index: u32| {
        let turn = f64::from(index) * TAU / 60.0;
        let wave = |frequency: f64, phase: f64| {
            let amplitude = 3.2;
            let position = 5.0 + amplitude * (frequency * turn + phase).sin();
            (position * 1000.0).round() / 1000.0
        };
        [wave(1.0, 0.0), wave(1.0, TAU / 4.0), wave(0.37, 1.0)]
    };
    let distance = |from: [f64; 3], to: [f64; 3]| {
        let squares = from.iter().zip(to).map(|(from, to)| (from - to).powi(2));
        squares.sum::<f64>().sqrt()
    };
    let lengths = (1..LINES).map(|index| distance(at(index), at(index + 1)));
    let length_mm = distance([0.0; 3], at(1)) + lengths.sum::<f64>();
    let mut program: Vec<String> = vec!["G1F6000".into()];
    program.extend((1..=LINES).map(|index| {
        let [x, y, z] = at(index);
        format!("G1 X{x:.3} Y{y:.3} Z{z:.3}")
    }));
    Workload {
        name: "short G1 lines",
        settings: &[
            "$0=3",
            "$100=320",
            "$101=320",
            "$102=400",
            "$110=9000",
            "$111=9000",
            "$112=9000",
            "$120=5000",
            "$121=5000",
            "$122=5000",
        ],
        program,
        end_mm: at(LINES),
        motion_s: length_mm / 100.0 + 0.1,
        count: LINES.into(),
    }
}

/// Lines of 10 steps, as in a raster, 3750 of them a second. Per line.
pub(super) fn raster() -> Workload {
    const LINES: u32 = 2400;
    let at = |index: u32| f64::from(index) * 0.04;
    let mut program = vec!["G1F9000".into()];
    program.extend((1..=LINES).map(|index| format!("X{:.2}", at(index))));
    Workload {
        name: "lines of 10 steps",
        settings: &["$0=3", "$100=250", "$110=9000", "$120=20000"],
        program,
        end_mm: [at(LINES), 0.0, 0.0],
        motion_s: at(LINES) / 150.0 + 0.1,
        count: LINES.into(),
    }
}

/// Blocks that each new block of [`replanned`] re-plans, but for the first ones, which have fewer
/// before them.
const REPLANNED: f64 = 105.0;

/// Short lines in a row, too fast to be stopped in fewer than 105 lines: each new line raises the
/// speed of the lines before. Per line.
pub(super) fn replanned() -> Workload {
    const LINES: u32 = 1200;
    const LINE_MM: f64 = 0.05;
    const ACCELERATION_MM_S2: f64 = 100.0;
    let braking_mm = REPLANNED * LINE_MM;
    // As a whole number of mm/min, no faster.
    let feed = (60.0 * (2.0 * ACCELERATION_MM_S2 * braking_mm).sqrt()).floor();
    let speed_mm_s = feed / 60.0;
    let length_mm = f64::from(LINES) * LINE_MM;
    let mut program = vec![format!("G1F{feed}")];
    program.extend((1..=LINES).map(|index| format!("X{:.2}", f64::from(index) * LINE_MM)));
    Workload {
        name: "lines that re-plan 100 blocks",
        settings: &["$0=3", "$100=3000", "$110=2100", "$120=100"],
        program,
        end_mm: [length_mm, 0.0, 0.0],
        motion_s: length_mm / speed_mm_s + speed_mm_s / ACCELERATION_MM_S2,
        count: LINES.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_in_a_row_re_plan_a_hundred_blocks_in_the_mean() {
        let lines = replanned().count as f64;
        let missing = REPLANNED * REPLANNED / 2.0;
        let mean = REPLANNED - missing / lines;
        assert!((100.0..102.0).contains(&mean), "{mean}");
    }

    #[test]
    fn short_lines_are_as_long_as_promised() {
        let workload = short_lines();
        let lines = &workload.program[1..];
        assert_eq!(lines.len() as u64, workload.count);
        let mut before: Option<Vec<f64>> = None;
        for line in lines {
            assert_eq!(line.len() + 1, 24, "{line}");
            let words = line.split(' ').skip(1);
            let here: Vec<f64> = words.map(|word| word[1..].parse().unwrap()).collect();
            if let Some(before) = before {
                let square: f64 = here.iter().zip(&before).map(|(a, b)| (a - b).powi(2)).sum();
                let length = square.sqrt();
                assert!((0.3..0.45).contains(&length), "{length} mm: {line}");
            }
            before = Some(here);
        }
    }
}
