//! Damage to what is stored: the same contents, or a report that says which records are damaged.

use std::num::NonZeroU8;

use leadscrew::{
    axis::AXES,
    settings::{Change, Changes, STARTUP_LINES, TOOLS, ToolEntry, assign},
    sim::Flash,
    units::Nm,
};

use crate::{
    cases::each,
    eeprom::{self, Cells},
    history::{Contents, Loaded, power_up, write},
};

/// A flash with room for all changes in one page.
type Large = Flash<SECTOR>;

/// Bytes of a sector, and of its page.
const SECTOR: usize = 16384;
const PAGE: usize = SECTOR - 512;

/// The changes of a machine that is set up: so many of settings, and others behind the last ones.
fn changes(settings: usize) -> Vec<(Change, Contents)> {
    let mut contents = Contents::default();
    let mut changes = Vec::new();
    for number in 0..settings {
        let statement = format!("{}={}", [110, 120, 130][number % 3], 100 + number);
        assign(&mut contents.stored.settings, statement.as_bytes()).unwrap();
        changes.push((Change::Settings, contents.clone()));
        if number + 3 < settings {
            continue;
        }
        let one = number % 2;
        contents.stored.origins.coordinates.0[one][0] = Nm(1000 * i64::from(number as u8));
        changes.push((Change::Origins, contents.clone()));
        let mut entry = ToolEntry::new(NonZeroU8::new(one as u8 + 3).unwrap());
        entry.offset[2] = Nm(1_000_000 * i64::from(number as u8));
        contents.tools.replace(one, Some(entry));
        changes.push((Change::Tool(one), contents.clone()));
        contents.stored.startup[one] = b"G21 G90".iter().copied().collect();
        changes.push((Change::Startup(one), contents.clone()));
    }
    changes
}

/// Every record that differs.
fn differences(one: &Contents, other: &Contents) -> Changes {
    let mut differences = Changes::default();
    let (stored, others) = (&one.stored, &other.stored);
    let parts = [
        (Change::Settings, stored.settings != others.settings),
        (Change::Origins, stored.origins != others.origins),
        (Change::BuildInfo, stored.build_info != others.build_info),
    ];
    let lines = (0..STARTUP_LINES).map(|line| {
        (
            Change::Startup(line),
            stored.startup[line] != others.startup[line],
        )
    });
    let tools = (0..TOOLS).map(|slot| {
        (
            Change::Tool(slot),
            one.tools.slot(slot) != other.tools.slot(slot),
        )
    });
    for (change, differs) in parts.into_iter().chain(lines).chain(tools) {
        if differs {
            differences.insert(change);
        }
    }
    differences
}

/// The changes of a set.
fn each_of(mut changes: Changes) -> impl Iterator<Item = Change> {
    std::iter::from_fn(move || {
        let change = changes.first()?;
        changes.remove(change);
        Some(change)
    })
}

/// How often damage to an image was reported, and how often it was not and cost nothing.
#[derive(Debug, Default)]
struct Outcomes {
    reported: usize,
    /// More than two records at once.
    all: usize,
    whole: usize,
    /// A first start, which lists the defaults.
    first: usize,
}

impl Outcomes {
    /// Adds what has become of contents. Every record that is another one must be reported by its name.
    fn add(&mut self, loaded: &Loaded, expected: &Contents, what: &str) {
        if loaded.is_first_boot {
            self.first += 1;
            return;
        }
        let mut silent = differences(&loaded.contents, expected);
        each_of(loaded.damaged).for_each(|change| silent.remove(change));
        assert!(
            silent.is_empty(),
            "{what}: {silent:?}, {:?}",
            loaded.damaged
        );
        match loaded.damaged.count() {
            0 => self.whole += 1,
            1 | 2 => self.reported += 1,
            _ => self.all += 1,
        }
    }
}

/// Changes of settings of which one page has room: with six axes each is half as long again.
const MOST_SETTINGS: usize = if AXES > 4 { 15 } else { 23 };

/// An image with so many changes of settings, and its contents.
fn image(settings: usize) -> (Large, Contents) {
    let mut journal = power_up(Large::new()).0;
    let changes = changes(settings);
    for (change, contents) in &changes {
        write(&mut journal, *change, contents).unwrap();
    }
    let flash = journal.into_flash();
    assert_eq!(flash.erases(), [0, 0]);
    (flash, changes.last().unwrap().1.clone())
}

