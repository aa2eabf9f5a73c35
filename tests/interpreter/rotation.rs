//! `G10 L2 R`: rotated work coordinates.

use leadscrew::{
    axis::{AXES, Axes, X, Y, Z},
    gcode::LineError,
    model::{Command, WorkCoordinates},
    settings::Origins,
    units::{MicroDegrees, Nm},
};
use proptest::prelude::*;

use crate::support::{after, commands, decimal, error, um};

/// Asserts that two positions are equal but for rounding to a nanometre.
fn assert_near(position: Axes<Nm>, expected: Axes<Nm>, what: &str) {
    for axis in 0..AXES {
        let difference = position[axis].0 - expected[axis].0;
        assert!(
            difference.abs() <= 1,
            "{what}: {position:?} is not {expected:?}"
        );
    }
}

#[test]
fn quarter_turns_are_exact() {
    for (angle, x, y) in [
        ("0", 1000, 2000),
        ("90", -2000, 1000),
        ("180", -1000, -2000),
        ("270", 2000, -1000),
        ("-90", 2000, -1000),
        ("450", -2000, 1000),
    ] {
        let machine = after(&[&format!("G10L2P1X10Y20R{angle}"), "G0X1Y2Z3"]);
        assert_eq!(
            machine.position(),
            um(10_000 + x, 20_000 + y, 3000),
            "{angle}"
        );
    }
}

#[test]
fn targets_turn_about_the_origin_after_g92() {
    // 30 degrees: cos 0.8660254037844386, sin 0.5.
    let machine = after(&["G10L2P2X10Y5Z1R30", "G55", "G52X2", "G0X10Y0Z4"]);
    let expected = Axes::from_fn(|axis| {
        Nm([10_000_000 + 10_392_305, 5_000_000 + 6_000_000, 5_000_000]
            .get(axis)
            .copied()
            .unwrap_or(0))
    });
    assert_near(machine.position(), expected, "G55");
    // The tool length offset is not rotated.
    let with_tool = after(&["G10L2P1R90", "G43.1X1Z5", "G0X10Y0Z0"]);
    assert_eq!(with_tool.position(), um(1000, 10_000, 5000));
}

#[test]
fn machine_coordinates_and_stored_positions_are_never_rotated() {
    let machine = after(&["G10L2P1X7R30", "G53G0X1Y2Z3"]);
    assert_eq!(machine.position(), um(1000, 2000, 3000));
    let stored = after(&["G0X4Y5Z6", "G28.1", "G10L2P1R30", "G0X9Y9Z9", "G28"]);
    assert_eq!(stored.position(), um(4000, 5000, 6000));
}

#[test]
fn incremental_moves_add_up_without_drift() {
    let mut lines = vec!["G10L2P1X3Y-2R17.123456", "G0X1Y1"];
    lines.push("G91");
    lines.extend(std::iter::repeat_n("X0.001Y-0.003", 5000));
    lines.extend(std::iter::repeat_n("X-0.001Y0.003", 5000));
    lines.push("G90");
    let machine = after(&lines);
    assert_eq!(machine.position(), after(&lines[..2]).position());
}

#[test]
fn a_move_along_z_leaves_x_and_y_alone() {
    let machine = after(&["G0X1.234567Y7.654321", "G10L2P1R33.3", "G0Z5"]);
    assert_eq!(
        [X, Y].map(|axis| machine.position()[axis]),
        [Nm(1_234_567), Nm(7_654_321)]
    );
}

#[test]
fn the_offset_of_a_position_follows_from_the_rotation() {
    let machine = after(&["G10L2P1X10R90", "G0X1Y2"]);
    let position = machine.position();
    let offset = machine.work_offset(&position);
    // MPos is (10 - 2, 1), WPos is (1, 2).
    assert_eq!(position, um(8000, 1000, 0));
    assert_eq!(offset, um(7000, -1000, 0));
}

