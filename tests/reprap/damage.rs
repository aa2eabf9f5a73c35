//! Whole jobs through a line that damages bytes, and bytes that are no lines at all.

use leadscrew::{
    model::State,
    protocol::{RawLine, Verdict},
};
use proptest::prelude::*;

use crate::{
    cases,
    host::{Host, STEPS_PER_MM, numbered},
};

/// Knuth's MMIX.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % limit
    }
}

/// What a line becomes on its way: mostly itself.
fn damaged(random: &mut Random, line: &[u8], percent: u64) -> Vec<u8> {
    let mut line = line.to_vec();
    if random.below(100) >= percent {
        return line;
    }
    let place = random.below(line.len() as u64) as usize;
    match random.below(3) {
        0 => line[place] ^= 1 << random.below(8),
        1 => drop(line.remove(place)),
        _ => line.insert(place, line[place]),
    }
    line
}

/// Sends lines as Printrun does: the next at each `ok`, the one that is asked for at each `Resend`.
/// Returns the number of lines sent.
fn send_as_printrun(host: &mut Host, lines: &[String], random: &mut Random, percent: u64) -> usize {
    let mut next = 0;
    let mut resend: Option<usize> = None;
    let mut sent = 0;
    assert_eq!(host.ask(&numbered(-1, "M110 N-1")), ["ok"]);
    loop {
        let number = resend.unwrap_or(next);
        let Some(words) = lines.get(number) else {
            return sent;
        };
        resend = resend
            .map(|number| number + 1)
            .filter(|number| *number < next);
        next = next.max(number + 1);
        sent += 1;
        assert!(sent < 20 * lines.len() + 100, "the job never ends");
        let line = numbered(i32::try_from(number).expect("few lines"), words) + "\n";
        host.receive(&damaged(random, line.as_bytes(), percent));
        // A line whose end is lost is asked for after a second.
        let mut answers = Vec::new();
        for _ in 0..30 {
            host.rest();
            answers.extend(host.lines());
            if answers.iter().any(|line| line.starts_with("ok")) {
                break;
            }
            host.run_ms(100);
        }
        assert!(
            answers.iter().any(|line| line.starts_with("ok")),
            "no answer: {answers:?}"
        );
        for answer in &answers {
            assert!(!answer.starts_with("Error:Printer"), "{answer}");
            // OctoPrint ends a job at any other error.
            let is_known = ["checksum", "line number"];
            let lower = answer.to_lowercase();
            assert!(
                !answer.starts_with("Error:") || is_known.iter().any(|known| lower.contains(known)),
                "{answer} for {line:?}"
            );
            if let Some(number) = answer.strip_prefix("Resend: ") {
                let number = number.parse::<usize>().expect("a line that was sent");
                assert!(number <= next, "{answer} of {next}");
                resend = (number < next).then_some(number);
            }
        }
    }
}

proptest! {
    #![proptest_config(cases(4))]

    #[test]
    fn a_job_over_a_bad_line_is_executed_as_it_was_sent(seed in any::<u64>()) {
        let mut random = Random(seed);
        let mut host = Host::new();
        let mut lines = vec!["G91".to_owned(), "G1 F6000".to_owned()];
        let mut sum = [0; 2];
        for _ in 0..50 {
            let axis = random.below(2) as usize;
            let steps = random.below(2000) as i32 - 1000;
            sum[axis] += steps;
            let letter = ["X", "Y"][axis];
            let mm = f64::from(steps) / f64::from(STEPS_PER_MM);
            lines.push(format!("G1 {letter}{mm:.4}"));
        }
        let percent = [6, 30][random.below(2) as usize];
        let sent = send_as_printrun(&mut host, &lines, &mut random, percent);
        host.ask("M400");
        prop_assert_eq!(host.xy(), sum);
        prop_assert!(sent >= lines.len());
    }

    #[test]
    fn every_line_of_random_bytes_is_answered_once(seed in any::<u64>()) {
        let mut random = Random(seed);
        let mut host = Host::new();
        let mut raw: RawLine = RawLine::new();
        let (mut expected, mut answered) = (0, 0);
        let mut is_first = true;
        for _ in 0..3000 {
            let byte = match random.below(4) {
                0 => *b"\n NGM*;(\"".get(random.below(9) as usize).unwrap_or(&b'X'),
                1 => b'0' + random.below(10) as u8,
                _ => random.below(256) as u8,
            };
            // A realtime byte is none in a line, and a statement may do what it wants.
            let is_special = byte >= 0x80 || b"!~?$\x18\0".contains(&byte);
            let byte = if is_first && is_special { b'x' } else { byte };
            is_first = matches!(byte, b'\n' | b'\r');
            host.receive(&[byte]);
            if is_first {
                expected += usize::from(raw.verdict(0, false) != Verdict::Blank);
                raw.clear();
                host.rest();
                if host.state() == State::HoldComplete {
                    // A pause of the program.
                    host.receive(b"~");
                    host.rest();
                }
                let lines = host.lines();
                answered += lines.iter().filter(|line| line.starts_with("ok")).count();
                prop_assert_eq!(answered, expected, "{:?}", lines);
            } else if byte != 0 {
                raw.push(byte);
            }
        }
    }
}
