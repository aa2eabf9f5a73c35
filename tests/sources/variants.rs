//! A list `ALL` of an enum has every variant, in the order of the enum.

use std::{collections::BTreeMap, fmt::Write as _};

use super::sources;

/// The identifier at the beginning of a text.
fn identifier(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_');
    &text[..end.unwrap_or(text.len())]
}

/// The variants of the enums of a source, by the name of the enum.
fn variants(source: &str) -> BTreeMap<&str, Vec<&str>> {
    let mut enums = BTreeMap::new();
    let mut lines = source.lines();
    while let Some(line) = lines.next() {
        let Some((_, name)) = line.split_once("enum ") else {
            continue;
        };
        if line.starts_with(' ') || !line.ends_with('{') {
            continue;
        }
        let body = lines.by_ref().take_while(|line| *line != "}");
        let members = body.filter_map(|line| line.strip_prefix("    "));
        let variants = members.filter(|member| member.starts_with(char::is_uppercase));
        enums.insert(identifier(name), variants.map(identifier).collect());
    }
    enums
}

/// The lists `ALL` of a source, by the name of the type.
fn lists(source: &str) -> BTreeMap<&str, Vec<&str>> {
    source
        .split("\nimpl ")
        .skip(1)
        .filter_map(|block| {
            let block = block.split("\n}").next()?;
            let (_, list) = block.split_once("const ALL: [Self")?;
            let (_, list) = list.split_once("= [")?;
            let names = list.split(']').next()?.split("Self::").skip(1);
            Some((identifier(block), names.map(identifier).collect()))
        })
        .collect()
}

/// The lists that are not complete, a line for each.
fn incomplete(path: &str, source: &str) -> String {
    let mut found = String::new();
    let enums = variants(source);
    for (name, list) in lists(source) {
        let Some(variants) = enums.get(name) else {
            continue;
        };
        if *variants != list {
            let missing = variants.iter().find(|variant| !list.contains(variant));
            let what = missing.map_or_else(
                || format!("put `{name}::ALL` into the order of the variants"),
                |variant| format!("add `Self::{variant}` to `{name}::ALL`"),
            );
            let _ = writeln!(found, "{path}: {what}");
        }
    }
    found
}

#[test]
fn every_list_of_variants_is_complete() {
    let sources = sources(&["src"]);
    let known = sources.iter().map(|(_, source)| {
        let enums = variants(source);
        let lists = lists(source).into_keys();
        lists.filter(|name| enums.contains_key(name)).count()
    });
    assert!(
        known.sum::<usize>() >= 7,
        "the lists are not where they were"
    );
    let found: String = sources
        .iter()
        .map(|(path, source)| incomplete(path, source))
        .collect();
    assert!(found.is_empty(), "\n{found}");
}

#[test]
fn a_variant_that_is_not_in_the_list_is_found() {
    let source = |list: &str| {
        format!(
            "/// An alarm.\npub enum Alarm {{\n    /// One.\n    #[default]\n    One = 1,\n    Two(u8),\n    \
             Three {{\n        Field: u8,\n    }},\n}}\n\nimpl Alarm {{\n    pub const ALL: [Self; 3] = [{list}];\n\n    \
             fn text() {{}}\n}}\n"
        )
    };
    for (list, found) in [
        ("Self::One, Self::Two, Self::Three", ""),
        (
            "\n        Self::One,\n        Self::Two,\n    ",
            "a.rs: add `Self::Three` to `Alarm::ALL`\n",
        ),
        (
            "Self::Two, Self::One, Self::Three",
            "a.rs: put `Alarm::ALL` into the order of the variants\n",
        ),
    ] {
        assert_eq!(incomplete("a.rs", &source(list)), found);
    }
}
