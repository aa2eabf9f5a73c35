//! The number of a line of G-code as an `N` word in it, for an observer of the segments.

use core::ops::Range;

/// Digits of a number.
pub(super) const DIGITS: u32 = 7;

/// Where a line gets its number.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct NumberPlace {
    /// Index of the byte before which it stands.
    pub(super) at: usize,
    /// The `N` word that it replaces.
    pub(super) own: Range<usize>,
    /// Whether the line has a number and a checksum for the line itself: what is added must not change the
    /// sum, so it is said twice.
    pub(super) is_checked: bool,
}

impl NumberPlace {
    /// Returns where a whole line gets its number: before its first word, in place of an `N` word there.
    ///
    /// A line gets no number that could change its meaning: a `$` statement, a program number, a second `N` word. A
    /// line without a word gets none either.
    pub(super) fn of(line: &[u8]) -> Option<Self> {
        let is_blank = |byte: &u8| *byte <= b' ' || *byte == b'/';
        let at = line.iter().position(|byte| !is_blank(byte))?;
        let own = at..at + own_word(&line[at..])?;
        if own.end > at && line.contains(&b'*') {
            return Self::in_checked(line, own.end);
        }
        let first = line.get(at)?.to_ascii_uppercase();
        let is_word = first.is_ascii_uppercase() && first != b'O';
        let tail = line.get(own.end..)?;
        let has_another = words(tail).any(|byte| byte.eq_ignore_ascii_case(&b'N'));
        (is_word && !has_another).then_some(Self {
            at,
            own,
            is_checked: false,
        })
    }

    /// Returns where a checked line gets its number: before its G word, which is behind its own number.
    fn in_checked(line: &[u8], number_end: usize) -> Option<Self> {
        let at = number_end + line[number_end..].iter().position(|byte| *byte > b' ')?;
        let has_another = words(&line[at..]).any(|byte| byte.eq_ignore_ascii_case(&b'N'));
        let is_g_code = line[at].eq_ignore_ascii_case(&b'G');
        (is_g_code && !has_another).then_some(Self {
            at,
            own: at..at,
            is_checked: true,
        })
    }
}

/// Returns the length of the `N` word with which a line begins, 0 without such a word, `None` where the `N` has no
/// number.
fn own_word(line: &[u8]) -> Option<usize> {
    let Some((b'N' | b'n', digits)) = line.split_first() else {
        return Some(0);
    };
    let is_digit = |byte: &&u8| byte.is_ascii_digit();
    let count = digits.iter().take_while(is_digit).count();
    let is_whole = digits.get(count) != Some(&b'.');
    ((1..=DIGITS as usize).contains(&count) && is_whole).then_some(count + 1)
}

/// Returns the bytes of a line outside of comments.
fn words(line: &[u8]) -> impl Iterator<Item = &u8> {
    let mut in_parentheses = false;
    let line = line.split(|byte| *byte == b';').next().unwrap_or_default();
    line.iter().filter(move |byte| {
        match **byte {
            b'(' => in_parentheses = true,
            b')' => in_parentheses = false,
            _ => return !in_parentheses,
        }
        false
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_gets_its_number_where_it_changes_nothing() {
        for (line, place) in [
            ("G1 X1", Some((0, 0..0))),
            (" /g1 x1 (none N5)", Some((2, 2..2))),
            ("N12 G1 X1", Some((0, 0..3))),
            ("n0000012G1", Some((0, 0..8))),
            ("X1 ; N5", Some((0, 0..0))),
            ("", None),
            ("\n", None),
            ("(N5)", None),
            ("; G1", None),
            ("%", None),
            ("O1234", None),
            (":1234", None),
            ("$110=5000", None),
            ("#1=5", None),
            ("G1 N5 X1", None),
            ("N1 N2", None),
            ("N1.5 G1", None),
            ("N G1", None),
            ("N12345678 G1", None),
        ] {
            let place = place.map(|(at, own)| NumberPlace {
                at,
                own,
                is_checked: false,
            });
            assert_eq!(NumberPlace::of(line.as_bytes()), place, "{line}");
        }
    }

    #[test]
    fn a_checked_line_keeps_its_own_number_before_the_sum() {
        for (line, at) in [
            ("N3 G1 X1*57", Some(3)),
            ("N12g92 E0*3", Some(3)),
            ("N3 T0*57", None),
            ("N-1 M110 N-1*125", None),
            ("N5 M117 Go*1", None),
            ("N5 G1 N7 X1*1", None),
        ] {
            let place = at.map(|at| NumberPlace {
                at,
                own: at..at,
                is_checked: true,
            });
            assert_eq!(NumberPlace::of(line.as_bytes()), place, "{line}");
        }
    }
}
