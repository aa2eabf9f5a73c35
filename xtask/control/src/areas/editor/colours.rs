//! What the parts of a line are, for their colours.

/// What a part of a line is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// A word of motion or mode: `G1`.
    General,
    /// A word of the machine: `M3`.
    Machine,
    /// A coordinate, or what belongs to one: `X1`, `I2`, `R3`.
    Axis,
    /// Feed, speed or tool: `F100`.
    Feed,
    /// The number of a line: `N10`.
    Number,
    /// A comment, or a line that is none of the program.
    Comment,
    /// Anything else.
    Other,
}

impl Part {
    /// Its class in the style; anything else has none.
    pub(super) fn class(self) -> Option<&'static str> {
        Some(match self {
            Self::General => "general",
            Self::Machine => "miscellaneous",
            Self::Axis => "axis",
            Self::Feed => "feeds",
            Self::Number => "number",
            Self::Comment => "comment",
            Self::Other => return None,
        })
    }

    fn of_letter(letter: u8) -> Self {
        match letter.to_ascii_uppercase() {
            b'G' => Self::General,
            b'M' => Self::Machine,
            b'F' | b'S' | b'T' => Self::Feed,
            b'N' => Self::Number,
            b'A'..=b'C' | b'I'..=b'L' | b'P'..=b'R' | b'U'..=b'Z' | b'D' | b'H' => Self::Axis,
            _ => Self::Other,
        }
    }
}

/// How long the part at the beginning of a text is, and what it is.
fn part(text: &[u8]) -> (Part, usize) {
    match text {
        [b'(', ..] => {
            let end = text.iter().position(|byte| *byte == b')');
            (Part::Comment, end.map_or(text.len(), |end| end + 1))
        }
        [b';' | b'%', ..] => (Part::Comment, text.len()),
        [letter, value @ ..] if letter.is_ascii_alphabetic() => {
            let is_value = |byte: &u8| byte.is_ascii_digit() || b"+-. \t".contains(byte);
            let end = value.iter().take_while(|byte| is_value(byte)).count();
            let blanks =
                { value[..end].iter().rev() }.take_while(|byte| byte.is_ascii_whitespace());
            let end = end - blanks.count();
            let is_word = value[..end].iter().any(u8::is_ascii_digit);
            let part = if is_word {
                Part::of_letter(*letter)
            } else {
                Part::Other
            };
            (part, if is_word { end + 1 } else { 1 })
        }
        _ => (Part::Other, 1),
    }
}

/// The parts of a line, in order: together they are the line.
pub(super) fn parts(line: &str) -> Vec<(Part, &str)> {
    if line.trim_start().starts_with('$') {
        return vec![(Part::Other, line)];
    }
    let bytes = line.as_bytes();
    let (mut parts, mut at, mut begin) = (Vec::new(), 0, 0);
    while at < bytes.len() {
        let (kind, length) = part(&bytes[at..]);
        if kind != Part::Other {
            if begin < at {
                parts.push((Part::Other, &line[begin..at]));
            }
            begin = at + length;
            parts.push((kind, &line[at..begin]));
        }
        at += length;
    }
    if begin < bytes.len() {
        parts.push((Part::Other, &line[begin..]));
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_have_their_kinds() {
        use Part::{Axis, Comment, Feed, General, Machine, Number, Other};
        let line = "N10 g1X-1.5 Y 2 (to ; ä) M3 S12000 T1 ; F1";
        let expected = [
            (Number, "N10"),
            (Other, " "),
            (General, "g1"),
            (Axis, "X-1.5"),
            (Other, " "),
            (Axis, "Y 2"),
            (Other, " "),
            (Comment, "(to ; ä)"),
            (Other, " "),
            (Machine, "M3"),
            (Other, " "),
            (Feed, "S12000"),
            (Other, " "),
            (Feed, "T1"),
            (Other, " "),
            (Comment, "; F1"),
        ];
        assert_eq!(parts(line), expected);
    }

    #[test]
    fn the_parts_of_any_line_are_the_line() {
        for line in [
            "",
            "(never closed",
            "%",
            "GX1",
            "$J=G91X1",
            "X#<ä>1",
            "ää G",
            "G1 ",
            "[#1+2]F",
        ] {
            let whole: String = parts(line).into_iter().map(|(_, text)| text).collect();
            assert_eq!(whole, line);
        }
        assert_eq!(parts("GX1"), [(Part::Other, "G"), (Part::Axis, "X1")]);
        assert_eq!(parts("$J=X1"), [(Part::Other, "$J=X1")]);
    }
}