/// The programmed addresses, and the addresses after them up to the end of the sector's records.
fn used(flash: &Large) -> impl Iterator<Item = usize> + use<> {
    let contents = flash.contents();
    let end = contents[..PAGE].iter().rposition(|byte| *byte != 0xff);
    (0..end.unwrap() + 16).chain(PAGE..SECTOR + 8)
}

#[test]
fn each_flipped_bit_of_a_flash_changes_nothing_or_is_reported_by_name() {
    // All are newest records; then most are not, of which none may come back.
    for (settings, step) in [(1, 1), (MOST_SETTINGS, each(101))] {
        let (flash, contents) = image(settings);
        let mut outcomes = Outcomes::default();
        let bits = used(&flash).flat_map(|at| (0..8).map(move |bit| (at, bit)));
        for (at, bit) in bits.step_by(step) {
            let mut flash = flash.clone();
            flash.contents_mut()[at] ^= 1 << bit;
            let (_, loaded) = power_up(flash);
            outcomes.add(&loaded, &contents, &format!("bit {bit} of {at}"));
        }
        let Outcomes {
            reported,
            all,
            whole,
            first,
        } = outcomes;
        assert!(reported > 50 && whole > reported / 4, "{reported}, {whole}");
        // The base of the marks, and the first key behind them.
        assert!(all <= 72 && first == 0, "{all}, {first}");
    }
}

#[test]
fn eight_bytes_of_zeros_in_a_flash_change_nothing_or_are_reported_by_name() {
    let (flash, contents) = image(3);
    let mut outcomes = Outcomes::default();
    for at in used(&flash).step_by(each(3)) {
        let mut flash = flash.clone();
        flash.contents_mut()[at..at + 8].fill(0);
        let (_, loaded) = power_up(flash);
        // A page that looks closed, beside an apparently empty page.
        assert!(!loaded.is_first_boot || !loaded.damaged.is_empty(), "{at}");
        outcomes.add(&loaded, &contents, &at.to_string());
    }
    assert!(
        outcomes.reported > 200 && outcomes.first <= 1,
        "{outcomes:?}"
    );
}

#[test]
fn a_flash_that_is_cut_off_is_reported() {
    let (flash, contents) = image(MOST_SETTINGS);
    let mut outcomes = Outcomes::default();
    for at in (0..SECTOR).step_by(each(7)) {
        let mut flash = flash.clone();
        flash.contents_mut()[at..].fill(0xff);
        let (_, loaded) = power_up(flash);
        assert!(!loaded.is_first_boot || at < 100, "{at}");
        outcomes.add(&loaded, &contents, &at.to_string());
    }
    let Outcomes { all, whole, .. } = outcomes;
    assert!(all > 1000 && whole < 800, "{all}, {whole}");
}

#[test]
fn a_flash_whose_first_bytes_are_overwritten_is_reported() {
    for byte in [0, 0x55, 0xff] {
        for length in [1, 4, 64, 1000, PAGE] {
            let (mut flash, contents) = image(3);
            flash.contents_mut()[..length].fill(byte);
            let (_, loaded) = power_up(flash);
            let differs = !differences(&loaded.contents, &contents).is_empty();
            assert_eq!(!loaded.damaged.is_empty(), differs, "{length} of {byte:#x}");
        }
    }
}

#[test]
fn damage_is_reported_until_the_record_is_stored_anew() {
    let (flash, _) = image(2);
    let mut damaged = [0; 4];
    for at in used(&flash).step_by(each(17)) {
        let mut flash = flash.clone();
        flash.contents_mut()[at] ^= 4;
        let (mut journal, loaded) = power_up(flash);
        let first = loaded.damaged;
        let mut present = loaded.contents;
        // Another record, and as many of it as move all records to the other page.
        let is_lost = first.contains(Change::BuildInfo);
        for length in 0..if at % 170 == 0 && !is_lost { 301 } else { 1 } {
            present.stored.build_info.clear();
            present
                .stored
                .build_info
                .resize(length % 100, b'x')
                .unwrap();
            write(&mut journal, Change::BuildInfo, &present).unwrap();
        }
        let mut expected = first;
        expected.remove(Change::BuildInfo);
        let (mut journal, loaded) = power_up(journal.into_flash());
        assert_eq!(loaded.damaged, expected, "{at}");
        damaged[first.count().min(3) as usize] += 1;
        // Each record as it is; or all at once.
        let mut present = loaded.contents;
        let all: Vec<_> = if at % 2 == 0 {
            present = Contents::default();
            vec![Change::RestoreAll]
        } else {
            each_of(expected).collect()
        };
        for change in all {
            write(&mut journal, change, &present).unwrap();
        }
        let (_, loaded) = power_up(journal.into_flash());
        assert!(loaded.damaged.is_empty(), "{at}: {:?}", loaded.damaged);
        assert!(loaded.contents == present, "{at}");
    }
    assert!(damaged[0] > 10 && damaged[1] > 10, "{damaged:?}");
}

