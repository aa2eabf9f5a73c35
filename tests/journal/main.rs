//! The journal on a flash with the chip's rules, and with power cuts at every word and erase; the storage in an EEPROM
//! with losses of power at every byte.

#[path = "../support/cases.rs"]
mod cases;
mod damage;
mod eeprom;
mod history;
mod losses;
#[cfg(not(feature = "axes-4"))]
mod older;
mod postponed;
mod power_cuts;
// The document has the sizes with three axes.
#[cfg(not(feature = "axes-4"))]
mod sizes;
mod small_eeprom;
mod wear;
mod wires;
