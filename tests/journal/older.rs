//! What firmware without stamps and marks has stored is read, is not reported as damaged, and gets them.

use std::{fs, path::Path};

use leadscrew::{
    settings::{Change, EepromStore, Journal},
    sim::Flash,
};

use crate::{
    eeprom::{self, Cells},
    history::{Contents, History, load, power_up},
};

/// The flash of the histories.
type Middle = Flash<4096>;

/// Fills bytes with an image: lines of an address and of bytes, all in hexadecimal.
fn fill(bytes: &mut [u8], name: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("journal/older");
    let text = fs::read_to_string(path.join(name)).unwrap();
    for line in text.lines() {
        let (address, digits) = line.split_once(' ').unwrap();
        let address = usize::from_str_radix(address, 16).unwrap();
        for (index, at) in (address..).zip(0..digits.len() / 2) {
            bytes[index] = u8::from_str_radix(&digits[2 * at..2 * at + 2], 16).unwrap();
        }
    }
}

/// The contents after so many changes of a history.
fn after(changes: usize, seed: u64) -> Contents {
    let mut history = History::new(seed);
    for _ in 0..changes {
        history.change();
    }
    history.contents
}

fn flash() -> (Middle, Contents) {
    let mut flash = Middle::new();
    fill(flash.contents_mut(), "flash.hex");
    (flash, after(14, 21))
}

fn cells() -> (Cells, Contents) {
    let mut cells = Cells::new();
    fill(&mut cells.bytes, "eeprom.hex");
    (cells, after(24, 22))
}

#[test]
fn a_flash_of_older_firmware_is_read_and_damage_is_reported_from_then_on() {
    let (flash, contents) = flash();
    let (journal, loaded) = power_up(flash);
    assert!(loaded.contents == contents && loaded.damaged.is_empty());
    assert!(!loaded.is_first_boot);
    let flash = journal.into_flash();
    let operations = flash.operations();
    let (mut journal, loaded) = power_up(flash.clone());
    assert!(loaded.contents == contents && loaded.damaged.is_empty());
    assert_eq!(journal.flash().operations(), operations);
    // Where the newest records are now.
    let pages = &flash.contents()[..8192 - 512];
    let end = pages.iter().rposition(|byte| *byte != 0xff).unwrap();
    let mut reported = 0;
    for at in end - 800..end {
        let mut flash = flash.clone();
        flash.contents_mut()[at] ^= 2;
        let (_, loaded) = power_up(flash);
        assert!(loaded.contents == contents || !loaded.damaged.is_empty());
        reported += usize::from(!loaded.damaged.is_empty());
    }
    assert!(reported > 700, "{reported}");
}

#[test]
fn a_power_cut_while_a_flash_of_older_firmware_gets_stamps_loses_nothing() {
    let (flash, contents) = flash();
    for operations in 0.. {
        let mut flash = flash.clone();
        flash.cut_after(operations, operations);
        let mut journal = Journal::new(flash);
        let _ = load(&mut journal);
        let is_off = journal.flash().is_off();
        let (journal, loaded) = power_up(journal.into_flash());
        assert!(loaded.contents == contents, "{operations}");
        assert!(loaded.damaged.is_empty(), "{operations}");
        let (_, loaded) = power_up(journal.into_flash());
        assert!(loaded.contents == contents && loaded.damaged.is_empty());
        if !is_off {
            assert!(operations > 400, "{operations}");
            break;
        }
    }
}

#[test]
fn an_eeprom_of_older_firmware_is_read_and_damage_is_reported_from_then_on() {
    let (cells, contents) = cells();
    let (mut store, loaded) = eeprom::power_up(cells).unwrap();
    assert!(loaded.contents == contents && loaded.damaged.is_empty());
    let cells = store.eeprom().clone();
    let (mut store, loaded) = eeprom::power_up(cells.clone()).unwrap();
    assert!(loaded.contents == contents && loaded.damaged.is_empty());
    assert_eq!(store.eeprom().written, cells.written);
    let mut reported = 0;
    for at in 0..cells.bytes.len() {
        let mut cells = cells.clone();
        cells.bytes[at] ^= 2;
        let (_, loaded) = eeprom::power_up(cells).unwrap();
        assert!(loaded.contents == contents || !loaded.damaged.is_empty());
        reported += usize::from(!loaded.damaged.is_empty());
    }
    assert!(reported > 500, "{reported}");
}

#[test]
fn a_loss_of_power_while_an_eeprom_of_older_firmware_gets_marks_loses_nothing() {
    let (cells, contents) = cells();
    for bytes in 0.. {
        let mut cells = cells.clone();
        cells.cut_after(bytes, bytes);
        let mut store = EepromStore::<_>::new(cells);
        let _ = store.load();
        let is_off = store.eeprom().is_off;
        let (mut store, loaded) = eeprom::power_up(eeprom::on(store.eeprom().clone())).unwrap();
        assert!(loaded.contents == contents, "{bytes}");
        assert!(loaded.damaged.is_empty(), "{bytes}");
        let mut contents = contents.clone();
        contents.stored.build_info.push(b'x').unwrap();
        let written = store.write(Change::BuildInfo, &contents.stored, &contents.tools);
        assert_eq!(written, Ok(()));
        if !is_off {
            assert!(bytes > 50, "{bytes}");
            break;
        }
    }
}
