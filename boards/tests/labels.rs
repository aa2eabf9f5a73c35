//! What a user wires has the label that is printed beside it, or no source shows what is printed there.

use std::{collections::BTreeSet, path::Path};

use board_data::{Board, Pin, Wiring, fingerprint};

/// The pins of boards without a label, as they are written in the boards' files.
const UNKNOWN: [(&str, &str); 7] = [
    // The sources disagree: the socket of the TFT, or of the Raspberry Pi.
    ("btt-octopus-1.1-f429", "A9 A10"),
    ("btt-octopus-1.1-f446", "A9 A10"),
    ("btt-octopus-1.1-f446-2y", "A9 A10"),
    ("btt-skr-pro-1.2", "A9 A10"),
    // Its maker has these in pictures only.
    (
        "flexi-hal",
        "A3 C1 B8 D2 B14 A5 B9 C13 B6 C14 A8 B2 B1 C9 A7 B7 C4 A9 A10",
    ),
    // These lead to the ST-LINK on the board.
    ("nucleo-f446re", "A2 A3"),
    ("nucleo-f446re-uln2003", "A2 A3"),
];

/// The pins that a user wires. Where each driver has an enable pin of its own, drivers are in sockets, which have the
/// label of the step pin.
fn wired(wiring: &Wiring) -> Vec<Pin> {
    let second = wiring.second.iter().map(|motor| motor.step);
    let signed = [
        wiring.spindle,
        wiring.counter_clockwise,
        wiring.flood,
        wiring.mist,
    ];
    let inputs = wiring.inputs.iter().map(|(_, pin)| *pin);
    let signed = signed.into_iter().flatten().chain(inputs);
    let mut pins: Vec<Pin> = signed.map(|signed| signed.pin).collect();
    pins.extend(wiring.step.iter().copied().chain(second));
    pins.extend(wiring.phases.as_flattened());
    pins.extend(wiring.pwm.map(|(pin, _)| pin));
    pins.extend([wiring.serial.transmit, wiring.serial.receive]);
    if let [all] = wiring.enable[..] {
        pins.extend(wiring.direction.iter().copied().chain([all.pin]));
    }
    pins
}

#[test]
fn what_a_user_wires_has_a_label() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    for board in Board::all(root).unwrap() {
        let wirings = (3..=board.most_axes()).filter_map(|axes| board.wiring(axes));
        let pins: BTreeSet<Pin> = wirings.flat_map(wired).collect();
        let without = pins.iter().filter(|pin| !board.labels.contains_key(pin));
        let without: BTreeSet<Pin> = without.copied().collect();
        let unknown = UNKNOWN.iter().find(|(name, _)| *name == board.name);
        let unknown = unknown.map_or("", |(_, pins)| pins).split_whitespace();
        let unknown: BTreeSet<Pin> = unknown.map(|pin| pin.parse().unwrap()).collect();
        assert_eq!(without, unknown, "{} lacks labels", board.name);
    }
}

#[test]
fn neither_labels_nor_the_folder_of_the_file_change_an_image() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    for board in Board::all(root).unwrap() {
        let mut bare = board.clone();
        bare.labels.clear();
        bare.file = "elsewhere.toml".into();
        for axes in 3..=board.most_axes() {
            assert_eq!(fingerprint(&bare, axes), fingerprint(&board, axes));
        }
    }
}
