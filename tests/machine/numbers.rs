//! Numbers at their ends: what is asked for is done exactly, or refused, and then nothing changes.
//!
//! What is limited on purpose is in docs/gcodes.md.

use leadscrew::{axis::AXES, model::Outputs};

use crate::support::{Machine, on_every_axis};

/// What must be seen after the lines of a row.
#[derive(Debug, Clone, Copy)]
enum Seen {
    /// The last line is answered by this error, and nothing has changed.
    Refused(u8),
    /// A question is answered by a line that begins so, among others.
    Answer(&'static str, &'static str),
    /// Where X, Y and Z stand, steps.
    At([i32; 3]),
    /// The last line takes so many seconds, and its ramps.
    Takes(f64),
    /// The spindle's duty, of 255.
    Duty(u16),
}

use Seen::{Answer, At, Duty, Refused, Takes};

/// Settings besides [`FAST`], lines after `|`, and what is seen.
type Row = (&'static [&'static str], &'static str, Seen);

/// Speed and acceleration of X, so that moves do not take long.
const FAST: [(usize, i32); 2] = [(110, 6000), (120, 500)];

/// Lines of programs.
const PROGRAMS: &[Row] = &[
    // F, mm per minute.
    (&[], "G1 X1 F0", Refused(22)),
    (&[], "F0.000000001", Refused(39)),
    (&[], "F0.999999", Refused(39)),
    (&[], "G1 X1 F.5", Refused(39)),
    (
        &[],
        "F1",
        Answer("$G", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F1 S0]"),
    ),
    (&[], "G1 X0.02 F1", Takes(1.2)),
    (
        &[],
        "F10000000",
        Answer("$G", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F10000000 S0]"),
    ),
    (
        &[],
        "F9999999",
        Answer("$G", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F9999999 S0]"),
    ),
    (&[], "G1 X1 F10000001", Refused(39)),
    (&[], "F100000001", Refused(39)),
    (&[], "F99999999999999999999", Refused(39)),
    (&[], "F-1", Refused(4)),
    // Inches per minute.
    (&[], "G20 F0.0393", Refused(39)),
    (
        &[],
        "G20 F0.0394|G21",
        Answer("$G", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F1 S0]"),
    ),
    (
        &[],
        "G20 F393700|G21",
        Answer("$G", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F9999980 S0]"),
    ),
    (&[], "G20 F393701", Refused(39)),
    // Per minute.
    (&[], "G93 G1 X1 F0", Refused(22)),
    (&[], "G93 G1 X1 F0.00001", Refused(39)),
    (&[], "G93 F0.00001", Refused(39)),
    (&[], "G93 G1 X0.02 F5", Takes(12.0)),
    (&[], "G93 G2 X0.02 R1 F5", Takes(12.0)),
    (&[], "G93 G20 G1 X0.001 F5", Takes(12.0)),
    (&[], "G93 G1 X0.004 F0.5", Takes(120.0)),
    (&[], "G93 G1 X1 F10000000", At([250, 0, 0])),
    (&[], "G93 G1 X1 F10000001", Refused(39)),
    // A jog's.
    (&[], "$J=X1 F0", Refused(22)),
    (&[], "$J=X1 F0.9", Refused(39)),
    (&[], "$J=G20 X1 F0.03", Refused(39)),
    (&[], "$J=X1 F10000001", Refused(39)),
    (&[], "$J=X1 F10000000", At([250, 0, 0])),
    // S.
    (&[], "M3 S0", Duty(0)),
    (&[], "M3 S0.000001", Duty(1)),
    (&[], "M3 S1000", Duty(255)),
    (&[], "M3 S10000000", Duty(255)),
    (
        &[],
        "S10000000",
        Answer("$G", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S10000000]"),
    ),
    (&[], "S10000001", Refused(39)),
    (&[], "M3 S16777217", Refused(39)),
    (&[], "S99999999999999999999", Refused(39)),
    (&[], "S-0.001", Refused(4)),
    (&["30=10000000"], "M3 S5000000", Duty(128)),
    // P of a dwell.
    (&[], "G4 P0", Takes(0.0)),
    (&[], "G4 P0.0004", Takes(0.001)),
    (&[], "G4 P0.000000001", Takes(0.001)),
    (&[], "G4 P0.0016", Takes(0.002)),
    (&[], "G4 P1.234", Takes(1.234)),
    (&[], "G4 P4294968", Refused(39)),
    (&[], "G4 P99999999999999999999", Refused(39)),
    (&[], "G4 P-0.001", Refused(4)),
    (&[], "F100|G82 Z0 R0 P0.0004", Takes(0.001)),
    (&[], "F100|G82 Z-1 R0 P4294968", Refused(39)),
    // P of a work coordinate system, L, R.
    (&[], "G10 L2 P256 X1", Refused(29)),
    (&[], "G10 L2 P257 X1", Refused(29)),
    (&[], "G10 L2 P10 X1", Refused(29)),
    (&[], "G10 L2 P99999999999999999999 X1", Refused(29)),
    (&[], "G10 L2 P1.5 X1", Refused(23)),
    (&[], "G10 L2 P0.5 X1", Refused(23)),
    (&[], "G10 L2 P-1 X1", Refused(4)),
    (&[], "G10 L2 P1. X1", Answer("$#", "[G54:1.000,0.000,0.000")),
    (
        &[],
        "G10 L2 P9 X1",
        Answer("$#", "[G59.3:1.000,0.000,0.000"),
    ),
    (&[], "G10 L258 P1 X1", Refused(20)),
    (&[], "G10 L276 P1 X1", Refused(20)),
    (&[], "G10 L257 P1 Z1", Refused(20)),
    (&[], "G10 L2.5 P1 X1", Refused(23)),
    (&[], "G10 L20.1 P1 X1", Refused(23)),
    (&[], "G10 L1.5 P1 Z1", Refused(23)),
    (&[], "G10 L-2 P1 X1", Refused(20)),
    (&[], "G10 L99999999999999999999 P1 X1", Refused(20)),
    (&[], "G10 L2 P1 R360|G0 X1", At([250, 0, 0])),
    (&[], "G10 L2 P1 R-999999999990|G0 X1", At([0, 250, 0])),
    (&[], "G10 L2 P1 R1000000000000", Refused(39)),
    (&[], "G10 L2 P1 R-99999999999999999999", Refused(39)),
    (
        &[],
        "G10 L2 P1 X2147483",
        Answer("$#", "[G54:2147483.000,0.000,0.000"),
    ),
    (&[], "G10 L2 P1 X2147484", Refused(33)),
    (&[], "G20 G10 L2 P1 X84547", Refused(33)),
    // P of an arc: its turns.
    (&[], "G2 I0.01 P0 F6000", Refused(39)),
    (&[], "G2 I0.01 P65536 F6000", Refused(39)),
    (&[], "G2 I0.01 P1.5 F6000", Refused(23)),
    (&[], "G93 G2 I0.5 P2 F5", Takes(12.0)),
    // P of a probing move: a work coordinate.
    (&[], "F100|G38.3 Z-0.1 P2147484", Refused(33)),
    (&[], "F100|G38.3 Z-0.1 P99999999999999999999", Refused(33)),
    (&[], "F100|G20 G38.3 Z-0.1 P84547", Refused(33)),
    // P and Q of G64, and P of what switches overrides.
    (&[], "G64 P0.0000004", Refused(39)),
    (&[], "G64 P0.1 Q0.0000004", Refused(39)),
    (&[], "G20 G64 P0.00000001", Refused(39)),
    (&[], "G64 P4.29", At([0, 0, 0])),
    (&[], "G64 P4295", Refused(39)),
    (&[], "G64 P1 Q4295", Refused(39)),
    (&[], "G20 G64 P170", Refused(39)),
    (&[], "M50 P-1", Refused(4)),
    // Q: the depth of a peck.
    (&[], "F100|G83 X0 Z-1 R0 Q0", Refused(19)),
    (&[], "F100|G83 X0 Z-1 R0 Q-1", Refused(19)),
    (&[], "F100|G83 X0 Z-1 R0 Q0.000001", Refused(39)),
    (&[], "F100|G73 X0 Z-1 R0 Q0.0000001", Refused(19)),
    (&[], "F100|G83 X0 Z-1 R0 Q0.0039", Refused(39)),
    (&[], "F100|G20 G83 X0 Z-1 R0 Q0.0001", Refused(39)),
    (&[], "F100|G83 X0 Z-0.02 R0 Q0.004", At([0, 0, 0])),
    (
        &[],
        "F6000|G83 X0 Z-1 R0 Q99999999999999999999",
        At([0, 0, 0]),
    ),
    // L: how often a cycle drills.
    (&[], "F100|G81 Z-1 R0 L0", Refused(19)),
    (&[], "F100|G81 Z-1 R0 L0.5", Refused(23)),
    (&[], "F100|G81 Z-1 R0 L256", Refused(39)),
    (&[], "F6000|G91 G81 X0.004 Z-0.004 R0 L255", At([255, 0, 0])),
    // T, H, D, Q of M61: tools.
    (
        &[],
        "T255",
        Answer("$G", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T255 F0 S0]"),
    ),
    (&[], "T256", Refused(38)),
    (&[], "T1.5", Refused(23)),
    (&[], "T255.5", Refused(23)),
    (&[], "T0.000000001", Refused(23)),
    (&[], "T99999999999999999999", Refused(38)),
    (&[], "T-1", Refused(4)),
    (&[], "M61 Q255.5", Refused(23)),
    (&[], "M61 Q256", Refused(38)),
    (&[], "M61 Q255", At([0, 0, 0])),
    (&[], "G43 H0.5", Refused(23)),
    (&[], "G43 H256", Refused(38)),
    (&[], "G43 H-1", Refused(4)),
    (&[], "G41 D0.5", Refused(23)),
    (&[], "G41 D256", Refused(38)),
    (&[], "G41.1 D0.0000004", Refused(39)),
    (&[], "G41.1 D99999999999999999999", Refused(33)),
    (&[], "G10 L1 P256 Z1", Refused(38)),
    (&[], "G10 L1 P255.5 Z1", Refused(23)),
    (&[], "G10 L1 P1 R99999999999999999999", Refused(33)),
    (&[], "$TT2=T2.9 Z1", Refused(39)),
    (&[], "$TT2.5=Z1", Refused(3)),
    (&[], "$TT256=Z1", Refused(38)),
    (&[], "$TT2=Z99999999999999999999", Refused(33)),
    // N.
    (&[], "N10000000 G0 X1", At([250, 0, 0])),
    (&[], "N10000001 G0 X1", Refused(27)),
    (&[], "N100.5 G0 X1", At([250, 0, 0])),
    (&[], "N99999999999999999999 G0 X1", Refused(27)),
    (&[], "N-0.5 G0 X1", Refused(4)),
    // Numbers of codes.
    (&[], "G1.001 X1 F100", Refused(23)),
    (&[], "G0.004 X1", Refused(23)),
    (&[], "G38.201 Z-1 F100", Refused(20)),
    (&[], "G92.1001", Refused(20)),
    (&[], "G59.1000001", Refused(23)),
    (&[], "G61.1001", Refused(20)),
    (&[], "M3.001 S100", Refused(23)),
    (&[], "G1.00 X1 F6000", At([250, 0, 0])),
    (&[], "G256 X1", Refused(23)),
    (&[], "M258", Refused(23)),
    // Coordinates and offsets.
    (&[], "G0 X2147484", Refused(33)),
    (&[], "G0 X-99999999999999999999", Refused(33)),
    (&[], "G20 G0 X-84546.7", Refused(33)),
    (&[], "G91 G0 X1|X2147483.5", Refused(33)),
    (&[], "G92 X-2147483|X1", Refused(33)),
    (&[], "G92 X99999999999999999999", Refused(33)),
    (&[], "G52 X2147484", Refused(33)),
    (&[], "G43.1 Z2147484", Refused(33)),
    (&[], "G0 X0.0000001", At([0, 0, 0])),
    (&["110=12", "100=100000"], "G0 X0.00001", At([1, 0, 0])),
    (&["110=12", "100=100000"], "G0 X5369", Refused(33)),
    // Arcs.
    (&[], "G2 X1 R0 F6000", Refused(34)),
    (&[], "G2 X1 R2147484 F6000", Refused(33)),
    (&[], "G2 X1 R99999999999999999999 F6000", Refused(33)),
    (&[], "G2 X1 R-99999999999999999999 F6000", Refused(33)),
    (&[], "G2 I0.0000004 F6000", Refused(33)),
    (&[], "G2 I99999999999999999999 F6000", Refused(33)),
    (&[], "G2 X0.000002 I0.000001 F6000", At([0, 0, 0])),
    (&[], "G3 X0.008 R0.004 F6000", At([2, 0, 0])),
    (&[], "G3 X1 Y1 R2000000 F6000", At([250, 250, 0])),
    (&[], "G2 I0.004 P65535 F6000", At([0, 0, 0])),
];

