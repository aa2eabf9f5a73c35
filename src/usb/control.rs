//! Answers the requests of endpoint 0: `usb_control`, which has no deadline.
//!
//! Hosts wait 50 ms for the end of a request without data, and 500 ms for data: USB 2.0, 9.2.6.

use usb_device::{
    LangID,
    device::{StringDescriptors, UsbDevice, UsbDeviceBuilder, UsbDeviceState, UsbRev, UsbVidPid},
    prelude::BuilderError,
};

use super::{ControlBus, ControlBusAllocator, PACKET_BYTES, class::SerialPort, mailbox::Answer};
use crate::model::Requests;

/// Vendor and product: those that pid.codes keeps for tests, until the project has its own.
const IDENTITY: UsbVidPid = UsbVidPid(0x1209, 0x0001);
const MANUFACTURER: &str = "Leadscrew";
/// Longest name of a board: `usb-device` has a buffer of 128 bytes for a head of two and 16 bits for each letter.
pub const LONGEST_NAME: usize = 63;

/// Bytes of a serial number.
pub const SERIAL_NUMBER_LENGTH: usize = 24;

/// Returns the serial number of a chip with this unique number: hexadecimal digits.
#[must_use]
pub fn serial_number(unique: [u32; 3]) -> [u8; SERIAL_NUMBER_LENGTH] {
    let mut digits = [0; SERIAL_NUMBER_LENGTH];
    for (index, digit) in digits.iter_mut().enumerate() {
        let word = unique.get(index / 8).copied().unwrap_or_default();
        let value = (word >> (28 - 4 * (index % 8)) & 0xf) as u8;
        *digit = match value {
            0..=9 => b'0' + value,
            _ => b'A' + (value - 10),
        };
    }
    digits
}

/// The device as the host sees it, but for the data.
pub struct UsbControl<'a> {
    device: UsbDevice<'a, ControlBus<'a>>,
    port: SerialPort<'a>,
}

impl<'a> UsbControl<'a> {
    /// Returns a device with the name of a board, which is no longer than [`LONGEST_NAME`], and a serial number.
    ///
    /// # Errors
    /// If `usb-device` refuses the sizes and names, which are the same for each board.
    pub fn new(
        allocator: &'a ControlBusAllocator<'a>,
        board: &'a str,
        serial_number: &'a str,
    ) -> Result<Self, BuilderError> {
        let port = SerialPort::new(allocator);
        let names = StringDescriptors::new(LangID::EN_US)
            .manufacturer(MANUFACTURER)
            .product(board)
            .serial_number(serial_number);
        let mut device = UsbDeviceBuilder::new(allocator, IDENTITY)
            .usb_rev(UsbRev::Usb200)
            .composite_with_iads()
            .self_powered(true)
            .max_packet_size_0(PACKET_BYTES as u8)?
            .strings(&[names])?
            .build();
        device.set_self_powered(true);
        Ok(Self { device, port })
    }

    /// Answers the newest event, if it has no answer yet. Returns whether a break of the sender waits for `interpret`.
    pub fn serve(&mut self, requests: &Requests) -> bool {
        let bus = self.device.bus();
        let Some((event, code, packet)) = bus.mailbox().begin() else {
            return false;
        };
        bus.load(event, &packet);
        self.device.poll(&mut [&mut self.port]);
        let bus = self.device.bus();
        let is_configured = self.device.state() == UsbDeviceState::Configured;
        bus.set(Answer::IS_CONFIGURED, is_configured);
        bus.set(Answer::CONFIGURES, self.port.configuration.take().is_some());
        bus.set(Answer::IS_OPEN, self.port.is_open);
        bus.mailbox().finish(code);
        let has_break = core::mem::take(&mut self.port.has_break);
        if has_break {
            requests.request_line_break();
        }
        has_break
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_serial_number_is_the_chips_number_in_hexadecimal() {
        let digits = serial_number([0x0123_4567, 0x89ab_cdef, 0xf0f0_0a0a]);
        assert_eq!(&digits, b"0123456789ABCDEFF0F00A0A");
    }
}
