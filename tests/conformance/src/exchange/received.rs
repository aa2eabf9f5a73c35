//! The lines received in an exchange, aligned with the lines of the recording.

use leadscrew::gcode::LineError;

use simulation::sender::Response;

/// A line that was received.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ReceivedLine {
    /// The step during which the line came.
    pub(super) step: usize,
    /// The end of the line, in the time of the recording; recordings of single lines have no times.
    pub(super) time_s: Option<f64>,
    pub(super) text: String,
}

impl ReceivedLine {
    /// Whether it is a status report.
    pub(super) fn is_report(&self) -> bool {
        self.text.starts_with('<')
    }

    /// The part that identifies a line: the text before the values of a list.
    fn kind(&self) -> &str {
        let text = self.text.as_str();
        let is_list = text.starts_with('$') || (text.starts_with('[') && !text.starts_with("[MSG"));
        match text.find(['=', ':']) {
            Some(end) if is_list => &text[..end],
            _ => text,
        }
    }

    /// Whether two lines of two recordings can be the same line: without times, in the same step. A line that no
    /// request caused may come in the step before.
    fn is_like(&self, other: &Self) -> bool {
        let is_near = self.step == other.step
            || (self.step + 1 == other.step && !self.is_answer() && !other.is_report());
        self.kind() == other.kind() && (self.time_s.is_some() || is_near)
    }

    /// Whether it is the answer to a line.
    pub(super) fn is_answer(&self) -> bool {
        Response::parse(&self.text).is_some()
    }

    /// Whether it refuses a line with this error.
    pub(super) fn is_error(&self, error: LineError) -> bool {
        Response::parse(&self.text) == Some(Response::Error(u16::from(error.number())))
    }
}

/// A place in two sequences.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pair {
    /// The same text in both, or at least the same kind of it: indices in ours and theirs.
    Both(usize, usize),
    /// Another text in the same place.
    Changed(usize, usize),
    /// Only ours has it; before this index of theirs.
    Ours(usize, usize),
    /// Only theirs has it; before this index of ours.
    Theirs(usize, usize),
}

/// Aligns two sequences: as many equal texts as possible, and what remains in pairs.
pub(super) fn align(ours: &[ReceivedLine], theirs: &[ReceivedLine]) -> Vec<Pair> {
    // Longest common subsequence, from the ends.
    let mut common = vec![vec![0_u32; theirs.len() + 1]; ours.len() + 1];
    for (i, our) in ours.iter().enumerate().rev() {
        for (j, their) in theirs.iter().enumerate().rev() {
            common[i][j] = if our.is_like(their) {
                common[i + 1][j + 1] + 1
            } else {
                common[i + 1][j].max(common[i][j + 1])
            };
        }
    }
    let (mut i, mut j) = (0, 0);
    let (mut only_ours, mut only_theirs) = (Vec::new(), Vec::new());
    let mut pairs = Vec::new();
    loop {
        let at_end = i == ours.len() || j == theirs.len();
        if !at_end && ours[i].is_like(&theirs[j]) {
            pair_up(&mut only_ours, &mut only_theirs, (i, j), &mut pairs);
            pairs.push(Pair::Both(i, j));
            i += 1;
            j += 1;
        } else if at_end && i == ours.len() && j == theirs.len() {
            pair_up(&mut only_ours, &mut only_theirs, (i, j), &mut pairs);
            return pairs;
        } else if i < ours.len() && (j == theirs.len() || common[i + 1][j] >= common[i][j + 1]) {
            only_ours.push(i);
            i += 1;
        } else {
            only_theirs.push(j);
            j += 1;
        }
    }
}

/// What lies between two equal texts, first with first.
fn pair_up(
    ours: &mut Vec<usize>,
    theirs: &mut Vec<usize>,
    (i, j): (usize, usize),
    pairs: &mut Vec<Pair>,
) {
    let both = ours.len().min(theirs.len());
    for index in 0..both {
        pairs.push(Pair::Changed(ours[index], theirs[index]));
    }
    pairs.extend(ours[both..].iter().map(|our| Pair::Ours(*our, j)));
    pairs.extend(theirs[both..].iter().map(|their| Pair::Theirs(*their, i)));
    ours.clear();
    theirs.clear();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn received(text: &str) -> Vec<ReceivedLine> {
        let words = text.split_whitespace();
        words
            .map(|word| ReceivedLine {
                step: 0,
                time_s: None,
                text: word.into(),
            })
            .collect()
    }

    fn aligned(ours: &str, theirs: &str) -> Vec<Pair> {
        align(&received(ours), &received(theirs))
    }

    #[test]
    fn what_is_equal_stays_together() {
        assert_eq!(
            aligned("a b c", "a c"),
            [Pair::Both(0, 0), Pair::Ours(1, 1), Pair::Both(2, 1)]
        );
        assert_eq!(
            aligned("a c", "a b c"),
            [Pair::Both(0, 0), Pair::Theirs(1, 1), Pair::Both(1, 2)]
        );
        assert_eq!(
            aligned("a x c", "a b c d"),
            [
                Pair::Both(0, 0),
                Pair::Changed(1, 1),
                Pair::Both(2, 2),
                Pair::Theirs(3, 3)
            ]
        );
    }

    #[test]
    fn values_of_the_same_list_stay_together() {
        assert_eq!(aligned("[GC:T1] ok", "[GC:T0] ok").len(), 2);
        assert_eq!(aligned("$1=2 $2=3", "$1=1 $2=3").len(), 2);
        assert_eq!(aligned("[MSG:a] ok", "[MSG:b] ok")[0], Pair::Changed(0, 0));
    }

    #[test]
    fn an_exchanged_order_is_a_difference() {
        assert_eq!(aligned("a b", "b a").len(), 3);
        assert_eq!(aligned("", ""), []);
    }
}
