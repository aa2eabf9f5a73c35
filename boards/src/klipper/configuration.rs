//! Sections and values of a configuration, with the lines they are in.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};

use glob::{MatchOptions, glob_with};

use crate::{Fault, Place};

/// A line of a value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Line {
    pub(crate) text: String,
    pub(crate) place: Place,
}

/// A value: the line of its key, and those that are indented below.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Value {
    key: String,
    pub(crate) lines: Vec<Line>,
}

impl Value {
    /// Returns the place of the key.
    pub(crate) fn place(&self) -> &Place {
        &self.lines[0].place
    }

    /// Returns the first line that is not empty.
    pub(crate) fn text(&self) -> &str {
        let texts = self.lines.iter().map(|line| line.text.as_str());
        texts
            .into_iter()
            .find(|text| !text.is_empty())
            .unwrap_or("")
    }
}

/// A section.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Section {
    /// What stands in the brackets, with single blanks: `tmc2209 stepper_x`.
    pub(crate) name: String,
    pub(crate) place: Place,
    values: Vec<Value>,
}

impl Section {
    /// Returns the value of a key: the last one that is given counts.
    pub(crate) fn value(&self, key: &str) -> Option<&Value> {
        self.values.iter().rfind(|value| value.key == key)
    }

    /// Returns the values whose keys a condition holds for.
    pub(crate) fn values(&self, of: fn(&str) -> bool) -> impl Iterator<Item = &Value> {
        self.values.iter().filter(move |value| of(&value.key))
    }

    /// Returns the first word of the name, and what is behind it.
    pub(crate) fn kind(&self) -> (&str, &str) {
        self.name.split_once(' ').unwrap_or((&self.name, ""))
    }
}

/// A configuration with all that it includes.
#[derive(Debug)]
pub(crate) struct Configuration {
    /// The sections, each once, in the order in which they begin.
    pub(crate) sections: Vec<Section>,
    /// Comments that tell of the chip: the configurations that Klipper ships say there how it is compiled.
    pub(crate) remarks: Vec<String>,
    /// The file as a whole.
    pub(crate) place: Place,
}

/// Words of comments that tell of the chip.
const TELLING: [&str; 4] = ["stm32", "bootloader", "crystal", "clock reference"];

impl Configuration {
    /// Reads a file and the files that it includes.
    pub(crate) fn read(path: &Path) -> Result<Self, Fault> {
        let mut configuration = Self {
            sections: Vec::new(),
            remarks: Vec::new(),
            place: Place::of_file(path),
        };
        let place = Place::of_file(path);
        configuration.add_file(path, &place, &mut Vec::new())?;
        Ok(configuration)
    }

    /// Returns the section of a name.
    pub(crate) fn section(&self, name: &str) -> Option<&Section> {
        self.sections.iter().find(|section| section.name == name)
    }

    /// Adds a file, which a line names.
    fn add_file(
        &mut self,
        path: &Path,
        named_at: &Place,
        including: &mut Vec<PathBuf>,
    ) -> Result<(), Fault> {
        let cannot = |error| named_at.fault(format!("cannot read {}: {error}", path.display()));
        let whole = path.canonicalize().map_err(cannot)?;
        if including.contains(&whole) {
            return Err(named_at.fault(format!("{} includes itself", path.display())));
        }
        including.push(whole);
        let text = fs::read_to_string(path).map_err(cannot)?;
        let file: Arc<Path> = Arc::from(path);
        let mut reader = Reader {
            to: self,
            section: None,
            indent: None,
        };
        for (number, line) in (1..).zip(text.trim_start_matches('\u{feff}').lines()) {
            let place = Place::of_line(&file, number);
            if let Some(pattern) = reader.add_line(line, &place)? {
                for included in included(path, &pattern, &place)? {
                    reader.to.add_file(&included, &place, including)?;
                }
            }
        }
        including.pop();
        Ok(())
    }
}

