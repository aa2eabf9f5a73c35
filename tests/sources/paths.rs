//! Every file of Rust that a document or a table names is there.

use std::{fmt::Write as _, fs, path::Path};

/// The paths in a text that end in `.rs`, with the number of the line. Names with a `*` or a
/// placeholder in capitals are none.
fn paths(text: &str) -> Vec<(usize, &str)> {
    let is_path = |c: char| c.is_alphanumeric() || matches!(c, '/' | '_' | '.' | '-' | '*');
    text.lines()
        .enumerate()
        .flat_map(|(number, line)| {
            line.split(move |c| !is_path(c))
                .filter(|name| name.contains('/') && name.split('.').next_back() == Some("rs"))
                .filter(|name| !name.contains('*') && !name.starts_with('/'))
                .map(move |name| (number + 1, name))
        })
        .collect()
}

/// The paths that lead nowhere, a line for each. They may begin at the project's root or in `src/`.
fn missing(document: &str, text: &str, root: &Path) -> String {
    let mut missing = String::new();
    for (line, path) in paths(text) {
        if !root.join(path).exists() && !root.join("src").join(path).exists() {
            let _ = writeln!(missing, "{document}:{line}: there is no {path}");
        }
    }
    missing
}

#[test]
fn every_file_that_a_document_names_is_there() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let mut documents = vec!["README.md".to_owned(), "schedule.toml".to_owned()];
    for entry in fs::read_dir(root.join("docs")).expect("docs/ can be read") {
        let name = entry.expect("docs/ can be read").file_name();
        let name = name.to_string_lossy();
        // The table of the glossary has names that are no more.
        if name.ends_with(".md") && name != "GLOSSARY.md" {
            documents.push(format!("docs/{name}"));
        }
    }
    let missing: String = documents
        .iter()
        .map(|document| {
            let text = fs::read_to_string(root.join(document)).expect("documents can be read");
            missing(document, &text, root)
        })
        .collect();
    assert!(missing.is_empty(), "\n{missing}");
}

#[test]
fn a_path_that_leads_nowhere_is_found() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let text = "see `gcode/modal.rs`\nand `src/gcode/no_such_file.rs`, tests/target_*.rs\n";
    assert_eq!(
        missing("a.md", text, root),
        "a.md:2: there is no src/gcode/no_such_file.rs\n"
    );
}

#[test]
fn a_host_test_is_a_module_of_a_folder() {
    let tests = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("tests");
    for entry in fs::read_dir(tests).expect("tests/ can be read") {
        let path = entry.expect("tests/ can be read").path();
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let is_program = path.extension().is_some_and(|extension| extension == "rs");
        assert!(
            !is_program || name.starts_with("target_"),
            "{name} is one more program to link: move it into a folder (docs/contributing.md)"
        );
    }
}
