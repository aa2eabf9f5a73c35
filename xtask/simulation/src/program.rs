//! A G-code program, line by line, as a sender sends it.
//!
//! Reads as it goes, so a file may be longer than memory. What the machine would take for realtime commands
//! (`?`, `!`, `~`, 0x18, bytes from 0x80 on that are no text in UTF-8) is never sent, as with other senders:
//! inside a file it is text. In a comment it is left out. Elsewhere that would join what it separates (`X1?5` is
//! not X15), so something is sent in its place that is refused.

use std::{
    collections::VecDeque,
    fs::{self, File},
    io::{self, BufRead, BufReader, Cursor, Read},
    path::Path,
};

use anyhow::{Context, Result, ensure};
use grbl_client::sender;

/// Longest line that is read: beyond it the file is no program.
const MAX_LINE_BYTES: usize = 1 << 20;
/// What some editors put in front of a text in UTF-8.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Reads a program's lines.
pub struct Program {
    name: String,
    reader: Box<dyn BufRead>,
    /// Lines that have been read with the one before.
    ready: VecDeque<Vec<u8>>,
    /// Bytes of the file, 0 where unknown.
    length: u64,
    read: u64,
    lines: u64,
    /// The first line that is not UTF-8.
    foreign_line: Option<u64>,
}

impl Program {
    /// Opens a file, or for `-` standard input.
    pub fn open(path: &Path) -> Result<Self> {
        if path == Path::new("-") {
            return Ok(Self::from_reader(
                "standard input".into(),
                io::stdin().lock(),
            ));
        }
        let name = path.display().to_string();
        let file = File::open(path).with_context(|| format!("cannot open the program {name}"))?;
        let metadata = file
            .metadata()
            .with_context(|| format!("cannot read {name}"))?;
        ensure!(
            !metadata.is_dir(),
            "{name} is a folder: a G-code file is wanted"
        );
        Ok(Self {
            length: metadata.len(),
            ..Self::from_reader(name, BufReader::with_capacity(1 << 16, file))
        })
    }

    /// Opens a program as the recordings of Grbl had it: without the bytes of realtime commands,
    /// wherever they stood.
    ///
    /// # Errors
    ///
    /// The file cannot be read.
    pub fn recorded(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        let mut text = fs::read(path).with_context(|| format!("cannot read the program {name}"))?;
        text.retain(|byte| !matches!(byte, b'?' | b'!' | b'~' | 0x18 | 0x80..));
        Ok(Self::from_reader(name, Cursor::new(text)))
    }

    /// Reads what is in memory.
    pub fn from_bytes(name: String, text: Vec<u8>) -> Self {
        Self {
            length: text.len() as u64,
            ..Self::from_reader(name, Cursor::new(text))
        }
    }

    /// Reads from anything.
    pub fn from_reader(name: String, reader: impl BufRead + 'static) -> Self {
        Self {
            name,
            reader: Box::new(reader),
            ready: VecDeque::new(),
            length: 0,
            read: 0,
            lines: 0,
            foreign_line: None,
        }
    }

    /// Bytes of the file, 0 where unknown.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Bytes read so far.
    pub fn read(&self) -> u64 {
        self.read
    }

    /// The number of the first line read so far that is not UTF-8.
    pub fn foreign_line(&self) -> Option<u64> {
        self.foreign_line
    }