#[test]
fn g10_l20_and_g92_make_the_given_values_the_work_position() {
    for line in ["G10L20P1X1Y2Z3", "G92X1Y2Z3"] {
        let machine = after(&["G10L2P1X10Y-4Z2R30", "G0X12Y7Z5", line]);
        let work = machine
            .position()
            .zip(machine.work_offset(&machine.position()), |m, o| m - o);
        assert_near(work, um(1000, 2000, 3000), line);
    }
    // Only the given axis: the others keep theirs.
    let machine = after(&["G10L2P1X10Y-4R30", "G0X12Y7", "G10L20P0X0"]);
    let work = machine
        .position()
        .zip(machine.work_offset(&machine.position()), |m, o| m - o);
    assert_near(work, um(0, 7000, 0), "Y is kept");
}

#[test]
fn a_rotation_is_kept_until_it_is_given_again_and_only_g10_l2_takes_it() {
    let machine = after(&["G10L2P9R12.5", "G10L2P9X1", "G20", "G10L2P9Y1"]);
    let system = WorkCoordinates::G59_3;
    let origins: &Origins = &machine.offsets().origins;
    assert_eq!(origins.rotations[system], MicroDegrees::new(12_500_000));
    assert_eq!(origins.coordinates[system][Y], Nm(Nm::PER_INCH));
    assert_eq!(error(&["G10L20P1X0R5"]), LineError::UnusedWords);
    assert_eq!(error(&["G10L20P1"]), LineError::NoAxisWords);
    assert_eq!(error(&["G10L2P1"]), LineError::NoAxisWords);
}

#[test]
fn arcs_in_the_rotated_plane_stay_arcs() {
    let [command] = commands(&["G10L2P1R90", "G0X1", "G3X0Y1I-1F100"])[..] else {
        panic!("one arc");
    };
    let Command::Arc { target, circle, .. } = command else {
        panic!("{command:?}");
    };
    assert_eq!(target.position, um(-1000, 0, 0));
    assert_eq!(circle.centre, [Nm(0), Nm(-1_000_000)]);
    assert_eq!(circle.tilt, MicroDegrees::ZERO);
    // R words and absolute centres are those of the work coordinates, too.
    for last in ["G3X0Y1R1F100", "G90.1G3X0Y1I0J0F100"] {
        let [again] = commands(&["G10L2P1R90", "G0X1", last])[..] else {
            panic!("one arc");
        };
        assert_eq!(again, command, "{last}");
    }
}

#[test]
fn absolute_centres_need_both_words_and_end_with_g91_1() {
    assert_eq!(
        error(&["G90.1", "G0X1", "G3X0Y1I0F100"]),
        LineError::NoOffsetsInPlane
    );
    let lines = ["G10L2P1X5", "G92Y2", "G90.1", "G0X1Y0", "G3X0Y1I0J0F100"];
    let relative = ["G10L2P1X5", "G92Y2", "G0X1Y0", "G3X0Y1I-1F100"];
    assert_eq!(commands(&lines), commands(&relative));
    let ended = ["G90.1", "G91.1", "G0X1", "G3X0Y1I-1F100"];
    assert_eq!(commands(&ended).len(), 1);
}

proptest! {
    #![proptest_config(crate::cases(64))]

    /// Whatever the frame, what a line asks for is where the work position is afterwards.
    #[test]
    fn the_work_position_is_what_lines_ask_for(
        angle in -360_000_000_i64..360_000_000,
        origin in prop::array::uniform2(-500_000_000_i64..500_000_000),
        work in -50_000_000_i64..50_000_000,
        tool in -50_000_000_i64..50_000_000,
        target in prop::array::uniform3(-900_000_000_i64..900_000_000),
    ) {
        let [x, y, z] = target.map(decimal);
        let machine = after(&[
            &format!("G10L2P3X{}Y{}R{}", decimal(origin[0]), decimal(origin[1]), decimal(angle)),
            "G56",
            &format!("G52X{}", decimal(work)),
            &format!("G43.1Y{0}Z{0}", decimal(tool)),
            &format!("G1X{x}Y{y}Z{z}F100"),
        ]);
        let position = machine.position();
        let offset = machine.work_offset(&position);
        for (axis, nm) in [X, Y, Z].into_iter().zip(target) {
            let reached = (position[axis] - offset[axis]).0;
            prop_assert!((reached - nm).abs() <= 1, "axis {axis}: {reached} is not {nm}");
        }
    }
}
