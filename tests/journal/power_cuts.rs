//! Power cuts.

use leadscrew::{
    settings::{Change, Journal, StoreError, TOOLS},
    sim::Flash,
};

use crate::{
    cases::rounds,
    history::{Contents, History, Small, load, power_up, write},
};

/// Numbers of words and erases of a change.
fn operations<const SIZE: usize>(flash: &Flash<SIZE>, change: Change, contents: &Contents) -> u64 {
    let (mut journal, _) = power_up(flash.clone());
    let before = journal.flash().operations();
    write(&mut journal, change, contents).unwrap();
    journal.flash().operations() - before
}

/// Contents of a flash after a power cut during a change.
fn cut_power<const SIZE: usize>(
    flash: &Flash<SIZE>,
    change: Change,
    contents: &Contents,
    after: u64,
    seed: u64,
) -> Flash<SIZE> {
    let (mut journal, _) = power_up(flash.clone());
    journal.flash().cut_after(after, seed);
    let written = write(&mut journal, change, contents);
    let flash = journal.into_flash();
    match written {
        // The mark behind the record was cut.
        Ok(()) => assert!(power_up(flash.clone()).1.contents == *contents),
        Err(error) => assert_eq!(error, StoreError::Flash),
    }
    flash
}

/// A flash in which a change was stored.
fn stored_in<const SIZE: usize>(
    flash: Flash<SIZE>,
    change: Change,
    contents: &Contents,
) -> Flash<SIZE> {
    let (mut journal, _) = power_up(flash);
    write(&mut journal, change, contents).unwrap();
    journal.into_flash()
}

#[test]
fn a_power_cut_at_any_word_or_erase_leaves_the_old_or_the_new() {
    let mut history = History::new(1);
    let mut flash = power_up(Small::new()).0.into_flash();
    let (mut cuts, mut kept) = (0_u64, 0_u64);
    let rounds = rounds(60);
    for round in 0..rounds {
        let old = history.contents.clone();
        let change = history.change();
        let new = history.contents.clone();
        for after in 0..operations(&flash, change, &new) {
            let left = cut_power(&flash, change, &new, after, round * 1000 + after);
            let (mut journal, loaded) = power_up(left);
            assert!(!loaded.is_first_boot, "round {round}, after {after}");
            assert!(
                loaded.damaged.is_empty(),
                "round {round}, after {after} {change:?} {:?}",
                loaded.damaged
            );
            assert!(
                loaded.contents == old || loaded.contents == new,
                "round {round}, {change:?}, after {after}: {:?}",
                loaded.contents
            );
            cuts += 1;
            kept += u64::from(loaded.contents == old);
            // The journal keeps working, with this change and the next.
            write(&mut journal, change, &new).unwrap();
            let (_, loaded) = power_up(journal.into_flash());
            assert_eq!(loaded.contents, new, "round {round}, after {after}");
        }
        flash = stored_in(flash, change, &new);
    }
    assert!(
        cuts > 24 * rounds && kept > 0,
        "{cuts} cuts, {kept} kept the old"
    );
    // A few rounds fill no sector again.
    assert!(rounds < 60 || flash.erases().iter().all(|&erases| erases > 2));
}

#[test]
fn a_second_cut_while_the_first_is_made_good_loses_nothing() {
    let mut history = History::new(2);
    let mut flash = power_up(Small::new()).0.into_flash();
    for round in 0..rounds(20) {
        let old = history.contents.clone();
        let change = history.change();
        let new = history.contents.clone();
        for first in 0..operations(&flash, change, &new) {
            let left = cut_power(&flash, change, &new, first, round + first);
            // At most a page is carried over anew: its words, and an erase.
            for second in [0, 1, 2, 3, 4, 5, 8, 60, 200, 400] {
                let mut flash = left.clone();
                flash.power_up();
                flash.cut_after(second, round * 7 + first * 3 + second);
                let mut journal = Journal::new(flash);
                let _ = load(&mut journal).and_then(|_| write(&mut journal, change, &new));
                let (_, loaded) = power_up(journal.into_flash());
                assert!(
                    loaded.contents == old || loaded.contents == new,
                    "round {round}, {change:?}, after {first} and {second}"
                );
            }
        }
        flash = stored_in(flash, change, &new);
    }
}

