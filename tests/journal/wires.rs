//! The two wires of an EEPROM, with a chip on them that sees each edge.

use leadscrew::settings::{Change, Eeprom, EepromError, StoreError, TwoWireEeprom, Wires};

use crate::{
    eeprom::{Cells, power_up},
    history::{Contents, History},
};

/// Bytes of a page of a 24C64: an address past the end of the page continues at its beginning.
const PAGE: usize = 32;
/// Selections for which the chip is busy after a write, and waits after which a test has gone on for too long.
const BUSY: u32 = 40;
const LONGEST: u64 = 200_000_000;

/// What the chip does with the bits that come.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// Waits for a start.
    Idle,
    /// Takes the byte of that number since the start.
    Receiving(usize),
    /// Sends a byte.
    Sending(u8),
}

/// A 24C64 on its two wires.
struct Chip {
    cells: Cells,
    state: State,
    /// Rising edges of the clock since the byte began.
    bits: u32,
    byte: u8,
    is_clock_high: bool,
    /// What the master, the chip and a fault pull low.
    is_master_low: bool,
    is_chip_low: bool,
    address: usize,
    latched: Vec<(usize, u8)>,
    busy: u32,
    /// Whether there is no chip, and what is held low for how many waits.
    is_missing: bool,
    clock_held: u64,
    data_held: u64,
    time: u64,
    /// Whether the last selection was one for reading.
    is_read: bool,
}

impl Chip {
    fn new(cells: Cells) -> Self {
        Self {
            cells,
            state: State::Idle,
            bits: 0,
            byte: 0,
            is_clock_high: true,
            is_master_low: false,
            is_chip_low: false,
            address: 0,
            latched: Vec::new(),
            busy: 0,
            is_missing: false,
            clock_held: 0,
            data_held: 0,
            time: 0,
            is_read: false,
        }
    }

    fn level(&self) -> bool {
        !self.is_master_low && !self.is_chip_low && self.data_held == 0
    }

    fn start(&mut self) {
        self.latched.clear();
        self.is_chip_low = false;
        self.state = State::Receiving(0);
        (self.bits, self.byte) = (0, 0);
    }

    fn stop(&mut self) {
        self.is_chip_low = false;
        self.state = State::Idle;
        if !self.latched.is_empty() {
            self.busy = BUSY;
        }
        for (address, byte) in std::mem::take(&mut self.latched) {
            self.cells.write_byte(address, byte);
        }
    }

    fn rising(&mut self) {
        self.bits += 1;
        if let State::Receiving(_) = self.state
            && self.bits <= 8
        {
            self.byte = self.byte << 1 | u8::from(self.level());
        } else if let State::Sending(_) = self.state
            && self.bits == 9
            && self.level()
        {
            // The master has had enough.
            self.state = State::Idle;
        }
    }

    fn falling(&mut self) {
        match self.state {
            State::Receiving(number) if self.bits == 8 => self.take(number),
            State::Receiving(number) if self.bits == 9 => {
                self.is_chip_low = false;
                (self.bits, self.byte) = (0, 0);
                self.state = State::Receiving(number + 1);
                if number == 0 && self.is_read {
                    self.send();
                }
            }
            State::Sending(_) if self.bits == 9 => {
                self.bits = 0;
                self.send();
            }
            State::Sending(byte) => {
                self.is_chip_low = self.bits < 8 && byte >> (7 - self.bits) & 1 == 0;
            }
            State::Idle => self.is_chip_low = false,
            State::Receiving(_) => {}
        }
    }

    fn send(&mut self) {
        let byte = self.cells.bytes[self.address];
        self.address = (self.address + 1) % self.cells.bytes.len();
        self.state = State::Sending(byte);
        self.is_chip_low = byte >> 7 == 0;
    }

    /// Takes a whole byte, and acknowledges it.
    fn take(&mut self, number: usize) {
        let byte = self.byte;
        match number {
            0 => {
                let is_own = byte >> 1 == 0xa0 >> 1 && !self.cells.is_off && !self.is_missing;
                if !is_own || self.busy != 0 {
                    self.busy = self.busy.saturating_sub(1);
                    self.state = State::Idle;
                    return;
                }
                self.is_read = byte & 1 != 0;
            }
            1 => self.address = usize::from(byte) << 8,
            2 => self.address = (self.address | usize::from(byte)) % self.cells.bytes.len(),
            _ => {
                let page = self.address - self.address % PAGE;
                self.latched.push((self.address, byte));
                self.address = page + (self.address + 1) % PAGE;
            }
        }
        self.is_chip_low = true;
    }
}

impl Wires for Chip {
    fn set_clock(&mut self, is_high: bool) {
        if is_high && !self.is_clock_high && self.clock_held == 0 {
            self.is_clock_high = true;
            self.rising();
        } else if !is_high && self.is_clock_high {
            self.is_clock_high = false;
            self.falling();
        }
    }

    fn set_data(&mut self, is_high: bool) {
        let before = self.level();
        self.is_master_low = !is_high;
        if self.is_clock_high && before != self.level() {
            if is_high {
                self.stop();
            } else {
                self.start();
            }
        }
    }

    fn clock(&mut self) -> bool {
        self.is_clock_high
    }

    fn data(&mut self) -> bool {
        self.level()
    }

