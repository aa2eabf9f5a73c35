//! `cargo xtask test --faults`: which check of `cargo xtask test` finds a fault, and in which of its parts.

use std::{
    collections::BTreeSet,
    fs,
    process::{ExitCode, Stdio},
    time::Instant,
};

use anyhow::{Context, Result, bail, ensure};
use common::ui;

use super::{
    Fault, Sources, faults, is_found,
    page::{Finding, Page, Tier},
};

/// The table of faults.
pub(super) const TABLE: &str = "tests/faults.toml";

/// The beginnings of the names of checks that read how the sources are written, find the texts of [`TABLE`], or have
/// faults of their own: a fault is to be found by its effect.
const NOT_OF_WHAT_IT_DOES: [&str; 5] = [
    "formatting",
    "lints",
    "documentation",
    "tests of the tools",
    "a fault of each kind",
];
/// What the proof says of each change of the firmware, right or wrong.
const OF_EACH_CHANGE: &str = "is out of date: run `cargo xtask schedule --write`";
/// What names of checks contain that run the code of a board, the quickest first. The others see no more of it than its
/// text.
const OF_BOARDS: [&str; 6] = [
    "proof",
    "serial",
    "rehearsal",
    "target",
    "bring-up",
    "firmware",
];

/// Looks for each fault whose name contains `name`, and, to write the page, which is not in it or was asked for.
pub(crate) fn run(name: &str, writes: bool) -> Result<ExitCode> {
    let copy = Sources::new();
    copy.restore()?;
    let checks = Checks::of(&copy)?;
    let all = faults(TABLE)?;
    let mut page = if writes {
        Page::read(&all)?
    } else {
        Page::default()
    };
    let chosen: Vec<_> = all
        .iter()
        .filter(|fault| fault.name.contains(name))
        .filter(|fault| !name.is_empty() || page.finding(fault).is_none())
        .collect();
    ensure!(!chosen.is_empty(), "no fault is left: name one of {TABLE}");
    ui::status("Unaltered", "the quick checks have to pass");
    for check in &checks.quick {
        ensure!(
            !copy.fails(check)?,
            "{check} fails without a fault: what it finds means nothing"
        );
    }
    let mut seeker = Seeker {
        passed: checks.quick.iter().cloned().collect(),
        copy,
        checks,
    };
    let mut missed = Vec::new();
    for fault in chosen {
        let start = Instant::now();
        let found = seeker.seek(fault).with_context(|| fault.name.clone())?;
        let elapsed = start.elapsed().as_secs();
        if let Some(finding) = found {
            let by = format!("{}, by {}, in {elapsed} s", fault.name, finding.check);
            ui::status("Found", &by);
            page.add(fault, finding);
            if writes {
                page.write(&all)?;
            }
        } else {
            ui::status("Missed", &fault.name);
            missed.push(fault.name.as_str());
        }
    }
    seeker.copy.restore()?;
    ensure!(missed.is_empty(), "not found: {}", missed.join(", "));
    Ok(ExitCode::SUCCESS)
}

/// The checks of both parts, as `cargo xtask test` names them, in its order.
struct Checks {
    quick: Vec<String>,
    rest: Vec<String>,
}

impl Checks {
    fn of(copy: &Sources) -> Result<Self> {
        let list = |arguments: &[&str]| -> Result<Vec<String>> {
            let listed = copy.cargo(arguments).stderr(Stdio::inherit()).output()?;
            ensure!(listed.status.success(), "the checks cannot be listed");
            Ok(chosen(&String::from_utf8(listed.stdout)?))
        };
        let rest = list(&["xtask", "test", "--rest", "--list"])?;
        let quick = list(&["xtask", "test", "--list"])?;
        ensure!(!quick.is_empty() && !rest.is_empty(), "there are no checks");
        Ok(Self { quick, rest })
    }
}

/// The checks of a list that look at what the firmware does.
fn chosen(list: &str) -> Vec<String> {
    let is_chosen = |name: &&str| {
        !NOT_OF_WHAT_IT_DOES
            .iter()
            .any(|begin| name.starts_with(begin))
    };
    list.lines().filter(is_chosen).map(str::to_owned).collect()
}

/// Orders checks for a fault: those first that run its code. That of the library is in all of them, of which senders take
/// longest.
fn order(checks: &mut [String], is_of_board: bool) {
    checks.sort_by_key(|name| name == "sender programs");
    if is_of_board {
        let rank = |name: &String| OF_BOARDS.iter().position(|word| name.contains(word));
        checks.sort_by_key(|name| rank(name).unwrap_or(OF_BOARDS.len()));
    }
}

/// Looks for faults.
struct Seeker {
    copy: Sources,
    checks: Checks,
    /// What has passed without a fault.
    passed: BTreeSet<String>,
}

impl Seeker {
    /// What finds a fault.
    fn seek(&mut self, fault: &Fault) -> Result<Option<Finding>> {
        let is_of_board = fault.file.starts_with("src/board/");
        self.copy.insert(fault)?;
        if is_of_board {
            self.copy.build(&["xtask", "build", "--unproven"])?;
        } else {
            self.copy.build(&[
                "build",
                "--package=leadscrew",
                "--lib",
                "--no-default-features",
                "--features=usb",
            ])?;
        }
        let tiers = [
            (Tier::Quick, self.checks.quick.clone()),
            (Tier::Rest, self.checks.rest.clone()),
        ];
        for (tier, mut checks) in tiers {
            order(&mut checks, is_of_board);
            for check in checks {
                if self.copy.fails(&check)? {
                    self.confirm(&check)?;
                    return Ok(Some(Finding { tier, check }));
                }
            }
        }
        Ok(None)
    }

    /// Makes sure that a check passes without a fault.
    fn confirm(&mut self, check: &str) -> Result<()> {
        if self.passed.contains(check) {
            return Ok(());
        }
        self.copy.restore()?;
        if self.copy.fails(check)? {
            bail!("{check} fails without a fault, too");
        }
        self.passed.insert(check.to_owned());
        Ok(())
    }
}

impl Sources {
    /// Whether a check fails. What it says is kept beside the copy.
    fn fails(&self, check: &str) -> Result<bool> {
        let output = self.cargo(&["xtask", "test", check]).output()?;
        let printed = [output.stdout, output.stderr].concat();
        fs::write(self.target.join("printed.txt"), &printed)?;
        let is_any_change = String::from_utf8_lossy(&printed).contains(OF_EACH_CHANGE);
        Ok(is_found(output.status)? && !is_any_change)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_looks_at_the_words_of_the_sources_is_not_asked() {
        let list = "formatting\nunit tests\nlints, host\nhost tests\ntests of the tools\na fault of each kind that the proof finds\ndocumentation of the library\ndocuments\n";
        assert_eq!(chosen(list), ["unit tests", "host tests", "documents"]);
    }

    #[test]
    fn for_a_fault_of_a_board_what_runs_its_code_comes_first() {
        let names = ["host tests", "a day", "the proof, a", "the rehearsal, a"];
        let ordered = |is_of_board| {
            let mut checks = names.map(str::to_owned);
            order(&mut checks, is_of_board);
            checks
        };
        assert_eq!(ordered(false), names);
        let for_boards = ["the proof, a", "the rehearsal, a", "host tests", "a day"];
        assert_eq!(ordered(true), for_boards);
    }
}
