//! The page of faults: which check finds each.

use std::{collections::BTreeMap, fmt::Write as _, fs, str::FromStr};

use anyhow::{Context, Result, bail};
use common::cargo;

use super::Fault;

const PATH: &str = "docs/faults.md";
/// The cells of a fault that no check finds.
const NOT_FOUND: (&str, &str) = ("-", "none yet");

/// A part of `cargo xtask test`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tier {
    Quick,
    Rest,
}

impl Tier {
    const fn text(self) -> &'static str {
        match self {
            Self::Quick => "quick",
            Self::Rest => "rest",
        }
    }
}

impl FromStr for Tier {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "quick" => Ok(Self::Quick),
            "rest" => Ok(Self::Rest),
            _ => bail!("{PATH}: there is no part {text}"),
        }
    }
}

/// What finds a fault.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Finding {
    pub(super) tier: Tier,
    pub(super) check: String,
}

/// What is known of faults, by their names.
#[derive(Debug, Default)]
pub(super) struct Page(BTreeMap<String, Finding>);

impl Page {
    /// Reads the page, as far as the faults are those of the table; an empty one where there is none.
    pub(super) fn read(faults: &[Fault]) -> Result<Self> {
        let text = fs::read_to_string(cargo::root().join(PATH)).unwrap_or_default();
        Self::parse(&text, faults)
    }

    fn parse(text: &str, faults: &[Fault]) -> Result<Self> {
        let mut page = Self::default();
        for line in text.lines() {
            let cells: Vec<_> = line.trim_matches('|').split('|').map(str::trim).collect();
            let [name, file, tier, check] = cells[..] else {
                continue;
            };
            let is_found = (tier, check) != NOT_FOUND;
            let fault = faults.iter().find(|fault| is_found && fault.name == name);
            if let Some(fault) = fault
                && file == linked(fault)
            {
                let (tier, check) = (tier.parse()?, check.to_owned());
                page.add(fault, Finding { tier, check });
            }
        }
        Ok(page)
    }

    pub(super) fn finding(&self, fault: &Fault) -> Option<&Finding> {
        self.0.get(&fault.name)
    }

    pub(super) fn add(&mut self, fault: &Fault, finding: Finding) {
        self.0.insert(fault.name.clone(), finding);
    }

    pub(super) fn write(&self, faults: &[Fault]) -> Result<()> {
        fs::write(cargo::root().join(PATH), self.text(faults))
            .with_context(|| format!("cannot write {PATH}"))
    }

    /// How many faults a part of the tests finds.
    fn count(&self, tier: Tier) -> usize {
        let is_of_it = |finding: &&Finding| finding.tier == tier;
        self.0.values().filter(is_of_it).count()
    }

    fn text(&self, faults: &[Fault]) -> String {
        let (quick, rest) = (self.count(Tier::Quick), self.count(Tier::Rest));
        let mut text = format!(
            "# Faults\n\n\
             Faults of the firmware that were inserted into a copy of its sources, one at a time, and the first check of\n\
             `cargo xtask test` that fails with each: [how](contributing.md#inserted-faults).\n\
             `cargo xtask test --faults --write` looks for those that are not found yet.\n\n\
             Of {} faults, what is quick finds {quick}, and what `--rest` tests {rest}.\n\n\
             | fault | file | part | check |\n|---|---|---|---|\n",
            faults.len()
        );
        for fault in faults {
            let found = self.finding(fault);
            let (tier, check) =
                found.map_or(NOT_FOUND, |Finding { tier, check }| (tier.text(), check));
            let (name, file) = (&fault.name, linked(fault));
            // Writing to a string never fails.
            let _ = writeln!(text, "| {name} | {file} | {tier} | {check} |");
        }
        text
    }
}

/// The file of a fault, in a table.
fn linked(fault: &Fault) -> String {
    format!("[{0}](../{0})", fault.file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inserted::{by_checks, faults};

    /// Of the faults, so many are found by what is quick, at least.
    const LEAST_QUICK: usize = 32;

    #[test]
    fn the_page_shows_who_finds_each_fault_of_the_table() {
        let faults = faults(by_checks::TABLE).unwrap();
        let page = Page::read(&faults).unwrap();
        let missing = faults.iter().filter(|fault| page.finding(fault).is_none());
        let missing: Vec<_> = missing.map(|fault| &fault.name).collect();
        assert!(missing.is_empty(), "not in {PATH}: {missing:#?}");
        assert!(page.count(Tier::Quick) >= LEAST_QUICK);
        let text = fs::read_to_string(cargo::root().join(PATH)).unwrap();
        assert_eq!(page.text(&faults), text, "{PATH} is out of date");
    }

    #[test]
    fn a_row_of_another_fault_or_file_is_not_taken() {
        let fault = |name: &str| Fault {
            name: name.into(),
            file: "src/a.rs".into(),
            old: String::new(),
            new: String::new(),
            board: None,
            message: None,
        };
        let row = |name, file, tier| format!("| {name} | [{file}](../{file}) | {tier} | tests |\n");
        let faults = [fault("one"), fault("two"), fault("three")];
        let text = [
            row("one", "src/a.rs", "rest"),
            row("two", "src/b.rs", "quick"),
            row("four", "src/a.rs", "quick"),
        ];
        let page = Page::parse(&text.concat(), &faults).unwrap();
        let (tier, check) = (Tier::Rest, "tests".to_owned());
        assert_eq!(page.finding(&faults[0]), Some(&Finding { tier, check }));
        assert_eq!(page.0.len(), 1);
        let again = Page::parse(&page.text(&faults), &faults).unwrap();
        assert_eq!(again.0, page.0);
        assert!(Page::parse(&row("one", "src/a.rs", "some"), &faults).is_err());
    }
}
