//! An EEPROM on two wires, of the kind 24C32 to 24C512: its side of a transfer, a bit at a time. NXP UM10204 3.1; data
//! sheets of the 24C32 and the 24C128.

use rigless::{device::Level, time::VirtualNanos};

/// What is selected with all address pins low, above the bit that says read.
const SELECTED: u8 = 0x50;
/// A write into its cells.
const WRITE_NS: u64 = 5_000_000;
const BITS: u8 = 8;

/// What the EEPROM is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    /// It waits for a start.
    Deselected,
    /// The EEPROM takes the byte that selects it.
    Selecting,
    AddressHigh,
    AddressLow,
    /// It takes bytes for a page.
    Writing,
    /// It sends bytes.
    Reading,
}

/// The EEPROM.
#[derive(Debug)]
pub(crate) struct Eeprom {
    bytes: Vec<u8>,
    page_bytes: usize,
    mode: Mode,
    /// What is next, once the acknowledgement is over.
    next: Mode,
    /// Bits of the byte that have passed; one more is the acknowledgement.
    bits: u8,
    byte: u8,
    address: usize,
    /// Bytes for the page, from the address on.
    page: Vec<u8>,
    is_acknowledged: bool,
    busy_until: VirtualNanos,
    /// What a master did that the data sheet forbids.
    pub(crate) faults: Vec<String>,
    /// Bytes that have been written into cells.
    pub(crate) written: usize,
    /// As many bytes are written before the supply is cut.
    pub(crate) cut_after: usize,
}

impl Eeprom {
    /// An erased one, of 4 KiB or of 16.
    pub(crate) fn new(is_small: bool) -> Self {
        let (kib, page_bytes) = if is_small { (4, 32) } else { (16, 64) };
        Self::with(vec![0xFF; kib * 1024], page_bytes)
    }

    fn with(bytes: Vec<u8>, page_bytes: usize) -> Self {
        Self {
            bytes,
            page_bytes,
            mode: Mode::Deselected,
            next: Mode::Deselected,
            bits: 0,
            byte: 0,
            address: 0,
            page: Vec::new(),
            is_acknowledged: false,
            busy_until: VirtualNanos(0),
            faults: Vec::new(),
            written: 0,
            cut_after: usize::MAX,
        }
    }

    /// The same after its supply has been off.
    pub(crate) fn restarted(self) -> Self {
        Self::with(self.bytes, self.page_bytes)
    }

    /// The data wire changes while the clock is high: a start where it falls, else a stop. It is let go of.
    pub(crate) fn condition(&mut self, data: Level, now: VirtualNanos) {
        if data == Level::High && self.mode == Mode::Writing && !self.page.is_empty() {
            self.write();
            self.busy_until = VirtualNanos(now.0 + WRITE_NS);
        }
        self.page.clear();
        self.bits = 0;
        self.byte = 0;
        self.mode = match data {
            Level::Low => Mode::Selecting,
            Level::High => Mode::Deselected,
        };
    }

    /// Writes the page into its cells: behind the end of a page, its beginning is next.
    fn write(&mut self) {
        let start = self.address - self.address % self.page_bytes;
        let offset = self.address % self.page_bytes;
        if offset + self.page.len() > self.page_bytes {
            let message = "a write to the EEPROM runs over the end of a page";
            self.faults
                .push(format!("{message}, from {:#x}", self.address));
        }
        for (nth, &byte) in self.page.iter().enumerate() {
            if self.written < self.cut_after {
                let place = start + (offset + nth) % self.page_bytes;
                self.bytes[place] = byte;
                self.written += 1;
            }
        }
    }

    /// The clock rises: a bit is valid.
    pub(crate) fn rise(&mut self, data: Level) {
        if self.mode != Mode::Reading && self.bits < BITS {
            self.byte = self.byte << 1 | u8::from(data == Level::High);
        }
        if self.bits == BITS {
            self.is_acknowledged = data == Level::Low;
        }
        self.bits += 1;
    }

