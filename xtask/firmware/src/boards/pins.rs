//! The pins of a board as a table: a column for each number of axes.

use std::fmt::Write as _;

use anyhow::Result;
use board_data::{Board, Pin, SignedPin, Wiring};

/// What a function of a machine is called, and the text of its pins.
type Row = (&'static str, fn(&Board, &Wiring) -> String);

/// The rows that do not stand for an axis.
const ROWS: [Row; 9] = [
    ("enable of the drivers", |board, wiring| {
        let pins = wiring.enable.iter().map(|pin| output(board, Some(*pin)));
        pins.collect::<Vec<_>>().join(", ")
    }),
    ("spindle PWM, laser", |board, wiring| {
        wiring
            .pwm
            .map_or_else(String::new, |(pin, _)| named(board, pin))
    }),
    ("spindle on", |board, wiring| output(board, wiring.spindle)),
    ("spindle direction, `M4`", |board, wiring| {
        output(board, wiring.counter_clockwise)
    }),
    ("flood, `M8`", |board, wiring| output(board, wiring.flood)),
    ("mist, `M7`", |board, wiring| output(board, wiring.mist)),
    ("sender: USB", |board, wiring| {
        let pins = wiring.usb_pins().map(|pin| named(board, pin));
        pins.collect::<Vec<_>>().join(", ")
    }),
    ("sender: TX, RX", |board, wiring| {
        serial(board, wiring, !wiring.has_usb)
    }),
    ("why it does not start: TX, RX", |board, wiring| {
        serial(board, wiring, wiring.has_usb)
    }),
];

/// The pins of the USART, for one of its two uses.
fn serial(board: &Board, wiring: &Wiring, is_used: bool) -> String {
    let pins = [wiring.serial.transmit, wiring.serial.receive].into_iter();
    let pins = pins.filter(|_| is_used).map(|pin| named(board, pin));
    pins.collect::<Vec<_>>().join(", ")
}

/// The inputs that do not stand for an axis, by their keys.
const INPUTS: [(&str, &str); 5] = [
    ("probe", "inputs.probe"),
    ("reset button", "inputs.reset"),
    ("feed hold button", "inputs.hold"),
    ("cycle start button", "inputs.start"),
    ("safety door", "inputs.door"),
];

/// Names of the axes.
const LETTERS: [&str; 6] = ["X", "Y", "Z", "A", "B", "C"];

/// Returns the table, in Markdown.
pub fn table(board: &Board) -> Result<String> {
    let wirings: Vec<_> = (3..=board.most_axes())
        .filter_map(|axes| board.wiring(axes))
        .collect();
    let mut text = String::from("| |");
    for wiring in &wirings {
        write!(text, " {} axes |", wiring.axes())?;
    }
    text.push_str("\n|---|");
    text.push_str(&"---|".repeat(wirings.len()));
    text.push('\n');
    let mut row = |name: &str, cell: &dyn Fn(&Wiring) -> String| -> Result<()> {
        let cells: Vec<String> = wirings.iter().map(|wiring| cell(wiring)).collect();
        if cells.iter().any(|cell| !cell.is_empty()) {
            writeln!(text, "| {name} | {} |", cells.join(" | "))?;
        }
        Ok(())
    };
    for (axis, letter) in LETTERS.iter().enumerate() {
        row(&format!("{letter}: step, direction"), &|wiring| {
            let pins = wiring.step.get(axis).zip(wiring.direction.get(axis));
            pins.map_or_else(String::new, |(step, direction)| {
                format!("{}, {}", named(board, *step), named(board, *direction))
            })
        })?;
        row(&format!("{letter}: IN1 to IN4"), &|wiring| {
            let coils = wiring.phases.get(axis).into_iter().flatten();
            let coils = coils.map(|pin| named(board, *pin));
            coils.collect::<Vec<_>>().join(", ")
        })?;
        row(&format!("{letter}: limit switch"), &|wiring| {
            input(board, wiring, &format!("axes.{letter}.limit"))
        })?;
        row(&format!("{letter}2: step, direction"), &|wiring| {
            second_motor(board, wiring, axis)
        })?;
        row(&format!("{letter}2: limit switch"), &|wiring| {
            input(board, wiring, &format!("axes.{letter}2.limit"))
        })?;
    }
    for (name, key) in INPUTS {
        row(name, &|wiring| input(board, wiring, key))?;
    }
    for (name, cell) in ROWS {
        row(name, &|wiring| cell(board, wiring))?;
    }
    row("EEPROM of the settings: SCL, SDA", &|wiring| {
        let pins = wiring.eeprom.map(|pins| [pins.clock, pins.data]);
        let pins = pins.into_iter().flatten().map(|pin| named(board, pin));
        pins.collect::<Vec<_>>().join(", ")
    })?;
    row("set at boot", &|wiring| {
        let levels = wiring.at_boot.iter().map(|(pin, is_high)| {
            let level = if *is_high { "high" } else { "low" };
            format!("{} {level}", named(board, *pin))
        });
        levels.collect::<Vec<_>>().join(", ")
    })?;
    Ok(text)
}

/// Returns the step and direction of an axis's second motor.
fn second_motor(board: &Board, wiring: &Wiring, axis: usize) -> String {
    let mut motors = wiring.second.iter();
    let motor = motors.find(|motor| motor.axis == axis);
    motor.map_or_else(String::new, |motor| {
        let direction = output(board, Some(motor.direction));
        format!("{}, {direction}", named(board, motor.step))
    })
}

/// Returns a pin with what is printed beside it on the board.
fn named(board: &Board, pin: Pin) -> String {
    match board.labels.get(&pin) {
        Some(label) => format!("{pin} ({label})"),
        None => pin.to_string(),
    }
}

fn output(board: &Board, signed: Option<SignedPin>) -> String {
    signed.map_or_else(String::new, |signed| {
        let level = if signed.is_active_low { ", low" } else { "" };
        format!("{}{level}", named(board, signed.pin))
    })
}

fn input(board: &Board, wiring: &Wiring, key: &str) -> String {
    let found = wiring.inputs.iter().find(|(input, _)| input.key() == key);
    found.map_or_else(String::new, |(input, signed)| {
        let slow = if wiring.polled().contains(input) {
            ", *slow*"
        } else {
            ""
        };
        let level = if signed.is_active_low { "" } else { ", high" };
        format!("{}{level}{slow}", named(board, signed.pin))
    })
}
