//! Mutants: the firmware with a fault put into it, which the proof has to find.
//!
//! Each of twelve kinds of fault is put at the beginning of functions that are drawn by a seed. A
//! mutant is built and analysed as the firmware is; a copy that cannot be built, or has the code of
//! the firmware, does not count. Results are kept, so that an interrupted run continues with the
//! next mutant.
//!
//! Kinds that break a rule each are tried together first: a mutant with all of them must break all
//! these rules. A fault whose rule is not broken there is tried alone.
//!
//! Before all that, every comment that bounds a loop is made too small, and the faults of
//! `proof/schedule/faults.toml` are put in.

mod comments;
mod fault;
mod known;
mod site;

use std::{cmp::Reverse, collections::BTreeMap, env, fmt::Write as _, fs, path::PathBuf};

use anstream::println;
use anyhow::{Context, Result, anyhow};
use common::{cargo, document, ui};
use firmware::boards::Board;
use serde::{Deserialize, Serialize};

use crate::project_copy::{ProjectCopy, Texts};
use fault::{FAULTS, Fault};
use site::{Draw, Site};

/// Where the documents show what was found.
const TEXT: &str = "docs/scheduling.md";
const BEGIN: &str = "<!-- begin: cargo xtask schedule --mutants --write -->\n";
const END: &str = "<!-- end of mutants -->\n";
const BEGIN_COMMENTS: &str = "<!-- begin: cargo xtask schedule --mutants=0 --write -->\n";
const BEGIN_KNOWN: &str =
    "<!-- begin: known faults, cargo xtask schedule --mutants=0 --write -->\n";
const END_KNOWN: &str = "<!-- end of known faults -->\n";
const END_COMMENTS: &str = "<!-- end of comments -->\n";

/// The outcome of a mutant.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
enum Outcome {
    /// The mutant does not compile.
    Unbuilt,
    /// Its code is that of the firmware.
    Equal,
    /// The proof says what is wrong.
    Detected(String),
    /// The mutant is proven.
    Survived,
}

/// Mutants of one kind of fault.
#[derive(Debug, Default)]
struct Tally {
    detected: usize,
    /// Where those are that were not.
    survivors: Vec<String>,
}

/// Makes comments too small, and builds and analyses so many mutants; whether all mutants were found.
pub(super) fn run(board: &Board, count: usize, seed: u64, write: bool) -> Result<bool> {
    let mut builder = MutantBuilder::new(board)?;
    let show = |begin: &str, end: &str, body: &str| {
        println!("{body}");
        let shown = write.then(|| document::write_part(TEXT, begin, end, body));
        shown.transpose()
    };
    let body = comments::set_to_one(&builder.copy)?;
    show(BEGIN_COMMENTS, END_COMMENTS, &body)?;
    let (known, are_refused) = known::try_all(&builder.copy)?;
    show(BEGIN_KNOWN, END_KNOWN, &known)?;
    if count == 0 {
        return Ok(are_refused);
    }
    let sites = builder.sites()?;
    let mut draws: Vec<Draw<'_>> = FAULTS
        .iter()
        .enumerate()
        .map(|(index, fault)| Draw::new(&sites, fault, seed.wrapping_add(index as u64)))
        .collect();
    let mut tallies: Vec<Tally> = FAULTS.iter().map(|_| Tally::default()).collect();
    for number in 0..count {
        let kind = number % FAULTS.len();
        if kind == 0 {
            builder.try_together(&draws[..FAULTS.len().min(count - number)])?;
        }
        let fault = &FAULTS[kind];
        let Some((site, outcome)) = next(&mut builder, fault, &mut draws[kind])? else {
            continue;
        };
        let tally = &mut tallies[kind];
        match outcome {
            Outcome::Survived => tally.survivors.push(site),
            Outcome::Unbuilt | Outcome::Equal | Outcome::Detected(_) => tally.detected += 1,
        }
    }
    println!();
    let table = table(&tallies);
    println!("{table}");
    if write {
        let body = format!("{count} mutants, drawn with the seed {seed}:\n\n{table}");
        document::write_part(TEXT, BEGIN, END, &body)?;
    }
    Ok(are_refused && tallies.iter().all(|tally| tally.survivors.is_empty()))
}

/// Returns the next mutant of a kind that counts: the place of the fault, and the outcome.
fn next(
    builder: &mut MutantBuilder,
    fault: &Fault,
    draw: &mut Draw<'_>,
) -> Result<Option<(String, Outcome)>> {
    for (site, variant) in draw.by_ref() {
        let name = name(fault, site);
        let outcome = builder.outcome(&name, site, &fault.code(variant))?;
        match &outcome {
            Outcome::Unbuilt | Outcome::Equal => {}
            Outcome::Detected(what) => ui::status("Detected", &format!("{name}: {what}")),
            Outcome::Survived => ui::status("Survived", &name),
        }
        if !matches!(outcome, Outcome::Unbuilt | Outcome::Equal) {
            return Ok(Some((site.to_string(), outcome)));
        }
    }
    Ok(None)
}

/// What a mutant is called.
fn name(fault: &Fault, site: &Site) -> String {
    format!("{}: {site}", fault.name)
}

/// A copy of the project, and what is known of its mutants.
struct MutantBuilder<'a> {
    copy: ProjectCopy<'a>,
    /// The firmware's own code.
    base: Vec<u8>,
    known: BTreeMap<String, Outcome>,
    kept: PathBuf,
}

