//! Changes while nothing may be erased: they wait, and lose nothing.

use leadscrew::settings::{Change, Changes, Erasing, StoreError, TOOLS};

use crate::{
    cases::rounds,
    history::{Contents, History, Small, power_up, write},
};

/// A journal that has been written for a while, at any place of its pages.
fn used(history: &mut History) -> Small {
    let (mut journal, _) = power_up(Small::new());
    for _ in 0..history.below(30) {
        let change = history.change();
        write(&mut journal, change, &history.contents).unwrap();
    }
    journal.into_flash()
}

/// Makes changes while erasing is postponed, until some wait. Returns the contents in effect from the last stored ones
/// to the newest, with the changes that wait.
fn change_until_some_wait(flash: Small, history: &mut History) -> (Small, Vec<Contents>, Changes) {
    let (mut journal, _) = power_up(flash);
    let erases = journal.flash().erases();
    let mut in_effect = vec![history.contents.clone()];
    let mut waiting = Changes::default();
    while waiting.is_empty() || history.below(8) != 0 {
        let change = history.change();
        let Contents { stored, tools } = &history.contents;
        let before = journal.flash().operations();
        match journal.write(change, Erasing::Postponed, stored, tools) {
            Ok(()) => {
                assert!(waiting.is_empty(), "{change:?} overtakes");
                in_effect.clear();
            }
            Err(error) => {
                assert_eq!(error, StoreError::MustWait);
                assert_eq!(journal.flash().operations(), before);
                waiting.insert(change);
            }
        }
        in_effect.push(history.contents.clone());
    }
    assert_eq!(journal.flash().erases(), erases);
    (journal.into_flash(), in_effect, waiting)
}

/// Stores what waits, with a loss of power after some words and erases. Returns the flash, and whether power was lost.
fn store_waiting(
    flash: Small,
    waiting: Changes,
    contents: &Contents,
    power_off: Option<(u64, u64)>,
) -> (Small, bool) {
    let (mut journal, _) = power_up(flash);
    if let Some((after, seed)) = power_off {
        journal.flash().cut_after(after, seed);
    }
    let mut remaining = waiting;
    while let Some(change) = remaining.first() {
        remaining.remove(change);
        if write(&mut journal, change, contents).is_err() {
            break;
        }
    }
    let is_off = journal.flash().is_off();
    (journal.into_flash(), is_off)
}

/// Whether each record of what is stored was in effect at some time.
fn was_in_effect(stored: &Contents, in_effect: &[Contents]) -> bool {
    let any = |is_same: &dyn Fn(&Contents) -> bool| in_effect.iter().any(is_same);
    let now = &stored.stored;
    any(&|then| then.stored.settings == now.settings)
        && any(&|then| then.stored.origins == now.origins)
        && any(&|then| then.stored.build_info == now.build_info)
        && (0..now.startup.len())
            .all(|line| any(&|then| then.stored.startup[line] == now.startup[line]))
        && (0..TOOLS).all(|slot| any(&|then| then.tools.slot(slot) == stored.tools.slot(slot)))
}

#[test]
fn what_waits_is_stored_later_and_a_loss_of_power_before_leaves_what_was_stored() {
    for seed in 0..rounds(60) {
        let mut history = History::new(1000 + seed);
        let flash = used(&mut history);
        let (flash, in_effect, waiting) = change_until_some_wait(flash, &mut history);
        let (_, loaded) = power_up(flash.clone());
        assert_eq!(loaded.contents, in_effect[0], "seed {seed}");
        let newest = &history.contents;
        let (flash, _) = store_waiting(flash, waiting, newest, None);
        let (_, loaded) = power_up(flash);
        assert_eq!(&loaded.contents, newest, "seed {seed}, {waiting:?}");
    }
}

#[test]
fn a_loss_of_power_while_what_waits_is_stored_leaves_old_or_new_records() {
    let mut interruptions = 0;
    for seed in 0..rounds(6) {
        let mut history = History::new(2000 + seed);
        let flash = used(&mut history);
        let (flash, in_effect, waiting) = change_until_some_wait(flash, &mut history);
        for after in 0.. {
            let power_off = Some((after, seed * 1000 + after));
            let (left, is_off) =
                store_waiting(flash.clone(), waiting, &history.contents, power_off);
            if !is_off {
                break;
            }
            interruptions += 1;
            let (_, loaded) = power_up(left);
            assert!(!loaded.is_first_boot, "seed {seed}, after {after}");
            assert!(
                was_in_effect(&loaded.contents, &in_effect),
                "seed {seed}, after {after}: {:?}",
                loaded.contents
            );
        }
    }
    assert!(interruptions > 250, "{interruptions}");
}

#[test]
fn a_journal_that_cannot_be_read_is_made_anew_only_when_it_may_be_erased() {
    let mut history = History::new(5);
    let (mut journal, _) = power_up(used(&mut history));
    // Both pages look closed, after the journal has been read.
    let size = journal.flash().contents().len() / 2;
    for sector in [0, size] {
        journal.flash().contents_mut()[sector..sector + size - 512].fill(0);
    }
    let erases = journal.flash().erases();
    let change = history.setting();
    let Contents { stored, tools } = &history.contents;
    let written = journal.write(change, Erasing::Postponed, stored, tools);
    assert_eq!(written, Err(StoreError::MustWait));
    assert_eq!(journal.flash().erases(), erases);
    assert_eq!(write(&mut journal, change, &history.contents), Ok(()));
    let (_, loaded) = power_up(journal.into_flash());
    assert_eq!(loaded.contents, history.contents);
}

#[test]
fn every_change_has_a_place_of_its_own_and_what_clears_comes_first() {
    let mut waiting = Changes::default();
    let tools = (0..TOOLS).map(Change::Tool);
    let others = [
        Change::BuildInfo,
        Change::Startup(1),
        Change::Startup(0),
        Change::Origins,
        Change::Settings,
        Change::RestoreSettings,
        Change::RestoreOrigins,
        Change::RestoreAll,
    ];
    let all: Vec<_> = tools.chain(others).collect();
    for &change in &all {
        waiting.insert(change);
        waiting.insert(change);
    }
    assert_eq!(waiting.count() as usize, all.len());
    let mut order = Vec::new();
    while let Some(change) = waiting.first() {
        waiting.remove(change);
        order.push(change);
    }
    assert!(all.iter().all(|change| order.contains(change)), "{order:?}");
    assert_eq!(
        order[..3],
        [
            Change::RestoreAll,
            Change::RestoreOrigins,
            Change::RestoreSettings
        ]
    );
}
