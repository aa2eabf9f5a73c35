//! The bytes of each record in flash are those that docs/ARCHITECTURE.md has.

use std::{fmt::Write as _, fs, num::NonZeroU8, path::Path};

use leadscrew::{
    settings::{Change, Journal, STORED_LINE, Stored, ToolEntry},
    sim::Flash,
    units::{MicroDegrees, Nm},
};

use crate::history::{Contents, load, write};

/// Returns the bytes that a change programs into a journal of a new machine.
fn bytes(change: Change, contents: &Contents) -> u64 {
    let mut journal = Journal::new(Flash::<16384>::new());
    load(&mut journal).unwrap();
    let before = journal.flash().operations();
    write(&mut journal, change, contents).unwrap();
    4 * (journal.flash().operations() - before)
}

/// Everything with the shortest records that hold something, and with the longest.
fn shortest_and_longest() -> [Contents; 2] {
    let mut shortest = Stored::default();
    shortest.settings.laser = true;
    shortest.origins.g28[0] = Nm(1);
    let mut longest = shortest.clone();
    longest.origins.rotations.0.fill(MicroDegrees::new(1));
    shortest.build_info.push(b'x').unwrap();
    longest.build_info.resize(STORED_LINE, b'x').unwrap();
    let [mut shortest, mut longest] = [shortest, longest].map(|stored| Contents {
        stored,
        ..Contents::default()
    });
    // A tool is removed in the one, and set in the other.
    shortest.tools.replace(0, None);
    longest
        .tools
        .replace(0, Some(ToolEntry::new(NonZeroU8::MAX)));
    [shortest, longest]
}

/// Returns the last cell of the row of a table in Markdown whose first cell is known.
fn last_cell<'a>(document: &'a str, first: &str) -> Option<&'a str> {
    let row = document
        .lines()
        .find(|line| line.starts_with(&format!("| {first} |")))?;
    row.trim_end_matches([' ', '|']).rsplit("| ").next()
}

/// Returns the records whose size is not that of the document, a line for each.
fn differences(document: &str) -> String {
    let mut found = String::new();
    for (record, change) in [
        ("settings", Change::Settings),
        ("origins", Change::Origins),
        ("`$N0`, `$N1`, `$I`", Change::BuildInfo),
        ("tool, each", Change::Tool(0)),
        ("generations", Change::RestoreAll),
    ] {
        let [least, most] = shortest_and_longest().map(|contents| bytes(change, &contents));
        let range = if least == most {
            least.to_string()
        } else {
            format!("{least} to {most}")
        };
        if last_cell(document, record) != Some(&range) {
            let _ = writeln!(
                found,
                "write {range} into the row of {record} in docs/ARCHITECTURE.md"
            );
        }
    }
    found
}

#[test]
fn every_record_has_the_size_that_the_document_says() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("docs/ARCHITECTURE.md");
    let document = fs::read_to_string(path).unwrap();
    let found = differences(&document);
    assert!(found.is_empty(), "\n{found}");
    let first = last_cell(&document, "settings").unwrap();
    let other = document.replace(&format!("| {first} |"), "| 1 |");
    let expected = format!("write {first} into the row of settings in docs/ARCHITECTURE.md\n");
    assert_eq!(differences(&other), expected);
}
