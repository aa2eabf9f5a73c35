//! Cutter radius compensation: what the machine gets, and when the sender is answered.

use leadscrew::path::Work;

use super::bench::Bench;

/// Where a move ends, in thousandths of a mm, and whether it is an arc.
type End = ([i64; 3], bool);

/// The moves that the machine has got since the last call.
fn moves(bench: &mut Bench, at: &mut [i64; 3]) -> Vec<End> {
    let steps_per_mm = bench.session.settings().steps_per_mm;
    let mut moves = Vec::new();
    for work in bench.works() {
        let Work::Move(block) = work else { continue };
        for (axis, at) in at.iter_mut().enumerate() {
            let per_mm = steps_per_mm[axis].millionths() as f64 * 1.0e-6;
            let mm = block.delta[axis] as f64 / 4_294_967_296.0 / per_mm;
            *at += (mm * 1000.0).round() as i64;
        }
        moves.push((*at, block.curve.is_some()));
    }
    moves
}

/// Sends lines that are all accepted, and returns the moves.
fn run(lines: &[&str]) -> Vec<End> {
    let mut bench = Bench::new();
    for line in lines {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    moves(&mut bench, &mut [0; 3])
}

/// Whether two lists of moves are the same within a hundredth of a mm.
fn assert_moves(moves: &[End], expected: &[End]) {
    let is_near =
        |(a, b): (&End, &End)| a.1 == b.1 && a.0.iter().zip(b.0).all(|(a, b)| (a - b).abs() <= 10);
    let is_same = moves.len() == expected.len() && moves.iter().zip(expected).all(is_near);
    assert!(is_same, "{moves:?}\nexpected {expected:?}");
}

const SQUARE: [&str; 5] = ["G1X0Y0", "Y20", "X20", "Y0", "X0"];

#[test]
fn the_cutter_stays_at_its_radius_from_a_square_on_either_side() {
    let square = |begin: &str| {
        let mut lines = vec!["F600", "G0X-10Y-10", begin];
        lines.extend(SQUARE);
        lines.extend(["G40", "G0X-10Y-10"]);
        run(&lines)
    };
    let outside = [
        ([-10_000, -10_000, 0], false),
        ([-1500, 621, 0], false),
        ([-1500, 20_000, 0], false),
        ([0, 21_500, 0], true),
        ([20_000, 21_500, 0], false),
        ([21_500, 20_000, 0], true),
        ([21_500, 0, 0], false),
        ([20_000, -1500, 0], true),
        ([0, -1500, 0], false),
        ([-10_000, -10_000, 0], false),
    ];
    assert_moves(&square("G41.1D3"), &outside);
    let inside = [
        ([-10_000, -10_000, 0], false),
        ([1061, -1061, 0], false),
        ([1500, 0, 0], true),
        ([1500, 18_500, 0], false),
        ([18_500, 18_500, 0], false),
        ([18_500, 1500, 0], false),
        ([0, 1500, 0], false),
        ([-10_000, -10_000, 0], false),
    ];
    assert_moves(&square("G42.1D3"), &inside);
    assert_moves(&square("G41.1D-3"), &inside);
}

#[test]
fn a_line_is_answered_although_its_move_waits() {
    let mut bench = Bench::new();
    for line in ["F600", "G41.1D2", "G1X10", "Y10"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    assert_moves(&moves(&mut bench, &mut [0; 3]), &[([9000, 1000, 0], false)]);
    assert_eq!(bench.ask("G40"), ["ok"]);
    let mut at = [9000, 1000, 0];
    assert_moves(&moves(&mut bench, &mut at), &[([9000, 10_000, 0], false)]);
}

#[test]
fn a_corner_that_does_not_fit_is_refused_and_the_move_before_it_waits() {
    let mut bench = Bench::new();
    for line in ["F600", "G41.1D10G1X10", "X20"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    let mut at = [0; 3];
    assert_eq!(moves(&mut bench, &mut at).len(), 1);
    assert_eq!(bench.ask("X11Y1"), ["error:92"]);
    assert_eq!(bench.ask("G3X21Y1I0J1"), ["error:92"]);
    assert!(moves(&mut bench, &mut at).is_empty());
    assert_eq!(bench.ask("Y20"), ["ok"]);
    assert_moves(&moves(&mut bench, &mut at), &[([15_000, 5000, 0], false)]);
}

#[test]
fn a_line_that_its_own_corner_takes_whole_is_refused_so_that_the_contour_can_end_anywhere() {
    // The corner takes 5 mm of both lines: less behind it would lead the cutter back into the first one.
    for end in ["G40", "M0", "M2", "M30"] {
        let mut bench = Bench::new();
        for line in ["F600", "G41.1D10G1X10", "X20"] {
            assert_eq!(bench.ask(line), ["ok"], "{line}");
        }
        let mut at = [0; 3];
        moves(&mut bench, &mut at);
        assert_eq!(bench.ask("Y4.99"), ["error:92"]);
        assert!(moves(&mut bench, &mut at).is_empty());
        assert_eq!(bench.ask("Y5"), ["ok"]);
        let answers = bench.ask(end);
        let is_refused = answers.iter().any(|answer| answer.starts_with("error"));
        assert!(!is_refused, "{end}: {answers:?}");
        assert_moves(&moves(&mut bench, &mut at), &[([15_000, 5000, 0], false)]);
    }
}

#[test]
fn an_entry_keeps_the_circle_of_its_words() {
    // The circle of R about Y10: the cutter ends inside of it, on the radius at its end.
    for words in ["X10Y10R10", "X10Y10I0J10"] {
        let entry = format!("G3{words}");
        let moves = run(&["F600", "G41.1D4", &entry, "G40"]);
        assert_moves(&moves, &[([8000, 10_000, 0], true)]);
    }
    let mut bench = Bench::new();
    for line in ["F600", "G41.1D4"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    for line in ["G1X2", "G3X0Y0I0J10", "G3X1Y1R1"] {
        assert_eq!(bench.ask(line), ["error:92"], "{line}");
    }
    assert_eq!(bench.ask("G1X2.01"), ["ok"]);
}

#[test]
fn what_has_no_place_beside_the_path_is_refused_until_g40() {
    let mut bench = Bench::new();
    for line in ["F600", "G41.1D4", "G1X10"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    assert_eq!(bench.ask("G42.1D4"), ["error:90"]);
    for line in [
        "G18",
        "G28",
        "G30.1",
        "G53G0X0",
        "G92X0",
        "G52X0",
        "G92.1",
        "G54",
        "G55",
        "G43.1Z1",
        "G49",
        "G10L2P1X1",
        "G10L20P0X1",
        "G38.2Z-1",
        "G81X1Z-1R1",
        "T3M6",
        "$J=X1F100",
        "$H",
    ] {
        let expected = if line == "$H" { "error:5" } else { "error:91" };
        assert_eq!(bench.ask(line), [expected], "{line}");
    }
    for line in [
        "G17",
        "G20",
        "G21",
        "G91",
        "G90",
        "G10L2P2X1",
        "G10L1P1R1",
        "M61Q1",
        "G64P0.1",
        "G61",
    ] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    assert!(bench.ask("$G")[0].contains(" G41.1 "));
    assert_eq!(bench.ask("G40"), ["ok"]);
    assert!(!bench.ask("$G")[0].contains("G4"));
    assert_eq!(bench.ask("G2X20I5"), ["error:205"]);
    for line in ["G1X11", "G2X21I5", "G28"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
}

#[test]
fn what_waits_after_a_move_is_done_at_the_corner_and_no_more_than_fits() {
    let mut bench = Bench::new();
    let mut at = [0; 3];
    for line in ["F600", "G41.1D4", "G1X10", "X20"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    moves(&mut bench, &mut at);
    for number in 0..16 {
        let line = format!("G1Z{}", number % 2);
        assert_eq!(bench.ask(&line), ["ok"], "{line}");
    }
    for line in ["G1Z-1", "M3S100", "G4P0.1"] {
        assert_eq!(bench.ask(line), ["error:207"], "{line}");
    }
    assert!(moves(&mut bench, &mut at).is_empty());
    assert_eq!(bench.ask("Y20"), ["ok"]);
    let done = moves(&mut bench, &mut at);
    assert_eq!(done.len(), 16, "{done:?}");
    assert!(
        done.iter().all(|end| end.0[..2] == [18_000, 2000]),
        "{done:?}"
    );
}

#[test]
fn a_rapid_goes_straight_where_a_feed_goes_around_a_corner() {
    let around = |move_after: &str| {
        let lines = ["F600", "G41.1D4", "G1X10", "X20", move_after, "G40"];
        run(&lines)[2..].to_vec()
    };
    let end = [22_000, -10_000, 0];
    assert_moves(&around("G1Y-10"), &[([22_000, 0, 0], true), (end, false)]);
    assert_moves(&around("G0Y-10"), &[([22_000, 0, 0], false), (end, false)]);
}

#[test]
fn path_control_changes_for_what_comes_after_the_move_that_waits() {
    let mut bench = Bench::new();
    for line in [
        "F600", "G41.1D4", "G1X10", "X20", "G61.1", "X30", "X40", "G61", "Z1", "G61.1", "X50",
        "X60", "G40",
    ] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    let stops: Vec<_> = bench
        .works()
        .iter()
        .filter_map(|work| match work {
            Work::Move(block) => Some(block.junction_sqr == 0.0),
            _ => None,
        })
        .collect();
    // At the start of the moves to X20, X30, X40, Z1, X50 and X60.
    assert_eq!(stops[1..], [false, false, true, true, false, true]);
}

#[test]
fn the_program_pauses_and_ends_on_the_offset_path() {
    let mut bench = Bench::new();
    let mut at = [0; 3];
    for line in ["F600", "G41.1D4", "G1X10", "X20"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    assert!(bench.ask("M0").is_empty());
    assert_eq!(
        moves(&mut bench, &mut at).last(),
        Some(&([20_000, 2000, 0], false))
    );
    assert_eq!(bench.answer("~"), ["ok"]);
    assert_eq!(bench.ask("X30"), ["ok"]);
    assert_eq!(bench.ask("M2").last().map(String::as_str), Some("ok"));
    assert_eq!(moves(&mut bench, &mut at), [([30_000, 2000, 0], false)]);
    // The position is that of the cutter.
    assert_eq!(bench.ask("G91G1Y1F600"), ["ok"]);
    assert_eq!(moves(&mut bench, &mut at), [([30_000, 3000, 0], false)]);
}

#[test]
fn a_jog_after_g40_begins_where_the_cutter_is_and_a_refused_one_changes_nothing() {
    let run = |jogs: &[(&str, &str)]| {
        let mut bench = Bench::new();
        for line in ["F600", "G41.1D4", "G1X10", "X20", "G40"] {
            assert_eq!(bench.ask(line), ["ok"], "{line}");
        }
        let mut at = [0; 3];
        moves(&mut bench, &mut at);
        for (jog, answer) in jogs {
            assert_eq!(bench.ask(jog), [*answer], "{jog}");
        }
        assert_eq!(bench.ask("G91G1X1"), ["ok"]);
        moves(&mut bench, &mut at)
    };
    // From the programmed position, and from the cutter's.
    assert_moves(
        &run(&[("$J=G91F3000", "error:26"), ("$J=X1F600G2", "error:35")]),
        &[([21_000, 0, 0], false)],
    );
    assert_moves(
        &run(&[("$J=G91X1F3000", "ok")]),
        &[([21_000, 2000, 0], false), ([22_000, 2000, 0], false)],
    );
}

#[test]
fn a_reset_forgets_the_move_that_waits() {
    let mut bench = Bench::new();
    let mut at = [0; 3];
    for line in ["F600", "G41.1D4", "G1X10", "X20"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    assert_eq!(moves(&mut bench, &mut at), [([10_000, 2000, 0], false)]);
    bench.answer("\x18");
    assert!(!bench.ask("$G")[0].contains("G41"));
    for line in ["G91", "G1X1F600"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    assert_eq!(moves(&mut bench, &mut at), [([11_000, 2000, 0], false)]);
}

#[test]
fn a_cutter_without_radius_follows_the_contour_itself() {
    for code in ["G41.1D0", "G42.1D0", "G41", "G42D0"] {
        let mut lines = vec!["F600", "G0X-10Y-10", code];
        lines.extend(SQUARE);
        lines.extend(["G3X0Y0I-5J5", "G1Y10", "G40", "G0X-10Y-10"]);
        let plain: Vec<_> = lines
            .iter()
            .copied()
            .filter(|line| *line != code && *line != "G40")
            .collect();
        assert_moves(&run(&lines), &run(&plain));
    }
}

#[test]
fn g40_before_the_entry_is_as_if_it_had_never_been_on() {
    let lines = [
        "F600", "G0X5Y5Z5", "G41.1D4", "Z3", "M3S100", "G40", "G2X15I5", "G1X20",
    ];
    let plain = ["F600", "G0X5Y5Z5", "Z3", "M3S100", "G2X15I5", "G1X20"];
    // The move of Z alone is no entry.
    assert_moves(&run(&lines[..4]), &run(&plain[..3]));
    assert_moves(
        &run(&["F600", "G0X5Y5Z5", "G41.1D4", "Z3", "G40", "G1X20"]),
        &run(&["F600", "G0X5Y5Z5", "Z3", "G1X20"]),
    );
}

#[test]
fn inverse_time_is_that_of_the_programmed_move_and_a_corner_is_as_fast_as_what_follows() {
    let mut bench = Bench::new();
    for line in [
        "G93",
        "G41.1D4",
        "G1X10F60",
        "X20F6",
        "Y-10F12",
        "Y-20Z10F12",
        "G40",
    ] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    let speeds: Vec<_> = bench
        .works()
        .iter()
        .filter_map(|work| match work {
            Work::Move(block) => Some((block.programmed_mm_s * 100.0).round() as i32),
            _ => None,
        })
        .collect();
    // 10 mm at 60, 6 and 12 a minute, the arc around the corner before the third; √200 mm at 12 a minute.
    assert_eq!(speeds, [1000, 100, 200, 200, 283]);
}

#[test]
fn what_ends_compensation_drops_the_move_that_waits() {
    for (end, resumes) in [
        ("$X", ""),
        ("$C", "$C"),
        ("$SLP", "\x18"),
        ("\x18", ""),
        ("M2", ""),
    ] {
        let mut bench = Bench::new();
        let mut at = [0; 3];
        for line in ["F600", "G41.1D4", "G1X10", "X20"] {
            assert_eq!(bench.ask(line), ["ok"], "{line}");
        }
        moves(&mut bench, &mut at);
        // What needs standstill looks at the motion, which has ended.
        assert_eq!(bench.ask("$27=2"), ["ok"]);
        for line in [end, resumes, "$X"] {
            bench.answer(&format!("{line}\n"));
        }
        assert!(!bench.ask("$G")[0].contains("G41"), "{end}");
        let waited = moves(&mut bench, &mut at);
        // M2 alone lets it go to its end.
        assert_eq!(waited.len(), usize::from(end == "M2"), "{end}: {waited:?}");
        let from = at;
        assert_eq!(bench.ask("G91G1Y1F600"), ["ok"], "{end}");
        let expected = [from[0], from[1] + 1000, 0];
        assert_moves(&moves(&mut bench, &mut at), &[(expected, false)]);
    }
}

#[test]
fn a_dry_run_finds_what_does_not_fit_and_moves_nothing() {
    let mut bench = Bench::new();
    bench.ask("$C");
    for line in ["F600", "G41.1D10G1X10", "X20"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    assert_eq!(bench.ask("Y4.99"), ["error:92"]);
    for line in ["Y20", "G40", "G0X0Y0"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    assert!(moves(&mut bench, &mut [0; 3]).is_empty());
}
