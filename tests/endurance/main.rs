//! A day of work in virtual time, with an operator who presses everything.
//!
//! Long slow moves and dwells mixed with fast ones, jogs that are cancelled, holds, doors and
//! overrides at random times. The clocks of 32 bits wrap every 51 s: some 1 700 times. Optimised
//! builds run 24 hours, as `cargo xtask test` does; others a quarter of an hour.
//! A program of its own, as the test looks at the memory of its process.
#![cfg(not(target_os = "none"))]

use std::collections::VecDeque;

use leadscrew::{
    axis::Axes,
    model::{State, queues::RECEIVED_RING},
    settings::Settings,
    sim::{Simulator, WINDOW},
    units::TICKS_PER_SECOND,
};

/// Length of the day.
const HOURS: f64 = if cfg!(debug_assertions) { 0.25 } else { 24.0 };
const SECOND: u64 = TICKS_PER_SECOND as u64;
/// One byte at 115 200 baud.
const BYTE_TICKS: u64 = SECOND * 10 / 115_200;
/// Longest time from a `?` to the first byte of its report.
const PROMPT_TICKS: u64 = SECOND / 200;
/// Greatest growth of the process while the machine runs, KiB.
const GROWTH_KIB: u64 = 512;

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

/// The operator's next action.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Press {
    Byte(u8),
    /// Cycle start, until the machine goes on.
    Resume,
}

/// A machine, its sender, and its operator.
struct Day {
    simulator: Box<Simulator>,
    random: Random,
    /// Lines that are being sent, and the lengths of those that have not been answered.
    line: VecDeque<u8>,
    unanswered: VecDeque<usize>,
    /// Realtime bytes on their way: they overtake.
    urgent: VecDeque<u8>,
    next_in: u64,
    next_out: u64,
    /// Time and kind of the operator's next action.
    press: (u64, Press),
    /// False if the operator does nothing.
    is_calm: bool,
    /// The line that is coming in.
    heard: String,
    /// Time at which each unanswered `?` was received.
    asked: VecDeque<u64>,
    answers: u64,
    reports: u64,
    presses: u64,
}

impl Day {
    fn new(settings: &Settings) -> Self {
        let mut simulator = Box::new(Simulator::new(settings));
        simulator.settle();
        Self {
            simulator,
            random: Random(0x1ead_5c3e_ffff_0001),
            line: VecDeque::new(),
            unanswered: VecDeque::new(),
            urgent: VecDeque::new(),
            next_in: 0,
            next_out: 0,
            press: (SECOND, Press::Byte(b'?')),
            is_calm: false,
            heard: String::new(),
            asked: VecDeque::new(),
            answers: 0,
            reports: 0,
            presses: 0,
        }
    }

    fn hours(&self) -> f64 {
        self.simulator.now() as f64 / SECOND as f64 / 3600.0
    }

    fn state(&self) -> State {
        self.simulator.snapshot().state
    }

    /// Puts a line on its way, as soon as character counting allows.
    fn send(&mut self, line: &str) {
        let length = line.len() + 1;
        while self.unanswered.iter().sum::<usize>() + length > WINDOW {
            self.run(SECOND / 100);
        }
        self.line.extend(line.as_bytes());
        self.line.push_back(b'\n');
        self.unanswered.push_back(length);
    }

    /// Runs until every line is answered and nothing moves.
    fn finish(&mut self) {
        loop {
            self.run(SECOND / 10);
            let snapshot = self.simulator.snapshot();
            let is_idle = snapshot.state == State::Idle && snapshot.is_at_rest;
            let nothing_waits = self.unanswered.is_empty()
                && self.urgent.is_empty()
                && self.simulator.received_free() == RECEIVED_RING - 1;
            if is_idle && nothing_waits {
                return;
            }
        }
    }

    fn run(&mut self, ticks: u64) {
        let end = self.simulator.now() + ticks;
        while self.simulator.now() < end {
            let now = self.simulator.now();
            if now >= self.next_out
                && let Some(byte) = self.simulator.send()
            {
                self.next_out = now + BYTE_TICKS;
                self.hear(byte, now);
                self.simulator.settle();
            }
            if now >= self.press.0 {
                self.act(now);
            }
            if now >= self.next_in
                && let Some(byte) = self.urgent.pop_front().or_else(|| self.line.pop_front())
            {
                self.next_in = now + BYTE_TICKS;
                if byte == b'?' {
                    self.asked.push_back(now);
                }
                self.simulator.receive(byte);
                self.simulator.settle();
            }
            let sends = !self.urgent.is_empty() || !self.line.is_empty();
            let events = [
                self.simulator.due(),
                self.simulator.has_to_send().then_some(self.next_out),
                sends.then_some(self.next_in),
                Some(self.press.0),
            ];
            let next = events.into_iter().flatten().fold(end, u64::min);
            let _ = self.simulator.advance(next.max(now));
        }
    }

