//! The storage in an EEPROM that loses power at any written byte.

use leadscrew::settings::{
    Change, EEPROM_KIB, Eeprom, EepromError, EepromStore, PAGE_BYTES, StoreError, TOOLS, ToolTable,
};

use crate::{
    cases::rounds,
    history::{Contents, History, Loaded},
};

/// Bytes of the larger EEPROM.
pub(crate) const EEPROM_BYTES: usize = EEPROM_KIB * 1024;

/// The cells of an EEPROM.
#[derive(Clone)]
pub(crate) struct Cells {
    pub(crate) bytes: Vec<u8>,
    /// Bytes of a page of the chip: what a write may spoil when the power is lost.
    page: usize,
    /// Bytes written so far.
    pub(crate) written: u64,
    /// Bytes before the one at which the power is lost; `None` without a loss.
    left: Option<u64>,
    pub(crate) is_off: bool,
    /// Whether writes change nothing, as with a protected chip.
    is_protected: bool,
    random: u64,
}

impl Cells {
    /// Returns an EEPROM as it is sold.
    pub(crate) fn new() -> Self {
        Self::with(EEPROM_BYTES, 64)
    }

    /// Returns one of other bytes in other pages.
    pub(crate) fn with(bytes: usize, page: usize) -> Self {
        Self {
            bytes: vec![0xff; bytes],
            page,
            written: 0,
            left: None,
            is_off: false,
            is_protected: false,
            random: 1,
        }
    }

    /// Loses the power at the byte after the next `bytes`; `seed` determines what is left of the page.
    pub(crate) fn cut_after(&mut self, bytes: u64, seed: u64) {
        self.left = Some(bytes);
        self.random = seed;
    }

    fn next(&mut self) -> u8 {
        self.random = self
            .random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.random >> 40) as u8
    }

    /// Writes a byte. When the power is lost, any byte of the page may be lost with it.
    pub(crate) fn write_byte(&mut self, address: usize, byte: u8) {
        if self.is_off || self.is_protected {
            return;
        }
        self.written += 1;
        match &mut self.left {
            Some(0) => {
                self.is_off = true;
                let page = address - address % self.page;
                let how = self.next() % 4;
                for at in page..page + self.page {
                    let any = self.next();
                    match how {
                        0 if at == address => self.bytes[at] = any,
                        1 if at >= address => self.bytes[at] = 0xff,
                        2 if any & 1 == 0 => self.bytes[at] = any,
                        _ => {}
                    }
                }
            }
            Some(left) => {
                *left -= 1;
                self.bytes[address] = byte;
            }
            None => self.bytes[address] = byte,
        }
    }

    fn check(&self) -> Result<(), EepromError> {
        if self.is_off {
            Err(EepromError::NoAcknowledge)
        } else {
            Ok(())
        }
    }
}

impl Eeprom for Cells {
    fn read(&mut self, address: u16, bytes: &mut [u8]) -> Result<(), EepromError> {
        self.check()?;
        let from = usize::from(address);
        bytes.copy_from_slice(&self.bytes[from..from + bytes.len()]);
        Ok(())
    }

    fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EepromError> {
        self.check()?;
        let address = usize::from(address);
        assert!(
            address % PAGE_BYTES + bytes.len() <= PAGE_BYTES,
            "{address}: a write of {} bytes leaves its page",
            bytes.len()
        );
        for (at, &byte) in (address..).zip(bytes) {
            self.write_byte(at, byte);
        }
        self.check()
    }
}

/// Switches the power on and reads what is stored.
pub(crate) fn power_up<E: Eeprom>(eeprom: E) -> Result<(EepromStore<E>, Loaded), StoreError> {
    power_up_with(eeprom)
}

/// The same with an EEPROM of so many KiB.
pub(crate) fn power_up_with<E: Eeprom, const KIB: usize>(
    eeprom: E,
) -> Result<(EepromStore<E, KIB>, Loaded), StoreError> {
    let mut store = EepromStore::new(eeprom);
    let loaded = store.load()?;
    let mut contents = Contents {
        stored: loaded.stored,
        tools: ToolTable::new(),
    };
    store.load_tools(&mut contents.tools)?;
    let is_first_boot = loaded.is_first_boot;
    let damaged = loaded.damaged;
    Ok((
        store,
        Loaded {
            contents,
            is_first_boot,
            damaged,
        },
    ))
}

