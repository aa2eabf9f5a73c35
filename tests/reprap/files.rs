//! Whole files of slicers and of a plotter, with the lines numbered as hosts send them.

use crate::machine::{STEPS_PER_MM, numbered, reprap_with};

const FILES: [(&str, &str); 3] = [
    ("PrusaSlicer", include_str!("files/prusa.gcode")),
    ("CuraEngine", include_str!("files/cura.gcode")),
    ("pen", include_str!("files/pen.gcode")),
];

/// The settings of a printer's frame, homed where it stands.
const FRAME: [&str; 5] = ["130=235", "131=235", "132=250", "22=1", "788=7"];

/// The value of a letter in a line that moves.
fn value(line: &str, letter: char) -> Option<f64> {
    let mut words = line.split_whitespace();
    let is_move = matches!(words.next(), Some("G0" | "G1" | "G2"));
    let word = words.find(|word| word.starts_with(letter))?;
    is_move.then(|| word[1..].parse().ok()).flatten()
}

#[test]
fn files_of_slicers_and_plotters_run_to_their_end() {
    for (name, text) in FILES {
        let mut machine = reprap_with(&FRAME);
        // Hosts leave comments and blank lines out.
        let words = text.lines().filter_map(|line| line.split(';').next());
        let lines: Vec<&str> = words
            .map(str::trim)
            .filter(|line| !line.is_empty())
            .collect();
        let mut absent = Vec::new();
        for (number, line) in (1..).zip(&lines) {
            let mut answer = machine.ask(&numbered(number, line));
            let last = answer.pop().unwrap_or_default();
            assert!(last.starts_with("ok"), "{name}, {line}: {last:?}");
            assert!(
                answer.iter().all(|message| message.starts_with("echo:")),
                "{name}, {line}: {answer:?}"
            );
            absent.extend(
                answer
                    .into_iter()
                    .filter(|message| message.ends_with("not present")),
            );
        }
        for (axis, letter) in "XYZ".chars().enumerate() {
            let end = lines.iter().rev().find_map(|line| value(line, letter));
            let end = end.expect("the file moves each axis");
            // The ends of the travel are its zero, and the machine stood at the other ones.
            let travel: f64 = FRAME[axis].split('=').nth(1).unwrap().parse().unwrap();
            let steps = ((end - travel) * f64::from(STEPS_PER_MM)).round() as i32;
            assert_eq!(machine.physical_steps()[axis], steps, "{name}, {letter}");
        }
        // Each heater is told once.
        let heaters = ["M104", "M109", "M140", "M190"];
        let reported = |heater: &&str| {
            absent
                .iter()
                .filter(|message| message.contains(*heater))
                .count()
        };
        let used = |heater: &&str| {
            let is_used = |line: &&str| line.starts_with(*heater) && !line.ends_with("S0");
            usize::from(
                lines
                    .iter()
                    .any(|line| is_used(&line.split(';').next().unwrap())),
            )
        };
        for heater in heaters {
            assert_eq!(
                reported(&heater),
                used(&heater),
                "{name}, {heater}: {absent:?}"
            );
        }
    }
}