#[test]
fn a_life_of_power_cuts_loses_nothing() {
    let mut history = History::new(3);
    let mut flash = power_up(Small::new()).0.into_flash();
    let (mut cuts, mut latest) = (0, Contents::default());
    let rounds = rounds(2_000);
    for round in 0..rounds {
        history.contents = latest.clone();
        let change = history.change();
        let after = history.below(150).into();
        flash.cut_after(after, round);
        let mut journal = Journal::new(flash);
        let _ = load(&mut journal).and_then(|_| write(&mut journal, change, &history.contents));
        cuts += u32::from(journal.flash().is_off());
        let (journal, loaded) = power_up(journal.into_flash());
        assert!(!loaded.is_first_boot, "round {round}");
        assert!(loaded.damaged.is_empty(), "round {round}");
        assert!(
            loaded.contents == latest || loaded.contents == history.contents,
            "round {round}, {change:?}, after {after}"
        );
        latest = loaded.contents;
        flash = journal.into_flash();
    }
    assert!(u64::from(cuts) > rounds / 4, "{cuts}");
}

#[test]
fn a_power_cut_during_the_first_start_is_another_first_start_or_none() {
    for after in 0..20 {
        for seed in 0..20 {
            let mut flash = Small::new();
            flash.cut_after(after, seed);
            let mut journal = Journal::new(flash);
            let _ = load(&mut journal);
            let (mut journal, loaded) = power_up(journal.into_flash());
            assert_eq!(loaded.contents, Contents::default());
            let mut history = History::new(seed);
            let change = history.setting();
            write(&mut journal, change, &history.contents).unwrap();
            let (_, loaded) = power_up(journal.into_flash());
            assert_eq!(loaded.contents, history.contents);
            assert!(!loaded.is_first_boot);
        }
    }
}

#[test]
fn restoring_everything_is_one_change() {
    let mut history = History::new(4);
    let mut flash = power_up(Small::new()).0.into_flash();
    for _ in 0..30 {
        let change = history.change();
        flash = stored_in(flash, change, &history.contents);
    }
    let (old, new) = (history.contents, Contents::default());
    assert_ne!(old, new);
    for after in 0..operations(&flash, Change::RestoreAll, &new) {
        let left = cut_power(&flash, Change::RestoreAll, &new, after, after);
        let (_, loaded) = power_up(left);
        assert!(loaded.contents == old || loaded.contents == new);
    }
    let flash = stored_in(flash, Change::RestoreAll, &new);
    assert_eq!(power_up(flash).1.contents, new);
}

#[test]
fn a_power_cut_while_a_full_tool_table_changes_loses_no_tool() {
    // Room for the table and a few dozen changes of it.
    let mut flash = power_up(Flash::<3840>::new()).0.into_flash();
    let mut history = History::new(6);
    while history
        .contents
        .tools
        .slot_of(7_u8.try_into().unwrap())
        .is_some()
    {
        let change = history.tool(TOOLS as u32);
        flash = stored_in(flash, change, &history.contents);
    }
    let (mut cuts, mut erases) = (0, flash.erases());
    let rounds = rounds(15);
    for round in 0..rounds {
        let old = history.contents.clone();
        let change = history.tool(TOOLS as u32);
        let new = history.contents.clone();
        for after in 0..operations(&flash, change, &new) {
            let left = cut_power(&flash, change, &new, after, round * 1000 + after);
            let (mut journal, loaded) = power_up(left);
            assert!(
                loaded.contents == old || loaded.contents == new,
                "round {round}, {change:?}, after {after}"
            );
            cuts += 1;
            write(&mut journal, change, &new).unwrap();
            let (_, loaded) = power_up(journal.into_flash());
            assert_eq!(loaded.contents, new, "round {round}, after {after}");
        }
        flash = stored_in(flash, change, &new);
    }
    erases = [0, 1].map(|sector| flash.erases()[sector] - erases[sector]);
    assert!(
        cuts > 25 * rounds && erases != [0, 0],
        "{cuts} cuts, {erases:?}"
    );
}
