//! A host: transfers over the bus, and how operating systems set a device up.

use crate::{Core, FromDevice, Handshake};

/// An operating system: the order in which it asks a new device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum System {
    /// Linux: `drivers/usb/core/hub.c`, `drivers/usb/class/cdc-acm.c`.
    Linux,
    /// Windows: the requests of its hub driver, and of `usbser.sys`.
    Windows,
    /// macOS: `IOUSBHostFamily` and `AppleUSBCDCACM`.
    MacOs,
}

impl System {
    /// Every system.
    pub const ALL: [Self; 3] = [Self::Linux, Self::Windows, Self::MacOs];
}

/// Why a transfer has failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HostError {
    /// The device refuses.
    Stalled,
    /// The device does not answer in time: 50 ms without data, 500 ms with, USB 2.0 9.2.6.
    TimedOut,
    /// The device's packet has the toggle of the one before.
    Toggle,
}

/// The state of a host about its device.
#[derive(Debug, Clone, Default)]
pub struct Host {
    address: u8,
    out_toggle: bool,
    in_toggle: bool,
    /// The device descriptor, of 18 bytes.
    pub device: Vec<u8>,
    /// The configuration descriptor with everything behind it.
    pub configuration: Vec<u8>,
    /// Manufacturer, product, serial number.
    pub strings: [String; 3],
}

/// The endpoint of data.
pub const DATA_ENDPOINT: usize = 1;
/// Bytes of a full packet.
pub const PACKET_BYTES: usize = 64;
/// Periods of the device in 50 ms, at the shortest that a driver may have.
const MOST_PERIODS: usize = 100;

type Outcome<T> = Result<T, HostError>;

/// A request of eight bytes.
const fn request(kind: u8, code: u8, value: u16, index: u16, length: u16) -> [u8; 8] {
    let ([v0, v1], [i0, i1], [l0, l1]) = (
        value.to_le_bytes(),
        index.to_le_bytes(),
        length.to_le_bytes(),
    );
    [kind, code, v0, v1, i0, i1, l0, l1]
}

impl Host {
    /// Fetches a packet of endpoint 0, in time; `device` lets a period of the device's driver pass.
    fn fetch(
        &self,
        core: &mut Core,
        device: &mut impl FnMut(&mut Core),
    ) -> Outcome<(bool, Vec<u8>)> {
        for _ in 0..MOST_PERIODS {
            match core.fetch(self.address, 0) {
                FromDevice::Packet(toggle, bytes) => return Ok((toggle, bytes)),
                FromDevice::Refusal(Handshake::Stall) => return Err(HostError::Stalled),
                FromDevice::Refusal(_) => device(core),
            }
        }
        Err(HostError::TimedOut)
    }

    /// Sends a packet to endpoint 0, in time.
    fn give(
        &self,
        core: &mut Core,
        toggle: bool,
        bytes: &[u8],
        device: &mut impl FnMut(&mut Core),
    ) -> Outcome<()> {
        for _ in 0..MOST_PERIODS {
            match core.out(self.address, 0, toggle, bytes) {
                Handshake::Ack => return Ok(()),
                Handshake::Stall => return Err(HostError::Stalled),
                Handshake::Nak | Handshake::Silence => device(core),
            }
        }
        Err(HostError::TimedOut)
    }

    /// Sends a SETUP, which no device refuses.
    ///
    /// # Errors
    /// If the device is not there.
    pub fn setup(
        &self,
        core: &mut Core,
        request: [u8; 8],
        device: &mut impl FnMut(&mut Core),
    ) -> Outcome<()> {
        for _ in 0..MOST_PERIODS {
            if core.setup(self.address, request) == Handshake::Ack {
                return Ok(());
            }
            device(core);
        }
        Err(HostError::TimedOut)
    }

