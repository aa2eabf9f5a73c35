//! The USART of the sender.

use crate::Pin;

/// The pins of the USART of the sender.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SerialPins {
    /// Number of the USART.
    pub usart: u8,
    /// Sends.
    pub transmit: Pin,
    /// Receives.
    pub receive: Pin,
}

/// Pins that send and receive: data sheets, alternate function mapping, the same on all F4.
const PINS: [(u8, &[&str], &[&str]); 4] = [
    (1, &["A9", "B6"], &["A10", "B7"]),
    (2, &["A2", "D5"], &["A3", "D6"]),
    (3, &["B10", "C10", "D8"], &["B11", "C11", "D9"]),
    (6, &["C6", "G14"], &["C7", "G9"]),
];

impl SerialPins {
    /// Returns the USART of two pins, on a chip with some USARTs.
    pub(crate) fn of(transmit: Pin, receive: Pin, usarts: &[u8]) -> Option<Self> {
        let has = |pins: &[&str], pin: Pin| pins.iter().any(|name| name.parse() == Ok(pin));
        let found = PINS.iter().find(|(usart, sending, receiving)| {
            usarts.contains(usart) && has(sending, transmit) && has(receiving, receive)
        });
        found.map(|&(usart, ..)| Self {
            usart,
            transmit,
            receive,
        })
    }

    /// Returns which pins send and receive on a chip with some USARTs, for an error.
    pub(crate) fn known(usarts: &[u8]) -> String {
        let pins = PINS.iter().filter(|(usart, ..)| usarts.contains(usart));
        let pins = pins.map(|(usart, sending, receiving)| {
            let [sending, receiving] = [sending, receiving].map(|pins| pins.join(" or "));
            format!("USART{usart} has TX on {sending}, RX on {receiving}")
        });
        pins.collect::<Vec<_>>().join("; ")
    }

    /// Returns the number of the pins' alternate function.
    pub(crate) fn alternate_function(self) -> u8 {
        if self.usart == 6 { 8 } else { 7 }
    }
}