    fn hear(&mut self, byte: u8, now: u64) {
        if byte == b'<' {
            let asked = self.asked.pop_front().expect("a report that was asked for");
            let waited = now - asked;
            assert!(waited <= PROMPT_TICKS, "a `?` waited {waited} ticks");
            self.reports += 1;
        }
        match byte {
            b'\r' => {}
            b'\n' => {
                let text = std::mem::take(&mut self.heard);
                // A jog may be refused while the machine still runs, G-code while it still jogs.
                if text == "ok" || text.starts_with("error:") {
                    assert_eq!(text, "ok", "at {} h", self.hours());
                    assert!(self.unanswered.pop_front().is_some(), "an answer too many");
                    self.answers += 1;
                }
                assert!(!text.starts_with("ALARM"), "{text} at {} h", self.hours());
            }
            byte => self.heard.push(char::from(byte)),
        }
    }

    /// The operator acts, and thinks of what is next.
    fn act(&mut self, now: u64) {
        let (_, press) = self.press;
        self.presses += 1;
        match press {
            Press::Byte(byte) => self.urgent.push_back(byte),
            Press::Resume => self.urgent.push_back(b'~'),
        }
        let is_stopped = self.state().is_suspended();
        let stops = matches!(press, Press::Byte(b'!' | 0x84));
        self.press = if stops || is_stopped {
            let wait = SECOND / 20 + self.random.below(SECOND);
            (now + wait, Press::Resume)
        } else if self.is_calm {
            (now + SECOND, Press::Byte(b'?'))
        } else {
            let wait = SECOND / 100 + self.random.below(5 * SECOND);
            (now + wait, Press::Byte(self.wish()))
        };
    }

    /// A byte that the operator might send.
    fn wish(&mut self) -> u8 {
        match self.random.below(20) {
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
        }
    }

    /// A few lines of a program; returns where they end, µm.
    fn program(&mut self) -> [i64; 3] {
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
            self.send(&line);
            self.send("G21 G90");
        }
        // 4 µm are a step: no end lies between two.
        let end = [0, 1, 2].map(|_| self.random.between(-2250, 2250) * 4);
        let [x, y, z] = end.map(|micrometres| micrometres as f64 * 0.001);
        self.send(&format!("G90 G21 G1 X{x:.3} Y{y:.3} Z{z:.3} F900"));
        end
    }

    /// Jogs; some are cancelled.
    fn jogs(&mut self) {
        for _ in 0..self.random.between(1, 5) {
            let x = self.random.between(-3000, 3000) as f64 * 0.001;
            let feed = self.random.pick(&[60, 300, 2000]);
            self.send(&format!("$J=G91 X{x} Y{:.3} F{feed}", -x * 0.3));
        }
        if self.random.below(2) == 0 {
            let wait = self.random.below(SECOND);
            self.run(wait);
            self.urgent.push_back(0x85);
        }
    }

    /// Where the machine stands must be where the program has led it, by its own count and by that
    /// of its pins.
    fn stands_at(&self, end: [i64; 3], settings: &Settings) {
        let snapshot = self.simulator.snapshot();
        for (axis, micrometres) in end.into_iter().enumerate() {
            let millionths = settings.steps_per_mm[axis].millionths().cast_signed();
            let steps = micrometres * millionths / 1_000_000_000;
            assert_eq!(
                i64::from(snapshot.steps[axis]),
                steps,
                "at {} h",
                self.hours()
            );
        }
        let physical = self.simulator.physical_steps();
        assert_eq!(physical, snapshot.steps, "at {} h", self.hours());
    }
}

/// Memory of this process in use, KiB; `None` where nobody says.
fn resident_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

#[test]
fn a_day_of_work_ends_on_the_exact_step() {
    let settings = Settings {
        max_rate_mm_min: Axes::all(3000.0),
        acceleration_mm_s2: Axes::all(200.0),
        ..Settings::default()
    };
    let mut day = Day::new(&settings);
    let mut before = None;
    while day.hours() < HOURS {
        let end = day.program();
        if day.random.below(3) == 0 {
            day.finish();
            day.stands_at(end, &settings);
            day.jogs();
            day.finish();
            // Nobody does anything for a while.
            let pause = day.random.below(120) * SECOND;
            day.run(pause);
        }
        before = before.or_else(resident_kib);
    }
    day.is_calm = true;
    day.urgent.push_back(0x90);
    let end = day.program();
    day.finish();
    day.stands_at(end, &settings);
    day.run(SECOND);
    assert!(day.asked.is_empty(), "a `?` without a report");
    assert_eq!((day.simulator.late(), day.simulator.lost()), (0, 0));
    if let (Some(before), Some(after)) = (before, resident_kib()) {
        assert!(after <= before + GROWTH_KIB, "{before} KiB, then {after}");
    }
    println!(
        "{:.1} h: {} lines, {} reports, {} presses, {} wraps of the clock",
        day.hours(),
        day.answers,
        day.reports,
        day.presses,
        day.simulator.now() >> 32
    );
}
