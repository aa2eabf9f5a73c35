//! What a user wires has the label that is printed beside it, or `""` where no source shows what is printed there.

use std::{collections::BTreeSet, path::Path};

use board_data::{Board, Pin, Wiring, fingerprint};

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
        let without: Vec<_> = without.map(ToString::to_string).collect();
        assert_eq!(without.join(" "), "", "{} lacks labels", board.name);
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
