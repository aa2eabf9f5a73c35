//! Documents with parts that commands write: each part is between two lines of its document.

use std::fs;

use anyhow::{Context, Result};

use crate::{cargo, ui};

/// The text of a document of the project.
pub fn read(path: &str) -> Result<String> {
    fs::read_to_string(cargo::root().join(path)).with_context(|| format!("cannot read {path}"))
}

/// Returns a document with another text between two of its lines.
pub fn with_part(document: &str, begin: &str, end: &str, part: &str) -> Option<String> {
    let (head, rest) = document.split_once(begin)?;
    let (_, tail) = rest.split_once(end)?;
    Some(format!("{head}{begin}{part}{end}{tail}"))
}

/// Writes a text into a document of the project, between two of its lines.
pub fn write_part(path: &str, begin: &str, end: &str, part: &str) -> Result<()> {
    let text = with_part(&read(path)?, begin, end, part);
    let text = text.with_context(|| format!("{path} has no line {begin}"))?;
    fs::write(cargo::root().join(path), text).with_context(|| format!("cannot write {path}"))?;
    ui::status("Written", path);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_between_its_lines_and_nothing_else_changes() {
        let document = "before\n<!-- a -->\nold\n<!-- end of a -->\nafter\n";
        let [begin, end] = ["<!-- a -->\n", "<!-- end of a -->\n"];
        let new = with_part(document, begin, end, "new\n");
        assert_eq!(new, Some(document.replace("old", "new")));
        assert_eq!(with_part(document, end, begin, "new\n"), None);
        assert_eq!(with_part(document, "<!-- b -->\n", end, "new\n"), None);
    }
}