    /// The next line without its end; `None` at the end of the program.
    ///
    /// A last line need not end in a line feed. A carriage return before it belongs to the end, and
    /// ends a line anywhere else.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or has a line of more than a mebibyte.
    pub fn next_line(&mut self) -> Result<Option<Vec<u8>>> {
        if let Some(line) = self.ready.pop_front() {
            return Ok(Some(line));
        }
        let mut line = Vec::new();
        let read = (&mut self.reader)
            .take(MAX_LINE_BYTES as u64 + 2)
            .read_until(b'\n', &mut line)
            .with_context(|| format!("cannot read {}", self.name))?;
        if read == 0 {
            return Ok(None);
        }
        self.read += read as u64;
        self.lines += 1;
        if self.lines == 1 && line.starts_with(BYTE_ORDER_MARK) {
            line.drain(..BYTE_ORDER_MARK.len());
        }
        if line.last() == Some(&b'\n') {
            line.pop();
        }
        if line.last() == Some(&b'\r') {
            line.pop();
        }
        ensure!(
            line.len() <= MAX_LINE_BYTES,
            "line {} of {} is longer than {MAX_LINE_BYTES} bytes: is it a G-code program?",
            self.lines,
            self.name
        );
        if self.foreign_line.is_none() && str::from_utf8(&line).is_err() {
            self.foreign_line = Some(self.lines);
        }
        self.ready
            .extend(line.split(|byte| *byte == b'\r').map(sender::sendable));
        Ok(self.ready.pop_front())
    }
}

/// What is said of a file with text that is not UTF-8, from this line on.
pub fn encoding_warning(line: u64) -> String {
    format!(
        "line {line} is not UTF-8 but, perhaps, Latin-1 or Shift-JIS: to a machine such bytes may be realtime commands, \
         and they are not sent"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &[u8]) -> Vec<Vec<u8>> {
        let mut program = Program::from_reader("test".into(), Cursor::new(text.to_vec()));
        std::iter::from_fn(|| program.next_line().unwrap()).collect()
    }

    #[test]
    fn the_last_line_needs_no_end() {
        assert_eq!(lines(b"G0\nX1"), [b"G0".to_vec(), b"X1".to_vec()]);
        assert_eq!(lines(b"G0\r\n\r\n"), [b"G0".to_vec(), vec![]]);
        assert!(lines(b"").is_empty());
    }

    #[test]
    fn each_line_ending_ends_one_line() {
        let expected = [b"G0".to_vec(), b"X1".to_vec(), vec![], b"Y1".to_vec()];
        assert_eq!(lines(b"G0\rX1\r\n\nY1"), expected);
    }

    #[test]
    fn realtime_bytes_of_a_file_are_not_sent_and_text_is() {
        let sent = lines("G1 (size? 5 \u{b5}m!) X1 ; what?\n".as_bytes());
        assert_eq!(sent, ["G1 (size 5 \u{b5}m) X1 ; what".as_bytes()]);
        assert_eq!(lines(b"(\xc4nderung \x84) G0"), [b"(nderung ) G0"]);
        assert_eq!(
            lines("\u{a0}G0 (a\u{84}b\u{3084})".as_bytes()),
            [" G0 (ab\u{3084})".as_bytes()]
        );
    }

    #[test]
    fn what_is_not_sent_joins_no_digits() {
        assert_eq!(lines("\u{feff}G21\n".as_bytes()), [b"G21".to_vec()]);
        for text in [
            &b"G1 X1\xa05"[..],
            b"G1 X1?5",
            b"G1 (a) X1\x185",
            b"G1 X1\xc2\x845",
            b"\xc2\xa1",
        ] {
            let sent = lines(text).concat();
            assert!(
                sent.is_ascii() && !sent.contains(&b'?') && !sent.contains(&0x18),
                "{text:x?}"
            );
            assert!(sent.contains(&sender::REFUSED), "{text:x?}");
        }
        assert_eq!(
            lines("G1 X1\u{2013}5".as_bytes()),
            ["G1 X1\u{2013}5".as_bytes()]
        );
    }

    #[test]
    fn the_first_line_that_is_not_utf_8_is_known() {
        let text = b"G0\n(\x8f\xc9)\n(\xc4)\n".to_vec();
        let mut program = Program::from_bytes("test".into(), text);
        let mut found = Vec::new();
        while program.next_line().unwrap().is_some() {
            found.push(program.foreign_line());
        }
        assert_eq!(found, [None, Some(2), Some(2)]);
    }

    #[test]
    fn an_endless_line_is_an_error() {
        let text = vec![b'G'; MAX_LINE_BYTES + 1];
        let mut program = Program::from_reader("test".into(), Cursor::new(text));
        assert!(program.next_line().is_err());
    }
}
