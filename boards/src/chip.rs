//! Chips: `boards/chips/*.toml`.

use std::{collections::BTreeMap, fmt, fs, path::Path};

use serde::Deserialize;

use crate::{Fault, Pin, pin::read_range};

/// A family of chips that differ in their flash and package only.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chip {
    /// Its manual, with the sections that the numbers are from.
    pub source: String,
    /// The feature of the HAL for this chip; with `chip-` before it, the one of the firmware.
    pub hal: String,
    /// What the chip says that it is, `DEV_ID` of `DBGMCU_IDCODE`: its own, and those of chips that its firmware also
    /// runs on.
    pub dev_ids: Vec<u16>,
    /// RAM in one piece from 0x2000\_0000 on, KiB.
    pub ram_kib: u32,
    /// Its clocks.
    pub clocks: Clocks,
    /// The general-purpose and advanced timers with outputs that the chip has.
    pub timers: Vec<u8>,
    /// The USARTs that the chip has.
    pub usarts: Vec<u8>,
    /// The sizes of the sectors of 1 MiB of flash, KiB; smaller parts have fewer.
    pub sectors_kib: Vec<u32>,
    /// The parts, by what stands behind `STM32`: `F405RG`.
    pub parts: BTreeMap<String, Part>,
}

/// A part of a chip's family.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// Flash, KiB.
    pub flash_kib: u32,
    /// Pins of the package: `A0-15`.
    pins: Vec<String>,
    /// What probe-rs calls the part.
    pub probe_rs: String,
}

/// The clocks of a chip, as fast as it runs with a clock for USB beside it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Clocks {
    /// The core, MHz.
    pub core_mhz: u32,
    /// Wait states of the flash.
    pub flash_wait_states: u8,
    /// Divider of the bus of USART 2 and 3 and of timers 2 to 7 and 12 to 14.
    pub apb1_divider: u8,
    /// Divider of the bus of USART 1 and 6 and of timers 1 and 8 to 11.
    pub apb2_divider: u8,
}

/// The clock of most chips, MHz, and the others, each with the feature of the firmware for it. The firmware's unit of
/// time follows the clock (`CORE_MHZ` in `src/units.rs`).
const USUAL_MHZ: u32 = 168;
const CLASSES: [(u32, &str); 1] = [(96, "clock-96")];

impl Clocks {
    /// Returns the feature that the firmware needs for the clock of the core, where it needs one.
    pub fn feature(self) -> Option<&'static str> {
        let mut classes = CLASSES.into_iter();
        let class = classes.find(|(mhz, _)| *mhz == self.core_mhz);
        class.map(|(_, feature)| feature)
    }

    /// Returns every feature for the clock of a core.
    pub fn features() -> impl Iterator<Item = &'static str> {
        CLASSES.into_iter().map(|(_, feature)| feature)
    }

    /// Returns the clock of the timers of the slower bus, MHz: one tick of the step timer is a period of half
    /// the core's clock on every chip.
    pub fn apb1_timers_mhz(self) -> u32 {
        self.timers_mhz(self.apb1_divider)
    }

    /// Returns the clock of the timers of the faster bus, MHz.
    pub fn apb2_timers_mhz(self) -> u32 {
        self.timers_mhz(self.apb2_divider)
    }

    /// RM0090 7.2: the timers have twice the clock of a bus that is divided.
    fn timers_mhz(self, divider: u8) -> u32 {
        match divider {
            1 => self.core_mhz,
            _ => self.core_mhz / u32::from(divider) * 2,
        }
    }
}

/// What a manual allows: the proof of the timing rests on it.
struct ManualLimits {
    manual: &'static str,
    /// The features of the HAL for its chips.
    hals: &'static [&'static str],
    /// The fastest clock of the core for 0 wait states of the flash, for 1 and so on, MHz, with a supply of 2.7 V or
    /// more.
    wait_states_mhz: &'static [u32],
    /// The fastest clock of the buses APB1 and APB2, MHz.
    buses_mhz: [u32; 2],
}

