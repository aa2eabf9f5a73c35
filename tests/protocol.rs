//! The conversation with a sender: lines in, answers out, on a machine that does as it is told.

use heapless::spsc::Queue;
use leadscrew::{
    machine::{Snapshot, State},
    planner::{Entry, Work},
    protocol::{
        Progress, Session,
        realtime::{self, Release, Requests},
    },
    settings::Settings,
};
use proptest::prelude::*;

const WELCOME: [&str; 2] = ["", "Grbl 1.1h ['$' for help]"];
const UNLOCK: &str = "[MSG:'$H'|'$X' to unlock]";

/// A session with its queues and a machine that finishes each entry at once, unless it withholds.
struct Bench {
    session: Session,
    requests: Requests,
    received: Queue<u8, 1024>,
    sent: Queue<u8, 512>,
    entries: Queue<Entry, 4>,
    machine: Snapshot,
    /// Waiting for cycle start after `M0`.
    is_paused: bool,
    /// The machine takes no entries: as if all places for blocks were in use.
    withholds: bool,
    /// The sender reads nothing.
    is_deaf: bool,
    output: Vec<u8>,
    done: Vec<Work>,
}

impl Bench {
    /// Switched on, the welcome read.
    fn new() -> Self {
        let mut bench = Self::booting(Settings::default());
        assert_eq!(bench.serve(), WELCOME);
        bench
    }

    fn booting(settings: Settings) -> Self {
        let state = if settings.homing {
            State::Alarm
        } else {
            State::Idle
        };
        Self {
            session: Session::new(settings),
            requests: Requests::new(),
            received: Queue::new(),
            sent: Queue::new(),
            entries: Queue::new(),
            machine: Snapshot {
                state,
                blocks_free: 100,
                is_at_rest: true,
                ..Snapshot::default()
            },
            is_paused: false,
            withholds: false,
            is_deaf: false,
            output: Vec::new(),
            done: Vec::new(),
        }
    }

    /// What `prepare` does.
    fn prepare(&mut self) {
        let machine = &mut self.machine;
        if machine.epoch != self.requests.epoch() {
            machine.epoch = self.requests.epoch();
            machine.reset_in_motion = matches!(machine.state, State::Run | State::HoldSlowing);
            machine.state = match machine.state {
                State::Run | State::HoldSlowing | State::Alarm => State::Alarm,
                State::Idle | State::HoldComplete => State::Idle,
            };
            machine.is_at_rest = true;
            machine.finished = machine
                .finished
                .wrapping_add(u32::from(std::mem::take(&mut self.is_paused)));
        }
        if self.requests.take_hold() && matches!(machine.state, State::Idle | State::Run) {
            machine.state = State::HoldComplete;
        }
        if self.requests.take_start() && machine.state == State::HoldComplete {
            machine.state = State::Idle;
            machine.finished = machine
                .finished
                .wrapping_add(u32::from(std::mem::take(&mut self.is_paused)));
        }
        while machine.state != State::HoldComplete && !self.withholds {
            let Some(entry) = self.entries.dequeue() else {
                break;
            };
            machine.finished = machine.finished.wrapping_add(1);
            if entry.epoch == machine.epoch {
                match entry.work {
                    Work::Unlock => machine.state = State::Idle,
                    Work::Pause => {
                        machine.state = State::HoldComplete;
                        machine.finished = machine.finished.wrapping_sub(1);
                        self.is_paused = true;
                    }
                    _ => {}
                }
                self.done.push(entry.work);
            }
        }
    }

    /// Runs every task until all wait.
    fn settle(&mut self) {
        for _ in 0..100_000 {
            self.prepare();
            let (mut sent, mut read) = self.sent.split();
            let (_, mut received) = self.received.split();
            let (mut entries, _) = self.entries.split();
            let progress = self.session.run(
                &self.machine,
                &self.requests,
                &mut received,
                &mut sent,
                &mut entries,
            );
            let mut has_read = false;
            while !self.is_deaf {
                let Some(byte) = read.dequeue() else { break };
                self.output.push(byte);
                has_read = true;
            }
            let is_held = self.withholds || self.machine.state == State::HoldComplete;
            let has_entries = !self.entries.is_empty() && !is_held;
            if progress == Progress::Waiting && !has_read && !has_entries {
                return;
            }
        }
        panic!("the session never waits");
    }

