//! The storage of everything that outlives power: records in a journal of two flash sectors, or twice in an EEPROM.

mod eeprom;
mod journal;
mod record;
mod sectors;
mod stamp;
mod two_wire;

pub use eeprom::{EEPROM_KIB, Eeprom, EepromError, EepromStore, PAGE_BYTES, SMALL_EEPROM_KIB};
pub use journal::{Journal, Loaded};
pub use two_wire::{TwoWireEeprom, Wires};
