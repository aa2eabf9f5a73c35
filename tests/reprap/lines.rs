//! Numbers and checksums: what is executed, what is asked for again.

use leadscrew::protocol::{FailedCheck, MAX_NUMBER, RawLine, Verdict};
use proptest::prelude::*;

use crate::{
    machine::{STEPS_PER_MM, machine_with, numbered, reprap, send_numbered, xy},
    support::{cases, statistics},
};

/// What a host gets for a damaged line.
fn refusal(what: &str, last: i32) -> [String; 3] {
    [
        format!("Error:{what}, Last Line: {last}"),
        format!("Resend: {}", last + 1),
        "ok".to_owned(),
    ]
}

const MISMATCH: &str = "checksum mismatch";
const NO_CHECKSUM: &str = "No Checksum with line number";
const NO_NUMBER: &str = "checksum without line number";
const WRONG_NUMBER: &str = "Line Number is not Last Line Number+1";

#[test]
fn the_six_lines_of_the_reprap_pages() {
    let mut machine = reprap();
    assert_eq!(machine.ask("M110 N2"), ["ok"]);
    for line in [
        "N3 T0*57",
        "N4 G92 E0*67",
        "N5 G28*22",
        "N6 G1 F1500.0*82",
        "N7 G1 X2.0 Y2.0 F3000.0*85",
        "N8 G1 X3.0 Y3.0*33",
    ] {
        let answer = machine.ask(line);
        assert_eq!(answer.last().map(String::as_str), Some("ok"), "{line}");
        let is_refused = answer.iter().any(|line| line.starts_with("Resend"));
        assert!(!is_refused, "{line}: {answer:?}");
    }
    assert_eq!(xy(&machine), [3 * STEPS_PER_MM; 2]);
}

#[test]
fn each_kind_of_damage_is_answered_in_the_words_that_hosts_know() {
    let mut machine = reprap();
    send_numbered(&mut machine, 1, &["G1 X1 F6000"]);
    for (line, what) in [
        ("N2 G1 X2*1", MISMATCH),
        ("N2 G1 X2*999", MISMATCH),
        ("N2 G1 X2*00096", MISMATCH),
        ("N2 G1 X2*", MISMATCH),
        ("Nx G1 X2*5", MISMATCH),
        ("N2 G1 X2", NO_CHECKSUM),
        ("N2 G1 X2(*96", NO_CHECKSUM),
        ("G1 X2*96", NO_NUMBER),
        ("96", NO_NUMBER),
        (&numbered(3, "G1 X2"), WRONG_NUMBER),
        (&numbered(1, "G1 X2"), WRONG_NUMBER),
        (&numbered(-1, "G1 X2"), WRONG_NUMBER),
        (&numbered(i32::MAX, "G1 X2"), MISMATCH),
    ] {
        assert_eq!(machine.ask(line), refusal(what, 1), "{line}");
    }
    assert_eq!(xy(&machine), [STEPS_PER_MM, 0]);
    send_numbered(&mut machine, 2, &["G1 X2"]);
    assert_eq!(xy(&machine), [2 * STEPS_PER_MM, 0]);
}

#[test]
fn blanks_belong_to_the_checksum_and_comments_do_not_end_it() {
    let mut machine = reprap();
    send_numbered(
        &mut machine,
        1,
        &["  G1   X1\tF6000 ", "g1 x2", "G1 (a*b) X3"],
    );
    let line = numbered(4, "G1 X4") + " ; the last * one\r";
    assert_eq!(machine.ask(&line), ["ok"]);
    assert_eq!(xy(&machine), [4 * STEPS_PER_MM, 0]);
    assert_eq!(machine.ask("N5 G1 X5 *80"), refusal(MISMATCH, 4));
}

#[test]
fn nothing_is_answered_to_a_line_without_words() {
    let mut machine = reprap();
    for line in ["", "  ", ";", "; G1 X1", "(G1 X1)", "\r\r\n", "\t;*33"] {
        assert!(machine.ask(line).is_empty(), "{line:?}");
    }
    assert_eq!(machine.ask("G1 X1 F6000 ;"), ["ok"]);
}

#[test]
fn m110_sets_the_number_in_each_of_its_forms() {
    let mut machine = reprap();
    for (line, last) in [
        ("M110 N7", 7),
        ("N-1 M110 N-1*125", -1),
        ("N0 M110 N0*125", 0),
        (&numbered(41, "M110"), 41),
        (&numbered(9, "m110 n12"), 12),
    ] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
        let expected = format!("echo:Line number: {last}");
        assert_eq!(machine.ask("M110"), [expected.as_str(), "ok"], "{line}");
    }
    assert_eq!(machine.ask("N3 M110 N3*1"), refusal(MISMATCH, 12));
    assert_eq!(machine.ask("N3 M110 N3"), refusal(NO_CHECKSUM, 12));
    assert_eq!(machine.ask("N3 M110 Nx*124"), refusal(MISMATCH, 12));
    send_numbered(&mut machine, 13, &["G1 X1 F6000"]);
}

