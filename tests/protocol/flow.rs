//! Answers: when they come, when they are withheld, what a reset does.

use leadscrew::{model::State, protocol::Progress, settings::Settings};

use super::bench::{Bench, UNLOCK, WELCOME, answers};

#[test]
fn each_line_end_gets_one_answer() {
    let mut bench = Bench::new();
    assert_eq!(bench.answer("G0G1\r\n"), ["error:24", "ok"]);
    assert_eq!(bench.answer("\n"), ["ok"]);
    assert_eq!(bench.answer("\r\r\n"), ["ok", "ok", "ok"]);
    assert_eq!(bench.answer("  (c) ;d\n"), ["ok"]);
    assert_eq!(
        bench.answer("G0X1\nG33\n\n;x\nG1X2\nG1X2F100\n"),
        ["ok", "error:20", "ok", "ok", "error:22", "ok"]
    );
}

#[test]
fn a_line_without_its_end_is_not_answered() {
    let mut bench = Bench::new();
    assert!(bench.answer("G0 X1").is_empty());
    assert_eq!(bench.answer("\n"), ["ok"]);
}

#[test]
fn a_line_too_long_is_refused_as_a_whole() {
    let mut bench = Bench::new();
    let line = format!("G0X1.{}", "0".repeat(10_000));
    assert_eq!(bench.ask(&line), ["error:11"]);
    assert!(bench.done.is_empty());
    assert_eq!(bench.ask(&format!("({})G0Y1", "c".repeat(10_000))), ["ok"]);
    assert_eq!(bench.done.len(), 1);
}

#[test]
fn ok_is_withheld_while_there_is_no_room_for_blocks() {
    let mut bench = Bench::new();
    bench.withholds = true;
    bench.machine.state = State::Run;
    bench.receive(b"G1X1F100\nX2\nX3\nX4\nX5\n");
    // Room for three in a queue of four.
    assert_eq!(bench.serve(), ["ok", "ok", "ok"]);
    assert!(bench.serve().is_empty());
    bench.withholds = false;
    assert_eq!(bench.serve(), ["ok", "ok"]);
    assert_eq!(bench.done.len(), 5);
}

#[test]
fn no_line_is_begun_in_a_feed_hold() {
    let mut bench = Bench::new();
    assert!(bench.answer("!$G\n$#\n$X\nG0X0\n").is_empty());
    assert_eq!(
        bench.answer("?"),
        ["<Hold:0|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>"]
    );
    let lines = bench.answer("~");
    assert_eq!(lines[0], "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]");
    assert_eq!(answers(&lines).len(), 4);
}

#[test]
fn a_line_that_changes_offsets_waits_for_the_moves_before_it() {
    let mut bench = Bench::new();
    bench.withholds = true;
    assert_eq!(bench.ask("G1X5F600"), ["ok"]);
    bench.machine.is_at_rest = false;
    assert!(bench.ask("G10L2P1X1").is_empty());
    bench.withholds = false;
    assert!(bench.serve().is_empty());
    bench.machine.is_at_rest = true;
    assert_eq!(bench.serve(), ["ok"]);
}

#[test]
fn a_jog_that_waits_for_room_when_jogging_is_cancelled_is_void() {
    let mut bench = Bench::new();
    bench.withholds = true;
    for line in ["$J=X1F600", "$J=X2F600", "$J=X3F600"] {
        assert_eq!(bench.ask(line), ["ok"]);
    }
    bench.machine.state = State::Jog;
    bench.machine.is_at_rest = false;
    assert!(bench.ask("$J=X99F600").is_empty());
    // The machine has cancelled, and come to rest, before the session looks again.
    bench.machine.cancelled_motions = 1;
    bench.machine.state = State::Idle;
    bench.machine.is_at_rest = true;
    bench.machine.steps[0] = 100;
    bench.withholds = false;
    assert_eq!(bench.serve(), ["ok"]);
    assert!(bench.done.is_empty(), "{:?}", bench.done);
    assert_eq!(bench.ask("$J=G91X1F600"), ["ok"]);
    assert_eq!(bench.machine.steps[0], 350);
}

#[test]
fn a_dwell_and_a_program_end_are_answered_when_they_are_done() {
    let mut bench = Bench::new();
    bench.withholds = true;
    assert!(bench.ask("G4P1").is_empty());
    bench.withholds = false;
    assert_eq!(bench.serve(), ["ok"]);
    assert_eq!(bench.ask("M3S100"), ["ok"]);
    bench.withholds = true;
    assert!(bench.ask("M30").is_empty());
    bench.withholds = false;
    assert_eq!(bench.serve(), ["[MSG:Pgm End]", "ok"]);
}

#[test]
fn a_program_pause_is_answered_at_cycle_start() {
    let mut bench = Bench::new();
    assert!(bench.ask("M0").is_empty());
    assert_eq!(bench.machine.state, State::HoldComplete);
    assert_eq!(bench.answer("~"), ["ok"]);
}

