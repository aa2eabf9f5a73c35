//! The EEPROM of the settings, on two pins of the board's file.
//!
//! The pins are switched by the program, a bit at a time: any two do, and no peripheral can hang. An exchange is at
//! rest, in a task without a deadline; whatever interrupts it makes it longer, and nothing else.

use cortex_m::asm;
use leadscrew::settings::{Eeprom, EepromError, TwoWireEeprom, Wires};

use super::{chosen::WIRING, pac, watchdog};

/// Turns of `asm::delay` in a wait, three cycles each: 2 µs, ten times as long at the frequency of the internal
/// oscillator.
const WAIT_TURNS: u32 = WIRING.core_hz / 10_000_000 * 7;

/// The EEPROM. A transfer lasts some ms, and 75 ms with one that does not answer; the watchdog is fed in each wait.
pub(crate) struct SettingsEeprom(TwoWireEeprom<Pins>);

/// The pins.
struct Pins;

impl SettingsEeprom {
    /// Returns the EEPROM, in the place of the flash. The clocks of the ports must run.
    pub(super) fn new(_: pac::FLASH) -> Self {
        WIRING.eeprom.clock.make_open_drain();
        WIRING.eeprom.data.make_open_drain();
        Self(TwoWireEeprom::new(Pins))
    }
}

impl Eeprom for SettingsEeprom {
    fn read(&mut self, address: u16, bytes: &mut [u8]) -> Result<(), EepromError> {
        self.0.read(address, bytes)
    }

    fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EepromError> {
        self.0.write(address, bytes)
    }
}

impl Wires for Pins {
    fn set_clock(&mut self, is_high: bool) {
        WIRING.eeprom.clock.set(is_high);
    }

    fn set_data(&mut self, is_high: bool) {
        WIRING.eeprom.data.set(is_high);
    }

    fn clock(&mut self) -> bool {
        WIRING.eeprom.clock.is_high()
    }

    fn data(&mut self) -> bool {
        WIRING.eeprom.data.is_high()
    }

    fn wait(&mut self) {
        watchdog::feed();
        asm::delay(WAIT_TURNS);
    }
}