/// RM0090 table 10, RM0390 table 5, RM0383 table 5 (flash); 7.2, 6.2 and 6.2 (clocks).
const MANUALS: [ManualLimits; 4] = [
    ManualLimits {
        manual: "RM0090",
        hals: &["f405", "f407"],
        wait_states_mhz: &[30, 60, 90, 120, 150, 168],
        buses_mhz: [42, 84],
    },
    ManualLimits {
        manual: "RM0090",
        hals: &["f429"],
        wait_states_mhz: &[30, 60, 90, 120, 150, 180],
        buses_mhz: [45, 90],
    },
    ManualLimits {
        manual: "RM0390",
        hals: &["f446"],
        wait_states_mhz: &[30, 60, 90, 120, 150, 180],
        buses_mhz: [45, 90],
    },
    ManualLimits {
        manual: "RM0383",
        hals: &["f411"],
        wait_states_mhz: &[30, 64, 90, 100],
        buses_mhz: [50, 100],
    },
];

/// Returns what clocks promise beyond the manual of a chip, if anything.
fn beyond_manual(hal: &str, clocks: Clocks) -> Option<String> {
    let mut manuals = MANUALS.iter();
    let Some(limits) = manuals.find(|limits| limits.hals.contains(&hal)) else {
        return Some(format!(
            "the limits of the clocks of `{hal}` are not known (MANUALS in boards/src/chip.rs)"
        ));
    };
    let (manual, core_mhz) = (limits.manual, clocks.core_mhz);
    let mut fast_enough = limits.wait_states_mhz.iter();
    let Some(least) = fast_enough.position(|fastest| core_mhz <= *fastest) else {
        return Some(format!("{manual} does not allow a core at {core_mhz} MHz"));
    };
    if usize::from(clocks.flash_wait_states) < least {
        return Some(format!(
            "{manual} requires {least} wait states of the flash at {core_mhz} MHz, not {}",
            clocks.flash_wait_states
        ));
    }
    let dividers = [("apb1", clocks.apb1_divider), ("apb2", clocks.apb2_divider)];
    let mut buses = dividers.into_iter().zip(limits.buses_mhz);
    buses.find_map(|((bus, divider), fastest_mhz)| {
        if ![1, 2, 4, 8, 16].contains(&divider) {
            return Some(format!("`{bus}_divider` is 1, 2, 4, 8 or 16"));
        }
        let is_too_fast = core_mhz > fastest_mhz * u32::from(divider);
        is_too_fast.then(|| {
            format!(
                "{manual} allows {fastest_mhz} MHz on {bus}: a core at {core_mhz} MHz divided by {divider} is faster"
            )
        })
    })
}

impl fmt::Display for Clocks {
    /// Writes the core's MHz, the wait states, and the dividers of both buses: `168/5/4/2`.
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            core_mhz,
            flash_wait_states,
            apb1_divider,
            apb2_divider,
        } = self;
        write!(
            to,
            "{core_mhz}/{flash_wait_states}/{apb1_divider}/{apb2_divider}"
        )
    }
}

impl Chip {
    /// Returns every chip of the folder of chips.
    pub(crate) fn all(folder: &Path) -> Result<Vec<Self>, Fault> {
        let listing = fs::read_dir(folder)
            .map_err(|error| Fault::of_file(folder, format!("cannot be read: {error}")))?;
        let mut files: Vec<_> = listing.flatten().map(|entry| entry.path()).collect();
        files.retain(|file| file.extension().is_some_and(|kind| kind == "toml"));
        files.sort();
        files.iter().map(|file| Self::read(file)).collect()
    }

    fn read(file: &Path) -> Result<Self, Fault> {
        let text = fs::read_to_string(file)
            .map_err(|error| Fault::of_file(file, format!("cannot be read: {error}")))?;
        let chip: Self =
            toml::from_str(&text).map_err(|error| Fault::of_file(file, error.to_string()))?;
        if let Some(message) = beyond_manual(&chip.hal, chip.clocks) {
            return Err(Fault::of_file(file, message));
        }
        let core_mhz = chip.clocks.core_mhz;
        if core_mhz != USUAL_MHZ && chip.clocks.feature().is_none() {
            let classes = CLASSES.map(|(mhz, _)| mhz.to_string()).join(", ");
            let message = format!(
                "the firmware has no unit of time for {core_mhz} MHz; it has {USUAL_MHZ}, {classes}"
            );
            return Err(Fault::of_file(file, message));
        }
        Ok(chip)
    }
}

impl Part {
    /// Returns the pins of the package: `A0-15, B0-10`.
    pub(crate) fn pins(&self) -> String {
        self.pins.join(", ")
    }

    /// Returns whether the package has a pin.
    pub(crate) fn has(&self, pin: Pin) -> bool {
        let ranges = self.pins.iter().flat_map(|range| read_range(range));
        ranges.flatten().any(|other| other == pin)
    }
}