    /// Hands over bytes, each as the receive interrupt would; false when one found no room.
    fn receive(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if self.received.is_full() {
                self.settle();
            }
            let (mut line, _) = self.received.split();
            if realtime::receive(byte, &self.requests, &mut line) == Release::Report {
                let free = self.received.capacity() - self.received.len();
                let (mut sent, _) = self.sent.split();
                self.session
                    .report(&self.machine, &self.requests, free, &mut sent);
            }
        }
    }

    /// The lines that have been sent since the last call.
    fn serve(&mut self) -> Vec<String> {
        self.settle();
        let text = String::from_utf8(std::mem::take(&mut self.output)).expect("ASCII");
        assert!(text.is_empty() || text.ends_with("\r\n"), "{text:?}");
        let lines = text.strip_suffix("\r\n").unwrap_or(&text);
        if text.is_empty() {
            Vec::new()
        } else {
            lines.split("\r\n").map(String::from).collect()
        }
    }

    /// The answer to bytes.
    fn answer(&mut self, text: &str) -> Vec<String> {
        self.receive(text.as_bytes());
        self.serve()
    }

    /// The answer to one line.
    fn ask(&mut self, line: &str) -> Vec<String> {
        self.answer(&format!("{line}\n"))
    }
}

fn answers(lines: &[String]) -> Vec<&str> {
    lines
        .iter()
        .map(String::as_str)
        .filter(|line| *line == "ok" || line.starts_with("error:"))
        .collect()
}

#[test]
fn each_line_end_gets_one_answer() {
    let mut bench = Bench::new();
    assert_eq!(bench.answer("G0G1\r\n"), ["error:24", "ok"]);
    assert_eq!(bench.answer("\n"), ["ok"]);
    assert_eq!(bench.answer("\r\r\n"), ["ok", "ok", "ok"]);
    assert_eq!(bench.answer("  (c) ;d\n"), ["ok"]);
    assert_eq!(
        bench.answer("G0X1\nG99\n\n;x\nG1X2\nG1X2F100\n"),
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
    // Three places in a queue of four.
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
fn nothing_is_said_before_the_machine_has_acted_on_a_reset() {
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
        homing: true,
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
fn work_offset_and_overrides_come_round_as_in_grbl() {
    let mut bench = Bench::new();
    for (state, offset, overrides) in [(State::Run, 31, 22), (State::Idle, 11, 12)] {
        bench.machine.state = State::Idle;
        assert_eq!(bench.answer("\x18"), WELCOME);
        bench.machine.state = state;
        let reports: Vec<_> = (0..31).map(|_| bench.answer("?").remove(0)).collect();
        let with = |field| -> Vec<usize> {
            let numbered = reports.iter().zip(1..);
            numbered
                .filter_map(|(report, number)| report.contains(field).then_some(number))
                .collect()
        };
        assert_eq!(with("|WCO:")[..2], [1, offset], "{state:?}");
        assert_eq!(with("|Ov:")[..2], [2, overrides], "{state:?}");
    }
}

#[test]
fn a_changed_offset_is_reported_at_once() {
    let mut bench = Bench::new();
    let mut extra = |line: &str| {
        if !line.is_empty() {
            assert_eq!(bench.ask(line), ["ok"], "{line}");
        }
        let report = bench.answer("?").remove(0);
        report.split_once("|FS:0,0").expect("idle").1.to_owned()
    };
    for (line, expected) in [
        ("", "|WCO:0.000,0.000,0.000>"),
        ("", "|Ov:100,100,100>"),
        ("G54", ">"),
        ("G55", "|WCO:0.000,0.000,0.000>"),
        ("G92X5", "|WCO:-5.000,0.000,0.000>"),
        ("", ">"),
        ("G92.1", "|WCO:0.000,0.000,0.000>"),
        ("G43.1Z1", "|WCO:0.000,0.000,1.000>"),
        ("G49", "|WCO:0.000,0.000,0.000>"),
        ("G10L2P2X3", "|WCO:3.000,0.000,0.000>"),
        ("M8", "|Ov:100,100,100|A:F>"),
        ("", ">"),
        ("M9", "|Ov:100,100,100>"),
        ("M4S100", "|Ov:100,100,100|A:C>"),
        ("M3", "|Ov:100,100,100|A:S>"),
    ] {
        assert_eq!(extra(line), expected, "after {line:?}");
    }
}

#[test]
fn the_report_mask_and_the_unit_choose_what_a_report_shows() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("$10=3"), ["ok"]);
    assert_eq!(bench.ask("G10L2P1X5Y-6"), ["ok"]);
    bench.machine.steps.0[0] = 2500;
    assert_eq!(
        bench.answer("?"),
        ["<Idle|MPos:10.000,0.000,0.000|Bf:100,1023|FS:0,0|WCO:5.000,-6.000,0.000>"]
    );
    assert_eq!(bench.ask("$10=0"), ["ok"]);
    assert_eq!(
        bench.answer("?"),
        ["<Idle|WPos:5.000,6.000,0.000|FS:0,0|Ov:100,100,100>"]
    );
    assert_eq!(bench.ask("$10=1"), ["ok"]);
    assert_eq!(bench.ask("$13=1"), ["ok"]);
    bench.machine.feed_mm_min = 500.0;
    bench.machine.spindle_rpm = 999.5;
    assert_eq!(
        bench.answer("?"),
        ["<Idle|MPos:0.3937,0.0000,0.0000|FS:19.7,1000>"]
    );
    assert_eq!(bench.ask("F254")[0], "ok");
    assert_eq!(
        bench.ask("$G")[0],
        "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F10.0 S0]"
    );
    assert_eq!(
        bench.ask("$#")[9..],
        ["[TLO:0.0000]", "[PRB:0.0000,0.0000,0.0000:0]", "ok"]
    );
}

#[test]
fn modes_are_listed_in_grbls_words() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("G1 G91 G20 G18 G55 G93 F1 M4 S100 M8 T3"), ["ok"]);
    assert_eq!(
        bench.ask("$G"),
        ["[GC:G1 G55 G18 G20 G91 G93 M4 M8 T3 F1 S100]", "ok"]
    );
    assert_eq!(bench.ask("G80 G94 G21 G90 G19 G59 M3 M9"), ["ok"]);
    let modes = &bench.ask("$G")[0];
    assert!(
        modes.starts_with("[GC:G80 G59 G19 G21 G90 G94 M3 M9 T3 "),
        "{modes}"
    );
}

