//! The serial line of the board: messages of faults, then bytes in both directions, all compared.
//!
//! `tests/bring_up/echo.rs` is the other side; the bytes of both are in `tests/bring_up/sequence.rs`.

use std::{
    io::{ErrorKind, Read, Write},
    iter, thread,
    time::Instant,
};

use anyhow::{Context, Result, ensure};
use common::ui;

use super::{
    facts::Facts,
    sequence::{BURST, BURSTS, FROM_BOARD, Sequence, TO_BOARD},
    stream,
};

/// Says that what the board sends from there on are answers.
const MARK: &[u8] = b"\r\n[bring-up]\r\n";
/// Asks for a byte, in the emulator.
const BYTE_REQUEST: &[u8] = b"\r\n[byte]\r\n";
/// More bytes than all messages of faults.
const MOST_RECEIVED: usize = 1 << 16;
/// The messages of faults to the sender, with their names in the facts.
const FAULT_MESSAGES: [(&str, &str); 3] = [
    ("told.processor", "[MSG:Fault: processor fault]"),
    ("told.panic", "[MSG:Fault: panic at "),
    ("told.interrupt", "[MSG:Fault: unknown interrupt]"),
];

/// Sends a byte when the program in the emulator asks for one: to somebody who does not receive yet.
pub(super) fn send_early(from: &mut dyn Read, mut to: impl Write) -> Result<()> {
    receive_until(from, BYTE_REQUEST)?;
    to.write_all(b"$")
        .context("cannot write to the serial line")
}

/// Reads the messages of the board before the exchange, and counts the faults.
pub(super) fn listen(from: &mut dyn Read, facts: &mut Facts) -> Result<()> {
    let received = receive_until(from, MARK)?;
    for (name, message) in FAULT_MESSAGES {
        facts.count(name, received.matches(message).count());
    }
    Ok(())
}

/// Reads the output of the board up to a mark.
fn receive_until(from: &mut dyn Read, mark: &[u8]) -> Result<String> {
    let mut received = Vec::new();
    let mut byte = [0];
    while !received.ends_with(mark) {
        let length = from.read(&mut byte);
        let length = length.context("the board says nothing at its serial line")?;
        ensure!(length == 1, "the serial line is closed");
        ensure!(
            received.len() < MOST_RECEIVED,
            "the board does not come to its end"
        );
        received.push(byte[0]);
    }
    Ok(String::from_utf8_lossy(&received).into_owned())
}

/// Reads the messages of the board, then exchanges all bytes with it.
pub(super) fn exchange_all(
    from: &mut (impl Read + Send),
    to: &mut (impl Write + Send),
    facts: &mut Facts,
) -> Result<()> {
    listen(from, facts)?;
    ui::status("Exchanging", "bytes over the serial line");
    let bytes = facts.get("serial.expected").unwrap_or_default();
    exchange(from, &mut *to, bytes, facts)?;
    let bytes = facts.get("stream.expected").unwrap_or_default();
    let start = Instant::now();
    stream::receive(from, &mut *to, || start.elapsed(), bytes, facts)?;
    ui::status("Erasing", "a sector of the flash while bytes come");
    send_bursts(from, to)
}

/// Sends so many bytes and counts what comes back, until everything has or nothing comes any more.
pub(super) fn exchange(
    from: &mut dyn Read,
    mut to: impl Write + Send,
    bytes: i64,
    facts: &mut Facts,
) -> Result<()> {
    let count = usize::try_from(bytes).context("the program waits for less than nothing")?;
    let sent: Vec<u8> = bytes_of(TO_BOARD).take(count).collect();
    let mut answers = bytes_of(FROM_BOARD);
    let (mut returned, mut wrong) = (0, 0);
    thread::scope(|scope| -> Result<()> {
        let sender = scope.spawn(move || to.write_all(&sent).and_then(|()| to.flush()));
        let mut chunk = [0; 4096];
        while returned < count {
            let length = read(from, &mut chunk)?;
            if length == 0 {
                break;
            }
            let right = chunk[..length].iter().zip(&mut answers);
            wrong += right.filter(|(byte, expected)| **byte != *expected).count();
            returned += length;
        }
        let sent = sender.join().expect("the sender does not panic");
        sent.context("cannot write to the serial line")
    })?;
    facts.count("serial.returned", returned);
    facts.count("serial.returned_wrong", wrong);
    Ok(())
}

/// How often bytes are sent while the flash is busy.
const OPERATIONS: usize = 3;

