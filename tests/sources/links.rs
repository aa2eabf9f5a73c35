//! Every link between documents leads to a file, and to a heading that is there.

use std::{
    collections::BTreeMap,
    fmt::Write as _,
    fs,
    path::{Component, Path, PathBuf},
};

/// The lines of a document outside blocks of code, with their numbers.
fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut is_code = false;
    (1..).zip(text.lines()).filter(move |(_, line)| {
        let is_fence = line.trim_start().starts_with("```");
        is_code ^= is_fence;
        !is_code && !is_fence
    })
}

/// The anchor that a page gives to a heading: in lower case, with hyphens for blanks, and without
/// other punctuation.
fn anchor(heading: &str) -> String {
    let kept = |c: &char| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_');
    let text = heading.trim().to_lowercase();
    text.chars()
        .filter(kept)
        .collect::<String>()
        .replace(' ', "-")
}

/// The anchors of a document. A heading that comes again has its number behind it.
fn anchors(text: &str) -> Vec<String> {
    let mut counts = BTreeMap::new();
    prose(text)
        .filter(|(_, line)| line.starts_with('#'))
        .filter_map(|(_, line)| line.trim_start_matches('#').strip_prefix(' '))
        .map(|heading| {
            let anchor = anchor(heading);
            let count = counts.entry(anchor.clone()).or_insert(0);
            *count += 1;
            match *count {
                1 => anchor,
                again => format!("{anchor}-{}", again - 1),
            }
        })
        .collect()
}

/// The targets of a document's links to files and headings, each with the number of its line.
fn targets(text: &str) -> Vec<(usize, &str)> {
    prose(text)
        .flat_map(|(number, line)| {
            line.split("](")
                .skip(1)
                .filter_map(|rest| rest.split_once(')'))
                .map(move |(target, _)| (number, target))
        })
        .filter(|(_, target)| !target.contains("://"))
        .collect()
}

/// A path without `.` and `..`.
fn normal(path: &Path) -> PathBuf {
    let mut normal = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                normal.pop();
            }
            Component::CurDir => {}
            part => normal.push(part),
        }
    }
    normal
}

/// The links of a document that lead nowhere, a line for each. `exists` finds a file by its path from
/// the project's root, and `read` gives its text.
fn broken(
    document: &str,
    text: &str,
    exists: impl Fn(&Path) -> bool,
    read: impl Fn(&Path) -> String,
) -> String {
    let folder = Path::new(document).parent().unwrap_or(Path::new(""));
    let mut broken = String::new();
    for (line, target) in targets(text) {
        let (file, wanted) = target.split_once('#').unwrap_or((target, ""));
        let path = if file.is_empty() {
            PathBuf::from(document)
        } else {
            normal(&folder.join(file))
        };
        if !exists(&path) {
            let _ = writeln!(broken, "{document}:{line}: there is no {}", path.display());
        } else if !wanted.is_empty() && !anchors(&read(&path)).iter().any(|a| a == wanted) {
            let path = path.display();
            let _ = writeln!(broken, "{document}:{line}: {path} has no heading #{wanted}");
        }
    }
    broken
}

/// The documents whose links are read.
pub(super) fn documents(root: &Path) -> Vec<String> {
    let mut documents = vec!["CHANGELOG.md".to_owned(), "README.md".to_owned()];
    for folder in ["docs", "docs/boards"] {
        for entry in fs::read_dir(root.join(folder)).expect("documents can be read") {
            let name = entry.expect("documents can be read").file_name();
            let name = name.to_string_lossy();
            if name.ends_with(".md") {
                documents.push(format!("{folder}/{name}"));
            }
        }
    }
    documents
}

#[test]
fn every_link_of_a_document_leads_somewhere() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let read = |path: &Path| fs::read_to_string(root.join(path)).expect("documents can be read");
    let broken: String = documents(root)
        .iter()
        .map(|document| {
            let text = read(Path::new(document));
            broken(document, &text, |path| root.join(path).exists(), read)
        })
        .collect();
    assert!(broken.is_empty(), "\n{broken}");
}

#[test]
fn every_page_is_in_the_readme_or_on_a_page_that_is() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let mut reached = vec![PathBuf::from("README.md")];
    let mut next = 0;
    while let Some(document) = reached.get(next).cloned() {
        next += 1;
        let text = fs::read_to_string(root.join(&document)).expect("documents can be read");
        let folder = document.parent().unwrap_or(Path::new(""));
        for (_, target) in targets(&text) {
            let path = normal(&folder.join(target.split('#').next().unwrap_or_default()));
            if path.extension().is_some_and(|end| end == "md") && !reached.contains(&path) {
                reached.push(path);
            }
        }
    }
    for document in documents(root) {
        let is_reached = reached.contains(&PathBuf::from(&document));
        assert!(is_reached, "no link leads to {document}");
    }
}

#[test]
fn a_link_that_leads_nowhere_is_found() {
    let pages = BTreeMap::from([
        ("docs/a.md", "# A: `x` and 3.5 ms\n\n## Twice\n\n## Twice\n"),
        ("README.md", ""),
    ]);
    let text = "[1](a.md#a-x-and-35-ms), [2](a.md#twice-1) and [3](../README.md)\n\
                [4](a.md#thrice) [5](b.md#twice) [6](https://example.org/c.md)\n\
                ```\n[7](d.md)\n# Here\n```\n# There\n[8](#there) [9](#here)\n";
    let found = broken(
        "docs/c.md",
        text,
        |path| path == Path::new("docs/c.md") || pages.keys().any(|page| path == Path::new(page)),
        |path| {
            let page = path.to_str().and_then(|path| pages.get(path));
            page.map_or(text, |page| *page).to_owned()
        },
    );
    assert_eq!(
        found,
        "docs/c.md:2: docs/a.md has no heading #thrice\n\
         docs/c.md:2: there is no docs/b.md\n\
         docs/c.md:8: docs/c.md has no heading #here\n"
    );
}
