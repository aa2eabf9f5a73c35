//! What a host is told while nothing comes: busy, wait, and lines without an end.

use crate::machine::{STEPS_PER_MM, numbered, reprap, reprap_with, send_numbered, xy};

#[test]
fn a_lost_line_end_is_asked_for_after_a_second() {
    let mut machine = reprap();
    send_numbered(&mut machine, 1, &["G1 X1 F6000"]);
    let line = numbered(2, "G1 X2");
    machine.send_for(line, 900);
    assert!(machine.lines().is_empty());
    machine.run(300);
    let asked = [
        "Error:No Checksum with line number, Last Line: 1",
        "Resend: 2",
        "ok",
    ];
    assert_eq!(machine.lines(), asked);
    send_numbered(&mut machine, 2, &["G1 X2"]);
    assert_eq!(xy(&machine), [2 * STEPS_PER_MM, 0]);
    // What is typed by hand may take its time.
    machine.send_for(b"G1 X", 5000);
    let lines = machine.lines();
    assert!(lines.is_empty(), "{lines:?}");
}

#[test]
fn wait_is_reported_each_second_of_a_job_that_has_nothing_left_to_do() {
    let mut machine = reprap();
    machine.ask("G1 X1 F6000");
    machine.run(5000);
    assert!(machine.lines().is_empty());
    send_numbered(&mut machine, 1, &["G1 X2"]);
    machine.run(3500);
    let lines = machine.lines();
    assert_eq!(lines, ["wait"; 3]);
}

#[test]
fn busy_is_reported_while_a_line_waits_for_its_ok() {
    let mut machine = reprap_with(&["782=1"]);
    machine.send_for(b"G1 X50 F600\nM400\n", 4500);
    let lines = machine.lines();
    assert_eq!(lines.iter().filter(|line| *line == "ok").count(), 1);
    assert_eq!(
        lines
            .iter()
            .filter(|line| *line == "echo:busy: processing")
            .count(),
        4
    );
    machine.run_to_standstill();
    machine.lines();
    assert_eq!(machine.ask("M113 S0"), ["ok"]);
    machine.send_for(b"G1 X0 F600\nM400\n", 4500);
    assert_eq!(machine.lines(), ["ok"]);
}
