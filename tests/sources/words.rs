//! No name that has been given up comes back: the glossaries list them, old to new.

use std::{collections::BTreeMap, fmt::Write as _, fs, path::Path};

use super::sources;

/// The documents with a table of names.
const GLOSSARIES: [&str; 2] = ["docs/GLOSSARY.md", "proof/GLOSSARY.md"];

/// The folders whose names are read.
const FOLDERS: [&str; 4] = ["src", "tests", "xtask", "proof"];

/// A row of the table.
#[derive(Debug, PartialEq)]
struct Retired {
    /// The old name. In lower case and without `_` it is a word, which no name may have as a part;
    /// otherwise it is a whole name.
    old: String,
    new: String,
    /// Beginning of the paths where it is given up.
    folder: String,
    /// The glossary that says so.
    glossary: String,
}

/// The rows of the table under "Old and new names" of a glossary with this text.
fn retired(glossary: &str, text: &str) -> Vec<Retired> {
    let (_, table) = text
        .split_once("## Old and new names")
        .expect("the glossary has the table");
    table
        .lines()
        .filter(|line| line.starts_with("| `"))
        .flat_map(|line| {
            let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
            let [old, new, folder] = cells[..] else {
                panic!("a row has three cells: {line}");
            };
            old.split(", ")
                .map(|old| Retired {
                    old: old.trim_matches('`').into(),
                    new: new.into(),
                    folder: folder.trim_matches('`').into(),
                    glossary: glossary.into(),
                })
                .collect::<Vec<_>>()
        })
        .collect()
}

/// A line without its comment and its texts.
fn code(line: &str) -> String {
    let mut code = String::new();
    let mut is_text = false;
    let mut characters = line.chars().peekable();
    while let Some(c) = characters.next() {
        match c {
            '\\' if is_text => {
                characters.next();
            }
            '"' => is_text = !is_text,
            '/' if !is_text && characters.peek() == Some(&'/') => break,
            _ if is_text => {}
            // A character, but no lifetime.
            '\'' if characters.clone().nth(1) == Some('\'') => {
                characters.next();
                characters.next();
            }
            c => code.push(c),
        }
    }
    code
}

/// The words that a name is made of, in lower case: `reset_count`, `ResetCount` and `RESET_COUNT`
/// have the same.
fn parts(name: &str) -> Vec<String> {
    let is_constant = !name.contains(char::is_lowercase);
    let mut parts = vec![String::new()];
    for c in name.chars() {
        if c == '_' || c.is_uppercase() && !is_constant {
            parts.push(String::new());
        }
        if c != '_' {
            let last = parts.last_mut().expect("there is one");
            last.extend(c.to_lowercase());
        }
    }
    parts
}

/// Names that a library has given: a file, and the name.
const NAMES_OF_OTHERS: [(&str, &str); 1] = [("tests/virtual_board/src/unmodelled.rs", "told")];

/// The retired names in a file, a line for each.
fn comebacks(path: &str, source: &str, retired: &[Retired]) -> String {
    let here: BTreeMap<&str, &Retired> = retired
        .iter()
        .filter(|row| path.starts_with(&row.folder))
        .map(|row| (row.old.as_str(), row))
        .collect();
    let mut found = String::new();
    let names_of_others = NAMES_OF_OTHERS.map(|(file, name)| (file == path).then_some(name));
    for (number, line) in source.lines().enumerate() {
        let code = code(line);
        let names = code.split(|c: char| !c.is_alphanumeric() && c != '_');
        for name in names.filter(|name| !names_of_others.contains(&Some(name))) {
            let parts = parts(name);
            let words = parts.iter().map(String::as_str);
            let row = here
                .get(name)
                .or_else(|| words.into_iter().find_map(|word| here.get(word)));
            if let Some(row) = row {
                let _ = writeln!(
                    found,
                    "{path}:{}: `{name}`: `{}` is {} now ({})",
                    number + 1,
                    row.old,
                    row.new,
                    row.glossary,
                );
            }
        }
    }
    found
}

/// The retired names of all glossaries.
fn all_retired() -> Vec<Retired> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let rows = GLOSSARIES.iter().flat_map(|glossary| {
        let text = fs::read_to_string(root.join(glossary)).expect("the glossaries can be read");
        let rows = retired(glossary, &text);
        assert!(
            rows.len() > 5,
            "the table of {glossary} is not where it was"
        );
        rows
    });
    rows.collect()
}

/// Whether the names of a folder are read.
fn is_read(folder: &str) -> bool {
    let mut parts = folder.split('/');
    parts.next().is_some_and(|top| FOLDERS.contains(&top))
}

#[test]
fn no_retired_name_comes_back() {
    let retired = all_retired();
    let found: String = sources(&FOLDERS)
        .iter()
        .map(|(path, source)| comebacks(path, source, &retired))
        .collect();
    assert!(found.is_empty(), "\n{found}");
}

#[test]
fn each_folder_of_the_tables_is_there_and_read() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    for row in all_retired() {
        let folder = &row.folder;
        assert!(is_read(folder) && root.join(folder).is_dir(), "{row:?}");
    }
    assert!(is_read("xtask/send/") && is_read("tests/"));
    assert!(!is_read("boards/") && !is_read("source/"));
}

#[test]
fn a_retired_name_is_found_as_a_name_and_as_a_part_of_one() {
    let text = "## Old and new names\n\
        | old | new | where |\n|---|---|---|\n\
        | `StepCounts`, `be_patient` | `SegmentRing` | `src/` |\n\
        | `gate` | junction limit | `src/motion/` |\n\
        | `lane` | path | `proof/` |\n";
    let retired = retired("proof/GLOSSARY.md", text);
    assert_eq!(retired.len(), 4);
    for (path, source) in [
        ("src/stepper/mod.rs", "struct StepCounts;"),
        ("src/app.rs", "fn f() { requests.be_patient(); }"),
        ("src/motion/plan.rs", "let first_gate = 1;"),
        ("src/motion/plan.rs", "const GATE_MM: f32 = 1.0;"),
        ("src/motion/plan.rs", "let c = '\"'; struct LastGate;"),
        ("proof/schedule/src/wcet.rs", "let first_lane = 1;"),
    ] {
        let found = comebacks(path, source, &retired);
        assert!(found.contains(":1: "), "{source}: {found:?}");
        assert!(found.contains(" now (proof/GLOSSARY.md)"), "{source}");
    }
    for (path, source) in [
        ("tests/motion/lookahead.rs", "struct StepCounts;"),
        ("src/path/block.rs", "let gate = 1;"),
        ("proof/cost/src/lib.rs", "let always = \"way\";"),
        (
            "src/motion/plan.rs",
            "// gate\nlet navigate = \"gate\"; let delegated = 'g';",
        ),
    ] {
        assert_eq!(comebacks(path, source, &retired), "", "{source}");
    }
}
