//! A text as lines, with what was done to it: edited, undone, searched.

use std::mem;

/// The edits that can be undone.
const MOST_EDITS: usize = 500;
/// How wide a tabulator is at most, in letters.
const TABULATOR: usize = 4;

/// A place in a text.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Place {
    /// The line, from 0.
    pub(super) line: usize,
    /// In UTF-16, as browsers count.
    pub(super) column: usize,
}

/// Lines in place of others.
#[derive(Debug)]
struct Edit {
    line: usize,
    removed: Vec<String>,
    inserted: Vec<String>,
}

impl Edit {
    /// Whether another edit goes on in the line of this one.
    fn goes_on(&self, next: &Self) -> bool {
        self.line == next.line
            && self.removed.len() == 1
            && self.inserted == next.removed
            && next.inserted.len() == 1
    }

    /// Where the text has changed last.
    fn end(&self) -> Place {
        let last = self.inserted.last().map_or(0, |line| width_utf16(line));
        Place {
            line: self.line + self.inserted.len().saturating_sub(1),
            column: last,
        }
    }
}

/// A text.
#[derive(Debug)]
pub(super) struct Text {
    lines: Vec<String>,
    done: Vec<Edit>,
    undone: Vec<Edit>,
    longest: usize,
    /// Changes with each edit.
    pub(super) revision: u32,
}

/// The length of a line as browsers count.
pub(super) fn width_utf16(line: &str) -> usize {
    if line.is_ascii() {
        line.len()
    } else {
        line.encode_utf16().count()
    }
}

/// How many letters wide a line is at most.
fn letters(line: &str) -> usize {
    if line.is_ascii() {
        line.len() + line.matches('\t').count() * (TABULATOR - 1)
    } else {
        // Some are twice as wide as Latin ones.
        line.chars().count() * 2 + line.matches('\t').count() * TABULATOR
    }
}

/// The lines of a text; behind the last end of a line there is an empty one.
fn divided(text: &str) -> impl Iterator<Item = &str> {
    text.split('\n')
        .map(|line| line.strip_suffix('\r').unwrap_or(line))
}

impl Text {
    /// A text that was never edited.
    pub(super) fn new(text: &str) -> Self {
        let lines: Vec<_> = divided(text).map(str::to_owned).collect();
        Self {
            longest: { lines.iter() }
                .map(|line| letters(line))
                .max()
                .unwrap_or_default(),
            lines,
            done: Vec::new(),
            undone: Vec::new(),
            revision: 0,
        }
    }

    /// Whether it is the same text, by its lines.
    pub(super) fn is(&self, text: &str) -> bool {
        divided(text).eq(self.lines.iter().map(String::as_str))
    }

    /// The lines; there is at least one.
    pub(super) fn lines(&self) -> &[String] {
        &self.lines
    }

    /// How many letters the longest line has at most.
    pub(super) fn longest(&self) -> usize {
        self.longest
    }

    /// The text as a whole.
    pub(super) fn whole(&self) -> String {
        self.lines.join("\n")
    }

    /// Puts a text in place of some lines.
    pub(super) fn replace(&mut self, line: usize, count: usize, text: &str) {
        let inserted: Vec<_> = divided(text).collect();
        let removed = &self.lines[line..line + count];
        let most = inserted.len().min(count);
        let pairs = || inserted.iter().zip(removed);
        let before = pairs().take_while(|(new, old)| *new == old).count();
        let pairs = inserted.iter().rev().zip(removed.iter().rev());
        let after = pairs
            .take(most - before)
            .take_while(|(new, old)| *new == old)
            .count();
        if before == inserted.len() && before == count {
            return;
        }
        let edit = Edit {
            line: line + before,
            removed: removed[before..count - after].to_vec(),
            inserted: { inserted[before..inserted.len() - after].iter() }
                .map(|line| (*line).to_owned())
                .collect(),
        };
        self.undone.clear();
        self.apply(&edit);
        match self.done.last_mut() {
            Some(last) if last.goes_on(&edit) => last.inserted = edit.inserted,
            _ => self.done.push(edit),
        }
        if self.done.len() > MOST_EDITS {
            self.done.remove(0);
        }
    }

    /// Takes the last edit back, and tells where.
    pub(super) fn undo(&mut self) -> Option<Place> {
        let edit = reversed(self.done.pop()?);
        self.apply(&edit);
        let end = edit.end();
        self.undone.push(reversed(edit));
        Some(end)
    }

    /// Makes the last edit that was undone again, and tells where.
    pub(super) fn redo(&mut self) -> Option<Place> {
        let edit = self.undone.pop()?;
        self.apply(&edit);
        let end = edit.end();
        self.done.push(edit);
        Some(end)
    }

    fn apply(&mut self, edit: &Edit) {
        let end = edit.line + edit.removed.len();
        self.lines
            .splice(edit.line..end, edit.inserted.iter().cloned());
        let longest = edit.inserted.iter().map(|line| letters(line)).max();
        self.longest = self.longest.max(longest.unwrap_or_default());
        self.revision += 1;
    }

    /// Where a text stands, whatever its letters' case; it has no ends of lines.
    pub(super) fn find(&self, wanted: &str) -> Vec<Place> {
        let mut places = Vec::new();
        for (line, text) in self.lines.iter().enumerate() {
            let columns = occurrences(text, wanted).map(|at| width_utf16(&text[..at]));
            places.extend(columns.map(|column| Place { line, column }));
        }
        places
    }
}

fn reversed(mut edit: Edit) -> Edit {
    mem::swap(&mut edit.removed, &mut edit.inserted);
    edit
}

