//! Functions into which a fault can be put.

use std::{collections::BTreeMap, fmt, ops::RangeInclusive, path::Path};

use anyhow::{Error, Result, anyhow};
use schedule::SourceFile;
use syn::{Block, ImplItemFn, ItemFn, Signature, spanned::Spanned, visit::Visit};

use super::fault::Fault;

/// A function that tasks run.
#[derive(Debug, Clone)]
pub(super) struct Site {
    /// Its file, from the root of the project.
    pub(super) file: String,
    name: String,
    /// Where its body begins, after the brace.
    line: usize,
    column: usize,
    /// The highest priority of a task with a deadline that runs it.
    pub(super) priority: Option<u8>,
}

impl fmt::Display for Site {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}` ({}:{})", self.name, self.file, self.line)
    }
}

impl Site {
    /// Where its body begins: the file, the line and the column.
    pub(super) fn place(&self) -> (String, usize, usize) {
        (self.file.clone(), self.line, self.column)
    }

    /// The text of its file with code at the beginning of its body.
    pub(super) fn with(&self, text: &str, code: &str) -> String {
        let lines = text.split_inclusive('\n').take(self.line - 1);
        let before: usize = lines.map(str::len).sum();
        let tail_from_line = &text[before..];
        let place = tail_from_line.char_indices().nth(self.column);
        let (head, tail) =
            tail_from_line.split_at(place.map_or(tail_from_line.len(), |(at, _)| at));
        format!("{}{head}{code}{tail}", &text[..before])
    }
}

/// The functions of the files below `src` that tasks run.
pub(super) fn all(root: &Path, lines: &BTreeMap<(String, u32), Option<u8>>) -> Result<Vec<Site>> {
    let files = SourceFile::all(root).map_err(Error::msg)?;
    let sites = files
        .iter()
        .map(|file| of_file(&file.name, &file.text, lines));
    Ok(sites.collect::<Result<Vec<_>>>()?.concat())
}

fn of_file(
    file: &str,
    text: &str,
    lines: &BTreeMap<(String, u32), Option<u8>>,
) -> Result<Vec<Site>> {
    let parsed = syn::parse_file(text).map_err(|error| anyhow!("{file}: {error}"))?;
    let mut found = Found::default();
    found.visit_file(&parsed);
    let sites = found
        .0
        .into_iter()
        .filter_map(|(name, whole, line, column)| {
            let run = whole.filter_map(|line| lines.get(&(file.to_owned(), line)));
            let priority = run.max()?;
            Some(Site {
                file: file.to_owned(),
                name,
                line,
                column,
                priority: *priority,
            })
        });
    Ok(sites.collect())
}

/// Functions: name, lines, and where the body begins.
#[derive(Default)]
struct Found(Vec<(String, RangeInclusive<u32>, usize, usize)>);

impl Found {
    fn add(&mut self, signature: &Signature, block: &Block) {
        // A constant function cannot hold such a fault; a closure's lines are its own.
        if signature.constness.is_some() || signature.asyncness.is_some() {
            return;
        }
        let (open, whole) = (block.brace_token.span.open(), block.span());
        let lines = whole.start().line as u32..=whole.end().line as u32;
        let end = open.end();
        let name = signature.ident.to_string();
        self.0.push((name, lines, end.line, end.column));
    }
}

impl<'ast> Visit<'ast> for Found {
    fn visit_item_fn(&mut self, item: &'ast ItemFn) {
        self.add(&item.sig, &item.block);
        syn::visit::visit_item_fn(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast ImplItemFn) {
        self.add(&item.sig, &item.block);
        syn::visit::visit_impl_item_fn(self, item);
    }
}

/// Sites in the order in which a seed draws them, with a number for the variant of the fault.
#[derive(Clone)]
pub(super) struct Draw<'a> {
    left: Vec<&'a Site>,
    state: u64,
    drawn: usize,
}

impl<'a> Draw<'a> {
    pub(super) fn new(sites: &'a [Site], fault: &Fault, seed: u64) -> Self {
        Self {
            left: sites.iter().filter(|site| fault.fits(site)).collect(),
            state: seed,
            drawn: 0,
        }
    }

    /// Numbers without a pattern: `SplitMix64`, G. Steele et al. 2014.
    fn number(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.state;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }
}

impl<'a> Iterator for Draw<'a> {
    type Item = (&'a Site, usize);

    fn next(&mut self) -> Option<Self::Item> {
        let number = self.number();
        let index = number.checked_rem(self.left.len() as u64)?;
        let site = self.left.swap_remove(index as usize);
        self.drawn += 1;
        Some((site, self.drawn - 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mutants::fault::FAULTS;

    const TEXT: &str = "const fn a() -> u8 { 1 }\nimpl T {\n    fn b(x: u8) -> u8 {\n        x\n    }\n}\nfn c() {}\n";

    fn sites(lines: &[(u32, Option<u8>)]) -> Vec<Site> {
        let lines = lines
            .iter()
            .map(|(line, priority)| (("src/a.rs".to_owned(), *line), *priority));
        of_file("src/a.rs", TEXT, &lines.collect()).unwrap()
    }

    #[test]
    fn a_fault_is_inserted_after_the_brace_of_a_function_that_is_run() {
        let found = sites(&[(1, Some(5)), (4, Some(2))]);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].to_string(), "`b` (src/a.rs:3)");
        let changed = found[0].with(TEXT, " f(); ");
        assert!(
            changed.contains("fn b(x: u8) -> u8 { f(); \n        x\n"),
            "{changed}"
        );
    }

    #[test]
    fn a_seed_draws_each_site_once_and_always_in_the_same_order() {
        let found = sites(&[(4, Some(2)), (7, Some(3))]);
        let draw = |seed| -> Vec<String> {
            let draw = Draw::new(&found, &FAULTS[0], seed);
            draw.map(|(site, _)| site.to_string()).collect()
        };
        assert_eq!(draw(1), draw(1));
        assert_eq!(draw(1).len(), 2);
        let orders: std::collections::BTreeSet<_> = (0..20).map(draw).collect();
        assert_eq!(orders.len(), 2);
    }
}
