//! New inputs from those of a corpus.

use proptest::prelude::Rng;
use proptest::test_runner::{RngAlgorithm, TestRng};

/// What stands for a number when one is changed.
const NUMBERS: [&str; 16] = [
    "0",
    "-0",
    ".",
    "-",
    "1e9",
    "0.0000001",
    "4294967295",
    "4294967296",
    "-2147483648",
    "99999999999",
    "1.5.2",
    "+7",
    "254",
    "255",
    "256",
    "3.4028235e38",
];
/// Longest input, bytes.
const MAX_INPUT_BYTES: usize = 600;
/// Most changes of one input.
const CHANGES: u64 = 6;

/// Makes inputs from a corpus and a seed: the same ones each time.
pub(super) struct Mutator<'a> {
    corpus: &'a [Vec<u8>],
    random: TestRng,
}

impl<'a> Mutator<'a> {
    pub(super) fn new(corpus: &'a [Vec<u8>], seed: u64) -> Self {
        let mut bytes = [0; 32];
        bytes[..8].copy_from_slice(&seed.to_le_bytes());
        Self {
            corpus,
            random: TestRng::from_seed(RngAlgorithm::ChaCha, &bytes),
        }
    }

    /// Returns the next input.
    pub(super) fn next_input(&mut self) -> Vec<u8> {
        let mut input = self.of_corpus().to_vec();
        for _ in 0..=self.below(CHANGES) {
            self.change(&mut input);
        }
        input.truncate(MAX_INPUT_BYTES);
        input
    }

    fn below(&mut self, end: u64) -> u64 {
        self.random.next_u64() % end.max(1)
    }

    fn of_corpus(&mut self) -> &'a [u8] {
        let place = self.below(self.corpus.len() as u64) as usize;
        self.corpus.get(place).map_or(&[], Vec::as_slice)
    }

    /// A piece of something, from one place to another.
    fn range(&mut self, length: usize) -> std::ops::Range<usize> {
        let from = self.below(length as u64 + 1) as usize;
        let longest = (length - from).min(24) as u64;
        from..from + self.below(longest + 1) as usize
    }

    fn change(&mut self, input: &mut Vec<u8>) {
        let place = self.below(input.len() as u64 + 1) as usize;
        match self.below(8) {
            0 => {
                if let Some(byte) = input.get_mut(place) {
                    *byte ^= 1 << self.below(8);
                }
            }
            1 => input.insert(place, self.below(256) as u8),
            2 => {
                let range = self.range(input.len());
                input.drain(range);
            }
            3 => {
                let range = self.range(input.len());
                let piece = input[range].to_vec();
                input.splice(place..place, piece);
            }
            4 | 5 => {
                let other = self.of_corpus();
                let range = self.range(other.len());
                input.splice(place..place, other[range].iter().copied());
            }
            6 => {
                let number = NUMBERS[self.below(NUMBERS.len() as u64) as usize];
                let digits = input[place..]
                    .iter()
                    .take_while(|byte| byte.is_ascii_digit());
                let end = place + digits.count();
                input.splice(place..end, number.bytes());
            }
            _ => {
                let letter = b"GMXYZIJKRPQFSTNDHLE$=\n ;()"[self.below(26) as usize];
                input.insert(place, letter);
            }
        }
    }
}

/// An input as a line of text.
pub(super) fn escaped(input: &[u8]) -> String {
    input.escape_ascii().to_string()
}

/// The input of a line of text.
pub(super) fn unescaped(text: &str) -> Vec<u8> {
    let mut input = Vec::new();
    let mut remainder = text.as_bytes();
    while let [first, others @ ..] = remainder {
        let (byte, length) = match others {
            [b'n', ..] if *first == b'\\' => (b'\n', 2),
            [b'r', ..] if *first == b'\\' => (b'\r', 2),
            [b't', ..] if *first == b'\\' => (b'\t', 2),
            [b'x', high, low, ..] if *first == b'\\' => {
                let digit = |byte: u8| char::from(byte).to_digit(16).unwrap_or(0) as u8;
                (digit(*high) << 4 | digit(*low), 4)
            }
            [quoted, ..] if *first == b'\\' => (*quoted, 2),
            _ => (*first, 1),
        };
        input.push(byte);
        remainder = &remainder[length..];
    }
    input
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_input_can_be_written_as_a_line_of_text() {
        let all: Vec<u8> = (0..=255).collect();
        assert_eq!(unescaped(&escaped(&all)), all);
        assert!(!escaped(&all).contains('\n'));
    }

    #[test]
    fn inputs_are_the_same_for_a_seed_and_others_for_another() {
        let corpus = [b"G1 X10".to_vec(), b"$110=5000".to_vec()];
        let inputs = |seed| {
            let mut mutator = Mutator::new(&corpus, seed);
            [(); 100].map(|()| mutator.next_input())
        };
        assert_eq!(inputs(1), inputs(1));
        assert_ne!(inputs(1), inputs(2));
        assert!(inputs(1).iter().any(|input| !corpus.contains(input)));
    }
}