/// Lines with an axis that turns: degrees have no inches.
#[cfg(feature = "axes-4")]
const TURNS: &[Row] = &[
    (&[], "G1 A0.02 F1", Takes(1.2)),
    (&[], "G1 A1 F0.9", Refused(39)),
    (&[], "G20 G1 A0.02 F1", Takes(1.2)),
    (&[], "G20 G1 A1 F0.9", Refused(39)),
    (&[], "G20 G38.3 A1 F0.9", Refused(39)),
    (&[], "G20 F0.9|G1 A1", Refused(39)),
    (&[], "G20 F0.9|G1 A0", At([0, 0, 0])),
    (&[], "G20 G1 X0.004 A1 F0.9", At([25, 0, 0])),
    (&[], "$J=G20 A0.02 F1", Takes(1.2)),
    (&[], "$J=G20 A1 F0.9", Refused(39)),
    (&[], "G93 G1 A0.02 F5", Takes(12.0)),
    (&[], "G93 G20 G1 A0.02 F5", Takes(12.0)),
    (&[], "G93 G1 X0.004 A2 F5", Takes(12.0)),
    (&[], "G93 G1 X0.004 A20 F5", Takes(12.0)),
    (&[], "G93 G1 A1 F0.00001", Refused(39)),
    (
        &[],
        "G20 G0 A90|G28.1",
        Answer("$#", "[G28:0.000,0.000,0.000,90.000"),
    ),
    (
        &[],
        "G20 G10 L2 P1 A90",
        Answer("$#", "[G54:0.000,0.000,0.000,90.000"),
    ),
    (&[], "G0 A2147484", Refused(33)),
    (&[], "G92 A-99999999999999999999", Refused(33)),
    (&[], "$133=2147485", Refused(52)),
    (&[], "$133=0", Answer("$$", "$133=0.000")),
    (&[], "$113=0.0009", Refused(52)),
];

