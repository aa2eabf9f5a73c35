//! The pins of a board as tables: what a pin does, what is printed beside it, and with which numbers of axes.

use std::fmt::Write as _;

use board_data::{AXIS_LETTERS, Board, Input, Pin, SignedPin, Wiring};

/// Pins with what is to be known of each, in a cell.
type Pins = Vec<(Pin, &'static str)>;
/// What a function of a machine is called, and its pins.
type Row = (&'static str, fn(&Wiring) -> Pins);

/// Where drivers and coils are.
const MOTORS_HEAD: &str = "motor | label | step, direction, enable; or IN1 to IN4";
/// All but the motors.
const CONNECTORS_HEAD: &str = "what | label | pin";

/// The inputs that do not stand for an axis.
const INPUTS: [(&str, Input); 5] = [
    ("probe", Input::Probe),
    ("reset button", Input::Reset),
    ("feed hold button", Input::Hold),
    ("cycle start button", Input::Start),
    ("safety door", Input::Door),
];

/// The outputs, and the sender.
const OUTPUTS: [Row; 7] = [
    ("spindle PWM, laser", |wiring| {
        wiring.pwm.map(|(pin, _)| (pin, "")).into_iter().collect()
    }),
    ("spindle on", |wiring| output(wiring.spindle)),
    ("spindle direction, `M4`", |wiring| {
        output(wiring.counter_clockwise)
    }),
    ("flood, `M8`", |wiring| output(wiring.flood)),
    ("mist, `M7`", |wiring| output(wiring.mist)),
    ("sender: TX, RX", |wiring| serial(wiring, !wiring.has_usb)),
    ("why it does not start: TX, RX", |wiring| {
        serial(wiring, wiring.has_usb)
    }),
];

/// What is connected on the board itself.
const ON_BOARD: [Row; 3] = [
    ("sender: USB", |wiring| {
        wiring.usb_pins().map(|pin| (pin, "")).collect()
    }),
    ("EEPROM of the settings: SCL, SDA", |wiring| {
        let pins = wiring.eeprom.map(|pins| [pins.clock, pins.data]);
        pins.into_iter().flatten().map(|pin| (pin, "")).collect()
    }),
    ("set at boot", |wiring| {
        let pins = wiring.at_boot.iter();
        pins.map(|&(pin, is_high)| (pin, if is_high { " high" } else { " low" }))
            .collect()
    }),
];

/// Returns a board's tables in Markdown: of its motors, its connectors, and what is on the board itself, which may be
/// nothing.
pub fn tables(board: &Board) -> [String; 3] {
    let row = |name: &str, pins: &dyn Fn(&Wiring) -> Pins| rows(board, name, pins);
    let mut motors = String::new();
    let mut switches = String::new();
    for (axis, letter) in (0_u8..).zip(AXIS_LETTERS) {
        motors += &row(letter, &|wiring| motor(wiring, axis));
        motors += &row(&format!("{letter}2"), &|wiring| second_motor(wiring, axis));
        for (name, limit) in [
            (format!("{letter}: limit switch"), Input::Limit(axis)),
            (format!("{letter}2: limit switch"), Input::SecondLimit(axis)),
        ] {
            switches += &row(&name, &|wiring| input(wiring, limit));
        }
    }
    motors += &row("all: enable", &|wiring| enable(wiring, ""));
    let inputs = INPUTS.map(|(name, function)| row(name, &|wiring| input(wiring, function)));
    let [outputs, own] =
        [&OUTPUTS[..], &ON_BOARD].map(|all| all.iter().map(|(name, pins)| row(name, pins)));
    [
        table(MOTORS_HEAD, &motors),
        table(
            CONNECTORS_HEAD,
            &(switches + &inputs.concat() + &outputs.collect::<String>()),
        ),
        table(CONNECTORS_HEAD, &own.collect::<String>()),
    ]
}

fn table(head: &str, rows: &str) -> String {
    if rows.is_empty() {
        return String::new();
    }
    format!("| {head} | axes |\n|---|---|---|---|\n{rows}")
}

/// Returns the rows of a function: more than one where it has other pins with another number of axes.
fn rows(board: &Board, name: &str, pins: &dyn Fn(&Wiring) -> Pins) -> String {
    let by_axes = |axes| board.wiring(axes).map(pins).unwrap_or_default();
    let mut text = String::new();
    for (pins, axes) in grouped(board, by_axes) {
        let labels = pins.iter().filter_map(|(pin, _)| board.labels.get(pin));
        let known = labels.map(String::as_str).filter(|label| !label.is_empty());
        let labels: Vec<_> = known.collect();
        let pins = pins.iter().map(|(pin, note)| format!("{pin}{note}"));
        let pins: Vec<_> = pins.collect();
        if !pins.is_empty() {
            let (labels, pins) = (labels.join(", "), pins.join(", "));
            let _ = writeln!(text, "| {name} | {labels} | {pins} | {axes} |");
        }
    }
    text
}

/// Returns what a board has with each number of axes: each once, with the numbers.
pub fn grouped<T: PartialEq>(board: &Board, of: impl Fn(usize) -> T) -> Vec<(T, String)> {
    let mut groups: Vec<(T, String)> = Vec::new();
    for axes in 3..=board.most_axes() {
        let found = of(axes);
        match groups.iter_mut().find(|(it, _)| *it == found) {
            Some((_, list)) => list.extend([", ".to_owned(), axes.to_string()]),
            None => groups.push((found, axes.to_string())),
        }
    }
    groups
}

/// The pins of an axis's motor.
fn motor(wiring: &Wiring, axis: u8) -> Pins {
    let index = usize::from(axis);
    let pins = wiring.step.get(index).into_iter();
    let pins = pins.chain(wiring.direction.get(index));
    let pins = pins.chain(wiring.phases.get(index).into_iter().flatten());
    let mut pins: Pins = pins.map(|pin| (*pin, "")).collect();
    pins.extend(enable(wiring, AXIS_LETTERS[index]));
    pins
}

/// The pins of an axis's second motor.
fn second_motor(wiring: &Wiring, axis: u8) -> Pins {
    let mut motors = wiring.second.iter();
    let motor = motors.find(|motor| motor.axis == usize::from(axis));
    let mut pins = Vec::new();
    if let Some(motor) = motor {
        pins.push((motor.step, ""));
        pins.extend(output(Some(motor.direction)));
        pins.extend(enable(wiring, &format!("{}2", AXIS_LETTERS[motor.axis])));
    }
    pins
}

/// The pin that enables a motor, or the one of all.
fn enable(wiring: &Wiring, motor: &str) -> Pins {
    let pins = wiring.enabled.iter().zip(&wiring.enable);
    let pins = pins.filter(|(of, _)| *of == motor);
    pins.flat_map(|(_, pin)| output(Some(*pin))).collect()
}

/// The pins of the USART, for one of its two uses.
fn serial(wiring: &Wiring, is_used: bool) -> Pins {
    let pins = [wiring.serial.transmit, wiring.serial.receive].into_iter();
    pins.filter(|_| is_used).map(|pin| (pin, "")).collect()
}

fn output(signed: Option<SignedPin>) -> Pins {
    let level = |is_low| if is_low { " (low)" } else { "" };
    let pins = signed.into_iter();
    pins.map(|signed| (signed.pin, level(signed.is_active_low)))
        .collect()
}

fn input(wiring: &Wiring, function: Input) -> Pins {
    let found = wiring.inputs.iter().find(|(input, _)| *input == function);
    let is_slow = wiring.polled().contains(&function);
    let note = |is_low| match (is_low, is_slow) {
        (true, false) => "",
        (true, true) => " (*slow*)",
        (false, false) => " (high)",
        (false, true) => " (high, *slow*)",
    };
    let pins = found.into_iter();
    pins.map(|(_, signed)| (signed.pin, note(signed.is_active_low)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::boards::named;

    #[test]
    fn a_row_has_label_pins_and_the_numbers_of_axes() {
        for (name, row) in [
            (
                "btt-octopus-1.1-f446-2y",
                "| Y2 | MOTOR6 | PE2, PE3, PD4 (low) | 3, 4, 5 |",
            ),
            ("netduino-plus-2", "| X | D2, D5 | PA3, PB8 | 3, 4, 5, 6 |"),
            (
                "netduino-plus-2",
                "| all: enable | D8 | PA0 (low) | 3, 4, 5, 6 |",
            ),
            ("netduino-plus-2", "| Z: limit switch | D0 | PC7 | 4 |"),
            ("netduino-plus-2", "| safety door | D0 | PC7 | 3, 5 |"),
            ("nucleo-f446re", "| reset button | A0 | PA0 (*slow*) |"),
            ("flexi-hal", "| X |  | PA3, PC2, PA14 (low) | 3, 4, 5 |"),
        ] {
            let tables = tables(&named(name).unwrap()).concat();
            let row = format!("\n{row}");
            assert!(tables.contains(&row), "{name}: {row}\n{tables}");
        }
    }

    #[test]
    fn a_table_without_rows_is_none() {
        let [.., inside] = tables(&named("nucleo-f446re-uln2003").unwrap());
        assert_eq!(inside, "");
    }
}