    /// The clock falls: returns whether the data wire is to be pulled low.
    pub(crate) fn fall(&mut self, now: VirtualNanos) -> bool {
        match self.mode {
            Mode::Deselected => false,
            Mode::Reading if self.bits < BITS => self.byte << self.bits & 0x80 == 0,
            // The master acknowledges.
            Mode::Reading if self.bits == BITS => false,
            Mode::Reading if self.is_acknowledged => self.send(),
            Mode::Reading => {
                self.mode = Mode::Deselected;
                false
            }
            _ if self.bits < BITS => false,
            _ if self.bits == BITS => self.take(now),
            _ => {
                self.mode = self.next;
                self.bits = 0;
                self.byte = 0;
                self.mode == Mode::Reading && self.send()
            }
        }
    }

    /// Begins to send the next byte; returns whether its first bit is low.
    fn send(&mut self) -> bool {
        self.byte = self.bytes[self.address % self.bytes.len()];
        self.address += 1;
        self.bits = 0;
        self.byte & 0x80 == 0
    }

    /// Takes a byte; returns whether it is acknowledged.
    fn take(&mut self, now: VirtualNanos) -> bool {
        self.next = match self.mode {
            Mode::Selecting if self.byte >> 1 != SELECTED || now < self.busy_until => {
                Mode::Deselected
            }
            Mode::Selecting if self.byte & 1 == 0 => Mode::AddressHigh,
            Mode::Selecting => Mode::Reading,
            Mode::AddressHigh => {
                self.address = usize::from(self.byte) << 8 & (self.bytes.len() - 1);
                Mode::AddressLow
            }
            Mode::AddressLow => {
                self.address |= usize::from(self.byte);
                Mode::Writing
            }
            Mode::Writing => {
                self.page.push(self.byte);
                Mode::Writing
            }
            Mode::Reading | Mode::Deselected => Mode::Deselected,
        };
        if self.next == Mode::Deselected {
            self.mode = Mode::Deselected;
        }
        self.mode != Mode::Deselected
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A master that clocks bytes out and in.
    struct Master {
        eeprom: Eeprom,
        now: u64,
    }

    impl Master {
        fn clock(&mut self, data: Level) -> Level {
            self.now += 5_000;
            self.eeprom.rise(data);
            let pulls = self.eeprom.fall(VirtualNanos(self.now));
            if pulls { Level::Low } else { Level::High }
        }

        /// Sends a byte; returns whether it is acknowledged.
        fn send(&mut self, byte: u8) -> bool {
            let mut pulled = Level::High;
            for bit in (0..8).rev() {
                pulled = self.clock(Level::from(byte >> bit & 1 != 0));
            }
            self.clock(pulled);
            pulled == Level::Low
        }

        fn write(&mut self, address: u16, bytes: &[u8]) -> bool {
            self.eeprom.condition(Level::Low, VirtualNanos(self.now));
            let [high, low] = address.to_be_bytes();
            let head = [0xA0, high, low];
            let is_taken = head.iter().chain(bytes).all(|&byte| self.send(byte));
            self.eeprom.condition(Level::High, VirtualNanos(self.now));
            is_taken
        }
    }

    #[test]
    fn a_page_is_written_and_a_selection_meanwhile_is_not_acknowledged() {
        let mut master = Master {
            eeprom: Eeprom::new(true),
            now: 0,
        };
        assert!(master.write(0x123, &[1, 2, 3]));
        assert_eq!(master.eeprom.bytes[0x122..0x127], [0xFF, 1, 2, 3, 0xFF]);
        assert!(!master.write(0x200, &[9]), "it is still writing");
        master.now += WRITE_NS;
        assert!(master.write(0x200, &[9]));
        assert!(master.eeprom.faults.is_empty());
    }

    #[test]
    fn a_write_over_the_end_of_a_page_is_a_fault_and_begins_the_page_anew() {
        let mut master = Master {
            eeprom: Eeprom::new(true),
            now: 0,
        };
        assert!(master.write(31, &[1, 2]));
        assert_eq!((master.eeprom.bytes[31], master.eeprom.bytes[0]), (1, 2));
        assert_eq!(master.eeprom.bytes[32], 0xFF);
        assert_eq!(master.eeprom.faults.len(), 1);
    }

    #[test]
    fn nothing_is_written_behind_the_cut() {
        let mut master = Master {
            eeprom: Eeprom::new(false),
            now: 0,
        };
        master.eeprom.cut_after = 1;
        assert!(master.write(0, &[1, 2]));
        let eeprom = master.eeprom.restarted();
        assert_eq!(eeprom.bytes[..2], [1, 0xFF]);
    }
}