#[cfg(feature = "axes-4")]
#[test]
fn what_a_program_asks_of_an_axis_that_turns_is_done_or_refused() {
    check_all(TURNS);
}

/// Settings.
const SETTINGS: &[Row] = &[
    // Whole numbers, bits and flags.
    (&[], "$0=2", Refused(6)),
    (&[], "$0=10.5", Refused(52)),
    (&[], "$0=256", Refused(52)),
    (&[], "$0=255", Answer("$$", "$0=255")),
    (&[], "$1=255.0", Answer("$$", "$1=255")),
    (&[], "$1=256", Refused(52)),
    (&[], "$1=254.5", Refused(52)),
    (&[], "$26=99999999999999999999", Refused(52)),
    (&[], "$2=255", Answer("$$", "$2=255")),
    (&[], "$2=256", Refused(52)),
    (&[], "$3=0.5", Refused(52)),
    (&[], "$10=3.9", Refused(52)),
    (&[], "$32=0.5", Refused(52)),
    (&[], "$32=0.000000001", Refused(52)),
    (&[], "$32=2", Refused(52)),
    (&[], "$4=256", Refused(52)),
    (&[], "$4=0.5", Refused(52)),
    (&[], "$5=7", Answer("$$", "$5=1")),
    (&[], "$13=2", Refused(52)),
    (&[], "$21=3", Refused(52)),
    (&[], "$4=1.0", Answer("$$", "$4=1")),
    (&[], "$22=1.5", Refused(52)),
    (&[], "$23=-1", Refused(4)),
    (&[], "$341=4.2", Refused(52)),
    // Numbers of settings and of startup lines.
    (&[], "$12.7=0.25", Refused(3)),
    (&[], "$100.5=80", Refused(3)),
    (&[], "$65636=80", Refused(3)),
    (&[], "$99999999999999999999=80", Refused(3)),
    (&[], "$N0.5=G21", Refused(3)),
    (&[], "$N99999999999999999999=G21", Refused(3)),
    // Decimal numbers.
    (&[], "$11=0.0000004", Refused(52)),
    (&[], "$12=0.000000001", Refused(52)),
    (&[], "$11=0", Answer("$$", "$11=0.000")),
    (&[], "$11=10000000", Answer("$$", "$11=10000000.000")),
    (&[], "$11=10000001", Refused(52)),
    (&[], "$785=0.0000004", Refused(52)),
    (&[], "$800=0.0000004", Refused(52)),
    (&[], "$130=0.0000004", Refused(52)),
    (&[], "$394=0.0000004", Refused(52)),
    (&[], "$394=20", Answer("$+", "$394=20.000")),
    (&[], "$394=20.001", Refused(52)),
    (&[], "$30=1000.5", Refused(52)),
    (&[], "$30=10000000", Answer("$$", "$30=10000000")),
    (&[], "$30=16777217", Refused(52)),
    (&[], "$33=99", Refused(52)),
    (&[], "$33=100.5", Refused(52)),
    (&[], "$786=0.5", Refused(52)),
    (&[], "$786=1000", Answer("$+", "$786=1000")),
    (&[], "$786=1001", Refused(52)),
    // Speeds of homing and parking.
    (&[], "$24=0", Refused(52)),
    (&[], "$25=0", Refused(52)),
    (&[], "$25=0.999", Refused(52)),
    (&[], "$24=1", Answer("$$", "$24=1.000")),
    (&[], "$57=0.5", Refused(52)),
    // Axes.
    (&[], "$100=0", Refused(52)),
    (&[], "$100=0.0009", Refused(52)),
    (&[], "$100=0.001", Answer("$$", "$100=0.001")),
    (&[], "$100=100000.000001", Refused(52)),
    (&[], "$110=12|$100=100000", Answer("$$", "$100=100000.000")),
    (&[], "$110=0.0009", Refused(52)),
    (&[], "$110=0.001", Answer("$$", "$110=0.001")),
    (&[], "$110=10000000", Refused(12)),
    (&[], "$120=0", Refused(52)),
    (&[], "$120=10000000", Answer("$$", "$120=10000000.000")),
    (&[], "$120=10000001", Refused(52)),
    // Lengths that an axis cannot count.
    (&[], "$130=2147483", Answer("$$", "$130=2147483.000")),
    (&[], "$130=2147485", Refused(52)),
    (&["132=1000000"], "$112=60|$102=1000", Refused(52)),
    (&[], "$27=2147485", Refused(52)),
    (&[], "$56=2147485", Refused(52)),
    (&[], "$58=-2147485", Refused(52)),
    (&[], "$58=-2147483", Answer("$+", "$58=-2147483.000")),
    (&["27=6000"], "$110=12|$100=100000", Refused(52)),
];