    /// A request that reads.
    ///
    /// # Errors
    /// As the device answers.
    pub fn read(
        &self,
        core: &mut Core,
        request: [u8; 8],
        device: &mut impl FnMut(&mut Core),
    ) -> Outcome<Vec<u8>> {
        let wanted = usize::from(u16::from_le_bytes([request[6], request[7]]));
        self.setup(core, request, device)?;
        let (mut answer, mut expected) = (Vec::new(), true);
        loop {
            let (toggle, bytes) = self.fetch(core, device)?;
            if toggle != expected {
                return Err(HostError::Toggle);
            }
            expected = !expected;
            let is_short = bytes.len() < PACKET_BYTES;
            answer.extend(bytes);
            if is_short || answer.len() >= wanted {
                break;
            }
        }
        self.give(core, true, &[], device)?;
        Ok(answer)
    }

    /// A request that writes.
    ///
    /// # Errors
    /// As the device answers.
    pub fn write(
        &self,
        core: &mut Core,
        request: [u8; 8],
        data: &[u8],
        device: &mut impl FnMut(&mut Core),
    ) -> Outcome<()> {
        self.setup(core, request, device)?;
        let mut toggle = true;
        for packet in data.chunks(PACKET_BYTES) {
            self.give(core, toggle, packet, device)?;
            toggle = !toggle;
        }
        match self.fetch(core, device)? {
            (true, end) if end.is_empty() => Ok(()),
            _ => Err(HostError::Toggle),
        }
    }

    /// Resets the bus: the device has address 0. USB 2.0 wants 10 ms of reset, and 10 ms of rest.
    pub fn reset(&mut self, core: &mut Core, device: &mut impl FnMut(&mut Core)) {
        core.reset_bus();
        (self.address, self.out_toggle, self.in_toggle) = (0, false, false);
        for _ in 0..40 {
            device(core);
        }
    }

    /// Waits for the device, sets it up as a system does, and opens its port.
    ///
    /// # Errors
    /// As the device answers.
    pub fn enumerate(
        &mut self,
        core: &mut Core,
        system: System,
        device: &mut impl FnMut(&mut Core),
    ) -> Outcome<()> {
        self.identify(core, system, device)?;
        self.write(core, request(0, 9, 1, 0, 0), &[], device)?;
        (self.out_toggle, self.in_toggle) = (false, false);
        self.open(core, system, device)
    }

    /// Waits for the device, resets the bus, gives the device its address and reads its descriptors, as a system does.
    ///
    /// # Errors
    /// As the device answers.
    pub fn identify(
        &mut self,
        core: &mut Core,
        system: System,
        device: &mut impl FnMut(&mut Core),
    ) -> Outcome<()> {
        for _ in 0..2 * MOST_PERIODS {
            if core.is_connected() {
                break;
            }
            device(core);
        }
        self.reset(core, device);
        let first_length = if system == System::MacOs {
            8
        } else {
            PACKET_BYTES as u16
        };
        // The first read at address 0 ends behind its first packet.
        let first = self.read(core, request(0x80, 6, 0x100, 0, first_length), device)?;
        if first.get(7) != Some(&(PACKET_BYTES as u8)) {
            return Err(HostError::TimedOut);
        }
        if system != System::MacOs {
            self.reset(core, device);
        }
        self.write(core, request(0, 5, 9, 0, 0), &[], device)?;
        self.address = 9;
        self.device = self.read(core, request(0x80, 6, 0x100, 0, 18), device)?;
        self.read_descriptors(core, system, device)
    }

    /// The address of the device.
    #[must_use]
    pub const fn address(&self) -> u8 {
        self.address
    }

