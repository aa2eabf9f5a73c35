//! Pins, as board files write them.

use std::{fmt, str::FromStr};

/// A pin of a chip: a port and a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Pin {
    /// The port, 0 for A to 8 for I.
    pub port: u8,
    /// The number in the port, 0 to 15.
    pub number: u8,
}

/// Ports of the largest chip: A to I.
const PORTS: u8 = 9;

impl Pin {
    /// Returns the letter of the port.
    pub fn letter(self) -> char {
        char::from(b'A' + self.port)
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(to, "P{}{}", self.letter(), self.number)
    }
}

impl FromStr for Pin {
    type Err = String;

    /// Reads `A3` or `PA3`.
    fn from_str(text: &str) -> Result<Self, String> {
        let unknown = || {
            format!(
                "{text:?} is no pin: a port, A to I, and a number, 0 to 15, are wanted, as in \"A3\""
            )
        };
        let name = text.strip_prefix('P').unwrap_or(text);
        let mut characters = name.chars();
        let port = characters.next().ok_or_else(unknown)?;
        let port = u32::from(port).wrapping_sub(u32::from('A'));
        let digits = characters.as_str();
        let is_number = digits.bytes().all(|digit| digit.is_ascii_digit());
        let number: u8 = digits.parse().map_err(|_| unknown())?;
        if port >= PORTS.into() || !is_number || number > 15 {
            return Err(unknown());
        }
        let port = port as u8;
        Ok(Self { port, number })
    }
}

/// The resistor of an input in the chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pull {
    /// None.
    None,
    /// To the supply, `^`.
    Up,
    /// To ground, `~`.
    Down,
}

/// A pin with the level that is active, as Klipper writes it: `^` pull-up, `~` pull-down, `!` active low.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SignedPin {
    /// The pin.
    pub pin: Pin,
    /// Whether the low level is the active one.
    pub is_active_low: bool,
    /// The resistor, of inputs only.
    pub pull: Pull,
}

impl FromStr for SignedPin {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (pull, rest) = match text.as_bytes().first() {
            Some(b'^') => (Pull::Up, &text[1..]),
            Some(b'~') => (Pull::Down, &text[1..]),
            _ => (Pull::None, text),
        };
        let name = rest.strip_prefix('!');
        if name.is_some_and(|name| name.starts_with(['^', '~', '!'])) {
            return Err(format!(
                "the signs of a pin are one of ^ and ~, then !: not {text:?}"
            ));
        }
        Ok(Self {
            pin: name.unwrap_or(rest).parse()?,
            is_active_low: name.is_some(),
            pull,
        })
    }
}

/// Reads `A0-15` or `D2` as pins.
pub(crate) fn read_range(text: &str) -> Result<Vec<Pin>, String> {
    let (first, last) = text.split_once('-').unwrap_or((text, ""));
    let first: Pin = first.parse()?;
    let last = if last.is_empty() {
        first.number
    } else {
        last.parse()
            .map_err(|_| format!("{text:?} is no range of pins"))?
    };
    let numbers = first.number..=last;
    let pin = |number| Pin { number, ..first };
    Ok(numbers.map(pin).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pins_have_a_port_a_number_and_signs() {
        let pin: SignedPin = "^!PB12".parse().unwrap();
        assert_eq!(pin.pin.to_string(), "PB12");
        assert!(pin.is_active_low && pin.pull == Pull::Up);
        let pin: SignedPin = "~I0".parse().unwrap();
        assert!(pin.pin.port == 8 && !pin.is_active_low && pin.pull == Pull::Down);
        for wrong in ["", "^", "B", "12", "J1", "A16", "A+1", "!^A1", "a1", "A1 "] {
            assert!(wrong.parse::<SignedPin>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn ranges_of_pins_are_inclusive() {
        assert_eq!(read_range("A0-15").unwrap().len(), 16);
        assert_eq!(read_range("D2").unwrap()[0].to_string(), "PD2");
        assert!(read_range("A0-x").is_err());
    }
}
