//! Words that have changed on their own, and what other firmware has left.

use leadscrew::settings::{Change, Stored};

use crate::history::{History, Small, power_up};

/// Bytes of a page's marks and of the log behind it.
const MARK: usize = 4;
const LOG: usize = 512;

/// The parts of what is stored that differ.
fn differences(one: &Stored, other: &Stored) -> Vec<&'static str> {
    [
        ("settings", one.settings != other.settings),
        ("origins", one.origins != other.origins),
        ("$N0", one.startup[0] != other.startup[0]),
        ("$N1", one.startup[1] != other.startup[1]),
        ("$I", one.build_info != other.build_info),
    ]
    .into_iter()
    .filter_map(|(part, differs)| differs.then_some(part))
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
    let mut values = vec![Stored::default()];
    // One page not full.
    while journal.flash().operations() < 400 {
        let change = history.change();
        if change == Change::RestoreAll {
            history.stored = values.last().unwrap().clone();
        } else {
            journal.write(change, &history.stored).unwrap();
            values.push(history.stored.clone());
        }
    }
    let flash = journal.into_flash();
    assert_eq!(flash.erases(), [0, 0]);
    let page = Small::new().contents().len() / 2 - LOG;
    let mut rotten = 0;
    for place in (MARK..page - MARK).step_by(4) {
        for mask in [u32::MAX, 1, 0x8000_0000, 0x00ff_ff00, 0x5a5a_5a5a] {
            let mut flash = flash.clone();
            let word = flash.contents_mut()[place..].first_chunk_mut().unwrap();
            *word = (u32::from_le_bytes(*word) ^ mask).to_le_bytes();
            let (mut journal, loaded) = power_up(flash);
            let parts = differences(&loaded.stored, &history.stored);
            assert!(parts.len() <= 1, "{place}, {mask:#x}: {parts:?}");
            let is_known = |value: &Stored| !differences(value, &loaded.stored).contains(&parts[0]);
            assert!(parts.is_empty() || values.iter().any(is_known), "{place}");
            rotten += parts.len();
            let mut next = History::new(8);
            next.stored = loaded.stored;
            let change = next.setting();
            journal.write(change, &next.stored).unwrap();
            assert_eq!(power_up(journal.into_flash()).1.stored, next.stored);
        }
    }
    assert!(rotten > 100, "{rotten}");
}

#[test]
fn a_flash_full_of_something_else_is_a_first_start() {
    let mut history = History::new(9);
    for round in 0..200 {
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
        assert_eq!(loaded.stored, Stored::default());
        let mut next = History::new(round);
        for _ in 0..40 {
            let change = next.change();
            journal.write(change, &next.stored).unwrap();
        }
        let (_, loaded) = power_up(journal.into_flash());
        assert_eq!(loaded.stored, next.stored);
        assert!(!loaded.is_first_boot);
    }
}
