//! The walk of a move in `docs/ARCHITECTURE.md` names functions that are in the files named with them.

use std::{collections::BTreeSet, fmt::Write as _, fs, path::Path};

/// Most files that a reader opens to follow the walk, without leaves and with them.
const MOST_FILES: usize = 20;
const MOST_FILES_WITH_LEAVES: usize = 28;

/// A name, the file in `src/` that has the name, and the number of the line in the table.
type Named<'a> = (&'a str, &'a str, usize);

/// The texts between backticks.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

/// The rows of the walk: the file and the functions of the second and third cell; and of the last cell
/// the leaves, `name` of `file`.
fn walk(document: &str) -> (Vec<Named<'_>>, Vec<Named<'_>>) {
    let (mut rows, mut leaves) = (Vec::new(), Vec::new());
    let lines = (1..).zip(document.lines());
    let section = lines
        .skip_while(|(_, line)| *line != "## A move's way")
        .take_while(|(_, line)| !line.starts_with("What this line did not need"));
    for (number, line) in section {
        let cells: Vec<&str> = line.trim_matches('|').split('|').collect();
        let &[_, file, functions, what] = cells.as_slice() else {
            continue;
        };
        let Some(file) = quoted(file).next() else {
            continue;
        };
        rows.extend(quoted(functions).map(|name| (name, file, number)));
        let names: Vec<&str> = what.split("` of `").collect();
        leaves.extend(names.windows(2).filter_map(|two| {
            let name = two[0].rsplit('`').next()?;
            let file = two[1].split('`').next()?;
            Some((name, file, number))
        }));
    }
    (rows, leaves)
}

/// Whether a source defines a function or a type of that name.
fn defines(source: &str, name: &str) -> bool {
    ["fn ", "struct ", "enum "].iter().any(|keyword| {
        let start = format!("{keyword}{name}");
        source.match_indices(&start).any(|(at, _)| {
            let next = source[at + start.len()..].chars().next();
            !next.is_some_and(|c| c.is_alphanumeric() || c == '_')
        })
    })
}

/// The names that their files do not define, a line for each.
fn missing(named: &[Named<'_>], read: impl Fn(&str) -> String) -> String {
    let mut missing = String::new();
    for (name, file, line) in named {
        if !defines(&read(file), name) {
            let _ = writeln!(
                missing,
                "docs/ARCHITECTURE.md:{line}: src/{file} has no `{name}`: follow the move again"
            );
        }
    }
    missing
}

#[test]
fn every_function_of_the_walk_is_in_its_file() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let document = fs::read_to_string(root.join("docs/ARCHITECTURE.md")).expect("it can be read");
    let (rows, leaves) = walk(&document);
    assert!(
        rows.len() > 50 && leaves.len() > 5,
        "the walk is not where it was"
    );
    let read = |file: &str| fs::read_to_string(root.join("src").join(file)).unwrap_or_default();
    let missing = missing(&rows, read) + &missing(&leaves, read);
    assert!(missing.is_empty(), "\n{missing}");
    let mut files: BTreeSet<&str> = rows.iter().map(|(_, file, _)| *file).collect();
    assert!(
        files.len() <= MOST_FILES,
        "{} files to open: make what a reader may skip a leaf",
        files.len()
    );
    files.extend(leaves.iter().map(|(_, file, _)| *file));
    assert!(
        files.len() <= MOST_FILES_WITH_LEAVES,
        "{} files with leaves: {files:?}",
        files.len()
    );
}

#[test]
fn a_function_that_has_gone_elsewhere_is_found() {
    let document = "## A move's way\n\
        | task | file | functions | what |\n|---|---|---|---|\n\
        | | `a.rs` | `begin`, `gone` | then `Leaf` of `b.rs`, and `other` of `b.rs` |\n\
        What this line did not need\n";
    let (rows, leaves) = walk(document);
    assert_eq!(rows, [("begin", "a.rs", 4), ("gone", "a.rs", 4)]);
    assert_eq!(leaves, [("Leaf", "b.rs", 4), ("other", "b.rs", 4)]);
    let read = |file: &str| match file {
        "a.rs" => "pub fn begin() {}\nfn gone_before() {}".to_owned(),
        _ => "pub struct Leaf;\nfn another() {}".to_owned(),
    };
    assert_eq!(
        missing(&rows, read) + &missing(&leaves, read),
        "docs/ARCHITECTURE.md:4: src/a.rs has no `gone`: follow the move again\n\
         docs/ARCHITECTURE.md:4: src/b.rs has no `other`: follow the move again\n"
    );
}
