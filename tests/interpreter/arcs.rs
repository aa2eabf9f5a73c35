//! From the words of an arc to its circle.

use leadscrew::{
    axis::{Axes, X, Y, Z},
    gcode::LineError,
    model::{Circle, Command, Plane, Rotation},
    units::Nm,
};
use proptest::prelude::*;

use crate::support::{commands, decimal, error};

fn circle_of(command: &Command) -> Circle {
    match command {
        Command::Arc { circle, .. } => *circle,
        other => panic!("{other:?} is no arc"),
    }
}

/// The angle of an arc in its own sense of rotation, 0 to 2 pi.
fn angle(circle: Circle, chord: [f64; 2]) -> f64 {
    let [i, j] = circle.centre.map(Nm::to_mm_f64);
    let (start, end) = ([-i, -j], [chord[0] - i, chord[1] - j]);
    let cross = start[0] * end[1] - start[1] * end[0];
    let dot = start[0] * end[0] + start[1] * end[1];
    let angle = cross.atan2(dot);
    let angle = match circle.rotation {
        Rotation::Clockwise => -angle,
        Rotation::CounterClockwise => angle,
    };
    angle.rem_euclid(std::f64::consts::TAU)
}

#[test]
fn a_full_circle_is_one_turn_back_to_the_start_in_every_plane() {
    for (plane, offset, along) in [
        (Plane::Xy, "I5", X),
        (Plane::Zx, "K5", Z),
        (Plane::Yz, "J5", Y),
    ] {
        let select = match plane {
            Plane::Xy => "G17",
            Plane::Zx => "G18",
            Plane::Yz => "G19",
        };
        for (command, rotation) in [
            ("G2", Rotation::Clockwise),
            ("G3", Rotation::CounterClockwise),
        ] {
            let text = format!("{select}{command}X0Y0Z0{offset}F10");
            let made = commands(&[&text]);
            let circle = circle_of(&made[0]);
            // Without axis words in the plane it is the same circle, or a helix around it.
            let alone = format!("{select}{command}{offset}F10");
            assert_eq!(commands(&[&alone]), made);
            let again = format!("F10{select}{command}X0Y0Z0{offset}");
            assert_eq!(commands(&[&again, offset]), made);
            let helix = format!("{alone}{}7", ["X", "Y", "Z"][plane.axes().2]);
            assert_eq!(circle_of(&commands(&[&helix])[0]), circle);
            let mut centre = Axes::all(Nm(0));
            let (first, second, _) = plane.axes();
            centre[first] = circle.centre[0];
            centre[second] = circle.centre[1];
            assert_eq!(centre[along], Nm(5 * Nm::PER_MM), "{text}");
            assert_eq!((circle.plane, circle.rotation), (plane, rotation), "{text}");
            assert_eq!(circle.turns, 1);
        }
    }
    // The circle of a rotated system, in the line that selects it.
    let rotated = ["G10L2P2X3Y4R90", "G1X5Y5F10"];
    let lines = |circle| commands(&[rotated[0], rotated[1], circle]).pop();
    assert_eq!(lines("G55G2I5"), lines("G55G2X1Y-2I5"));
    // Words of the line have to define the circle, and to say that there is a circle.
    assert_eq!(error(&["G2F10"]), LineError::NoAxisWords);
    assert_eq!(error(&["G2R5F10"]), LineError::NoAxisWords);
    assert_eq!(error(&["G2K5F10"]), LineError::NoAxisWords);
    assert_eq!(error(&["G2Z1R5F10"]), LineError::NoAxisWordsInPlane);
    assert_eq!(error(&["G90.1G2I5F10"]), LineError::NoOffsetsInPlane);
    assert_eq!(error(&["G2I0F10"]), LineError::InvalidTarget);
    assert_eq!(error(&["G2Z1I0J0F10"]), LineError::InvalidTarget);
    for line in ["G1F10", "G2X1I.5F10", "G80"] {
        let word = if line.starts_with("G2") { "R5" } else { "I5" };
        assert_eq!(error(&[line, word]), LineError::UnusedWords, "{line}");
    }
    assert_eq!(error(&["G2X1I.5F10", "G4P0I5"]), LineError::UnusedWords);
}