/// Where in a line a text begins, in bytes, whatever the case of its Latin letters.
pub(super) fn occurrences(line: &str, wanted: &str) -> impl Iterator<Item = usize> {
    let (line, wanted) = (line.as_bytes(), wanted.as_bytes());
    let mut at = 0;
    std::iter::from_fn(move || {
        let first = *wanted.first()?;
        while let Some(part) = line.get(at..at + wanted.len()) {
            let is_here = part[0].eq_ignore_ascii_case(&first) && part.eq_ignore_ascii_case(wanted);
            if is_here {
                at += wanted.len();
                return Some(at - wanted.len());
            }
            at += 1;
        }
        None
    })
}

/// A line in two, at a column as browsers count.
pub(super) fn split_at(line: &str, column: usize) -> (&str, &str) {
    let mut width = 0;
    let mut letters = line.char_indices();
    let at = letters.find(|(_, letter)| {
        let is_there = width >= column;
        width += letter.len_utf16();
        is_there
    });
    line.split_at(at.map_or(line.len(), |(at, _)| at))
}

/// The place in some lines at an offset in their text, which joins them by line feeds.
pub(super) fn place_at(lines: &[String], mut offset: usize) -> Place {
    for (line, text) in lines.iter().enumerate() {
        let width = width_utf16(text);
        if offset <= width {
            return Place {
                line,
                column: offset,
            };
        }
        offset -= width + 1;
    }
    let line = lines.len().saturating_sub(1);
    let column = lines.last().map_or(0, |line| width_utf16(line));
    Place { line, column }
}

/// The offset of a place in the text of some lines.
pub(super) fn offset_of(lines: &[String], place: Place) -> usize {
    let before = lines
        .iter()
        .take(place.line)
        .map(|line| width_utf16(line) + 1);
    let width = lines.get(place.line).map_or(0, |line| width_utf16(line));
    before.sum::<usize>() + place.column.min(width)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(line: usize, column: usize) -> Place {
        Place { line, column }
    }

    #[test]
    fn a_text_comes_back_as_it_was_but_for_the_ends_of_its_lines() {
        for text in ["", "G0", "G0\n", "\n\nG0X1\n(ä)\n"] {
            assert_eq!(Text::new(text).whole(), text);
        }
        let text = Text::new("G0\r\nX1\r\n");
        assert_eq!(text.whole(), "G0\nX1\n");
        assert!(text.is("G0\nX1\n") && text.is("G0\r\nX1\r\n") && !text.is("G0\nX1"));
    }

    #[test]
    fn edits_are_undone_and_made_again_to_the_letter() {
        let mut text = Text::new("G0\nX1\nY1\nZ1");
        // A key at a time: one edit. Then a line more, and two lines less.
        text.replace(1, 2, "X12\nY1");
        text.replace(1, 2, "X123\nY1");
        text.replace(1, 1, "X1\nX23");
        text.replace(0, 3, "X23");
        assert_eq!(text.whole(), "X23\nY1\nZ1");
        let texts = ["G0\nX1\nX23\nY1\nZ1", "G0\nX123\nY1\nZ1", "G0\nX1\nY1\nZ1"];
        for expected in texts {
            assert!(text.undo().is_some());
            assert_eq!(text.whole(), expected);
        }
        assert_eq!(text.undo(), None);
        assert_eq!(text.redo(), Some(place(1, 4)));
        assert_eq!(text.whole(), texts[1]);
        text.replace(0, 1, "G1");
        assert_eq!(text.redo(), None);
    }

    #[test]
    fn what_is_the_same_is_no_edit() {
        let mut text = Text::new("G0\nG0\nG0");
        text.replace(0, 3, "G0\nG0\nG0");
        assert_eq!((text.revision, text.undo()), (0, None));
        text.replace(0, 3, "G0\nG0");
        text.replace(0, 2, "G0\nG0\nG0\nG0");
        assert_eq!(text.lines().len(), 4);
        text.undo();
        text.undo();
        assert_eq!(text.whole(), "G0\nG0\nG0");
    }

    #[test]
    fn texts_are_found_in_either_case() {
        let text = Text::new("g1 x1 (ä g1)\nM3\nG1G1");
        let found = [place(0, 0), place(0, 9), place(2, 0), place(2, 2)];
        assert_eq!(text.find("G1"), found);
        assert_eq!(text.find("Ä"), []);
        assert_eq!(text.find(""), []);
        assert_eq!(occurrences("aaa", "AA").collect::<Vec<_>>(), [0]);
    }

    #[test]
    fn places_and_offsets_belong_together() {
        let lines = ["G0", "", "(ä😀)", "X"].map(str::to_owned);
        for (offset, wanted) in [
            (0, place(0, 0)),
            (2, place(0, 2)),
            (3, place(1, 0)),
            (9, place(2, 5)),
            (11, place(3, 1)),
        ] {
            assert_eq!(place_at(&lines, offset), wanted);
            assert_eq!(offset_of(&lines, wanted), offset);
        }
        assert_eq!(place_at(&lines, 99), place(3, 1));
        assert_eq!(offset_of(&lines, place(0, 99)), 2);
    }

    #[test]
    fn a_line_is_divided_where_browsers_count() {
        assert_eq!(split_at("(ä😀)X", 4), ("(ä😀", ")X"));
        assert_eq!(split_at("G0", 0), ("", "G0"));
        assert_eq!(split_at("G0", 9), ("G0", ""));
    }

    #[test]
    fn the_width_is_enough_for_every_line() {
        let mut text = Text::new("G0\n(漢字)");
        assert_eq!(text.longest(), 8);
        text.replace(0, 1, "\tG0 X1 Y1");
        assert_eq!(text.longest(), 12);
    }
}