/// Reads the lines of a file.
struct Reader<'a> {
    to: &'a mut Configuration,
    /// The section that is open, as its number.
    section: Option<usize>,
    /// Blanks before the key of the value that is open.
    indent: Option<usize>,
}

impl Reader<'_> {
    /// Adds a line; returns the pattern of an `[include]`.
    fn add_line(&mut self, line: &str, place: &Place) -> Result<Option<String>, Fault> {
        let (line, comment) = without_comment(line);
        let small = comment.to_lowercase();
        if TELLING.iter().any(|word| small.contains(word)) {
            self.to.remarks.push(comment.trim().to_owned());
        }
        let text = line.trim();
        if text.is_empty() {
            return Ok(None);
        }
        let indent = line.len() - line.trim_start().len();
        if let (Some(section), Some(of_key)) = (self.section, self.indent)
            && indent > of_key
        {
            let value = self.to.sections[section].values.last_mut();
            let value = value.expect("a value is open");
            let (text, place) = (text.to_owned(), place.clone());
            value.lines.push(Line { text, place });
            return Ok(None);
        }
        self.indent = None;
        if let Some(rest) = text.strip_prefix('[') {
            return self.add_section(rest, place);
        }
        let Some((key, value)) = text.split_once([':', '=']) else {
            let message = format!("{text:?} is neither [section] nor key: value");
            return Err(place.fault(message));
        };
        let key = key.trim().to_lowercase();
        let section = self.section.ok_or_else(|| {
            place.fault(format!(
                "`{key}` is in no section: a line with [section] must be before it"
            ))
        })?;
        let (text, place) = (value.trim().to_owned(), place.clone());
        let lines = vec![Line { text, place }];
        self.to.sections[section].values.push(Value { key, lines });
        self.indent = Some(indent);
        Ok(None)
    }

    /// Opens a section, of which `rest` is what stands behind the bracket.
    fn add_section(&mut self, rest: &str, place: &Place) -> Result<Option<String>, Fault> {
        let Some((name, _)) = rest.rsplit_once(']') else {
            return Err(place.fault("the bracket is not closed: [section] is wanted"));
        };
        if let Some(pattern) = name.trim().strip_prefix("include ") {
            self.section = None;
            return Ok(Some(pattern.trim().to_owned()));
        }
        let name = name.split_whitespace().collect::<Vec<_>>().join(" ");
        let sections = &mut self.to.sections;
        let known = sections.iter().position(|section| section.name == name);
        self.section = Some(known.unwrap_or_else(|| {
            sections.push(Section {
                name,
                place: place.clone(),
                values: Vec::new(),
            });
            sections.len() - 1
        }));
        Ok(None)
    }
}

/// Divides a line into what counts and its comment: behind `#`, or behind `;` at the beginning or after a blank.
fn without_comment(line: &str) -> (&str, &str) {
    let mut before = ' ';
    for (at, character) in line.char_indices() {
        if character == '#' || character == ';' && before.is_whitespace() {
            return (&line[..at], &line[at + 1..]);
        }
        before = character;
    }
    (line, "")
}

/// Returns the files that a pattern names from a file's folder, in the order of their names.
fn included(from: &Path, pattern: &str, place: &Place) -> Result<Vec<PathBuf>, Fault> {
    let folder = from.parent().unwrap_or(Path::new(""));
    let has_wildcard = pattern.contains(['*', '?', '[']);
    if !has_wildcard {
        return Ok(vec![folder.join(pattern)]);
    }
    // Names that begin with a dot are for those only who write the dot.
    let options = MatchOptions {
        require_literal_leading_dot: true,
        require_literal_separator: true,
        ..MatchOptions::new()
    };
    let folder = glob::Pattern::escape(&folder.to_string_lossy());
    let whole = Path::new(&folder).join(pattern);
    let found = glob_with(&whole.to_string_lossy(), options)
        .map_err(|error| place.fault(format!("{pattern:?} is no pattern of files: {error}")))?;
    let mut found: Vec<_> = found.flatten().collect();
    found.sort();
    Ok(found)
}