/// The EEPROM of a machine, with the power on again.
pub(crate) fn on(mut cells: Cells) -> Cells {
    cells.is_off = false;
    cells.left = None;
    cells
}

/// Stores a change in an EEPROM, which may lose its power: returns what is left.
pub(crate) fn store(cells: Cells, change: Change, contents: &Contents) -> Cells {
    store_with::<EEPROM_KIB>(cells, change, contents)
}

/// The same with an EEPROM of so many KiB.
pub(crate) fn store_with<const KIB: usize>(
    cells: Cells,
    change: Change,
    contents: &Contents,
) -> Cells {
    let Ok((mut store, _)) = power_up_with::<_, KIB>(cells.clone()) else {
        return cells;
    };
    let written = store.write(change, &contents.stored, &contents.tools);
    let cells = store.eeprom().clone();
    if written.is_ok() && cells.is_off {
        // What follows the record may be cut.
        let (_, loaded) = power_up_with::<_, KIB>(on(cells.clone())).unwrap();
        assert!(loaded.contents == *contents, "{change:?}");
    }
    assert!(written.is_ok() || cells.is_off, "{written:?}");
    cells
}

#[test]
fn a_loss_of_power_at_any_byte_leaves_the_old_or_the_new() {
    let mut history = History::new(1);
    let mut cells = store(Cells::new(), history.change(), &history.contents);
    let (mut cuts, mut kept) = (0_u64, 0_u64);
    let rounds = rounds(40);
    for round in 0..rounds {
        let old = history.contents.clone();
        let change = history.change();
        let new = history.contents.clone();
        let all = store(cells.clone(), change, &new).written - cells.written;
        for after in 0..all {
            let mut interrupted = cells.clone();
            interrupted.cut_after(after, round * 1000 + after);
            let left = on(store(interrupted, change, &new));
            let (mut store, loaded) = power_up(left).unwrap();
            assert!(!loaded.is_first_boot, "round {round}, after {after}");
            assert!(loaded.damaged.is_empty(), "round {round}, after {after}");
            assert!(
                loaded.contents == old || loaded.contents == new,
                "round {round}, {change:?}, after {after}"
            );
            cuts += 1;
            kept += u64::from(loaded.contents == old);
            // It keeps working, with this change.
            store.write(change, &new.stored, &new.tools).unwrap();
            let (_, loaded) = power_up(store.eeprom().clone()).unwrap();
            assert!(loaded.contents == new, "round {round}, after {after}");
        }
        cells = store(cells, change, &new);
    }
    assert!(cuts > 40 * rounds && kept > cuts / 2, "{cuts}, {kept}");
}

#[test]
fn a_life_of_losses_of_power_loses_nothing_else() {
    let mut history = History::new(3);
    let mut cells = store(Cells::new(), Change::Settings, &history.contents);
    let (mut cuts, mut latest) = (0, Contents::default());
    let rounds = rounds(1000);
    for round in 0..rounds {
        history.contents = latest.clone();
        let change = history.change();
        cells.cut_after(history.below(300).into(), round);
        cells = store(cells, change, &history.contents);
        cuts += u64::from(cells.is_off);
        cells = on(cells);
        let (_, loaded) = power_up(cells.clone()).unwrap();
        assert!(!loaded.is_first_boot, "round {round}");
        assert!(loaded.damaged.is_empty(), "round {round}");
        assert!(
            loaded.contents == latest || loaded.contents == history.contents,
            "round {round}, {change:?}"
        );
        latest = loaded.contents;
    }
    assert!(cuts > rounds / 8, "{cuts}");
}

#[test]
fn restoring_everything_is_one_change_of_an_eeprom() {
    let mut history = History::new(4);
    let mut cells = Cells::new();
    for _ in 0..30 {
        let change = history.change();
        cells = store(cells, change, &history.contents);
    }
    for _ in 0..TOOLS {
        let change = history.tool(TOOLS as u32);
        cells = store(cells, change, &history.contents);
    }
    let (old, new) = (history.contents, Contents::default());
    assert!(old.tools != new.tools && old.stored != new.stored);
    let all = store(cells.clone(), Change::RestoreAll, &new).written - cells.written;
    assert!(all > 0);
    for after in 0..=all {
        let mut interrupted = cells.clone();
        interrupted.cut_after(after, after);
        let left = on(store(interrupted, Change::RestoreAll, &new));
        let (_, loaded) = power_up(left).unwrap();
        assert!(loaded.contents == old || loaded.contents == new, "{after}");
    }
}

