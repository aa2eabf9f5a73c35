//! What a firmware must never do to its chip: each access to a register is looked at.

use std::collections::BTreeMap;

use rigless::{
    emulator::{Access, AccessKind},
    session::Session,
    time::VirtualNanos,
};

use crate::{chip::Change, machine::Machine, program::Program};

const RCC_CR: u64 = 0x4002_3800;
const RCC_PLLCFGR: u64 = 0x4002_3804;
const FLASH_KEYR: u64 = 0x4002_3C04;
const FLASH_CR: u64 = 0x4002_3C10;
const IWDG_KR: u64 = 0x4000_3000;
const PLLON: u64 = 1 << 24;
const LOCK: u64 = 1 << 31;
/// `PG`, `SER` and `STRT`.
const PROTECTED: u64 = 0x1_0003;
/// The keys of `FLASH_KEYR`: RM0090 3.6.1.
const KEYS: [u64; 2] = [0x4567_0123, 0xCDEF_89AB];
/// Keys of the watchdog: RM0090 21.4.1.
const WATCHDOG_START: u64 = 0xCCCC;
const WATCHDOG_FEED: u64 = 0xAAAA;
/// How long the firmware may leave the watchdog unfed, ms: `src/board/watchdog.rs`.
const UNFED_MS: u64 = 100;
/// What the PLL can make, MHz: RM0090 7.3.2, the data sheets.
const PLL_MHZ: std::ops::RangeInclusive<f64> = 24.0..=180.0;
const HSI_MHZ: f64 = 16.0;

/// The rules, with what they have seen.
#[derive(Debug)]
pub(crate) struct Watch {
    /// The crystal that is there, MHz.
    pub(crate) crystal_mhz: f64,
    /// `RCC_CR` and `RCC_PLLCFGR`, as they were written last.
    control: u64,
    pll: u64,
    /// The last two words written to `FLASH_KEYR`.
    keys: [u64; 2],
    /// `LOCK` of `FLASH_CR`.
    is_locked: bool,
    fed_at: Option<VirtualNanos>,
    /// The supply is too low for the flash.
    pub(crate) is_supply_low: bool,
    /// Words that were programmed.
    pub(crate) words: usize,
    /// Sectors that were erased.
    pub(crate) erased: usize,
    /// Each fault with the instruction that has made it first.
    pub(crate) faults: BTreeMap<String, Option<u64>>,
}

impl Watch {
    pub(crate) fn new(crystal_mhz: u32) -> Self {
        Self {
            crystal_mhz: crystal_mhz.into(),
            control: 0x83,
            pll: 0x2400_3010,
            keys: [0; 2],
            is_locked: true,
            fed_at: None,
            is_supply_low: false,
            words: 0,
            erased: 0,
            faults: BTreeMap::new(),
        }
    }

    /// The chip has been reset.
    pub(crate) fn restart(&mut self) {
        let old = std::mem::replace(self, Self::new(0));
        *self = Self {
            control: self.control,
            pll: self.pll,
            keys: self.keys,
            is_locked: true,
            fed_at: None,
            ..old
        };
    }

    /// Whether the watchdog runs.
    pub(crate) fn has_watchdog(&self) -> bool {
        self.fed_at.is_some()
    }

    pub(crate) fn fault(&mut self, message: impl Into<String>, by: Option<u64>) {
        self.faults.entry(message.into()).or_insert(by);
    }

    /// Records an access that has been made.
    pub(crate) fn record_access(
        &mut self,
        access: &Access,
        session: &mut Session<Machine>,
        program: &Program,
    ) {
        let by = access.program_counter;
        let is_own =
            by.is_some_and(|by| program.holds(by) || (0x2000_0000..0x2004_0000).contains(&by));
        if access.kind == AccessKind::Write {
            if is_own {
                self.write(access, by);
            } else if access.address == RCC_CR {
                self.control = access.value;
            }
        }
        let changes = std::mem::take(&mut session.board_mut().chip.flash.changes);
        for change in changes {
            self.change(change, by, program);
        }
    }

