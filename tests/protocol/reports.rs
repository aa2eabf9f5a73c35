//! Reports and `$` statements, in Grbl's words.

use leadscrew::{
    model::{State, WorkCoordinates},
    path::Work,
    settings::Setting,
};

use super::{
    bench::{Bench, WELCOME, answers},
    support::fields_after_speeds,
};

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
        fields_after_speeds(&bench.report())
    };
    for (line, expected) in [
        ("", "WCO:0.000,0.000,0.000"),
        ("", "Ov:100,100,100"),
        ("G54", ""),
        ("G55", "WCO:0.000,0.000,0.000"),
        ("G92X5", "WCO:-5.000,0.000,0.000"),
        ("", ""),
        ("G92.1", "WCO:0.000,0.000,0.000"),
        ("G43.1Z1", "WCO:0.000,0.000,1.000"),
        ("G49", "WCO:0.000,0.000,0.000"),
        ("G10L2P2X3", "WCO:3.000,0.000,0.000"),
        ("M8", "Ov:100,100,100|A:F"),
        ("", ""),
        ("M9", "Ov:100,100,100"),
        ("M4S100", "Ov:100,100,100|A:C"),
        ("M3", "Ov:100,100,100|A:S"),
        ("$13=0", "WCO:3.000,0.000,0.000"),
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
        ["<Idle|MPos:0.3937,0.0000,0.0000|FS:19.7,1000|WCO:0.1969,-0.2362,0.0000>"]
    );
    assert_eq!(bench.ask("F254")[0], "ok");
    assert_eq!(
        bench.ask("$G")[0],
        "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F10.0 S0]"
    );
    assert!(bench.ask("$#").ends_with(&[
        "[TLO:0.0000]".into(),
        "[PRB:0.0000,0.0000,0.0000:0]".into(),
        "ok".into()
    ]));
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
        [
            "[VER:1.1h.20190830:]",
            "[OPT:VMPH+,128,1023]",
            "[MSG:Step rate: 30000 Hz, unproven]",
            "ok"
        ]
    );
    let mut extended = bench.ask("$I+");
    assert_eq!(extended.remove(3), "[NEWOPT:TC]");
    assert_eq!(extended.remove(3), "[MSG:Last reset: power]");
    let faults = "[MSG:Late events: 0, lost bytes: 0]";
    assert_eq!(extended.remove(3), faults);
    assert_eq!(extended, bench.ask("$I"));
    assert_eq!(bench.ask("$n"), ["$N0=", "$N1=", "ok"]);
    let axes = ["0.000"; 3].join(",");
    let of_grbl = &WorkCoordinates::ALL[..WorkCoordinates::FIRST_BEYOND_GRBL.index()];
    let systems: Vec<_> = of_grbl.iter().map(|system| system.word()).collect();
    let mut expected: Vec<_> = systems
        .iter()
        .chain(&["G28", "G30", "G92"])
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
        ("$RST=X", 3),
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
    bench.is_unread = true;
    bench.receive(b"$$\n$#\n?$G\nG33\n");
    bench.settle();
    bench.receive(b"?");
    bench.is_unread = false;
    let lines = bench.serve();
    assert_eq!(answers(&lines), ["ok", "ok", "ok", "error:20"]);
    assert!(lines.iter().any(|line| line.starts_with("<Idle|")));
    let settings = lines.iter().filter(|line| line.starts_with('$')).count();
    assert_eq!(settings, Setting::all().filter(Setting::is_of_grbl).count());
}

#[test]
fn under_rotation_every_report_shows_the_offset_of_its_place() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("G10 L2 P1 X10 R90"), ["ok"]);
    for (steps, expected) in [
        (
            [0, 0],
            "<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,-10.000,0.000>",
        ),
        (
            [2500, 0],
            "<Idle|MPos:10.000,0.000,0.000|FS:0,0|WCO:10.000,0.000,0.000|Ov:100,100,100>",
        ),
        (
            [2500, 500],
            "<Idle|MPos:10.000,2.000,0.000|FS:0,0|WCO:8.000,2.000,0.000>",
        ),
    ] {
        bench.machine.steps.0[..2].copy_from_slice(&steps);
        assert_eq!(bench.answer("?"), [expected]);
    }
    assert_eq!(bench.ask("G10 L2 P1 R0"), ["ok"]);
    assert_eq!(bench.answer("?").len(), 1);
    assert_eq!(bench.answer("?"), ["<Idle|MPos:10.000,2.000,0.000|FS:0,0>"]);
}

#[test]
fn rotations_and_systems_that_grbl_lacks_are_listed_where_they_are_set() {
    let mut bench = Bench::new();
    let before = bench.ask("$#").len();
    for line in ["G10 L2 P2 X1 R30", "G10 L2 P8 Y-2 R-0.125", "G43.1 X1 Z2"] {
        assert_eq!(bench.ask(line), ["ok"]);
    }
    let listed = bench.ask("$#");
    assert_eq!(listed.len(), before + 1);
    assert_eq!(listed[1], "[G55:1.000,0.000,0.000:30.00]");
    assert_eq!(listed[9], "[TLO:1.000,0.000,2.000]");
    assert_eq!(listed[11], "[G59.2:0.000,-2.000,0.000:-0.13]");
}

#[test]
fn absolute_centres_are_shown_as_a_mode() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("G90.1 G59.3"), ["ok"]);
    assert_eq!(
        bench.ask("$G"),
        ["[GC:G0 G59.3 G17 G21 G90 G94 G90.1 M5 M9 T0 F0 S0]", "ok"]
    );
}

#[test]
fn five_lines_return_to_the_start_from_any_offsets() {
    for before in [
        &[
            "G10 L2 P4 X5 Y6 R30",
            "G57",
            "G92 X1 Y2",
            "G43.1 Z3",
            "G20",
            "G91",
            "G1 X1 Y1 F50",
        ][..],
        &["G10 L2 P1 X7 R-45", "G80", "G43.1 X1 Z3", "G92 X9"],
    ] {
        let mut bench = Bench::new();
        for line in before {
            assert_eq!(bench.ask(line), ["ok"], "{line}");
        }
        for line in [
            "G53 G0 X0 Y0 Z0",
            "G92.1",
            "G54",
            "G10 L2 P1 X0 Y0 Z0 R0",
            "G49",
        ] {
            assert_eq!(bench.ask(line), ["ok"], "{line} after {before:?}");
        }
        bench.machine.steps.0.fill(0);
        let report = bench.answer("?");
        assert_eq!(
            report,
            ["<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>"]
        );
        let zero = ":0.000,0.000,0.000]";
        let listed = bench.ask("$#");
        let of_g57 = "[G57:5.000,6.000,0.000:30.00]";
        for line in &listed[..9] {
            assert!(line.ends_with(zero) || line == of_g57, "{line}");
        }
        assert_eq!(listed[9], "[TLO:0.000]");
        let work = bench.session.interpreter();
        assert_eq!(work.position(), leadscrew::axis::Axes::default());
    }
}
