//! Bounds of loops that the source states.
//!
//! ```text
//! // wcet-bound: 6: why           at most six runs each time that the loop is entered
//! // wcet-total: 170: why         at most 170 runs in one activation, which enters it once
//! // wcet-total: 170 per f: why   the same, however often it is entered in one call of `f`
//! for axis in axes { … }
//! ```
//!
//! Loops whose totals have the same name share one budget. Both may stand in one comment: `//
//! wcet-bound: axes, wcet-total: segment_steps: why`. The reason is needed where nothing counts the loop.
//!
//! A comment belongs to the loop beneath it or on its own line, or to the statement there: then to
//! the loops of library functions that the statement calls. Instead of a number it may give a name
//! that `schedule.toml` defines.

mod source;

use std::{collections::HashMap, ops::RangeInclusive, path::Path};

pub(crate) use source::{SourceLoop, Stated};

use crate::{Count, SourceFile};

/// The loops of the source files, with what is said of them.
#[derive(Debug, Clone, Default)]
pub struct Annotations {
    /// By the file's path from the project's root.
    files: HashMap<String, Vec<SourceLoop>>,
}

impl Annotations {
    /// Reads the Rust files of the folder `src` in `root`.
    ///
    /// # Errors
    ///
    /// When a file cannot be read or parsed, or a comment has no loop or no number.
    pub fn read(root: &Path) -> Result<Self, String> {
        let mut annotations = Self::default();
        for file in SourceFile::all(root)? {
            annotations.add(&file.name, &file.text)?;
        }
        Ok(annotations)
    }

    /// Adds the loops of a file with the contents `text`.
    ///
    /// # Errors
    ///
    /// When it cannot be parsed, or a comment has no loop or no number.
    pub fn add(&mut self, file: &str, text: &str) -> Result<(), String> {
        let loops =
            source::loops(text).map_err(|(line, error)| format!("{file}:{line}: {error}"))?;
        self.files.insert(file.to_owned(), loops);
        Ok(())
    }

    /// The loops of a file; `None` when it is none of the project's.
    pub(crate) fn loops(&self, file: &str) -> Option<&[SourceLoop]> {
        self.files.get(file).map(Vec::as_slice)
    }

    /// The names that are used instead of numbers, and where.
    pub fn names(&self) -> impl Iterator<Item = (&str, String)> {
        let all = self
            .files
            .iter()
            .flat_map(|(file, loops)| loops.iter().map(move |one| (file, one)));
        all.flat_map(|(file, one)| {
            one.bound
                .iter()
                .chain(&one.total)
                .filter_map(move |stated| match &stated.count {
                    Count::Named(name) => Some((name.as_str(), format!("{file}:{}", stated.line))),
                    Count::Number(_) => None,
                })
        })
    }
}

/// Lines of a file, from one.
pub(crate) type Lines = RangeInclusive<u32>;

#[cfg(test)]
mod tests {
    use super::*;

    fn loops(text: &str) -> Result<Vec<SourceLoop>, String> {
        let mut annotations = Annotations::default();
        annotations.add("src/a.rs", text)?;
        Ok(annotations.loops("src/a.rs").unwrap().to_vec())
    }

    fn count(stated: Option<&Stated>) -> Option<Count> {
        stated.map(|stated| stated.count.clone())
    }

    #[test]
    fn a_comment_goes_with_the_loop_beneath_it() {
        let text = "fn f() {
            for a in x {
                // wcet-bound: 7
                // Why it is seven.
                while g() {}
            }
            loop { break } // wcet-total: many
        }";
        let loops = loops(text).unwrap();
        let bounds: Vec<_> = loops.iter().map(|one| count(one.bound.as_ref())).collect();
        assert_eq!(bounds, [None, Some(Count::Number(7)), None]);
        let total = count(loops[2].total.as_ref());
        assert_eq!(total, Some(Count::Named("many".to_owned())));
        assert_eq!(loops[1].whole, 5..=5);
        assert_eq!(loops[0].header, 2..=2);
    }

    #[test]
    fn a_comment_gives_a_reason_for_all_its_parts_and_the_function_of_a_total() {
        let text = "fn f() {
            // wcet-bound: 7: a line: 7 words
            for a in x {}
            // wcet-bound: 32, wcet-total: events per drain: bits of a word
            loop { break }
            loop { break } // wcet-total: 9 per drain
        }";
        let loops = loops(text).unwrap();
        let parsed = |stated: &Option<Stated>| {
            let it = stated.clone().unwrap();
            (it.per, it.reason)
        };
        let some = |text: &str| Some(text.to_owned());
        assert_eq!(parsed(&loops[0].bound), (None, some("a line: 7 words")));
        assert_eq!(parsed(&loops[1].bound), (None, some("bits of a word")));
        let drain = some("drain");
        assert_eq!(
            parsed(&loops[1].total),
            (drain.clone(), some("bits of a word"))
        );
        assert_eq!(parsed(&loops[2].total), (drain, None));
    }

    #[test]
    fn a_comment_without_a_loop_takes_the_statement() {
        let text = "fn f() {
            // wcet-bound: 3
            let a = x.iter()
                .position(|b| *b == 1);
        }";
        let loops = loops(text).unwrap();
        assert_eq!(loops.len(), 1);
        assert_eq!(loops[0].whole, 3..=4);
        assert_eq!(loops[0].header, 3..=4);
    }

    #[test]
    fn closures_and_asynchronous_functions_are_counted() {
        let text = "async fn f() {
            loop {}
            x(|| { loop {} });
        }
        fn g() { loop {} }";
        let closures: Vec<usize> = loops(text)
            .unwrap()
            .iter()
            .map(|one| one.closures)
            .collect();
        assert_eq!(closures, [1, 2, 0]);
    }

    #[test]
    fn a_comment_that_cannot_be_used_is_an_error_with_its_line() {
        let wrong = [
            (
                "fn f() {}\n// wcet-bound: 3\n",
                "src/a.rs:2: no loop and no statement",
            ),
            (
                "fn f() {\n// wcet-bound: -1\nloop {}\n}",
                "src/a.rs:2: `-1` is neither",
            ),
            (
                "fn f() {\n// wcet-most: 1\nloop {}\n}",
                "src/a.rs:2: `wcet-most: 1` is neither",
            ),
            ("fn f() {\nlet = 1;\n}", "src/a.rs:2: expected"),
        ];
        for (text, expected) in wrong {
            let error = loops(text).unwrap_err();
            assert!(error.starts_with(expected), "{error}");
        }
    }
}
