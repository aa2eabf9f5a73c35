//! An EEPROM on two wires (I2C), of the kind 24C32 to 24C512: the master's side, a bit at a time.
//!
//! Both wires are pulled up; master and EEPROM pull them low. NXP UM10204 3.1: the data wire changes while the clock
//! is low, but for the start and the stop of a transfer. Every wait has an end: for a clock that somebody holds low,
//! for the acknowledgement of an EEPROM that is still writing, for a data wire held low by a transfer which a reset has
//! cut off.

use super::eeprom::{Eeprom, EepromError};

/// The two wires.
pub trait Wires {
    /// Lets go of the clock, or pulls it low.
    fn set_clock(&mut self, is_high: bool);
    /// Lets go of the data wire, or pulls it low.
    fn set_data(&mut self, is_high: bool);
    /// Returns whether the clock is high.
    fn clock(&mut self) -> bool;
    /// Returns whether the data wire is high.
    fn data(&mut self) -> bool;
    /// Waits for 0.65 µs or more: at 400 kHz the clock is low for two of them, and high for one.
    fn wait(&mut self);
}

/// The address of the EEPROM whose address pins are low, with the bit of a write; and that of a read.
const WRITE: u8 = 0xa0;
const READ: u8 = 0xa1;
/// Waits for a clock that is held low: 1.3 ms.
const CLOCK_WAITS: u32 = 2000;
/// Selections before an EEPROM that does not acknowledge counts as missing: 20 ms or more, where a write takes 10 ms
/// at most (data sheets of 24C32 to 24C512).
const SELECTIONS: u32 = 1000;
/// Clocks after which an EEPROM has sent the last bit of a byte.
const BYTE_CLOCKS: u32 = 9;

/// An EEPROM on two wires.
#[derive(Debug)]
pub struct TwoWireEeprom<W>(W);

impl<W: Wires> TwoWireEeprom<W> {
    /// Returns the EEPROM on two wires, both of which are let go of.
    pub const fn new(wires: W) -> Self {
        Self(wires)
    }

    /// Returns the wires, mutably.
    pub fn wires(&mut self) -> &mut W {
        &mut self.0
    }

    /// Lets the clock go high.
    fn raise_clock(&mut self) -> Result<(), EepromError> {
        self.0.set_clock(true);
        self.0.wait();
        let is_high = |wires: &mut W| wires.clock();
        if is_high(&mut self.0) {
            return Ok(());
        }
        for _ in 0..CLOCK_WAITS {
            self.0.wait();
            if is_high(&mut self.0) {
                return Ok(());
            }
        }
        Err(EepromError::Stuck)
    }

    fn drop_clock(&mut self) {
        self.0.set_clock(false);
        self.0.wait();
    }

    /// Begins a transfer, or another one after what has been sent.
    fn start(&mut self) -> Result<(), EepromError> {
        self.0.set_data(true);
        self.0.wait();
        self.raise_clock()?;
        if !self.0.data() {
            self.free_data()?;
        }
        self.0.set_data(false);
        self.0.wait();
        self.drop_clock();
        Ok(())
    }

    /// Clocks out the rest of a byte that the EEPROM is in the middle of.
    fn free_data(&mut self) -> Result<(), EepromError> {
        for _ in 0..BYTE_CLOCKS {
            self.drop_clock();
            self.raise_clock()?;
            if self.0.data() {
                return Ok(());
            }
        }
        Err(EepromError::Stuck)
    }

    fn stop(&mut self) -> Result<(), EepromError> {
        self.0.set_data(false);
        self.0.wait();
        self.raise_clock()?;
        self.0.set_data(true);
        self.0.wait();
        Ok(())
    }

    /// Sends a bit, and returns the level of the data wire meanwhile.
    fn bit(&mut self, is_high: bool) -> Result<bool, EepromError> {
        self.0.set_data(is_high);
        self.0.wait();
        self.raise_clock()?;
        let level = self.0.data();
        self.drop_clock();
        Ok(level)
    }

    /// Sends a byte. Returns whether it is acknowledged.
    fn send(&mut self, byte: u8) -> Result<bool, EepromError> {
        for number in (0..8).rev() {
            self.bit(byte >> number & 1 != 0)?;
        }
        Ok(!self.bit(true)?)
    }

    /// Receives a byte, and acknowledges it unless it is the last.
    fn receive(&mut self, is_last: bool) -> Result<u8, EepromError> {
        let mut byte = 0;
        for _ in 0..8 {
            byte = byte << 1 | u8::from(self.bit(true)?);
        }
        self.bit(is_last)?;
        Ok(byte)
    }

    /// Sends bytes that must be acknowledged.
    fn send_all(&mut self, bytes: &[u8]) -> Result<(), EepromError> {
        for &byte in bytes {
            if !self.send(byte)? {
                return Err(EepromError::NoAcknowledge);
            }
        }
        Ok(())
    }

    /// Begins a transfer at an address; an EEPROM that is still writing does not acknowledge before.
    fn select(&mut self, address: u16) -> Result<(), EepromError> {
        for _ in 0..SELECTIONS {
            self.start()?;
            if self.send(WRITE)? {
                return self.send_all(&address.to_be_bytes());
            }
            self.stop()?;
        }
        Err(EepromError::NoAcknowledge)
    }

    /// Ends a transfer, whatever has become of it.
    fn finish(&mut self, transfer: Result<(), EepromError>) -> Result<(), EepromError> {
        let stopped = self.stop();
        transfer.and(stopped)
    }

    fn read_bytes(&mut self, address: u16, bytes: &mut [u8]) -> Result<(), EepromError> {
        self.select(address)?;
        self.start()?;
        self.send_all(&[READ])?;
        let last = bytes.len().saturating_sub(1);
        for (index, byte) in bytes.iter_mut().enumerate() {
            *byte = self.receive(index == last)?;
        }
        Ok(())
    }
}

impl<W: Wires> Eeprom for TwoWireEeprom<W> {
    fn read(&mut self, address: u16, bytes: &mut [u8]) -> Result<(), EepromError> {
        if bytes.is_empty() {
            return Ok(());
        }
        let read = self.read_bytes(address, bytes);
        self.finish(read)
    }

    fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EepromError> {
        let written = self.select(address).and_then(|()| self.send_all(bytes));
        self.finish(written)
    }
}
