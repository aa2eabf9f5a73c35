//! `cargo xtask fuzz`: inputs that nobody sends, made from those of a corpus.
//!
//! An input that ends in a panic is made shorter, and printed as a line for the corpus.

mod mutator;
mod targets;

use std::{fs, process::ExitCode};

use anyhow::{Context, Result, bail};
use common::options::Fuzz as Options;
use common::{cargo, ui};
use indicatif::{HumanCount, ProgressBar};

use self::{
    mutator::{Mutator, escaped, unescaped},
    targets::{TARGETS, Target},
};
use crate::quiet::panic_of;

/// Runs the targets.
pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let names = TARGETS.map(|target| target.name);
    let wanted: Vec<_> = TARGETS
        .iter()
        .filter(|target| {
            options
                .target
                .as_deref()
                .is_none_or(|name| name == target.name)
        })
        .collect();
    if wanted.is_empty() {
        bail!(
            "there is no such target: the targets are {}",
            names.join(", ")
        );
    }
    for target in wanted {
        let corpus = corpus(target)?;
        if let Some((input, panic)) = search(target, &corpus, options.inputs, options.seed) {
            anstream::println!(
                "{panic}\nAn input of {} that ends so:\n{}",
                target.name,
                escaped(&input)
            );
            ui::status(
                "Broken",
                &format!(
                    "as a line of tests/soak/corpus/{}.txt it is tried first",
                    target.name
                ),
            );
            return Ok(ExitCode::FAILURE);
        }
        ui::status(
            "Fuzzed",
            &format!(
                "{}: {} inputs, no panic",
                target.name,
                HumanCount(options.inputs)
            ),
        );
    }
    Ok(ExitCode::SUCCESS)
}

/// The inputs of a target's corpus.
fn corpus(target: &Target) -> Result<Vec<Vec<u8>>> {
    let path = cargo::root()
        .join("tests/soak/corpus")
        .join(format!("{}.txt", target.name));
    let text =
        fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(text.lines().map(unescaped).collect())
}

/// Tries inputs; returns the first that panics, as short as was found, and its panic.
fn search(
    target: &Target,
    corpus: &[Vec<u8>],
    inputs: u64,
    seed: u64,
) -> Option<(Vec<u8>, String)> {
    let mut mutator = Mutator::new(corpus, seed);
    let progress = ProgressBar::new(inputs);
    let panics = |input: &[u8]| panic_of(|| (target.run)(input));
    for number in 0..inputs {
        let input = corpus.get(number as usize).cloned();
        let input = input.unwrap_or_else(|| mutator.next_input());
        if let Some(panic) = panics(&input) {
            progress.finish_and_clear();
            let short = shortened(input, |input| panics(input).is_some());
            let panic = panics(&short).unwrap_or(panic);
            return Some((short, panic));
        }
        progress.inc(1);
    }
    progress.finish_and_clear();
    None
}

/// Leaves out what an input does not need to fail: halves, then smaller pieces, then single bytes.
fn shortened(mut input: Vec<u8>, fails: impl Fn(&[u8]) -> bool) -> Vec<u8> {
    let mut piece = input.len() / 2;
    while piece > 0 {
        let mut at = 0;
        while at < input.len() {
            let mut shorter = input.clone();
            shorter.drain(at..input.len().min(at + piece));
            if fails(&shorter) {
                input = shorter;
            } else {
                at += piece;
            }
        }
        piece /= 2;
    }
    input
}

#[cfg(test)]
mod tests {
    use super::*;

    const STUMBLES: Target = Target {
        name: "stumbles",
        run: |input| {
            let has_pair = input.windows(2).any(|pair| pair == b"X-");
            assert!(!has_pair, "X- is too much");
        },
    };

    #[test]
    fn what_panics_is_found_and_is_made_short() {
        let corpus = [b"G1 X10 Y-20".to_vec(), b"G0 Z5".to_vec()];
        let (input, panic) = search(&STUMBLES, &corpus, 100_000, 1).expect("X- is never made");
        assert_eq!(input, b"X-");
        assert!(panic.contains("X- is too much"), "{panic}");
    }

    #[test]
    fn every_target_has_a_corpus_that_it_takes() {
        for target in &TARGETS {
            let corpus = corpus(target).unwrap();
            assert!(
                corpus.len() >= 10,
                "{}: {} inputs",
                target.name,
                corpus.len()
            );
            let found = search(target, &corpus, corpus.len() as u64 + 50, 1);
            assert!(found.is_none(), "{}: {found:?}", target.name);
        }
    }
}
