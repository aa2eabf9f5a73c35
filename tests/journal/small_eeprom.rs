//! The storage in an EEPROM of 4 KiB: fewer tools and axes, and the same promise.

use std::num::NonZeroU8;

use leadscrew::settings::{Change, EepromStore, SMALL_EEPROM_KIB, StoreError, ToolEntry};

use crate::{
    cases::rounds,
    eeprom::{Cells, on, power_up_with, store_with},
    history::{Contents, History},
};

type Small = EepromStore<Cells, SMALL_EEPROM_KIB>;

/// An EEPROM as it is sold: a 24C32 has pages of 32 bytes.
fn new() -> Cells {
    Cells::with(SMALL_EEPROM_KIB * 1024, 32)
}

fn store(cells: Cells, change: Change, contents: &Contents) -> Cells {
    store_with::<SMALL_EEPROM_KIB>(cells, change, contents)
}

fn contents(cells: Cells) -> Contents {
    let (_, loaded) = power_up_with::<_, SMALL_EEPROM_KIB>(cells).unwrap();
    loaded.contents
}

/// Everything as large as it can be.
fn fullest() -> Contents {
    let mut history = History::new(11);
    let mut contents = Contents::default();
    for _ in 0..40 {
        history.change();
    }
    contents.stored = history.contents.stored;
    for line in &mut contents.stored.startup {
        line.resize(leadscrew::settings::STORED_LINE, b'x').unwrap();
    }
    contents.stored.build_info = contents.stored.startup[0].clone();
    for (slot, number) in (1..=Small::TOOLS as u8).enumerate() {
        let mut tool = ToolEntry::new(NonZeroU8::new(number).unwrap());
        for (length, sign) in tool.lengths_mut().zip([1, -1, 1, -1]) {
            length.0 = sign * (ToolEntry::LONGEST.0 - i64::from(number));
        }
        contents.tools.replace(slot, Some(tool));
    }
    contents
}

#[test]
fn everything_and_sixteen_tools_fit_4_kib() {
    if !Small::HAS_ROOM {
        return;
    }
    let full = fullest();
    let tools = (0..Small::TOOLS).map(Change::Tool);
    let others = [
        Change::Settings,
        Change::Origins,
        Change::Startup(0),
        Change::Startup(1),
        Change::BuildInfo,
    ];
    let mut cells = new();
    // Twice, so that both copies of each are written.
    for round in [&Contents::default(), &full] {
        for change in others.into_iter().chain(tools.clone()) {
            cells = store(cells, change, round);
        }
    }
    assert_eq!(contents(cells), full);
}

#[test]
fn a_seventeenth_tool_and_a_fifth_axis_are_refused() {
    let (mut store, _) = power_up_with::<_, SMALL_EEPROM_KIB>(new()).unwrap();
    let full = fullest();
    let mut write = |change| store.write(change, &full.stored, &full.tools);
    assert_eq!(write(Change::Tool(15)), Ok(()));
    assert_eq!(write(Change::Tool(16)), Err(StoreError::NoRoom));
    let origins = if Small::HAS_ROOM {
        Ok(())
    } else {
        Err(StoreError::NoRoom)
    };
    assert_eq!(Small::HAS_ROOM, leadscrew::axis::AXES <= 4);
    assert_eq!(write(Change::Origins), origins);
}

#[test]
fn a_loss_of_power_at_any_byte_of_4_kib_leaves_the_old_or_the_new() {
    if !Small::HAS_ROOM {
        return;
    }
    let mut history = History::new(12);
    let mut cells = store(new(), history.change(), &history.contents);
    let mut kept = 0_u64;
    let rounds = rounds(20);
    for round in 0..rounds {
        let old = history.contents.clone();
        let change = history.change();
        let new = history.contents.clone();
        let all = store(cells.clone(), change, &new).written - cells.written;
        for after in 0..all {
            let mut interrupted = cells.clone();
            interrupted.cut_after(after, round * 1000 + after);
            let left = contents(on(store(interrupted, change, &new)));
            assert!(
                left == old || left == new,
                "round {round}, {change:?}, after {after}"
            );
            kept += u64::from(left == old);
        }
        cells = store(cells, change, &new);
    }
    assert!(kept > 25 * rounds, "{kept}");
}
