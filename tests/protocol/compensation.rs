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