/// An EEPROM with so many changes of settings, and its contents.
fn eeprom_image(settings: usize) -> (Cells, Contents) {
    let mut cells = Cells::new();
    let changes = changes(settings);
    for (change, contents) in &changes {
        cells = eeprom::store(cells, *change, contents);
    }
    (cells, changes.last().unwrap().1.clone())
}

#[test]
fn damage_to_an_eeprom_changes_nothing_or_is_reported_by_name() {
    let (cells, contents) = eeprom_image(5);
    let used: Vec<_> = (0..cells.bytes.len())
        .filter(|&at| cells.bytes[at] != 0xff)
        .collect();
    let mut outcomes = Outcomes::default();
    for bit in (0..8 * used.len()).step_by(each(3)) {
        let mut cells = cells.clone();
        cells.bytes[used[bit / 8]] ^= 1 << (bit % 8);
        let (_, loaded) = eeprom::power_up(cells).unwrap();
        outcomes.add(
            &loaded,
            &contents,
            &format!("bit {} of {}", bit % 8, used[bit / 8]),
        );
    }
    assert!(
        outcomes.reported > 1000 && outcomes.whole > 1000,
        "{outcomes:?}"
    );
    assert_eq!(outcomes.first, 0);
    // The newest record of generations.
    assert!(outcomes.all <= 60 * 8, "{outcomes:?}");
    let mut outcomes = Outcomes::default();
    for at in used.into_iter().filter(|at| at % 4096 < 4096 - 8) {
        let mut cells = cells.clone();
        cells.bytes[at..at + 8].fill(0);
        let (_, loaded) = eeprom::power_up(cells).unwrap();
        outcomes.add(&loaded, &contents, &at.to_string());
    }
    assert_eq!(outcomes.first, 0);
}

#[test]
fn an_eeprom_that_is_cut_off_is_reported() {
    let (cells, contents) = eeprom_image(5);
    let mut outcomes = Outcomes::default();
    for at in (0..cells.bytes.len()).step_by(each(5)) {
        let mut cells = cells.clone();
        cells.bytes[at..].fill(0xff);
        let (_, loaded) = eeprom::power_up(cells).unwrap();
        assert!(!loaded.is_first_boot || at < 64, "{at}");
        outcomes.add(&loaded, &contents, &at.to_string());
    }
    assert!(outcomes.all > 100, "{outcomes:?}");
}

#[test]
fn damage_to_an_eeprom_is_reported_until_the_record_is_stored_anew() {
    let (cells, _) = eeprom_image(3);
    for at in (0..cells.bytes.len())
        .filter(|at| cells.bytes[*at] != 0xff)
        .step_by(each(7))
    {
        let mut cells = cells.clone();
        cells.bytes[at] ^= 4;
        let (mut store, loaded) = eeprom::power_up(cells).unwrap();
        let mut expected = loaded.damaged;
        let mut present = loaded.contents;
        present.stored.build_info.push(b'x').unwrap();
        store
            .write(Change::BuildInfo, &present.stored, &present.tools)
            .unwrap();
        expected.remove(Change::BuildInfo);
        let (mut store, loaded) = eeprom::power_up(store.eeprom().clone()).unwrap();
        assert_eq!(loaded.damaged, expected, "{at}");
        let mut present = loaded.contents;
        let all: Vec<_> = if at % 2 == 0 {
            present = Contents::default();
            vec![Change::RestoreAll]
        } else {
            each_of(expected).collect()
        };
        for change in all {
            store
                .write(change, &present.stored, &present.tools)
                .unwrap();
        }
        let (_, loaded) = eeprom::power_up(store.eeprom().clone()).unwrap();
        assert!(loaded.damaged.is_empty(), "{at}: {:?}", loaded.damaged);
        assert!(loaded.contents == present, "{at}");
    }
}
