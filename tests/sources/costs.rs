//! Costs stand in one place of a file: comments elsewhere are about the machine, not the compiler.

use std::fmt::Write as _;

use super::sources;

/// Words of what the compiler makes of a source.
const WORDS: [&str; 10] = [
    "branch",
    "branches",
    "compiler",
    "inline",
    "inlined",
    "instruction",
    "instructions",
    "memcpy",
    "optimiser",
    "out of line",
];

/// Returns the text of a comment, and whether it belongs to the head of the file.
fn comment(line: &str) -> Option<(&str, bool)> {
    let line = line.trim_start();
    if let Some(text) = line.strip_prefix("//!") {
        return Some((text, true));
    }
    let (_, text) = line.split_once("// ").or_else(|| line.split_once("/// "))?;
    Some((text, false))
}

/// Returns whether a text has a phrase that begins and ends with whole words.
fn has(text: &str, phrase: &str) -> bool {
    text.match_indices(phrase).any(|(start, _)| {
        let before = text[..start].chars().next_back();
        let after = text[start + phrase.len()..].chars().next();
        let is_part = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
        !is_part(before) && !is_part(after)
    })
}

/// Returns the comments on costs that are not below `# Cost` in the head of a file, a line for each.
fn misplaced(path: &str, source: &str) -> String {
    let mut found = String::new();
    let mut is_in_cost = false;
    for (number, line) in source.lines().enumerate() {
        let Some((text, is_head)) = comment(line) else {
            continue;
        };
        let title = text.trim().strip_prefix("# ");
        if let Some(title) = title {
            is_in_cost = is_head && title == "Cost";
        }
        if is_in_cost && is_head {
            continue;
        }
        let words = WORDS.iter().filter(|word| has(text, word));
        let stray = words.chain((title == Some("Cost")).then_some(&"# Cost"));
        for word in stray {
            let _ = writeln!(
                found,
                "{path}:{}: `{word}`: put what the source costs below `//! # Cost` in the head of \
                 the file",
                number + 1
            );
        }
    }
    found
}

#[test]
fn costs_stand_in_the_head_of_a_file() {
    let found: String = sources(&["src"])
        .iter()
        .map(|(path, source)| misplaced(path, source))
        .collect();
    assert!(found.is_empty(), "\n{found}");
}

#[test]
fn a_cost_elsewhere_is_found() {
    for source in [
        "/// Returns a root by a few instructions.\nfn root() {}",
        "let a = 1; // the compiler cannot see this",
        "/// A type.\n///\n/// # Cost\n/// Small.\nstruct A;",
        "//! A file whose functions are inlined.",
        "//! A file.\n//!\n//! # Cost\n//! Fast.\n\n// out of line\nfn a() {}",
        "//! # Cost\n//! Fast.\n//!\n//! # Deadline\n//! As the compiler makes it.",
    ] {
        let found = misplaced("a.rs", source);
        assert_eq!(found.lines().count(), 1, "{source}: {found:?}");
        assert!(found.starts_with("a.rs:"), "{found}");
    }
    for source in [
        "//! A file.\n//!\n//! # Cost\n//! Inlined: no instruction more.\n\nfn a() {}",
        "compiler_fence(SeqCst); // the order of the program",
        "let text = \"instructions\";",
    ] {
        assert_eq!(misplaced("a.rs", source), "", "{source}");
    }
}
