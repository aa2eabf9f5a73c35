//! The board's file: what is known as its lines, what is not as comments.

use std::{fmt::Write as _, path::Path};

use crate::{Pin, Pull, SignedPin};

use super::printer::{Limit, Motor, NamedPin, Printer};

/// What the user has to add above the tables.
const ABOVE: &str = "\
# Add: what is printed on the chip behind STM32, as in F407VG, and the MHz of the crystal beside it.
# chip = \"?\"
# crystal_mhz = 0

# Add, where the board has a bootloader, its KiB, and the name of the file that it takes from the SD card.
# bootloader = { kib = 32, file = \"firmware.bin\" }
";
/// What the user has to add of the sender.
const SERIAL: &str = "\
# Add: the pins of one USART that your sender is connected to, often A9 and A10. Klipper's configurations do not
# tell them.
[serial]
# tx = \"?\"
# rx = \"?\"
";

/// Letters of axes, in the order of the bits of `$2` and `$3`.
const AXES: [&str; 6] = ["X", "Y", "Z", "A", "B", "C"];

/// Returns the file, with the name of that of the configuration.
pub(crate) fn text(printer: &Printer, path: &Path) -> String {
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let name = title(&stem);
    let mut text = format!(
        "# Made of {file} by `cargo xtask board import`. docs/boards.md explains the keys, `cargo xtask board check` \
         says what\n# is missing.\nname = {name:?}\n\n{ABOVE}"
    );
    list(
        &mut text,
        &format!("{file} says of that:"),
        &printer.remarks,
    );
    if uses_debug_pins(printer) {
        text.push_str("\n# Pins of the debug probe have functions here.\ndebug_pins = true\n");
    }
    text.push('\n');
    text.push_str(SERIAL);
    text.push('\n');
    axes(&mut text, printer);
    text.push('\n');
    outputs(&mut text, printer);
    text.push('\n');
    inputs(&mut text, printer);
    text
}

/// Returns a board's name of a file's: what the check takes.
fn title(stem: &str) -> String {
    let plain = stem.chars().filter(|c| matches!(c, ' '..='~') && *c != ':');
    let name: String = plain.take(40).collect();
    if name.trim().is_empty() {
        return "My board".into();
    }
    name
}

/// Writes the table of outputs.
fn outputs(text: &mut String, printer: &Printer) {
    text.push_str("[outputs]\n");
    if let Some(enable) = common_enable(&printer.motors) {
        let _ = writeln!(text, "enable = \"{}\"", shown(enable));
    }
    text.push_str("# Add what you connect; pwm needs a pin that is an output of a timer.\n");
    unknown(
        text,
        &["pwm", "spindle", "counter_clockwise", "flood", "mist"],
    );
    named(text, "The printer has these outputs:", &printer.outputs);
}

/// Writes the table of inputs.
fn inputs(text: &mut String, printer: &Printer) {
    text.push_str("[inputs]\n");
    if let Some(probe) = printer.probe {
        let _ = writeln!(text, "probe = \"{}\"", shown(probe));
    }
    text.push_str("# Add what you connect: a button between pin and ground is ^! and the pin.\n");
    if printer.probe.is_none() {
        unknown(text, &["probe"]);
    }
    unknown(text, &["reset", "hold", "start", "door"]);
    named(text, "The printer has these inputs:", &printer.inputs);
}

/// Writes the table of axes.
fn axes(text: &mut String, printer: &Printer) {
    text.push_str("[axes]\n");
    let common = common_enable(&printer.motors);
    for (index, motor) in printer.motors.iter().enumerate() {
        let before = &printer.motors[..index];
        // A pin has one function: it enables the drivers of all motors that share it.
        let sharing = before.iter().find(|other| {
            let pins = other.enable.zip(motor.enable);
            pins.is_some_and(|(other, own)| other.pin == own.pin)
        });
        let own_enable = motor
            .enable
            .filter(|_| common.is_none() && sharing.is_none());
        let _ = writeln!(text, "{}", line(&printer.motors, motor, own_enable));
        if let (Some(sharing), None) = (sharing, common) {
            let _ = writeln!(
                text,
                "# {} is enabled together with {}.",
                motor.axis, sharing.axis
            );
        }
        if let Limit::Other(pin) = &motor.limit {
            let _ = writeln!(
                text,
                "# {} has no switch, it is homed by {pin}: add limit = \"^!…\" where you connect one.",
                motor.axis
            );
        }
    }
    signs(
        text,
        "steps",
        "$2",
        &inverted(&printer.motors, |motor| motor.step.is_active_low),
    );
    // Klipper's high level is the positive direction, Grbl's the negative one.
    signs(
        text,
        "directions",
        "$3",
        &inverted(&printer.motors, |motor| !motor.direction.is_active_low),
    );
    named(
        text,
        "Drivers are not set up by the firmware; the printer does it by:",
        &printer.drivers,
    );
    list(text, "Left out:", &printer.left_out);
}