#[test]
fn lines_that_wait_when_one_is_asked_for_again_are_dropped() {
    let mut machine = reprap();
    let mut bytes = numbered(1, "G1 X1 F6000").replace('X', "Y").into_bytes();
    bytes.push(b'\n');
    for number in 2..9 {
        bytes.extend(numbered(number, &format!("G1 X{number}")).bytes());
        bytes.push(b'\n');
    }
    for byte in bytes {
        machine.receive(byte);
    }
    let answers = machine.answers();
    let requests = answers.iter().filter(|line| line.starts_with("Resend"));
    assert_eq!(requests.count(), 1, "{answers:?}");
    let acknowledged = answers.iter().filter(|line| *line == "ok").count();
    assert_eq!(acknowledged, 8, "{answers:?}");
    assert_eq!(xy(&machine), [0; 2]);
    send_numbered(&mut machine, 1, &["G1 X1 F6000", "G1 X2"]);
    // The request has been lost: the next line repeats it.
    assert_eq!(machine.ask(&numbered(4, "G1 X4")), refusal(WRONG_NUMBER, 2));
    assert_eq!(machine.ask(&numbered(4, "G1 X4")), refusal(WRONG_NUMBER, 2));
}

#[test]
fn a_line_received_right_but_refused_by_its_words_counts() {
    let mut machine = reprap();
    let answer = machine.ask(&numbered(1, "G2 X1 Y1 F100"));
    assert_eq!(answer.len(), 2, "{answer:?}");
    assert!(answer[0].starts_with("Error:") && answer[0].ends_with("(error:35)"));
    let answer = machine.ask(&numbered(2, "G150 X1"));
    assert_eq!(answer, ["echo:Unknown command: \"G150 X1\"", "ok"]);
    send_numbered(&mut machine, 3, &["G1 X1 F6000"]);
}

#[test]
fn a_line_that_is_too_long_is_counted_and_refused() {
    let mut machine = reprap();
    let long = format!("G1 X1 {}", "Y1 ".repeat(100));
    let answer = machine.ask(&numbered(1, &long));
    assert_eq!(answer, ["Error:the line is too long (error:11)", "ok"]);
    send_numbered(&mut machine, 2, &["G1 X1 F6000"]);
    assert_eq!(xy(&machine), [STEPS_PER_MM, 0]);
}

#[test]
fn a_megabyte_without_a_line_end_is_one_line_that_is_refused() {
    let reprap: &[&str] = &["Error:the line is too long (error:11)", "ok"];
    for (dialect, refused) in [("780=1", reprap), ("780=2", &["error:11"])] {
        let mut machine = machine_with(&[dialect]);
        for _ in 0..1 << 20 {
            machine.receive(b'X');
            machine.settle();
        }
        assert!(machine.lines().is_empty());
        assert_eq!(machine.ask(""), refused, "{dialect}");
        assert_eq!(machine.ask("G1 X1 F6000"), ["ok"], "{dialect}");
        assert_eq!(machine.lost(), 0, "{dialect}");
        assert_eq!(xy(&machine), [STEPS_PER_MM, 0], "{dialect}");
    }
}

/// Every variant of a line with a flipped bit, a byte less or a byte more.
fn damaged(line: &[u8]) -> Vec<Vec<u8>> {
    let mut all = Vec::new();
    for index in 0..line.len() {
        for bit in 0..8 {
            let mut one = line.to_vec();
            one[index] ^= 1 << bit;
            all.push(one);
        }
        let mut one = line.to_vec();
        one.remove(index);
        all.push(one);
        let mut one = line.to_vec();
        one.insert(index, line[index]);
        all.push(one);
    }
    all
}

proptest! {
    #![proptest_config(cases(100))]

    #[test]
    fn every_number_but_the_next_is_asked_for(
        last in -1..=MAX_NUMBER - 1,
        distance in -3_i64..=3,
        far in any::<i32>(),
    ) {
        let mut raw: RawLine = RawLine::new();
        for number in [i64::from(last) + 1 + distance, far.into()] {
            let line = format!("N{number} G1 X1");
            let sum = line.bytes().fold(0, |sum, byte| sum ^ byte);
            raw.clear();
            for byte in format!("{line}*{sum}").bytes() {
                raw.push(byte);
            }
            let verdict = raw.verdict(last, true);
            let is_number = (-1..=i64::from(MAX_NUMBER)).contains(&number);
            prop_assert_eq!(verdict, match number - i64::from(last) {
                1 => Verdict::Execute(Some(last + 1)),
                _ if is_number => Verdict::Refuse(FailedCheck::Number),
                _ => Verdict::Refuse(FailedCheck::Checksum),
            });
        }
    }
}