#[test]
fn dollar_statements_are_answered_in_grbls_words() {
    let mut bench = Bench::new();
    assert_eq!(
        bench.ask("$"),
        [
            "[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]",
            "ok"
        ]
    );
    assert_eq!(
        bench.ask("$ i"),
        ["[VER:1.1h.20190830:]", "[OPT:V,128,1023]", "ok"]
    );
    assert_eq!(bench.ask("$n"), ["$N0=", "$N1=", "ok"]);
    let axes = ["0.000"; leadscrew::axis::AXES].join(",");
    let mut expected: Vec<_> = [
        "G54", "G55", "G56", "G57", "G58", "G59", "G28", "G30", "G92",
    ]
    .iter()
    .map(|name| format!("[{name}:{axes}]"))
    .collect();
    expected.extend(["[TLO:0.000]".into(), format!("[PRB:{axes}:0]"), "ok".into()]);
    assert_eq!(bench.ask("$#"), expected);
    for (line, number) in [
        ("$H", 5),
        ("$HX", 5),
        ("$L", 2),
        ("$%", 2),
        ("$7=1", 3),
        ("$0=2", 6),
        ("$20=1", 10),
        ("$3=-1", 4),
        ("$100=0", 52),
        ("$C", 3),
        ("$RST=*", 3),
    ] {
        assert_eq!(bench.ask(line), [format!("error:{number}")], "{line}");
    }
    assert_eq!(bench.answer("$?x\n").len(), 2);
}

#[test]
fn settings_are_listed_as_grbl_lists_them() {
    let mut bench = Bench::new();
    let lines = bench.ask("$$");
    let expected = [
        "$0=10",
        "$1=25",
        "$2=0",
        "$3=0",
        "$4=0",
        "$5=0",
        "$6=0",
        "$10=1",
        "$11=0.010",
        "$12=0.002",
        "$13=0",
        "$20=0",
        "$21=0",
        "$22=0",
        "$23=0",
        "$24=25.000",
        "$25=500.000",
        "$26=250",
        "$27=1.000",
        "$30=1000",
        "$31=0",
        "$32=0",
        "$100=250.000",
    ];
    assert_eq!(lines[..23], expected);
    assert_eq!(lines.last().map(String::as_str), Some("ok"));
}

#[test]
fn new_settings_reach_the_machine_before_the_next_line() {
    let mut bench = Bench::new();
    assert_eq!(bench.answer("$110=600\nG0X1\n$$\n")[..2], ["ok", "ok"]);
    assert!(matches!(bench.done[0], Work::Configure(s) if s.max_rate_mm_min.0[0] == 600.0));
    assert_eq!(bench.session.settings().max_rate_mm_min.0[0], 600.0);
}

#[test]
fn a_sender_that_does_not_read_loses_nothing() {
    let mut bench = Bench::new();
    bench.is_deaf = true;
    bench.receive(b"$$\n$#\n?$G\nG99\n");
    bench.settle();
    bench.receive(b"?");
    bench.is_deaf = false;
    let lines = bench.serve();
    assert_eq!(answers(&lines), ["ok", "ok", "ok", "error:20"]);
    assert!(lines.iter().any(|line| line.starts_with("<Idle|")));
    let settings = lines.iter().filter(|line| line.starts_with('$')).count();
    assert_eq!(settings, 22 + 4 * leadscrew::axis::AXES);
}

