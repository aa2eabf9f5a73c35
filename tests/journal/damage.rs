//! Words that have changed on their own, and what other firmware has left.

use leadscrew::settings::TOOLS;

use crate::{
    cases::{each, rounds},
    history::{Contents, History, Small, power_up, write},
};

/// Bytes of a page's marks and of the log behind it.
const MARK: usize = 4;
const LOG: usize = 512;

/// The parts of what is stored that differ: each has a record.
fn differences(one: &Contents, other: &Contents) -> Vec<String> {
    let (stored, others) = (&one.stored, &other.stored);
    let parts = [
        ("settings", stored.settings != others.settings),
        ("origins", stored.origins != others.origins),
        ("$N0", stored.startup[0] != others.startup[0]),
        ("$N1", stored.startup[1] != others.startup[1]),
        ("$I", stored.build_info != others.build_info),
    ];
    let parts = parts
        .into_iter()
        .filter(|(_, differs)| *differs)
        .map(|(part, _)| part.to_owned());
    let slots = (0..TOOLS).filter(|&slot| one.tools.slot(slot) != other.tools.slot(slot));
    parts
        .chain(slots.map(|slot| format!("tool in slot {slot}")))
        .collect()
}

#[test]
fn a_rotten_word_costs_no_more_than_the_record_it_is_in() {
    // With some seeds the word behind the last record is rotten, too.
    for seed in [7, 11, 13] {
        check_rotten_words(seed);
    }
}

fn check_rotten_words(seed: u64) {
    let mut history = History::new(seed);
    let (mut journal, _) = power_up(Small::new());
    let mut values = vec![Contents::default()];
    // One page not full.
    while journal.flash().operations() < 340 {
        let change = history.change();
        if change.clears_tools() {
            history.contents = values.last().unwrap().clone();
        } else {
            write(&mut journal, change, &history.contents).unwrap();
            values.push(history.contents.clone());
        }
    }
    let flash = journal.into_flash();
    assert_eq!(flash.erases(), [0, 0]);
    let page = Small::new().contents().len() / 2 - LOG;
    let mut rotten = 0;
    for place in (MARK..page - MARK).step_by(4 * each(5)) {
        for mask in [u32::MAX, 1, 0x8000_0000, 0x00ff_ff00, 0x5a5a_5a5a] {
            let mut flash = flash.clone();
            let word = flash.contents_mut()[place..].first_chunk_mut().unwrap();
            *word = (u32::from_le_bytes(*word) ^ mask).to_le_bytes();
            let (mut journal, loaded) = power_up(flash);
            let parts = differences(&loaded.contents, &history.contents);
            assert!(parts.len() <= 1, "{place}, {mask:#x}: {parts:?}");
            let is_known =
                |value: &Contents| !differences(value, &loaded.contents).contains(&parts[0]);
            assert!(parts.is_empty() || values.iter().any(is_known), "{place}");
            rotten += parts.len();
            let mut next = History::new(8);
            next.contents = loaded.contents;
            let change = next.setting();
            write(&mut journal, change, &next.contents).unwrap();
            assert_eq!(power_up(journal.into_flash()).1.contents, next.contents);
        }
    }
    assert!(rotten > 100 / each(5), "{rotten}");
}

#[test]
fn a_flash_full_of_something_else_is_a_first_start() {
    let mut history = History::new(9);
    for round in 0..rounds(50) {
        let mut flash = Small::new();
        for byte in flash.contents_mut() {
            *byte = match round {
                0 => 0,
                1 => 0x55,
                _ => history.below(256) as u8,
            };
        }
        let (mut journal, loaded) = power_up(flash);
        assert!(loaded.is_first_boot);
        assert_eq!(loaded.contents, Contents::default());
        let mut next = History::new(round);
        for _ in 0..40 {
            let change = next.change();
            write(&mut journal, change, &next.contents).unwrap();
        }
        let (_, loaded) = power_up(journal.into_flash());
        assert_eq!(loaded.contents, next.contents);
        assert!(!loaded.is_first_boot);
    }
}
