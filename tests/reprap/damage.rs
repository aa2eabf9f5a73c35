//! Whole jobs through a line that damages bytes, and bytes that are no lines at all.

use leadscrew::{
    model::State,
    protocol::{RawLine, Verdict},
};
use proptest::prelude::*;

use crate::{
    machine::{STEPS_PER_MM, machine_with, numbered, reprap, xy},
    support::{Machine, cases, rounds},
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

/// The lines in some bytes that are answered: all but blank ones. The last may have lost its end.
fn answered_lines(bytes: &[u8]) -> usize {
    let is_answered = |line: &&[u8]| {
        let mut raw: RawLine = RawLine::new();
        for byte in *line {
            raw.push(*byte);
        }
        raw.verdict(0, true) != Verdict::Blank
    };
    let lines = bytes.split(|byte| matches!(byte, b'\n' | b'\r'));
    lines.filter(is_answered).count()
}

/// What has been sent, and how much of it was damaged.
#[derive(Default)]
struct Sent {
    lines: usize,
    damaged: usize,
}

/// Sends lines as Printrun does: the next at each `ok`, the one that is asked for at each `Resend`.
fn send_as_printrun(
    machine: &mut Machine,
    lines: &[String],
    random: &mut Random,
    percent: u64,
) -> Sent {
    let mut next = 0;
    let mut resend: Option<usize> = None;
    let mut sent = Sent::default();
    assert_eq!(machine.ask(&numbered(-1, "M110 N-1")), ["ok"]);
    loop {
        let number = resend.unwrap_or(next);
        let Some(words) = lines.get(number) else {
            return sent;
        };
        resend = resend
            .map(|number| number + 1)
            .filter(|number| *number < next);
        next = next.max(number + 1);
        sent.lines += 1;
        assert!(sent.lines < 20 * lines.len() + 100, "the job never ends");
        let line = numbered(i32::try_from(number).expect("few lines"), words) + "\n";
        let bytes = damaged(random, line.as_bytes(), percent);
        sent.damaged += usize::from(bytes != line.as_bytes());
        machine.send(&bytes);
        let expected = answered_lines(&bytes);
        let is_ok = |line: &&String| line.starts_with("ok");
        // A line whose end is lost is asked for after a second.
        let mut answers = Vec::new();
        for _ in 0..30 {
            machine.run_to_standstill();
            answers.extend(machine.lines());
            if answers.iter().filter(is_ok).count() >= expected {
                break;
            }
            machine.run(100);
        }
        let answered = answers.iter().filter(is_ok).count();
        assert_eq!(answered, expected, "{answers:?} for {bytes:?}");
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

#[test]
fn of_many_damaged_lines_none_is_executed_and_every_one_is_answered_once() {
    let mut random = Random(19);
    let mut damaged = 0;
    while damaged < rounds(100_000) as usize {
        let mut machine = reprap();
        let mut lines = vec!["M83".to_owned(), "G91".to_owned(), "G1 F6000".to_owned()];
        let mut sum = [0; 2];
        for _ in 0..1000 {
            // Mostly E, which is only counted: exact, and without a step to be made.
            let axis = usize::from(random.below(64) != 0);
            let thousandths = random.below(2000) as i32 - 1000;
            sum[axis] += thousandths;
            let letter = ["Y", "E"][axis];
            lines.push(format!("G1 {letter}{:.3}", f64::from(thousandths) / 1000.0));
        }
        damaged += send_as_printrun(&mut machine, &lines, &mut random, 50).damaged;
        let mm = sum.map(|sum| format!("{:.3}", f64::from(sum) / 1000.0));
        let position = machine.ask("M114").remove(0);
        let expected = format!("X:0.000 Y:{} Z:0.000 E:{} Count", mm[0], mm[1]);
        assert!(position.starts_with(&expected), "{position}: {expected}");
    }
}

proptest! {
    #![proptest_config(cases(4))]

    #[test]
    fn a_job_over_a_bad_line_is_executed_as_it_was_sent(seed in any::<u64>()) {
        let mut random = Random(seed);
        let mut machine = reprap();
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
        let sent = send_as_printrun(&mut machine, &lines, &mut random, percent);
        machine.ask("M400");
        prop_assert_eq!(xy(&machine), sum);
        prop_assert!(sent.lines >= lines.len());
    }
}

/// Sends random bytes: all bytes that make lines in one of the two dialects are answered.
fn send_random_bytes(dialect: &str, seed: u64) {
    let is_reprap = dialect == "780=1";
    let mut random = Random(seed);
    let mut machine = machine_with(&[dialect]);
    let mut raw: RawLine = RawLine::new();
    let (mut expected, mut answered) = (0, 0);
    let mut is_first = true;
    for _ in 0..3000 {
        let byte = match random.below(4) {
            0 => *b"\n NGM*;(\""
                .get(random.below(9) as usize)
                .unwrap_or(&b'X'),
            1 => b'0' + random.below(10) as u8,
            _ => random.below(256) as u8,
        };
        // A realtime byte is none in a line, and a statement may do what it wants.
        let is_realtime = byte >= 0x80 || b"!~?\x18".contains(&byte);
        let is_special = is_first && b"$\0".contains(&byte);
        let byte = match (is_realtime && (is_first || !is_reprap), is_special) {
            (false, false) => byte,
            (..) => b'x',
        };
        is_first = matches!(byte, b'\n' | b'\r');
        machine.send([byte]);
        if is_first {
            let is_blank = is_reprap && raw.verdict(0, false) == Verdict::Blank;
            expected += usize::from(!is_blank);
            raw.clear();
            machine.run_to_standstill();
            if machine.state() == State::HoldComplete {
                // A pause of the program.
                machine.send(b"~");
                machine.run_to_standstill();
            }
            let lines = machine.lines();
            let is_answer = |line: &&String| line.starts_with("ok") || line.starts_with("error:");
            answered += lines.iter().filter(is_answer).count();
            assert_eq!(answered, expected, "{lines:?}");
        } else if byte != 0 {
            raw.push(byte);
        }
    }
}

proptest! {
    #![proptest_config(cases(4))]

    #[test]
    fn every_line_of_random_bytes_is_answered_once(seed in any::<u64>()) {
        for dialect in ["780=1", "780=2"] {
            send_random_bytes(dialect, seed);
        }
    }
}

#[test]
fn what_is_no_line_is_refused_in_clear_words_and_nothing_of_it_is_executed() {
    const RANGE: &str = "Error:the value is outside its range (error:39)";
    const WHOLE: &str = "Error:this number must be whole (error:23)";
    const NUMBER: &str = "Error:a letter must be followed by a number (error:2)";
    const LETTER: &str = "Error:a word must begin with a letter (error:1)";
    const MISMATCH: &str = "Error:checksum mismatch, Last Line: 0";
    let mut machine = reprap();
    let long = format!("G1 X{}", "1".repeat(60));
    for (line, expected) in [
        ("G1 X\"1", NUMBER),
        ("G1 X5 P\"a\"\"b", NUMBER),
        ("M106 S256", RANGE),
        ("M106 S-1", RANGE),
        ("M106 S99999999999999999999", RANGE),
        ("M113 S256", RANGE),
        ("M113 S0.5", WHOLE),
        ("M154 S1.5", WHOLE),
        ("M84 S0.5", WHOLE),
        ("M220 S9", RANGE),
        ("M220 S201", RANGE),
        ("M220 S99.5", WHOLE),
        ("M221 S9", RANGE),
        ("M221 S1001", RANGE),
        ("M203 X0.00001", RANGE),
        ("M201 X0.0001", RANGE),
        ("M204 S99999999", RANGE),
        ("M203 X0", "Error:the value must be above 0 (error:19)"),
        ("G1 X1 F0.5", RANGE),
        ("G1 X1 F99999999", RANGE),
        ("M0 S99999999", RANGE),
        ("M84 S65536", RANGE),
        ("G4 P99999999999999", RANGE),
        (&long, "Error:the target cannot be reached (error:33)"),
        ("G1 X--1", NUMBER),
        ("G1 X.", NUMBER),
        ("G1 X1 %", LETTER),
        ("G1 X1 2", LETTER),
        ("T70000", NUMBER),
        ("M70000", "echo:Unknown command: \"M70000\""),
        ("G70000", "echo:Unknown command: \"G70000\""),
        ("N1 G1 X5*12345", MISMATCH),
        ("N1 G1 X5*1234", MISMATCH),
        ("N99999999999 G1 X5*1", MISMATCH),
        ("N-2 G1 X5*1", MISMATCH),
        ("\u{1}\u{2}\u{7f}", LETTER),
    ] {
        let answer = machine.ask(line);
        assert_eq!(answer.first().map(String::as_str), Some(expected), "{line}");
        assert_eq!(answer.last().map(String::as_str), Some("ok"), "{line}");
    }
    assert_eq!(xy(&machine), [0, 0]);
}