/// Returns the line of a motor.
fn line(motors: &[Motor], motor: &Motor, enable: Option<SignedPin>) -> String {
    let first = motors
        .iter()
        .find(|first| motor.axis.len() > 1 && motor.axis.starts_with(&first.axis));
    // A third motor has no place.
    let is_further = first.is_some() && !motor.axis.ends_with('2');
    let is_reversed =
        first.is_some_and(|first| first.direction.is_active_low != motor.direction.is_active_low);
    let sign = if is_reversed { "!" } else { "" };
    let mut values = vec![
        format!("step = \"{}\"", bare(motor.step.pin)),
        format!("direction = \"{sign}{}\"", bare(motor.direction.pin)),
    ];
    values.extend(enable.map(|pin| format!("enable = \"{}\"", shown(pin))));
    if let Limit::Switch(pin) = motor.limit {
        values.push(format!("limit = \"{}\"", shown(pin)));
    }
    let lead = if is_further { "# " } else { "" };
    format!(
        "{lead}{} = {{ {} }}  # [{}]",
        motor.axis,
        values.join(", "),
        motor.section
    )
}

/// Returns the enable pin, where all motors that have one have the same and there are several.
fn common_enable(motors: &[Motor]) -> Option<SignedPin> {
    let mut pins = motors.iter().map(|motor| motor.enable);
    let first = pins.next()??;
    let are_same = motors.len() > 1 && pins.all(|pin| pin == Some(first));
    are_same.then_some(first)
}

/// Returns the axes of which something holds.
fn inverted(motors: &[Motor], of: fn(&Motor) -> bool) -> Vec<&str> {
    let motors = motors.iter().filter(|motor| of(motor));
    motors.map(|motor| motor.axis.as_str()).collect()
}

/// Writes which setting inverts as the printer does.
fn signs(text: &mut String, what: &str, setting: &str, axes: &[&str]) {
    let bits = AXES.iter().enumerate();
    let mask: u32 = bits
        .filter(|(_, axis)| axes.contains(axis))
        .map(|(bit, _)| 1 << bit)
        .sum();
    if mask != 0 {
        let _ = writeln!(
            text,
            "# With {setting}={mask} {what} are as in the printer."
        );
    }
}

/// Writes keys whose pins are not known as comments.
fn unknown(text: &mut String, keys: &[&str]) {
    for key in keys {
        let _ = writeln!(text, "# {key} = \"?\"");
    }
}

/// Writes pins with their names as comments.
fn named(text: &mut String, head: &str, pins: &[NamedPin]) {
    let lines: Vec<_> = pins
        .iter()
        .map(|named| format!("{}: {}", shown(named.pin), named.name))
        .collect();
    list(text, head, &lines);
}

/// Writes lines as comments.
fn list(text: &mut String, head: &str, lines: &[String]) {
    if !lines.is_empty() {
        let _ = writeln!(text, "# {head}");
    }
    for line in lines {
        let _ = writeln!(text, "#   {line}");
    }
}

/// Returns whether a pin that gets a function is one of the debug probe, A13 or A14.
fn uses_debug_pins(printer: &Printer) -> bool {
    let of_motors = printer.motors.iter().flat_map(|motor| {
        let limit = match motor.limit {
            Limit::Switch(pin) => Some(pin),
            Limit::None | Limit::Other(_) => None,
        };
        [Some(motor.step), Some(motor.direction), motor.enable, limit]
    });
    let mut pins = of_motors.chain([printer.probe]).flatten();
    pins.any(|signed| signed.pin.port == 0 && matches!(signed.pin.number, 13 | 14))
}

/// Returns a pin as board files write it: `A3`.
fn bare(pin: Pin) -> String {
    format!("{}{}", pin.letter(), pin.number)
}

/// Returns a pin with its signs: `^!A3`.
fn shown(signed: SignedPin) -> String {
    let pull = match signed.pull {
        Pull::None => "",
        Pull::Up => "^",
        Pull::Down => "~",
    };
    let low = if signed.is_active_low { "!" } else { "" };
    format!("{pull}{low}{}", bare(signed.pin))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_one_that_the_check_takes() {
        for (stem, name) in [
            ("printer", "printer"),
            ("Fr\u{e4}se: 1", "Frse 1"),
            ("\u{96ea}", "My board"),
            (&"x".repeat(50), &"x".repeat(40)),
        ] {
            assert_eq!(title(stem), name);
        }
    }
}
