//! How long the motion lasts that waits behind the block in execution, `$797`: a sender is not left without an answer.

use leadscrew::{model::State, units::TICKS_PER_MS};

use crate::support::Machine;

const MS: u64 = TICKS_PER_MS as u64;
const FAST: [&str; 4] = ["110=6000", "111=6000", "120=500", "121=500"];
/// A line of motion that lasts a second at its feed.
const SECOND: &str = "G1X1F60\n";

fn machine(assignments: &[&str]) -> Machine {
    let mut machine = Machine::new(&[&FAST, assignments].concat());
    machine.send_for("G91\n", 20);
    machine.take_received();
    machine
}

fn answers(machine: &Machine) -> usize {
    machine.received.matches("ok\r\n").count()
}

/// Sends a line when the one before has been answered, and returns how long its answer took, ms.
fn ask_ms(machine: &mut Machine, line: &str) -> u64 {
    let (start, before) = (machine.now(), answers(machine));
    machine.send(line);
    machine.run_until(|machine| answers(machine) > before);
    (machine.now() - start) / MS
}

/// Returns the longest time to an answer of a job, ms.
fn longest_wait_ms(machine: &mut Machine, lines: &[&str]) -> u64 {
    let waits = lines.iter().map(|line| ask_ms(machine, line));
    waits.max().unwrap_or_default()
}

#[test]
fn what_waits_for_standstill_behind_long_moves_is_answered_in_time() {
    for last in ["M3S100\n", "M8\n", "G4P.01\n", "M5\n"] {
        let lines = [&["M4S100\n"], &[SECOND; 40][..], &[last]].concat();
        let waited_ms = longest_wait_ms(&mut machine(&[]), &lines);
        assert!(
            (5_000..7_500).contains(&waited_ms),
            "{last}: {waited_ms} ms"
        );
    }
    let lines = [&["M4S100\n"], &[SECOND; 40][..], &["M5\n"]].concat();
    let waited_ms = longest_wait_ms(&mut machine(&["797=0"]), &lines);
    assert!(waited_ms > 30_000, "without a bound: {waited_ms} ms");
}

#[test]
fn every_kind_of_motion_counts() {
    for (first, line, what) in [
        ("", "G2X2Y0I1F180\n", "arcs"),
        ("", "G64P.01G1X.5Y.3F30\nX.5Y-.3\n", "blended moves"),
        ("", "G93G1X1F60\n", "inverse time"),
        ("", "G81G99X1Z-1R0F60\nG80\n", "cycles"),
        ("G41.1D1G1X1F60\n", SECOND, "compensated moves"),
    ] {
        let mut machine = machine(&[]);
        machine.send(first);
        for _ in 0..60 {
            machine.send(line);
        }
        machine.run(4_000);
        let queued = 128 - usize::from(machine.snapshot().blocks_free);
        assert!((2..24).contains(&queued), "{what}: {queued} blocks");
        assert!(
            !machine.received.contains("error"),
            "{what}: {}",
            machine.received
        );
    }
}

#[test]
fn short_moves_fill_the_look_ahead() {
    let mut machine = machine(&[]);
    for _ in 0..400 {
        machine.send("G1X.05F3000\n");
    }
    machine.run_until(|machine| machine.snapshot().blocks_free == 0);
}

#[test]
fn a_long_move_always_knows_the_next_one() {
    let mut machine = machine(&[]);
    machine.send("G1X20F60\nG1X20\nG1X20\nG1X20\n");
    machine.run(2_000);
    assert_eq!(machine.snapshot().blocks_free, 126);
    assert_eq!(answers(&machine), 2);
    // The next comes as soon as the first is over.
    machine.run(19_000);
    assert_eq!(machine.snapshot().blocks_free, 126);
    assert_eq!(answers(&machine), 3);
}

/// How long a job takes of which each line is sent when the one before has been answered, ms: with a bound of a second,
/// and without one.
fn bounded_and_unbounded_ms(assignments: &[&str], overrides: &[u8], job: &str) -> [u64; 2] {
    ["797=1", "797=0"].map(|bound| {
        let mut machine = machine(&[assignments, &[bound]].concat());
        machine.send_for(overrides, 100);
        for line in job.split_inclusive('\n') {
            ask_ms(&mut machine, line);
        }
        machine.run_to_standstill();
        machine.now() / MS
    })
}

#[test]
fn a_machine_that_brakes_for_longer_than_the_bound_does_not_become_slower() {
    // Ten seconds from 100 mm/s to standstill.
    let slow = [
        "100=40", "101=40", "102=40", "112=6000", "120=10", "121=10", "122=10",
    ];
    let jerk = ["800=10", "801=10", "802=10"];
    for (limits, overrides, lines, what) in [
        (&[][..], &b""[..], "G1X20F6000\n", "lines"),
        (&[], &[0x91; 10], "G1X20Z8F3000\n", "lines at 200 %"),
        (&jerk, &[0x91; 10], "G1X20Z8F3000\n", "limits of jerk"),
        (&[], b"", "G64P.1G1X20F6000\nX20Y.1\n", "blended moves"),
    ] {
        let assignments = [&slow[..], limits].concat();
        let [bounded, unbounded] =
            bounded_and_unbounded_ms(&assignments, overrides, &lines.repeat(90));
        assert!(
            bounded <= unbounded,
            "{what}: {bounded} ms instead of {unbounded} ms"
        );
    }
}

#[test]
fn a_job_of_fast_and_slow_moves_takes_no_longer_with_a_bound() {
    let job = "G1X20F6000\nG1X.1\nG1X.1\nG1X20F100\nG1Y5F600\nG0X-30\n".repeat(4);
    let [bounded, unbounded] = bounded_and_unbounded_ms(&[], b"", &job);
    assert!(
        bounded <= unbounded,
        "{bounded} ms instead of {unbounded} ms"
    );
}

#[test]
fn the_feed_override_counts() {
    let mut machine = machine(&[]);
    // 100 % less 90 %.
    machine.send_for([0x92; 9], 100);
    for _ in 0..40 {
        machine.send(SECOND);
    }
    machine.run(1_000);
    assert_eq!(machine.snapshot().overrides.feed, 10);
    assert_eq!(machine.snapshot().blocks_free, 126);
}

#[test]
fn a_spindle_speed_that_changes_with_the_moves_does_not_end_the_bound() {
    let mut machine = machine(&["30=1000"]);
    machine.send_for("M3S100\n", 100);
    for number in 1..40 {
        machine.send(format!("G1X1F60S{}\n", 100 + number));
    }
    machine.run(3_500);
    let queued = 128 - machine.snapshot().blocks_free;
    assert!((5..8).contains(&queued), "{queued} blocks");
}

#[test]
fn jogs_do_not_wait_for_their_time_and_are_all_cancelled() {
    let mut machine = machine(&[]);
    for _ in 0..6 {
        machine.send("$J=G91X10F60\n");
    }
    machine.run(500);
    assert_eq!(answers(&machine), 6);
    machine.send_for(b"\x85", 1_000);
    assert_eq!(machine.state(), State::Idle);
    let steps = machine.snapshot().steps;
    machine.run(2_000);
    assert_eq!(machine.snapshot().steps, steps);
}

#[test]
fn a_reset_ends_the_wait() {
    let mut machine = machine(&[]);
    for _ in 0..30 {
        machine.send(SECOND);
    }
    machine.run(2_000);
    machine.send_for(b"\x18", 1_000);
    machine.send_for("$X\nG91\n", 100);
    let waited_ms = ask_ms(&mut machine, SECOND);
    assert!(waited_ms < 100, "{waited_ms} ms");
}