/// Lines with known answers, to be mixed with anything.
fn known_line() -> impl Strategy<Value = (&'static str, &'static str)> {
    prop::sample::select(vec![
        ("G0X1\n", "ok"),
        ("G1X2F100\n", "ok"),
        ("G99\n", "error:20"),
        ("\n", "ok"),
        ("(comment)\r", "ok"),
        ("$7=1\n", "error:3"),
        ("$1=25\n", "ok"),
        ("$G\n", "ok"),
        ("$#\n", "ok"),
        ("G4P0.01\n", "ok"),
        ("G10L2P1X1\n", "ok"),
        ("M3S10\n", "ok"),
        ("G0G1\n", "error:24"),
        ("X\n", "error:2"),
        ("$0=1\n", "error:6"),
    ])
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    #[test]
    fn one_answer_for_each_line_in_order_whatever_is_mixed_in(
        lines in prop::collection::vec(known_line(), 1..40),
        realtime in prop::collection::vec((0_usize..400, prop::sample::select(vec![b'?', b'~', 0x91, 0x85, 0xc2])), 0..40),
        pauses in prop::collection::vec(0_usize..400, 0..10),
    ) {
        let mut bytes: Vec<u8> = lines.iter().flat_map(|line| line.0.bytes()).collect();
        for &(place, byte) in &realtime {
            bytes.insert(place % (bytes.len() + 1), byte);
        }
        let mut bench = Bench::new();
        let mut output = Vec::new();
        for (index, &byte) in bytes.iter().enumerate() {
            bench.receive(&[byte]);
            if pauses.contains(&index) {
                bench.receive(b"!");
                output.extend(bench.serve());
                bench.receive(b"~");
            }
        }
        output.extend(bench.serve());
        let expected: Vec<_> = lines.iter().map(|line| line.1).collect();
        prop_assert_eq!(answers(&output), expected);
        let reports = output.iter().filter(|line| line.starts_with('<')).count();
        prop_assert!(reports <= realtime.len());
    }

    #[test]
    fn any_bytes_are_answered_once_for_each_line_end(
        bytes in prop::collection::vec(prop_oneof![4 => 0_u8..128, 1 => any::<u8>(), 1 => Just(b'\n')], 0..1500),
    ) {
        let mut bench = Bench::new();
        let bytes: Vec<_> = bytes.into_iter().filter(|b| !matches!(b, 0x18 | b'!' | b'?')).collect();
        let ends = bytes.iter().filter(|b| matches!(b, b'\n' | b'\r')).count();
        bench.receive(&bytes);
        let lines = bench.serve();
        // M0 would wait for cycle start.
        prop_assume!(bench.machine.state == State::Idle);
        prop_assert_eq!(answers(&lines).len(), ends);
    }

    #[test]
    fn resets_anywhere_leave_a_session_that_answers(
        bytes in prop::collection::vec(prop_oneof![8 => 0x20_u8..0x60, 1 => Just(b'\n'), 1 => Just(0x18)], 0..600),
    ) {
        let mut bench = Bench::new();
        bench.receive(&bytes);
        bench.serve();
        bench.receive(b"\x18");
        let lines = bench.serve();
        prop_assert!(lines.ends_with(&[WELCOME[0].into(), WELCOME[1].into()]), "{lines:?}");
        prop_assert_eq!(bench.ask("$X"), ["ok"]);
    }

    #[test]
    fn listed_settings_set_again_are_the_same_settings(
        values in prop::collection::vec((0_usize..40, 0_u32..300, 0_u32..1000), 0..60),
    ) {
        let mut bench = Bench::new();
        let names: Vec<_> = bench.ask("$$").into_iter().filter_map(|line| {
            line.split_once('=').map(|(name, _)| name.to_owned())
        }).collect();
        for (place, whole, thousandths) in values {
            let name = &names[place % names.len()];
            let before = *bench.session.settings();
            let answer = bench.ask(&format!("{name}={whole}.{thousandths:03}"));
            if answer != ["ok"] {
                prop_assert_eq!(*bench.session.settings(), before, "{:?}", answer);
            }
        }
        let listed = bench.ask("$$");
        let mut other = Bench::new();
        // Homing first: soft limits are refused without it.
        let homing = listed.iter().filter(|line| line.starts_with("$22"));
        for line in homing.chain(&listed) {
            if line.starts_with('$') {
                prop_assert_eq!(other.ask(line), ["ok"], "{}", line);
            }
        }
        prop_assert_eq!(other.ask("$$"), listed);
        let (mut stored, shown) = (*bench.session.settings(), *other.session.settings());
        // Spindle speeds are listed without their fraction.
        stored.spindle_max_rpm = shown.spindle_max_rpm;
        stored.spindle_min_rpm = shown.spindle_min_rpm;
        prop_assert_eq!(stored, shown);
    }
}