/// Sends a burst of bytes for each operation of the flash, when the board has compared those before.
pub(super) fn send_bursts(from: &mut dyn Read, mut to: impl Write) -> Result<()> {
    let mut bytes = bytes_of(BURSTS);
    for _ in 0..OPERATIONS {
        let burst: Vec<u8> = bytes.by_ref().take(BURST as usize).collect();
        to.write_all(&burst)
            .context("cannot write to the serial line")?;
        if read(from, &mut [0])? == 0 {
            break;
        }
    }
    Ok(())
}

/// Reads what has come, or nothing after a silence.
pub(super) fn read(from: &mut dyn Read, bytes: &mut [u8]) -> Result<usize> {
    match from.read(bytes) {
        Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(0),
        other => other.context("the serial line is broken"),
    }
}

/// The bytes of one seed.
pub(super) fn bytes_of(seed: u8) -> impl Iterator<Item = u8> {
    let mut sequence = Sequence::new(seed);
    iter::repeat_with(move || sequence.next_byte())
}

#[cfg(test)]
mod tests {
    use std::cell::{Cell, RefCell};

    use super::*;

    /// A board whose answers are these.
    fn answered(answers: &[u8], bytes: i64) -> (Option<i64>, Option<i64>) {
        let mut facts = Facts::default();
        let mut sent = Vec::new();
        exchange(&mut &*answers, &mut sent, bytes, &mut facts).unwrap();
        assert_eq!(i64::try_from(sent.len()), Ok(bytes));
        assert_eq!(sent.split(|byte| *byte == b'\n').count(), 3);
        (
            facts.get("serial.returned"),
            facts.get("serial.returned_wrong"),
        )
    }

    #[test]
    fn a_byte_that_is_lost_or_changed_on_return_is_counted() {
        let right: Vec<u8> = bytes_of(FROM_BOARD).take(150).collect();
        assert_eq!(answered(&right, 150), (Some(150), Some(0)));
        let mut changed = right.clone();
        changed[100] ^= 1;
        assert_eq!(answered(&changed, 150), (Some(150), Some(1)));
        let mut lost = right;
        lost.remove(100);
        let (returned, wrong) = answered(&lost, 150);
        assert_eq!(returned, Some(149));
        assert!(wrong > Some(30), "{wrong:?}");
    }

    /// A board that answers so many bursts, each when it has come.
    struct Board {
        answers: Cell<usize>,
        sent: RefCell<Vec<u8>>,
    }

    impl Read for &Board {
        fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
            let left = self.answers.get().checked_sub(1);
            self.answers.set(left.ok_or(ErrorKind::WouldBlock)?);
            let sent = self.sent.borrow().len();
            assert!(sent.is_multiple_of(BURST as usize), "half a burst");
            bytes[0] = b'.';
            Ok(1)
        }
    }

    impl Write for &Board {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.sent.borrow_mut().write(bytes)
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn bytes_are_sent_to_a_busy_flash_as_long_as_the_board_answers() {
        for (answers, bursts) in [(3, 3), (2, 3), (1, 2), (0, 1)] {
            let board = Board {
                answers: Cell::new(answers),
                sent: RefCell::default(),
            };
            send_bursts(&mut &board, &board).unwrap();
            let all = bytes_of(BURSTS).take(bursts * BURST as usize);
            assert!(board.sent.into_inner().into_iter().eq(all), "{answers}");
        }
    }

    #[test]
    fn what_faults_tell_is_counted_up_to_the_mark() {
        let text = "\r\n[MSG:Fault: processor fault]\r\n\r\n[MSG:Fault: panic at a.rs:1]\r\n\
            \r\n[bring-up]\r\n[MSG:Fault: processor fault]\r\n";
        let mut facts = Facts::default();
        listen(&mut text.as_bytes(), &mut facts).unwrap();
        let counts = FAULT_MESSAGES.map(|(name, _)| facts.get(name));
        assert_eq!(counts, [Some(1), Some(1), Some(0)]);
        let silent = listen(&mut &b"\r\n[MSG:"[..], &mut facts);
        assert_eq!(silent.unwrap_err().to_string(), "the serial line is closed");
        let endless = b"[MSG:Fault: panic at a.rs:1]\r\n".repeat(10_000);
        let error = listen(&mut &*endless, &mut facts).unwrap_err();
        assert!(error.to_string().contains("its end"), "{error}");
    }
}
