//! What a host is told while nothing comes: busy, wait, and lines without an end.

use crate::host::{Host, STEPS_PER_MM, numbered};

#[test]
fn a_lost_line_end_is_asked_for_after_a_second() {
    let mut host = Host::new();
    host.run(1, &["G1 X1 F6000"]);
    let line = numbered(2, "G1 X2");
    host.receive(line.as_bytes());
    host.run_ms(900);
    assert!(host.lines().is_empty());
    host.run_ms(300);
    let asked = [
        "Error:No Checksum with line number, Last Line: 1",
        "Resend: 2",
        "ok",
    ];
    assert_eq!(host.lines(), asked);
    host.run(2, &["G1 X2"]);
    assert_eq!(host.xy(), [2 * STEPS_PER_MM, 0]);
    // What is typed by hand may take its time.
    host.receive(b"G1 X");
    host.run_ms(5000);
    let told = host.lines();
    assert!(told.is_empty(), "{told:?}");
}

#[test]
fn wait_is_told_each_second_of_a_job_that_has_nothing_left_to_do() {
    let mut host = Host::new();
    host.ask("G1 X1 F6000");
    host.run_ms(5000);
    assert!(host.lines().is_empty());
    host.run(1, &["G1 X2"]);
    host.run_ms(3500);
    let told = host.lines();
    assert_eq!(told, ["wait"; 3]);
}

#[test]
fn busy_is_told_while_a_line_waits_for_its_ok() {
    let mut host = Host::with(&["782=1"]);
    host.receive(b"G1 X50 F600\nM400\n");
    host.run_ms(4500);
    let told = host.lines();
    assert_eq!(told.iter().filter(|line| *line == "ok").count(), 1);
    assert_eq!(
        told.iter()
            .filter(|line| *line == "echo:busy: processing")
            .count(),
        4
    );
    host.rest();
    host.lines();
    assert_eq!(host.ask("M113 S0"), ["ok"]);
    host.receive(b"G1 X0 F600\nM400\n");
    host.run_ms(4500);
    assert_eq!(host.lines(), ["ok"]);
}