proptest! {
    #![proptest_config(cases(1000))]

    #[test]
    fn no_damage_to_a_line_is_executed(
        number in 1..100_000,
        words in "G1 [XYZ]-?[0-9]{1,3}(\\.[0-9]{1,3})?( [XYE][0-9]{1,2})?|M117 [ -~]{0,20}|[GMT][0-9]{1,3}( [A-Z][0-9]{0,3}){0,3}",
    ) {
        let line = numbered(number, &words);
        let mut raw: RawLine = RawLine::new();
        let mut judge = |line: &[u8]| {
            raw.clear();
            for byte in line {
                raw.push(*byte);
            }
            raw.verdict(number - 1, true)
        };
        let verdict = judge(line.as_bytes());
        prop_assume!(verdict == Verdict::Execute(Some(number)));
        for damaged in damaged(line.as_bytes()) {
            // A byte that has become a line end makes two lines, each damaged.
            for part in damaged.split(|byte| matches!(byte, b'\n' | b'\r')) {
                let verdict = judge(part);
                let is_harmless = matches!(verdict, Verdict::Refuse(_) | Verdict::Blank);
                prop_assert!(is_harmless, "{:?} of {line}: {verdict:?}", String::from_utf8_lossy(part));
            }
        }
    }
}

#[test]
fn grbls_words_may_have_checked_lines() {
    let mut machine = machine_with(&["780=2"]);
    assert_eq!(machine.ask("G21"), ["ok"]);
    assert_eq!(machine.ask(""), ["ok"]);
    assert_eq!(machine.ask(&numbered(1, "G1 X1 F6000")), ["ok"]);
    assert_eq!(machine.ask("N7 G1 X2"), ["ok"]);
    assert_eq!(machine.ask("N2 G1 X3*1"), ["[MSG:Resend: 2]", "error:200"]);
    assert_eq!(machine.ask("G1 X3*1"), ["[MSG:Resend: 2]", "error:200"]);
    assert_eq!(
        machine.ask("N2 G1 X3*12345"),
        ["[MSG:Resend: 2]", "error:200"]
    );
    assert_eq!(
        machine.ask("N99999999999 G1 X3*1"),
        ["[MSG:Resend: 2]", "error:200"]
    );
    assert_eq!(machine.ask("G1 X\"3"), ["error:2"]);
    let gap = numbered(3, "G1 X3");
    assert_eq!(machine.ask(&gap), ["[MSG:Resend: 2]", "error:201"]);
    assert_eq!(machine.ask("M110 N2"), ["ok"]);
    assert_eq!(machine.ask(&gap), ["ok"]);
    assert_eq!(machine.ask("G150"), ["error:20"]);
    assert_eq!(xy(&machine), [3 * STEPS_PER_MM, 0]);
    assert_eq!(machine.report().state, "Idle");
}

#[test]
fn a_file_runs_as_numbered_lines_do() {
    let program = [
        "G21 ; mm",
        "G0 X10 Y5 F3000",
        "",
        "(a comment)",
        "G2 X20 Y5 I5 J0 E3",
        "M106 S255",
        "G1 X0 Y0 F1200 E7 ;back",
        "G4 P100",
        "G91",
        "X1 Y1",
    ];
    let hash = |lines: &[String]| {
        let mut machine = reprap();
        for line in lines {
            let answer = machine.ask(line);
            let is_answered = answer.last().is_none_or(|last| last == "ok");
            let is_refused = answer.iter().any(|line| line.starts_with("Error"));
            assert!(is_answered && !is_refused, "{line}: {answer:?}");
        }
        assert!(statistics(&machine.edges).events > 1000);
        statistics(&machine.edges).hash
    };
    let plain: Vec<String> = program.map(str::to_owned).to_vec();
    // Senders leave comments out.
    let words = program.iter().filter_map(|line| line.split(';').next());
    let words = words.filter(|line| !line.is_empty());
    let checked: Vec<String> = (1..)
        .zip(words)
        .map(|(n, line)| numbered(n, line))
        .collect();
    assert_eq!(hash(&plain), hash(&checked));
}

#[test]
fn without_the_dialect_an_asterisk_is_an_error_as_before() {
    let mut machine = machine_with(&[]);
    assert_eq!(machine.ask(&numbered(1, "G1 X1 F6000")), ["error:1"]);
    assert_eq!(machine.ask("$780=1"), ["ok"]);
    assert_eq!(machine.ask(&numbered(1, "G1 X1 F6000")), ["ok"]);
    assert_eq!(machine.ask("$780=0"), ["ok"]);
    assert_eq!(machine.ask("M105"), ["error:20"]);
}

#[test]
fn a_line_that_has_lost_bytes_is_not_executed_where_its_checksum_is_right_all_the_same() {
    for dialect in ["780=1", "780=2"] {
        let mut machine = machine_with(&[dialect]);
        let line = numbered(1, "G1 X1005 F500");
        // Two equal bytes change nothing of an exclusive or.
        let (before, after) = line.split_once("00").unwrap();
        machine.send(before);
        machine.receive_damaged();
        machine.send(after);
        let answer = machine.ask("");
        assert!(
            answer.iter().any(|line| line.contains("Resend: 1")),
            "{answer:?}"
        );
        assert_eq!(xy(&machine), [0, 0]);
        assert_eq!(machine.ask(&numbered(1, "G1 X2 F500")), ["ok"]);
        assert_eq!(xy(&machine), [2 * STEPS_PER_MM, 0]);
    }
}