    fn write(&mut self, access: &Access, by: Option<u64>) {
        let value = access.value;
        match access.address {
            RCC_CR => {
                if value & !self.control & PLLON != 0 {
                    self.start_pll(by);
                }
                self.control = value;
            }
            RCC_PLLCFGR => {
                if self.control & PLLON != 0 {
                    self.fault(
                        "RCC_PLLCFGR is written while the PLL runs, which is ignored",
                        by,
                    );
                } else {
                    self.pll = value;
                }
            }
            FLASH_KEYR => {
                self.keys = [self.keys[1], value];
                if self.keys == KEYS {
                    self.is_locked = false;
                }
            }
            FLASH_CR => self.control_flash(value, by),
            IWDG_KR => self.control_watchdog(value, access.virtual_time, by),
            _ => {}
        }
    }

    fn start_pll(&mut self, by: Option<u64>) {
        if self.fed_at.is_none() {
            self.fault("the PLL is switched on before the watchdog is started", by);
        }
        let source = if self.pll >> 22 & 1 == 0 {
            HSI_MHZ
        } else {
            self.crystal_mhz
        };
        let divider = (self.pll & 63).max(1) as f64 * ((self.pll >> 16 & 3) * 2 + 2) as f64;
        let mhz = source / divider * (self.pll >> 6 & 511) as f64;
        if !PLL_MHZ.contains(&mhz) {
            self.fault(format!("RCC_PLLCFGR asks the PLL for {mhz:.0} MHz"), by);
        }
    }

    fn control_flash(&mut self, value: u64, by: Option<u64>) {
        if self.is_locked && value & LOCK == 0 {
            self.fault(
                "FLASH_CR is written while it is locked, which is ignored",
                by,
            );
        }
        if value & LOCK != 0 && value & PROTECTED != 0 {
            self.fault("FLASH_CR is written with LOCK and with what it locks", by);
        }
        if self.is_supply_low && value & PROTECTED != 0 {
            self.fault(
                "FLASH_CR starts a change of the flash while the supply is too low",
                by,
            );
        }
        self.is_locked |= value & LOCK != 0;
    }

    fn control_watchdog(&mut self, value: u64, now: VirtualNanos, by: Option<u64>) {
        let is_fed = value == WATCHDOG_FEED || value == WATCHDOG_START;
        if !is_fed || value == WATCHDOG_FEED && self.fed_at.is_none() {
            return;
        }
        let before = self.fed_at.replace(now);
        let unfed_ns = before.map_or(0, |before| now.0 - before.0);
        if unfed_ns > UNFED_MS * 1_000_000 {
            let message = format!("the watchdog is not fed for more than {UNFED_MS} ms");
            self.fault(message, by);
        }
    }

    fn change(&mut self, change: Change, by: Option<u64>, program: &Program) {
        let loaded = |start: u64, bytes: u64| {
            let mut segments = program.segments.iter();
            segments.any(|(first, content)| {
                *first < start + bytes && start < first + content.len() as u64
            })
        };
        match change {
            Change::Erased(start, bytes) => {
                self.erased += 1;
                if loaded(start, bytes) {
                    self.fault(
                        format!("the sector at {start:#x} is erased, which holds the program"),
                        by,
                    );
                }
            }
            Change::Programmed(address, bytes) => {
                self.words += 1;
                if loaded(address, bytes) {
                    self.fault("the program is overwritten", by);
                }
                if self.is_supply_low {
                    self.fault("flash is programmed while the supply is too low", by);
                }
            }
            Change::OtherSize(address) => {
                self.fault(
                    format!("{address:#x} is stored to with another PSIZE in FLASH_CR"),
                    by,
                );
            }
            Change::WhileBusy => {
                self.fault(
                    "FLASH_CR or the flash is written while the flash is busy",
                    by,
                );
            }
            Change::Sets(address) => {
                self.fault(
                    format!("{address:#x} is programmed twice, with bits that are to be set"),
                    by,
                );
            }
            Change::NotEnabled(address) => {
                self.fault(
                    format!("{address:#x} is stored to without PG in FLASH_CR"),
                    by,
                );
            }
        }
    }
}
