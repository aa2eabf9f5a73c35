//! A machine's whole life of changes.

use leadscrew::sim::Flash;

use crate::history::{History, power_up, write};

#[test]
fn ten_thousand_changes_wear_both_sectors_alike() {
    let mut history = History::new(5);
    let (mut journal, loaded) = power_up(Flash::<16384>::new());
    assert!(loaded.is_first_boot);
    for round in 0..10_000 {
        let change = history.change();
        write(&mut journal, change, &history.contents).unwrap();
        if round % 1000 == 0 {
            let loaded;
            (journal, loaded) = power_up(journal.into_flash());
            assert_eq!(loaded.contents, history.contents, "round {round}");
        }
    }
    let words = journal.flash().operations();
    let [one, other] = journal.flash().erases();
    println!("{words} operations, {one} and {other} erases");
    assert!(one.abs_diff(other) <= 1, "{one} and {other}");
    // The chip stands 10 000 erases of each sector (STM32F405 data sheet, table 42): of the largest
    // records, those of six axes with nine work coordinate systems, 900 000 changes (109 erases here).
    assert!((10..120).contains(&one), "{one}");
    assert_eq!(power_up(journal.into_flash()).1.contents, history.contents);
}

#[test]
fn what_is_stored_already_is_not_stored_again() {
    let mut history = History::new(6);
    let (mut journal, _) = power_up(Flash::<16384>::new());
    for _ in 0..50 {
        let change = history.setting();
        write(&mut journal, change, &history.contents).unwrap();
        let operations = journal.flash().operations();
        write(&mut journal, change, &history.contents).unwrap();
        assert_eq!(journal.flash().operations(), operations);
    }
}