#[test]
fn a_loss_of_power_during_the_first_start_is_another_first_start_or_none() {
    for after in 0..64 {
        let mut cells = Cells::new();
        cells.cut_after(after, after);
        let mut store = EepromStore::<_>::new(cells);
        let _ = store.load();
        let (_, loaded) = power_up(on(store.eeprom().clone())).unwrap();
        assert_eq!(loaded.contents, Contents::default(), "after {after}");
    }
    let (mut store, loaded) = power_up(Cells::new()).unwrap();
    assert!(loaded.is_first_boot);
    let (_, loaded) = power_up(store.eeprom().clone()).unwrap();
    assert!(!loaded.is_first_boot);
}

#[test]
fn what_other_firmware_has_left_counts_as_nothing() {
    for seed in 0..20 {
        let mut cells = Cells::new();
        cells.random = seed;
        let bytes: Vec<u8> = (0..EEPROM_BYTES).map(|_| cells.next()).collect();
        cells.bytes = bytes;
        let (_, loaded) = power_up(cells).unwrap();
        assert!(loaded.is_first_boot);
        assert_eq!(loaded.contents, Contents::default());
    }
}

#[test]
fn a_damaged_byte_of_an_eeprom_is_reported_where_it_costs_a_startup_line() {
    let mut history = History::new(5);
    let mut cells = Cells::new();
    history.contents.stored.startup[0].push(b'a').unwrap();
    cells = store(cells, Change::Startup(0), &history.contents);
    history.contents.stored.startup[0].push(b'b').unwrap();
    cells = store(cells, Change::Startup(0), &history.contents);
    let new = history.contents;
    let (mut lost, mut whole) = (0, 0);
    for at in 0..EEPROM_BYTES {
        let mut damaged = cells.clone();
        damaged.bytes[at] ^= 0x10;
        let (_, loaded) = power_up(damaged).unwrap();
        let is_lost = loaded.damaged.contains(Change::Startup(0));
        let expected = if is_lost { &Contents::default() } else { &new };
        assert!(loaded.contents == *expected, "{at}");
        lost += usize::from(is_lost);
        whole += usize::from(loaded.damaged.is_empty());
    }
    // Number, length, record with format and generation, and checksum; the same of the record of generations.
    assert_eq!(lost, 4 + 2 + 5 + 2 + 4 + 4 + 2 + 5 + 8 * 5 + 4);
    assert_eq!(whole, EEPROM_BYTES - lost);
}

#[test]
fn the_same_is_not_written_again() {
    let mut history = History::new(6);
    let change = history.setting();
    let cells = store(Cells::new(), change, &history.contents);
    let before = cells.written;
    assert_eq!(store(cells, change, &history.contents).written, before);
}

#[test]
fn a_protected_eeprom_is_an_error_and_not_a_stored_change() {
    let (mut store, _) = power_up(Cells::new()).unwrap();
    store.eeprom().is_protected = true;
    let mut history = History::new(7);
    let change = history.setting();
    let written = store.write(change, &history.contents.stored, &history.contents.tools);
    assert_eq!(written, Err(StoreError::Flash));
}

#[test]
fn a_missing_eeprom_is_an_error_of_each_operation() {
    let mut cells = Cells::new();
    cells.is_off = true;
    let mut store = EepromStore::<_>::new(cells);
    assert_eq!(store.load(), Err(StoreError::Flash));
    let contents = Contents::default();
    let written = store.write(Change::Settings, &contents.stored, &contents.tools);
    assert_eq!(written, Err(StoreError::Flash));
}

#[test]
fn a_line_or_a_tool_that_does_not_exist_is_refused() {
    let (mut store, _) = power_up(Cells::new()).unwrap();
    let contents = Contents::default();
    for change in [Change::Startup(2), Change::Tool(TOOLS)] {
        let written = store.write(change, &contents.stored, &contents.tools);
        assert_eq!(written, Err(StoreError::NoRoom), "{change:?}");
    }
}
