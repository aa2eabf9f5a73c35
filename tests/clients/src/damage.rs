//! Damage on a serial line: flipped bits, lost and doubled bytes, lost answers.
//!
//! As on a long cable beside a spindle, but from a seed, so that a run that has failed can be had again.

use fastrand::Rng;

/// How many of a hundred checked lines are damaged on their way to the machine.
const LINES_PERCENT: u32 = 6;
/// How many of a hundred answers are lost.
const ANSWERS_PERCENT: u32 = 3;

/// What is done to the lines that pass.
pub(crate) struct Damage {
    random: Rng,
    /// The beginning of a line whose end has not come.
    begun: Vec<u8>,
    /// Lines that have been damaged.
    pub(crate) lines: u64,
    /// Answers that have been lost.
    pub(crate) answers: u64,
}

impl Damage {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            random: Rng::with_seed(seed),
            begun: Vec::new(),
            lines: 0,
            answers: 0,
        }
    }

    /// What reaches the machine of bytes that have been sent, by whole lines.
    ///
    /// Only numbered lines are damaged, for only these can be sent again. `M110` is never damaged: after its loss,
    /// printcore takes the request for the next line as no reason to send `M110` again.
    pub(crate) fn sent(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut passed = Vec::new();
        self.begun.extend(bytes);
        // A question between lines has no end.
        if self.begun.first() == Some(&b'?') {
            passed.push(self.begun.remove(0));
        }
        while let Some(end) = self.begun.iter().position(|byte| *byte == b'\n') {
            let mut line: Vec<u8> = self.begun.drain(..=end).collect();
            let is_checked = line.starts_with(b"N") && !line.windows(4).any(|word| word == b"M110");
            if is_checked && self.random.u32(..100) < LINES_PERCENT {
                self.lines += 1;
                self.damage(&mut line);
            }
            passed.append(&mut line);
        }
        passed
    }

    fn damage(&mut self, line: &mut Vec<u8>) {
        let place = self.random.usize(..line.len());
        match self.random.u32(..3) {
            0 => line[place] ^= 1 << self.random.u32(..8),
            1 => drop(line.remove(place)),
            _ => line.insert(place, line[place]),
        }
    }

    /// What reaches the sender of bytes that the machine has sent: whole answers are lost.
    pub(crate) fn received(&mut self, bytes: &[u8], passed: &mut Vec<u8>) {
        for byte in bytes {
            passed.push(*byte);
            if *byte != b'\n' {
                continue;
            }
            let mut before = passed[..passed.len() - 1].iter();
            let begin = before.rposition(|byte| *byte == b'\n');
            let begin = begin.map_or(0, |end| end + 1);
            let line = &passed[begin..];
            let is_answer = line.starts_with(b"ok") || line.starts_with(b"Resend:");
            if is_answer && self.random.u32(..100) < ANSWERS_PERCENT {
                self.answers += 1;
                passed.truncate(begin);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbered_lines_are_damaged_and_no_others() {
        let mut damage = Damage::new(1);
        assert_eq!(damage.sent(b"?"), b"?");
        let others = b"M114\nN-1 M110 N-1*125\n";
        for _ in 0..1000 {
            assert_eq!(damage.sent(others), others);
        }
        assert_eq!(damage.lines, 0);
        let line = b"N12 G1 X3*21\n";
        // In pieces, as a serial port gives them.
        let changed = (0..1000).filter(|_| {
            let begin = damage.sent(&line[..5]);
            assert!(begin.is_empty());
            damage.sent(&line[5..]) != line
        });
        let changed = changed.count() as u64;
        assert!((30..100).contains(&changed), "{changed}");
        // A byte that comes twice beside its like changes the line all the same.
        assert_eq!(changed, damage.lines);
    }

    #[test]
    fn answers_are_lost_and_nothing_else() {
        let mut damage = Damage::new(1);
        let mut passed = Vec::new();
        for _ in 0..1000 {
            damage.received(b"wait\r\no", &mut passed);
            damage.received(b"k\r\n", &mut passed);
        }
        let text = String::from_utf8(passed).unwrap();
        let count = |line| text.lines().filter(|other| *other == line).count() as u64;
        assert_eq!(count("wait"), 1000);
        assert!((10..60).contains(&damage.answers), "{}", damage.answers);
        assert_eq!(count("ok") + damage.answers, 1000);
    }
}
