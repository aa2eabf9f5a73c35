//! What a program says to its operator: when the machine comes to the line, and without a stop.

use leadscrew::model::State;

use super::bench::Bench;
use crate::support::{Machine, assigned};

fn machine() -> Machine {
    Machine::with(&assigned(
        ["100=80", "110=6000", "120=500"].map(str::to_owned),
    ))
}

/// Sends lines, and returns each message with the place of X then, steps, until all is done.
fn messages(machine: &mut Machine, lines: &[&str]) -> Vec<(String, i32)> {
    machine.send(lines.join("\n") + "\n");
    let mut messages = Vec::new();
    loop {
        let is_over = !machine.advance() && machine.received.is_empty();
        for line in machine.lines() {
            assert!(!line.starts_with("error:"), "{line}");
            if line.starts_with("[MSG:") {
                messages.push((line, machine.physical_steps()[0]));
            }
        }
        match machine.state() {
            State::HoldComplete => machine.send("~"),
            State::Idle if is_over => return messages,
            _ => {}
        }
    }
}

#[test]
fn a_message_comes_when_the_machine_does_to_its_line() {
    let mut machine = machine();
    let reported = messages(
        &mut machine,
        &[
            "G1 X10 F600",
            "(MSG, half way)",
            "G1 X20 (not a message)",
            "G1 X30 ( msg,last)",
            "M0 (change clamps)",
            "G0 X0",
            "M1 (not asked for)",
        ],
    );
    let texts: Vec<_> = reported.iter().map(|it| it.0.as_str()).collect();
    let expected = ["[MSG:half way]", "[MSG:last]", "[MSG:change clamps]"];
    assert_eq!(texts, expected);
    // Within what the segments ahead hold.
    for ((text, steps), place_mm) in reported.iter().zip([10, 20, 30]) {
        assert!((steps - place_mm * 80).abs() <= 8, "{text}: {steps}");
    }
}

#[test]
fn a_message_does_not_stop_the_machine() {
    let moves = ["G1 X10 F6000", "G1 X20", "G1 X30"];
    let with_message = [
        "G1 X10 F6000 (MSG, no stop)",
        "(MSG, nor here)",
        "G1 X20 (MSG, nor here)",
        "G1 X30 (MSG, nor there)",
    ];
    let times = [&moves[..], &with_message[..]].map(|lines| {
        let mut machine = machine();
        messages(&mut machine, lines);
        machine.now()
    });
    assert_eq!(times[0], times[1]);
}

#[test]
fn a_message_waits_for_a_move_that_compensation_holds() {
    let lines = [
        "G41.1 D2",
        "G1 X5 F600",
        "G1 X25",
        "(MSG, at the corner)",
        "G1 Y30",
        "G40",
        "G1 X0",
    ];
    let reported = messages(&mut machine(), &lines);
    let [(text, steps)] = reported.as_slice() else {
        panic!("{reported:?}");
    };
    assert_eq!(text, "[MSG:at the corner]");
    assert!((23 * 80..=27 * 80).contains(steps), "{steps}");
}

#[test]
fn a_line_without_a_number_has_a_message_among_checked_ones() {
    let mut bench = Bench::set(&["780=2"]);
    assert_eq!(bench.ask("(MSG, plain)"), ["[MSG:plain]", "ok"]);
    assert_eq!(bench.ask("(plain)"), ["ok"]);
}

#[test]
fn a_machine_at_rest_and_one_that_only_checks_report_at_once() {
    let mut bench = Bench::new();
    let expected = ["[MSG:hello (2nd]", "ok"];
    assert_eq!(bench.ask("(MSG, hello (2nd )"), expected);
    assert_eq!(bench.ask("G21 (MSG,a) (MSG,b)"), ["[MSG:a]", "ok"]);
    bench.ask("$C");
    assert_eq!(bench.ask("G1 X10 F100 (MSG, b)"), ["[MSG:b]", "ok"]);
    assert_eq!(bench.ask("M0 (c)"), ["[MSG:c]", "ok"]);
    // No message: other comments, and a line that is refused.
    for (line, answer) in [
        ("(hello)", "ok"),
        ("(MSG,)", "ok"),
        ("M0 (MSG, )", "ok"),
        (";(MSG, a)", "ok"),
        ("G1 X5 (a)", "ok"),
        ("G33 (MSG, a)", "error:20"),
        ("$G1 (MSG, a)", "error:3"),
    ] {
        assert_eq!(bench.ask(line), [answer], "{line}");
    }
}

#[test]
fn a_reset_drops_the_message_of_a_line_that_is_not_reached() {
    let mut machine = machine();
    machine.send("G1 X100 F600\n(MSG, never)\n");
    for _ in 0..2000 {
        machine.advance();
    }
    machine.send("!");
    while machine.state() != State::HoldComplete {
        machine.advance();
    }
    let lines = machine.answers_to("\x18");
    assert!(
        !lines.iter().any(|line| line.contains("never")),
        "{lines:?}"
    );
    assert!(
        messages(&mut machine, &["$X", "(MSG, later)"])
            .iter()
            .any(|it| it.0 == "[MSG:later]")
    );
}