    fn read_descriptors(
        &mut self,
        core: &mut Core,
        system: System,
        device: &mut impl FnMut(&mut Core),
    ) -> Outcome<()> {
        // One speed only: no other configuration. Windows asks for its own string, too.
        let absent = [
            request(0x80, 6, 0x600, 0, 10),
            request(0x80, 6, 0x3ee, 0, 18),
        ];
        for asked in absent {
            if system == System::Windows
                && self.read(core, asked, device) != Err(HostError::Stalled)
            {
                return Err(HostError::TimedOut);
            }
        }
        let head_length = if system == System::Windows { 255 } else { 9 };
        let head = self.read(core, request(0x80, 6, 0x200, 0, head_length), device)?;
        let total = u16::from_le_bytes([head[2], head[3]]);
        self.configuration = self.read(core, request(0x80, 6, 0x200, 0, total), device)?;
        let languages = self.read(core, request(0x80, 6, 0x300, 0, 255), device)?;
        let language = u16::from_le_bytes([languages[2], languages[3]]);
        for index in 0..3 {
            let value = 0x301 + index;
            let mut length = 255;
            if system == System::MacOs {
                let head = self.read(core, request(0x80, 6, value, language, 2), device)?;
                length = head[0].into();
            }
            let text = self.read(core, request(0x80, 6, value, language, length), device)?;
            let units = text[2..]
                .chunks(2)
                .map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
            let text = char::decode_utf16(units).map(|unit| unit.unwrap_or('?'));
            self.strings[usize::from(index)] = text.collect();
        }
        Ok(())
    }

    /// Opens the port, as a program of a system does.
    ///
    /// # Errors
    /// As the device answers.
    pub fn open(
        &mut self,
        core: &mut Core,
        system: System,
        device: &mut impl FnMut(&mut Core),
    ) -> Outcome<()> {
        let coding = [0x00, 0xc2, 0x01, 0x00, 0, 0, 8];
        if system == System::Windows {
            self.read(core, request(0xa1, 0x21, 0, 0, 7), device)?;
            self.write(core, request(0x21, 0x22, 0, 0, 0), &[], device)?;
        }
        if system == System::MacOs {
            self.clear_halts(core, device)?;
        }
        self.write(core, request(0x21, 0x20, 0, 0, 7), &coding, device)?;
        let read = self.read(core, request(0xa1, 0x21, 0, 0, 7), device)?;
        if read != coding {
            return Err(HostError::TimedOut);
        }
        self.set_lines(core, 3, device)
    }

    /// Ends the halts of both endpoints of data: their next packets are DATA0.
    ///
    /// # Errors
    /// As the device answers.
    pub fn clear_halts(
        &mut self,
        core: &mut Core,
        device: &mut impl FnMut(&mut Core),
    ) -> Outcome<()> {
        for endpoint in [0x01, 0x81] {
            self.write(core, request(2, 1, 0, endpoint, 0), &[], device)?;
        }
        (self.out_toggle, self.in_toggle) = (false, false);
        Ok(())
    }

    /// Sets DTR (1) and RTS (2).
    ///
    /// # Errors
    /// As the device answers.
    pub fn set_lines(
        &self,
        core: &mut Core,
        lines: u16,
        device: &mut impl FnMut(&mut Core),
    ) -> Outcome<()> {
        self.write(core, request(0x21, 0x22, lines, 0, 0), &[], device)
    }

    /// Sends a break of some ms.
    ///
    /// # Errors
    /// As the device answers.
    pub fn send_break(
        &self,
        core: &mut Core,
        ms: u16,
        device: &mut impl FnMut(&mut Core),
    ) -> Outcome<()> {
        self.write(core, request(0x21, 0x23, ms, 0, 0), &[], device)
    }

    /// Offers a packet of data once. Returns whether the device has taken it.
    pub fn offer(&mut self, core: &mut Core, bytes: &[u8]) -> bool {
        let is_taken =
            core.out(self.address, DATA_ENDPOINT, self.out_toggle, bytes) == Handshake::Ack;
        self.out_toggle ^= is_taken;
        is_taken
    }

    /// Offers a packet, and misses the acknowledgement: the host will offer it again.
    pub fn offer_unheard(&self, core: &mut Core, bytes: &[u8]) -> Handshake {
        core.out(self.address, DATA_ENDPOINT, self.out_toggle, bytes)
    }

    /// Asks for a packet of data once. A packet with the wrong toggle is the one before, again.
    pub fn take(&mut self, core: &mut Core) -> Option<Vec<u8>> {
        let FromDevice::Packet(toggle, bytes) = core.fetch(self.address, DATA_ENDPOINT) else {
            return None;
        };
        if toggle != self.in_toggle {
            return None;
        }
        self.in_toggle = !self.in_toggle;
        Some(bytes)
    }
}