/// All that a refused line leaves as it was.
fn state(machine: &mut Machine) -> (Vec<Vec<String>>, [i32; 3], Outputs) {
    let answers = ["$G", "$#", "$+", "$TT", "$N"].map(|question| machine.ask(question));
    (answers.to_vec(), machine.xyz(), *machine.outputs())
}

fn check(row: &Row) {
    let (settings, lines, seen) = row;
    let fast = on_every_axis(&FAST);
    let fast = fast.iter().map(String::as_str);
    let all: Vec<&str> = fast.chain(settings.iter().copied()).collect();
    let mut machine = Machine::new(&all);
    let mut lines: Vec<&str> = lines.split('|').collect();
    let last = lines.pop().unwrap_or_default();
    for line in lines {
        assert_eq!(machine.ask(line), ["ok"], "{line} of {row:?}");
    }
    let before = state(&mut machine);
    let start = machine.seconds();
    let answer = machine.ask(last);
    if let Refused(number) = seen {
        assert_eq!(answer, [format!("error:{number}")], "{row:?}");
        assert!(state(&mut machine) == before, "a trace of {row:?}");
        return;
    }
    assert_eq!(answer, ["ok"], "{row:?}");
    match *seen {
        Refused(_) => {}
        Answer(question, line) => {
            let answer = machine.ask(question);
            let is_there = answer.iter().any(|other| other.starts_with(line));
            assert!(is_there, "{answer:?} for {row:?}");
        }
        At(steps) => assert_eq!(machine.xyz(), steps, "{row:?}"),
        Takes(seconds) => {
            let taken = machine.seconds() - start;
            let is_right = (seconds - 1.0e-4..seconds * 1.001 + 0.03).contains(&taken);
            assert!(is_right, "{taken} s for {row:?}");
        }
        Duty(duty) => assert_eq!(machine.outputs().duty / 4, duty, "{row:?}"),
    }
}

/// Checks every row of a table, and tells all that fail.
fn check_all(rows: &[Row]) {
    let mut failed = 0;
    for row in rows {
        failed += usize::from(std::panic::catch_unwind(|| check(row)).is_err());
    }
    assert_eq!(failed, 0, "rows fail with {AXES} axes");
}

#[test]
fn what_a_program_asks_for_is_done_or_refused() {
    check_all(PROGRAMS);
}

#[test]
fn what_is_set_is_kept_or_refused() {
    check_all(SETTINGS);
}

#[test]
fn a_move_that_takes_weeks_is_where_it_should_be_after_minutes() {
    for jerk in ["800=0", "800=10000"] {
        let mut machine = Machine::new(&["110=12", "100=100000", jerk]);
        // 1 mm in 35 days.
        machine.send("G93 G1 X1 F0.00002\n");
        for seconds in [100, 1000, 2000] {
            let remaining_s = seconds - machine.seconds() as u64;
            machine.run(remaining_s * 1000);
            let expected = seconds as f64 * 100_000.0 * 0.00002 / 60.0;
            let steps = f64::from(machine.xyz()[0]);
            assert!(
                (steps - expected).abs() <= 1.0,
                "{steps} of {expected} with ${jerk}"
            );
        }
    }
}
