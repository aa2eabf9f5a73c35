//! Coordinate systems, stored positions, rotary axes.

use leadscrew::{
    axis::{AXES, X, Z},
    gcode::{LineError, Modal},
    model::{FeedRate, WorkCoordinates},
    units::Nm,
};

use crate::support::{after, commands, error, line, um};

#[test]
fn machine_coordinates_ignore_every_offset_and_incremental_distance() {
    let lines = ["G10L2P1X10", "G92Y5", "G43.1Z3", "G91", "G53G0X1Y2Z3"];
    assert_eq!(
        commands(&lines),
        [line(um(1000, 2000, 3000), FeedRate::Rapid)]
    );
}

#[test]
fn offsets_add_up() {
    let machine = after(&["G10L2P2X10", "G55", "G92Y-5", "G43.1Z3", "G0X1Y0Z2"]);
    assert_eq!(
        machine.work_offset(&machine.position()),
        um(10_000, 5_000, 3_000)
    );
    assert_eq!(machine.position(), um(11_000, 5_000, 5_000));
    assert_eq!(machine.offsets().tool[Z], Nm(3 * Nm::PER_MM));
}

#[test]
fn a_reset_keeps_stored_offsets_and_the_position() {
    let lines = [
        "G10L2P1X1",
        "G91G20F5S6T7M3M8",
        "G43.1Z1",
        "G92X0",
        "G28.1",
        "G0X1",
    ];
    let mut machine = after(&lines);
    let position = machine.position();
    let stored = *machine.offsets();
    machine.reset();
    assert_eq!(*machine.modal(), Modal::default());
    assert_eq!(machine.position(), position);
    assert_eq!(
        machine.offsets().origins.coordinates,
        stored.origins.coordinates
    );
    assert_eq!(machine.offsets().origins.g28, stored.origins.g28);
    assert_eq!(machine.offsets().work, um(0, 0, 0));
    assert_eq!(machine.offsets().tool[Z], Nm(0));
}

#[test]
fn g28_passes_the_target_and_moves_the_named_axes_only() {
    let lines = ["G0X1Y2Z3", "G28.1", "G0X10Y20Z30"];
    let all = commands(&[&lines[..], &["G28"]].concat());
    assert_eq!(all, [line(um(1000, 2000, 3000), FeedRate::Rapid)]);
    let named = commands(&[&lines[..], &["G91G28Z5"]].concat());
    let intermediate = line(um(10_000, 20_000, 35_000), FeedRate::Rapid);
    let end = line(um(10_000, 20_000, 3_000), FeedRate::Rapid);
    assert_eq!(named, [intermediate, end]);
}

#[test]
fn g28_1_stores_the_position_before_the_move_of_its_line() {
    let machine = after(&["G0X1", "G28.1X3", "G30.1"]);
    assert_eq!(machine.offsets().origins.g28, um(1000, 0, 0));
    assert_eq!(machine.offsets().origins.g30, um(3000, 0, 0));
    assert_eq!(machine.position(), um(3000, 0, 0));
}

#[test]
fn axes_beyond_the_third_are_degrees() {
    let letters = &["A", "B", "C"][..AXES - 3];
    for (index, letter) in letters.iter().enumerate() {
        let machine = after(&[&format!("G20G1X1{letter}-90.5F10")]);
        assert_eq!(machine.position()[X], Nm(Nm::PER_INCH));
        assert_eq!(machine.position()[3 + index], Nm(-90_500_000));
        assert_eq!(
            error(&[&format!("{letter}1{letter}2")]),
            LineError::RepeatedWord
        );
        let stored = after(&[&format!("G10L2P1{letter}7"), &format!("G0{letter}1")]);
        assert_eq!(stored.position()[3 + index], Nm(8_000_000));
    }
    for letter in &["A", "B", "C"][AXES - 3..] {
        assert_eq!(error(&[&format!("{letter}1")]), LineError::Unsupported);
    }
}

#[test]
fn every_work_coordinate_system_is_chosen_by_its_word_and_set_by_its_number() {
    for (number, system) in (1..).zip(WorkCoordinates::ALL) {
        let word = system.word();
        let machine = after(&[&format!("G10L2P{number}X5"), word, "G0X1"]);
        assert_eq!(
            machine.modal().coordinates,
            system,
            "{word} chooses another system: make word and number of its row in \
             src/model/modes.rs the same"
        );
        assert_eq!(
            machine.position(),
            um(6000, 0, 0),
            "{word} is not P{number}"
        );
    }
}

#[test]
fn g10_takes_no_number_for_another_one() {
    for (line, refusal) in [
        ("G10L2P256X1", LineError::UnknownCoordinates),
        ("G10L2P1.9X1", LineError::NotInteger),
        ("G10L258P1X1", LineError::Unsupported),
        ("G10L2.5P1X1", LineError::NotInteger),
    ] {
        assert_eq!(error(&[line]), refusal, "{line}");
    }
    let beyond = WorkCoordinates::ALL.len() + 1;
    for p in [beyond, 255, 256 + beyond] {
        let line = format!("G10L2P{p}X1");
        assert_eq!(error(&[&line]), LineError::UnknownCoordinates, "{line}");
    }
}