#[test]
fn arcs_with_rounded_numbers_have_linuxcncs_tolerances() {
    // What `rs274` of LinuxCNC 2.9 takes and refuses, just below and above its limits.
    for (accepted, refused) in [
        ("G2X10.0282I5F10", "G2X10.0283I5F10"),
        ("G2X.2282I.1F10", "G2X.2283I.1F10"),
        ("G2X.004Y.001I.001F10", "G2X.02Y.01I.001F10"),
        ("G2X.002I.0005F10", "G2X.028I.0005F10"),
        ("G2X200.1I100F10", "G2X200.1002I100F10"),
        ("G20G2X2.00282I1F10", "G20G2X2.00284I1F10"),
        ("G20G2X20.01I10F10", "G20G2X20.0101I10F10"),
        ("G2X10R4.99874F10", "G2X10R4.99872F10"),
        ("G3X10R-4.99874F10", "G3X10R-4.99872F10"),
        ("G20G2X1R0.49996F10", "G20G2X1R0.49994F10"),
    ] {
        assert!(!commands(&[accepted]).is_empty(), "{accepted}");
        let expected = if refused.contains('R') {
            LineError::ArcRadius
        } else {
            LineError::InvalidTarget
        };
        assert_eq!(error(&[refused]), expected, "{refused}");
    }
    // Where `R` is too short, the arc is half of a circle.
    let circle = |line: &str| circle_of(&commands(&[line])[0]).centre;
    assert_eq!(circle("G2X10R4.999F10"), circle("G2X10R5F10"));
}

#[test]
fn an_arc_without_a_radius_is_a_straight_move() {
    for text in [
        "G2X0Y0I0J0F10",
        "G2X0Y0Z-5I0J0F10",
        "G2X.004I0F10",
        "G2X.004I.004F10",
    ] {
        let made = commands(&[text]);
        assert!(
            matches!(made[..], [Command::Line { .. }]),
            "{text}: {made:?}"
        );
    }
}

#[test]
fn turns_are_whole_and_at_least_one() {
    let turns = |text: &str| circle_of(&commands(&[text])[0]).turns;
    assert_eq!(turns("G2X0I1F10"), 1);
    assert_eq!(turns("G2X0I1P1F10"), 1);
    assert_eq!(turns("G3X1R5Z-3P12F10"), 12);
    assert_eq!(error(&["G2X0I1P1.5F10"]), LineError::NotInteger);
    assert_eq!(error(&["G2X0I1P0F10"]), LineError::ValueOutOfRange);
    assert_eq!(error(&["G2X0I1P65536F10"]), LineError::ValueOutOfRange);
    assert_eq!(error(&["G1X0P1F10"]), LineError::UnusedWords);
}

#[test]
fn arcs_continue_only_with_a_new_centre() {
    assert_eq!(error(&["G2X10I5F10", "X20"]), LineError::NoOffsetsInPlane);
    assert_eq!(commands(&["G2X10I5F10", "X20I5"]).len(), 1);
}

#[test]
fn radius_and_offsets_exclude_each_other() {
    assert_eq!(error(&["G2X10R5I5F10"]), LineError::UnusedWords);
}

proptest! {
    #![proptest_config(crate::cases(64))]

    #[test]
    fn both_ends_of_a_radius_arc_are_on_its_circle(
        x in -500_000_000..500_000_000_i64,
        y in -500_000_000..500_000_000_i64,
        excess in 1.0..20.0_f64,
        is_long: bool,
        is_clockwise: bool,
    ) {
        prop_assume!(x != 0 || y != 0);
        let chord = [x, y].map(|nm| Nm(nm).to_mm_f64());
        let radius = chord[0].hypot(chord[1]) / 2.0 * excess + 1.0e-6;
        let sign = if is_long { "-" } else { "" };
        let command = if is_clockwise { "G2" } else { "G3" };
        let text = format!("{command}X{}Y{}R{sign}{radius:.6}F10", decimal(x), decimal(y));
        let circle = circle_of(&commands(&[&text])[0]);
        let [i, j] = circle.centre.map(Nm::to_mm_f64);
        let ends = [i.hypot(j), (chord[0] - i).hypot(chord[1] - j)];
        for end in ends {
            // Near a half circle the centre reacts strongly to the rounding of R to 1 nm.
            prop_assert!((end - radius).abs() <= 2.0e-6, "{} is not {}", end, radius);
        }
        let angle = angle(circle, chord);
        let is_near_half = (angle - std::f64::consts::PI).abs() < 1.0e-3;
        prop_assert!(is_near_half || (angle > std::f64::consts::PI) == is_long, "{}", angle);
    }

    #[test]
    fn a_tiny_radius_arc_is_never_a_full_circle(
        x in -3000..3000_i64,
        y in -3000..3000_i64,
        radius in 2_000_000..2_000_000_000_i64,
        is_clockwise: bool,
    ) {
        prop_assume!(x != 0 || y != 0);
        let command = if is_clockwise { "G2" } else { "G3" };
        let text = format!(
            "{command}X{}Y{}R{}F10", decimal(x), decimal(y), decimal(radius)
        );
        let circle = circle_of(&commands(&[&text])[0]);
        let angle = angle(circle, [x, y].map(|nm| Nm(nm).to_mm_f64()));
        prop_assert!(angle < 0.01, "{} turns by {}", text, angle);
    }
}