#[test]
fn a_reset_in_motion_raises_alarm_3_and_locks() {
    let mut bench = Bench::new();
    bench.withholds = true;
    assert_eq!(bench.ask("G1X5F600"), ["ok"]);
    bench.machine.state = State::Run;
    bench.machine.is_at_rest = false;
    bench.receive(b"G1X9\nG1X\x18G1X7\nG1");
    assert_eq!(bench.serve(), ["ALARM:3", WELCOME[0], WELCOME[1], UNLOCK]);
    bench.withholds = false;
    assert_eq!(bench.ask("G0X1"), ["error:9"]);
    assert_eq!(bench.ask(""), ["ok"]);
    assert_eq!(bench.ask("$X"), ["[MSG:Caution: Unlocked]", "ok"]);
    assert_eq!(bench.ask("G0X1"), ["ok"]);
    assert_eq!(bench.done.len(), 2, "unlocking and the last move");
}

#[test]
fn an_underrun_is_reported_and_only_a_reset_ends_it() {
    let mut bench = Bench::new();
    bench.withholds = true;
    assert_eq!(bench.ask("G1X5F600"), ["ok"]);
    bench.machine.state = State::Alarm;
    bench.machine.has_underrun = true;
    let messages = ["ALARM:3", "[MSG:Reset to continue]"];
    assert_eq!(bench.ask("G1X9"), messages);
    assert_eq!(bench.ask("$X"), [""; 0]);
    assert_eq!(bench.report().state, "Alarm");
    bench.machine.has_underrun = false;
    assert_eq!(bench.answer("\x18"), [WELCOME[0], WELCOME[1], UNLOCK]);
    bench.withholds = false;
    assert_eq!(bench.ask("$X"), ["[MSG:Caution: Unlocked]", "ok"]);
    assert_eq!(bench.ask("G0X1"), ["ok"]);
}

#[test]
fn a_reset_at_rest_only_welcomes() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("G91"), ["ok"]);
    assert_eq!(bench.answer("\x18"), WELCOME);
    assert_eq!(bench.answer("!"), [""; 0]);
    assert_eq!(bench.answer("\x18"), WELCOME);
    assert_eq!(bench.ask("$X"), ["ok"]);
    assert_eq!(
        bench.ask("$G")[0],
        "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]"
    );
}

#[test]
fn nothing_is_sent_before_the_machine_has_acted_on_a_reset() {
    let mut bench = Bench::new();
    let session_only = |bench: &mut Bench| {
        let (mut sent, _) = bench.sent.split();
        let (_, mut received) = bench.received.split();
        let (mut entries, _) = bench.entries.split();
        bench.session.run(
            &bench.machine,
            &bench.requests,
            &mut received,
            &mut sent,
            &mut entries,
        )
    };
    bench.receive(b"\x18$G\n?");
    assert_eq!(session_only(&mut bench), Progress::Waiting);
    assert!(bench.sent.is_empty());
    let lines = bench.serve();
    assert_eq!(lines[..2], WELCOME);
    // The report that was asked for follows; the line sent before the welcome is lost.
    assert!(lines[2].starts_with("<Idle|"), "{lines:?}");
    assert_eq!(lines.len(), 3);
}

#[test]
fn with_homing_the_machine_starts_locked() {
    let settings = Settings {
        homing: 1,
        ..Settings::default()
    };
    let mut bench = Bench::booting(settings);
    assert_eq!(bench.serve(), [WELCOME[0], WELCOME[1], UNLOCK]);
    assert_eq!(bench.ask("M3"), ["error:9"]);
    assert_eq!(bench.ask("$C"), ["error:8"]);
    assert_eq!(bench.ask("$0=10"), ["ok"]);
    assert_eq!(bench.ask("$I")[0], "[VER:1.1h.20190830:]");
    assert_eq!(bench.ask("$H1"), ["error:3"]);
    assert_eq!(bench.ask("$X"), ["[MSG:Caution: Unlocked]", "ok"]);
    assert_eq!(bench.ask("M3"), ["ok"]);
}

#[test]
fn the_position_after_a_reset_is_where_the_machine_has_stopped() {
    let mut bench = Bench::new();
    bench.machine.steps.0[0] = 625;
    assert_eq!(bench.answer("\x18"), WELCOME);
    assert_eq!(bench.ask("G28.1"), ["ok"]);
    assert!(bench.ask("$#").contains(&"[G28:2.500,0.000,0.000]".into()));
    // Another resolution makes another position of the same steps.
    assert_eq!(bench.ask("$100=500"), ["ok"]);
    assert_eq!(bench.ask("G28.1"), ["ok"]);
    assert!(bench.ask("$#").contains(&"[G28:1.250,0.000,0.000]".into()));
}

#[test]
fn a_startup_line_with_a_motion_is_answered_when_it_is_over() {
    let mut bench = Bench::new();
    bench.withholds = true;
    assert!(bench.ask("$N0=G0X5").is_empty());
    bench.withholds = false;
    assert_eq!(bench.serve(), ["ok"]);
    assert_eq!(bench.ask("$N"), ["$N0=G0X5", "$N1=", "ok"]);
}
