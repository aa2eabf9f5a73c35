//! A G-code program, line by line, as a sender sends it.
//!
//! Reads as it goes, so a file may be longer than memory. Bytes that the machine would take for
//! realtime commands (`?`, `!`, `~`, 0x18, 0x80 and above) are left out, as senders do: inside a
//! file they are text, never commands.

use std::{
    fs::File,
    io::{BufRead, BufReader, Read},
    path::Path,
};

use anyhow::{Context, Result, ensure};

/// Longest line that is read: beyond it the file is no program.
const LONGEST: usize = 1 << 20;

/// Reads a program's lines.
pub(crate) struct Program {
    name: String,
    reader: Box<dyn BufRead>,
    /// Bytes of the file, 0 where unknown.
    length: u64,
    read: u64,
    lines: u64,
}

impl Program {
    /// Opens a file.
    pub(crate) fn open(path: &Path) -> Result<Self> {
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

    /// Reads from anything.
    pub(crate) fn from_reader(name: String, reader: impl BufRead + 'static) -> Self {
        Self {
            name,
            reader: Box::new(reader),
            length: 0,
            read: 0,
            lines: 0,
        }
    }

    /// Bytes of the file, 0 where unknown.
    pub(crate) fn length(&self) -> u64 {
        self.length
    }

    /// Bytes read so far.
    pub(crate) fn read(&self) -> u64 {
        self.read
    }

    /// The next line without its end; `None` at the end of the program.
    ///
    /// A last line need not end in a line feed. A carriage return before it belongs to the end.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or has a line of more than a mebibyte.
    pub(crate) fn next_line(&mut self) -> Result<Option<Vec<u8>>> {
        let mut line = Vec::new();
        let read = (&mut self.reader)
            .take(LONGEST as u64 + 2)
            .read_until(b'\n', &mut line)
            .with_context(|| format!("cannot read {}", self.name))?;
        if read == 0 {
            return Ok(None);
        }
        self.read += read as u64;
        self.lines += 1;
        if line.last() == Some(&b'\n') {
            line.pop();
        }
        if line.last() == Some(&b'\r') {
            line.pop();
        }
        ensure!(
            line.len() <= LONGEST,
            "line {} of {} is longer than {LONGEST} bytes: is it a G-code program?",
            self.lines,
            self.name
        );
        line.retain(|byte| !is_realtime(*byte));
        Ok(Some(line))
    }
}

/// Whether the machine acts on a byte wherever it stands.
fn is_realtime(byte: u8) -> bool {
    matches!(byte, b'?' | b'!' | b'~' | 0x18 | 0x80..)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

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
    fn realtime_bytes_of_a_file_are_not_sent() {
        let sent = lines("G1 (size? 5 \u{b5}m!) ~X1\x18\n".as_bytes());
        assert_eq!(sent, [b"G1 (size 5 m) X1".to_vec()]);
    }

    #[test]
    fn an_endless_line_is_an_error() {
        let text = vec![b'G'; LONGEST + 1];
        let mut program = Program::from_reader("test".into(), Cursor::new(text));
        assert!(program.next_line().is_err());
    }
}
