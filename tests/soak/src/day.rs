//! A day of work of one machine, with an operator who presses everything.
//!
//! Long slow moves and dwells mixed with fast ones, jogs that are cancelled, holds, doors and overrides at random
//! times. Nothing of that is refused, and each program ends on its step. The clocks of 32 bits wrap every 51 s.

use leadscrew::settings::StepRate;

use crate::{
    action::Action,
    bench::Bench,
    setup::{Kind, Setup},
};

/// Where the programs have their origin, in the middle of the travel.
const ORIGIN: &str = "G10 L2 P1 X-50 Y-50 Z-50";

/// What has been done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Worked {
    pub(crate) seconds: f64,
    pub(crate) lines: u64,
    pub(crate) presses: u64,
}

/// A machine, its sender, and its operator.
struct Day {
    bench: Bench,
    random: Random,
    worked: Worked,
}

/// Works for so many hours of the machine; `watch` is told after each program. Panics if a rule is broken.
pub(crate) fn work(seed: u64, hours: f64, step_rate: StepRate, mut watch: impl FnMut(&Worked)) {
    let setup = Setup {
        steps_per_mm: [250; 2],
        ..Setup::plain(Kind::Marks)
    };
    let mut day = Day {
        bench: Bench::new(setup, step_rate, None),
        random: Random(seed | 1),
        worked: Worked {
            seconds: 0.0,
            lines: 0,
            presses: 0,
        },
    };
    day.line(ORIGIN);
    while day.worked.seconds < hours * 3600.0 {
        day.program();
        if day.random.below(3) == 0 {
            day.bench.end_program();
            day.jogs();
            day.bench.end_program();
            // Nobody does anything for a while.
            let pause_ms = day.random.below(120_000) as u32;
            day.bench.act(&Action::Pass(pause_ms));
        }
        day.worked.seconds = day.bench.seconds();
        watch(&day.worked);
    }
    day.bench.finish();
}

impl Day {
    fn line(&mut self, line: &str) {
        self.bench.await_room(line);
        self.bench.act(&Action::Line(line.into()));
        self.worked.lines += 1;
    }

    /// A few lines of a program, with what the operator does meanwhile. It ends on a step.
    fn program(&mut self) {
        for _ in 0..self.random.between(3, 12) {
            let x = self.random.between(-9000, 9000) as f64 * 0.001;
            let y = self.random.between(-9000, 9000) as f64 * 0.001;
            let z = self.random.between(-300, 300) as f64 * 0.001;
            let feed = self.random.pick(&[20, 40, 90, 150, 400, 2500]);
            let line = match self.random.below(9) {
                0 => format!("G0 X{x} Y{y}"),
                1 => format!("G1 X{x} Y{y} Z{z} F{feed}"),
                2 => format!("G91 G1 X{:.3} Y{:.3} F{feed}", x * 0.1, y * 0.1),
                3 => format!("G90 G3 X{x} Y{y} R{} F{feed}", 20 + feed / 100),
                4 | 5 => format!("G4 P{}", self.random.between(1, 90)),
                6 => format!("M3 S{}", self.random.between(0, 1000)),
                7 => format!("G90 G20 G1 Z{:.4} F{}", z * 0.01, feed / 10),
                _ => self
                    .random
                    .pick(&["M5", "M8", "M9", "G21", "N7 T3", "G91.1 (a comment)"])
                    .to_owned(),
            };
            self.line(&line);
            self.line("G21 G90");
            self.operate();
        }
        let [x, y, z] = [0, 1, 2].map(|_| self.random.between(-9000, 9000) as f64 * 0.001);
        self.line(&format!("G90 G21 G1 X{x:.3} Y{y:.3} Z{:.3} F900", z * 0.1));
    }

    /// Jogs; some are cancelled.
    fn jogs(&mut self) {
        for _ in 0..self.random.between(1, 5) {
            let x = self.random.between(-3000, 3000) as f64 * 0.001;
            let feed = self.random.pick(&[60, 300, 2000]);
            self.line(&format!("$J=G91 X{x} Y{:.3} F{feed}", -x * 0.3));
        }
        if self.random.below(2) == 0 {
            let wait_ms = self.random.below(1000) as u32;
            self.bench.act(&Action::Pass(wait_ms));
            self.bench.act(&Action::Byte(0x85));
        }
    }

    /// The operator presses something, waits, and lets the machine go on.
    fn operate(&mut self) {
        for _ in 0..self.random.below(8) {
            let byte = match self.random.below(20) {
                0..=8 => b'?',
                9..=11 => b'!',
                12 => 0x84,
                13 => b'~',
                14 => 0x9e,
                15 => 0xa0,
                16 => self.random.pick(&[0x95, 0x96, 0x97]),
                17 => self.random.pick(&[0x99, 0x9a, 0x9b, 0x9c, 0x9d]),
                // Cancels nothing but jogs.
                18 => 0x85,
                _ => self.random.pick(&[0x90, 0x90, 0x91, 0x92, 0x93, 0x94]),
            };
            self.bench.act(&Action::Byte(byte));
            self.worked.presses += 1;
            let wait_ms = self.random.below(5000) as u32;
            self.bench.act(&Action::Pass(wait_ms));
            if matches!(byte, b'!' | 0x84) {
                self.bench.act(&Action::Byte(b'~'));
            }
        }
    }
}

/// xorshift64*, Vigna 2014.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16
    }

    fn below(&mut self, end: u64) -> u64 {
        self.next() % end
    }

    fn between(&mut self, least: i64, most: i64) -> i64 {
        least + self.below((most - least + 1) as u64).cast_signed()
    }

    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len() as u64) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn some_minutes_of_work_pass_without_a_refusal() {
        let mut last = None;
        work(1, 0.1, StepRate::Proven(190_000), |worked| {
            last = Some(*worked);
        });
        let worked = last.expect("a program has ended");
        assert!(worked.seconds >= 360.0 && worked.lines > 20, "{worked:?}");
        assert!(worked.presses > 10, "{worked:?}");
    }
}
