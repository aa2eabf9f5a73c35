//! A sentence of a comment names its noun: it has few pronouns.

use std::fmt::Write as _;

use super::sources;

/// The folders whose comments are read.
const FOLDERS: [&str; 2] = ["src", "tests"];

/// The words that stand for a noun.
const PRONOUNS: [&str; 5] = ["it", "that", "those", "one", "what"];

/// Most pronouns in a sentence.
const MOST_PRONOUNS: usize = 2;

/// The text of a line that is a comment.
fn comment(line: &str) -> Option<&str> {
    let text = line.trim().strip_prefix("//")?;
    Some(text.strip_prefix(['/', '!']).unwrap_or(text).trim())
}

/// Whether a line of a comment begins an item of a list.
fn is_item(text: &str) -> bool {
    let unnumbered = text.trim_start_matches(|c: char| c.is_ascii_digit());
    let is_numbered = unnumbered.len() < text.len() && unnumbered.starts_with(". ");
    is_numbered || text.starts_with("* ") || text.starts_with("- ")
}

/// The paragraphs of the comments in a source, each with the number of its first line. Blocks of code,
/// headings and rows of tables are left out.
fn paragraphs(source: &str) -> Vec<(usize, String)> {
    let mut paragraphs: Vec<(usize, String)> = Vec::new();
    let mut is_code = false;
    let mut continues = false;
    for (index, line) in source.lines().enumerate() {
        let Some(text) = comment(line) else {
            (is_code, continues) = (false, false);
            continue;
        };
        let is_fence = text.starts_with("```");
        is_code ^= is_fence;
        if is_fence || is_code || text.is_empty() || text.starts_with(['|', '#']) {
            continues = false;
            continue;
        }
        match paragraphs.last_mut() {
            Some((_, paragraph)) if continues && !is_item(text) => {
                paragraph.push(' ');
                paragraph.push_str(text);
            }
            _ => paragraphs.push((index + 1, text.to_owned())),
        }
        continues = true;
    }
    paragraphs
}

/// The sentences of a paragraph, without what is between backticks.
fn sentences(paragraph: &str) -> Vec<String> {
    let text: Vec<&str> = paragraph.split('`').step_by(2).collect();
    let mut sentences = vec![String::new()];
    for word in text.join("`").split_whitespace() {
        let sentence = sentences.last_mut().expect("there is one");
        let _ = write!(sentence, "{word} ");
        if word.ends_with(['.', '?', '!']) {
            sentences.push(String::new());
        }
    }
    sentences
}

/// The number of pronouns in a sentence.
fn pronouns(sentence: &str) -> usize {
    sentence
        .split(|c: char| !c.is_alphabetic() && c != '\'')
        .filter(|word| PRONOUNS.contains(&word.to_lowercase().as_str()))
        .count()
}

/// The sentences of a source with too many pronouns, a line for each.
fn without_nouns(path: &str, source: &str) -> String {
    let mut found = String::new();
    for (line, paragraph) in paragraphs(source) {
        for sentence in sentences(&paragraph) {
            if pronouns(&sentence) > MOST_PRONOUNS {
                let _ = writeln!(found, "{path}:{line}: {sentence}");
            }
        }
    }
    found
}

#[test]
fn a_sentence_names_its_noun() {
    let found: String = sources(&FOLDERS)
        .iter()
        .map(|(path, source)| without_nouns(path, source))
        .collect();
    assert!(
        found.is_empty(),
        "more than {MOST_PRONOUNS} of {PRONOUNS:?}: name the noun\n{found}"
    );
}

#[test]
fn a_sentence_with_three_pronouns_is_found() {
    for source in [
        "/// Sends what it has to one of the tasks.",
        "//! The first line.\n//! What comes of it\n//! is that.",
        "fn f() {\n    // Those that wait: each is one.\n}",
        "// 1. It is that.\n// 2. It is what\n//    it was.",
    ] {
        assert_ne!(without_nouns("a.rs", source), "", "{source}");
    }
    for source in [
        "/// It has what. It has that.\n/// Those.",
        "/// It has what\n///\n/// that one is.",
        "/// It is `that one`, or what.",
        "/// ```text\n/// it that those one what\n/// ```",
        "/// | it | that | those |\n// # It that one",
        "// * it is\n// * what it is",
        "let it = that; // one",
        "// It is, that\nlet one = 1;\n// is what.",
    ] {
        assert_eq!(without_nouns("a.rs", source), "", "{source}");
    }
}