    fn wait(&mut self) {
        self.time += 1;
        assert!(self.time < LONGEST, "a wait without an end");
        self.data_held = self.data_held.saturating_sub(1);
        if self.clock_held != 0 {
            self.clock_held -= 1;
            if self.clock_held == 0 {
                self.is_clock_high = true;
                self.rising();
            }
        }
    }
}

fn eeprom() -> TwoWireEeprom<Chip> {
    TwoWireEeprom::new(Chip::new(Cells::new()))
}

#[test]
fn what_is_written_is_read_at_any_address() {
    let mut eeprom = eeprom();
    for (address, length) in [(0, 1), (31, 1), (32, 32), (8160, 32), (4097, 7), (256, 3)] {
        let bytes: Vec<u8> = (0..length).map(|at| (at * 37 + length) as u8).collect();
        eeprom.write(address, &bytes).unwrap();
        let mut read = vec![0; bytes.len()];
        eeprom.read(address, &mut read).unwrap();
        assert_eq!(read, bytes, "{address}");
        let from = usize::from(address);
        assert_eq!(eeprom.wires().cells.bytes[from..from + bytes.len()], bytes);
    }
    assert_eq!(eeprom.read(0, &mut []), Ok(()));
}

#[test]
fn an_eeprom_that_is_still_writing_is_waited_for() {
    let mut eeprom = eeprom();
    eeprom.write(64, &[1, 2, 3]).unwrap();
    assert_eq!(eeprom.wires().busy, BUSY);
    let mut read = [0; 3];
    eeprom.read(64, &mut read).unwrap();
    assert_eq!((read, eeprom.wires().busy), ([1, 2, 3], 0));
}

#[test]
fn a_missing_eeprom_is_an_error_after_a_bounded_time() {
    let mut eeprom = eeprom();
    eeprom.wires().is_missing = true;
    assert_eq!(eeprom.read(0, &mut [0]), Err(EepromError::NoAcknowledge));
    assert_eq!(eeprom.write(0, &[0]), Err(EepromError::NoAcknowledge));
    // Waits of 0.65 µs or more: 10 ms for each, as long as a write may take, and far from the 100 ms after which the
    // watchdog may reset the chip.
    let time = eeprom.wires().time;
    assert!((2 * 15_385..2 * 40_000).contains(&time), "{time}");
}

#[test]
fn wires_that_are_held_low_are_an_error_after_a_bounded_time() {
    let mut eeprom = eeprom();
    eeprom.wires().data_held = u64::MAX;
    assert_eq!(eeprom.read(0, &mut [0]), Err(EepromError::Stuck));
    let mut eeprom = self::eeprom();
    eeprom.wires().is_clock_high = false;
    eeprom.wires().clock_held = u64::MAX;
    assert_eq!(eeprom.write(0, &[0]), Err(EepromError::Stuck));
    assert!(eeprom.wires().time < 40_000);
}

#[test]
fn a_clock_that_is_held_low_for_a_while_is_waited_for() {
    let mut eeprom = eeprom();
    eeprom.write(0, &[0x5a]).unwrap();
    eeprom.wires().is_clock_high = false;
    eeprom.wires().clock_held = 500;
    let mut read = [0];
    eeprom.read(0, &mut read).unwrap();
    assert_eq!(read, [0x5a]);
}

#[test]
fn a_read_that_a_reset_has_interrupted_delays_nothing() {
    for edges in 0..40 {
        let mut chip = Chip::new(Cells::new());
        chip.cells.bytes[5] = 0;
        chip.cells.bytes[6] = 0x81;
        // The chip is in the middle of bytes of zeros.
        chip.address = 5;
        chip.is_clock_high = false;
        chip.send();
        for _ in 0..edges {
            let is_high = chip.is_clock_high;
            chip.set_clock(!is_high);
        }
        let mut eeprom = TwoWireEeprom::new(chip);
        let mut read = [0; 2];
        assert_eq!(eeprom.read(5, &mut read), Ok(()), "{edges}");
        assert_eq!(read, [0, 0x81], "{edges}");
    }
}

#[test]
fn everything_is_stored_over_the_wires() {
    let mut history = History::new(8);
    let (mut store, loaded) = power_up(eeprom()).unwrap();
    assert!(loaded.is_first_boot);
    for _ in 0..30 {
        let change = history.change();
        let contents = &history.contents;
        store
            .write(change, &contents.stored, &contents.tools)
            .unwrap();
    }
    let cells = store.eeprom().wires().cells.clone();
    let (_, loaded) = power_up(TwoWireEeprom::new(Chip::new(cells))).unwrap();
    assert!(loaded.contents == history.contents && !loaded.is_first_boot);
}

#[test]
fn an_eeprom_that_disappears_is_an_error_and_is_used_again_when_it_is_back() {
    let (mut store, _) = power_up(eeprom()).unwrap();
    store.eeprom().wires().is_missing = true;
    let mut history = History::new(9);
    let change = history.setting();
    let Contents { stored, tools } = &history.contents;
    assert_eq!(store.write(change, stored, tools), Err(StoreError::Flash));
    store.eeprom().wires().is_missing = false;
    assert_eq!(store.write(change, stored, tools), Ok(()));
    assert_eq!(store.write(Change::Origins, stored, tools), Ok(()));
}