impl<'a> MutantBuilder<'a> {
    fn new(board: &'a Board) -> Result<Self> {
        let place = cargo::target_dir().join("mutants");
        let copy = ProjectCopy::new(board, &place)?;
        let base = copy.code()?;
        let tool = fs::read(env::current_exe()?)?;
        let proof = fs::read(copy.folder.join("schedule.toml"))?;
        let parts = [base.as_slice(), &tool, &proof];
        let digest = hmac_sha256::Hash::hash(&parts.concat());
        let name = digest.iter().take(8).fold(String::new(), |mut name, byte| {
            // Writing to a string never fails.
            let _ = write!(name, "{byte:02x}");
            name
        });
        let kept = place.join(name).with_extension("json");
        let known = match fs::read_to_string(&kept) {
            Ok(text) => {
                serde_json::from_str(&text).context("what is known of mutants is damaged")?
            }
            Err(_) => BTreeMap::new(),
        };
        Ok(Self {
            copy,
            base,
            known,
            kept,
        })
    }

    /// The functions that tasks run.
    fn sites(&self) -> Result<Vec<Site>> {
        let input = self.copy.input();
        let lines = schedule::lines_of_tasks(&input).map_err(|error| anyhow!("{error}"))?;
        site::all(&self.copy.folder, &lines)
    }

    /// Returns the outcome of a mutant, known or new.
    fn outcome(&mut self, name: &str, site: &Site, code: &str) -> Result<Outcome> {
        if let Some(known) = self.known.get(name) {
            return Ok(known.clone());
        }
        let outcome = self.inserted(vec![(site, code.to_owned())], Self::try_out)?;
        self.known.insert(name.to_owned(), outcome.clone());
        self.keep()?;
        Ok(outcome)
    }

    /// Puts the next fault of each kind that breaks a rule into one mutant. Of those whose rule it breaks it is known
    /// that they are detected.
    fn try_together(&mut self, draws: &[Draw<'_>]) -> Result<()> {
        let next = FAULTS.iter().zip(draws).filter_map(|(fault, draw)| {
            let rule = fault.rule?;
            let (site, variant) = draw.clone().next()?;
            let name = name(fault, site);
            let is_new = !self.known.contains_key(&name);
            is_new.then(|| (rule, name, (site, fault.code(variant))))
        });
        let next: Vec<_> = next.collect();
        if next.len() < 2 {
            return Ok(());
        }
        let faults = next.iter().map(|(_, _, fault)| fault.clone()).collect();
        let report = self.inserted(faults, |mutant| {
            let is_built = mutant.copy.build()?;
            is_built.then(|| mutant.copy.analyse()).transpose()
        })?;
        let flaws = report.map_or(Vec::new(), |report| report.flaws);
        for (rule, name, _) in next {
            if let Some(flaw) = flaws.iter().find(|flaw| flaw.rule == rule) {
                self.known
                    .insert(name, Outcome::Detected(flaw.what.clone()));
            }
        }
        self.keep()
    }

    /// Has something done with faults in the copy, which are gone afterwards.
    fn inserted<T>(
        &self,
        mut faults: Vec<(&Site, String)>,
        run: impl FnOnce(&Self) -> Result<T>,
    ) -> Result<T> {
        // From the end of a file on: the places of the others stay where they are.
        faults.sort_by_key(|(site, _)| Reverse(site.place()));
        let mut texts = Texts::new();
        for (site, code) in &faults {
            let text = self.copy.text(&texts, &site.file)?;
            texts.insert(site.file.clone(), site.with(&text, code));
        }
        self.copy.with(&texts, || run(self))
    }

    fn keep(&self) -> Result<()> {
        let text = serde_json::to_string_pretty(&self.known)? + "\n";
        fs::write(&self.kept, text).context("what is known of mutants cannot be kept")
    }

    fn try_out(&self) -> Result<Outcome> {
        if !self.copy.build()? {
            return Ok(Outcome::Unbuilt);
        }
        if self.copy.code()? == self.base {
            return Ok(Outcome::Equal);
        }
        let report = self.copy.analyse()?;
        Ok(match report.flaws.first() {
            Some(flaw) => Outcome::Detected(flaw.what.clone()),
            None => Outcome::Survived,
        })
    }
}

/// The results by the kind of fault.
fn table(tallies: &[Tally]) -> String {
    let rows = FAULTS.iter().zip(tallies).map(|(fault, tally)| {
        let survivors = match tally.survivors.as_slice() {
            [] => "-".to_owned(),
            survivors => survivors.join(", "),
        };
        format!(
            "| {} | {} of {} | {survivors} |\n",
            fault.name,
            tally.detected,
            tally.detected + tally.survivors.len()
        )
    });
    let rows: String = rows.collect();
    format!("| fault | detected | not detected |\n|---|---|---|\n{rows}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_a_row_for_each_kind_and_names_survivors() {
        let mut tallies: Vec<Tally> = FAULTS.iter().map(|_| Tally::default()).collect();
        tallies[0].detected = 5;
        tallies[0].survivors.push("src/a.rs:7".to_owned());
        let table = table(&tallies);
        assert_eq!(table.lines().count(), 2 + FAULTS.len());
        let first = table.lines().nth(2).unwrap();
        assert!(first.ends_with("| 5 of 6 | src/a.rs:7 |"), "{first}");
    }
}
