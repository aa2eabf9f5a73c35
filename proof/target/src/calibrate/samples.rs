//! Samples that the program on the board sends.

use std::str::FromStr;

use anyhow::{Context, Result, bail, ensure};

/// The measured times of repetitions of an instruction.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Sample {
    /// Class of the analysis' table.
    pub(super) class: String,
    /// Which of the things that the class stands for.
    pub(super) variant: String,
    /// How many.
    pub(super) repetitions: u64,
    /// The least that they took in several runs, cycles.
    pub(super) least: u64,
    /// The most.
    pub(super) most: u64,
}

/// Everything that was sent.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Measurement {
    /// There was nothing to measure with.
    NoCounter,
    /// What was measured.
    Samples(Vec<Sample>),
}

/// The last line.
const END: &str = "end";
/// The only line where there is no counter.
const NO_COUNTER: &str = "no cycle counter";

/// Whether everything has come.
#[cfg(any(feature = "probe", test))]
pub(super) fn is_complete(text: &str) -> bool {
    let mut lines = text.split_inclusive('\n');
    lines.any(|line| {
        [END, NO_COUNTER]
            .map(|end| format!("{end}\n"))
            .contains(&line.to_owned())
    })
}

impl Measurement {
    /// Reads all lines.
    pub(super) fn read(text: &str) -> Result<Self> {
        let mut samples = Vec::new();
        for line in text.lines() {
            match line.split(' ').collect::<Vec<_>>()[..] {
                [END] => return Ok(Self::Samples(samples)),
                _ if line == NO_COUNTER => return Ok(Self::NoCounter),
                ["sample", class, variant, repetitions, least, most] => {
                    let sample = Sample {
                        class: class.into(),
                        variant: variant.into(),
                        repetitions: number(repetitions, line)?,
                        least: number(least, line)?,
                        most: number(most, line)?,
                    };
                    let is_sound = sample.repetitions > 0 && sample.least <= sample.most;
                    ensure!(is_sound, "{line:?} cannot have been measured");
                    samples.push(sample);
                }
                _ => bail!("the program has sent {line:?}"),
            }
        }
        bail!("the program has not come to its end")
    }
}

fn number<T: FromStr>(text: &str, line: &str) -> Result<T> {
    let value = text.parse().ok();
    value.with_context(|| format!("{text:?} in {line:?} is no number"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_become_samples() {
        let text = "sample divide udiv 32 380 384\nsample apb1 read 32 448 452\nend\n";
        let Measurement::Samples(samples) = Measurement::read(text).unwrap() else {
            panic!("there are samples");
        };
        assert_eq!(samples.len(), 2);
        assert_eq!(samples[0].class, "divide");
        assert_eq!((samples[1].least, samples[1].most), (448, 452));
        assert!(is_complete(text));
    }

    #[test]
    fn a_program_without_a_counter_says_so() {
        let read = Measurement::read("no cycle counter\n").unwrap();
        assert_eq!(read, Measurement::NoCounter);
        assert!(is_complete("no cycle counter\n"));
    }

    #[test]
    fn a_truncated_or_meaningless_sample_is_refused() {
        for (text, reason) in [
            ("sample divide udiv 32 380 384\n", "not come to its end"),
            ("", "not come to its end"),
            ("sample divide udiv 32 380\nend\n", "has sent"),
            ("sample divide udiv 32 many 384\nend\n", "is no number"),
            ("sample divide udiv 0 1 2\nend\n", "cannot have been"),
            ("sample divide udiv 32 9 8\nend\n", "cannot have been"),
        ] {
            let error = Measurement::read(text).unwrap_err().to_string();
            assert!(error.contains(reason), "{text}: {error}");
        }
        for text in ["sample a", "end", "sample end end 1 1 1\n"] {
            assert!(!is_complete(text), "{text}");
        }
    }
}
