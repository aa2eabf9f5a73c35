//! No type has the name of another one of its crate.

use std::{collections::BTreeMap, fmt::Write as _};

use super::sources;

/// The file whose place a file takes with a feature, or without it.
fn place(path: &str) -> String {
    let path = path.replace("/qemu/", "/").replace("/no_", "/");
    path.replace("/usb_link.", "/serial.")
}

/// The name of the type that a line declares; an alias within an `impl` is none.
fn declared(line: &str) -> Option<&str> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let words = words.strip_prefix(&["pub"]).unwrap_or(&words);
    let words = match words {
        [visibility, rest @ ..] if visibility.starts_with("pub(") => rest,
        words => words,
    };
    let is_alias = words.first() == Some(&"type") && !line.starts_with(' ');
    match words {
        ["struct" | "enum" | "trait", name, ..] => Some(name),
        [_, name, ..] if is_alias => Some(name),
        _ => None,
    }
    .map(|name| {
        name.split(|c: char| !c.is_alphanumeric())
            .next()
            .unwrap_or(name)
    })
}

/// The names that two types of one crate have, a line for each.
fn doubled(files: &[(String, String)]) -> String {
    let mut seen: BTreeMap<(bool, &str), &str> = BTreeMap::new();
    let mut found = String::new();
    for (path, source) in files {
        let is_firmware = path.starts_with("src/board/") || path == "src/app.rs";
        for name in source.lines().filter_map(declared) {
            if let Some(other) = seen.insert((is_firmware, name), path)
                && place(other) != place(path)
            {
                let _ = writeln!(found, "`{name}` is a type of {other} and of {path}");
            }
        }
    }
    found
}

#[test]
fn no_type_has_the_name_of_another_of_its_crate() {
    let found = doubled(&sources(&["src"]));
    assert!(found.is_empty(), "\n{found}");
}

#[test]
fn two_types_of_one_name_are_found() {
    let file = |path: &str, source: &str| (path.to_owned(), source.to_owned());
    for (first, second) in [
        ("pub struct Block {", "enum Block {"),
        ("pub(super) struct Block;", "pub trait Block {"),
        ("type Block = u8;", "mod tests {\n    struct Block;\n}"),
    ] {
        let files = [file("src/a.rs", first), file("src/b.rs", second)];
        let found = doubled(&files);
        assert_eq!(found, "`Block` is a type of src/a.rs and of src/b.rs\n");
    }
    for files in [
        [
            file("src/a.rs", "impl A {\n    type Item = u8;\n}"),
            file("src/b.rs", "impl B {\n    type Item = u8;\n}"),
        ],
        [
            file("src/a.rs", "struct Shared;"),
            file("src/app.rs", "struct Shared;"),
        ],
    ] {
        assert_eq!(doubled(&files), "");
    }
}
