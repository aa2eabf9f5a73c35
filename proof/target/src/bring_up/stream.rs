//! The baud rate of the board as this computer's clock sees it, by bytes that come without a pause.
//!
//! `tests/bring_up/stream.rs` is the other side.

use std::{
    io::{Read, Write},
    time::Duration,
};

use anyhow::{Context, Result};

use super::{
    exchange::{bytes_of, read},
    facts::Facts,
    sequence::STREAM,
};

/// Asks the board for the bytes.
const STREAM_REQUEST: &[u8] = b"\n";
/// Start bit, eight bits, stop bit.
const BITS_PER_BYTE: f64 = 10.0;

/// The time at which this computer had so many bytes.
#[derive(Debug, Clone, Copy)]
struct Arrival {
    time: Duration,
    bytes: usize,
}

/// Asks for so many bytes, and takes the time of each arrival.
pub(super) fn receive(
    from: &mut dyn Read,
    mut to: impl Write,
    now: impl Fn() -> Duration,
    bytes: i64,
    facts: &mut Facts,
) -> Result<()> {
    let count = usize::try_from(bytes).context("the program sends less than nothing")?;
    to.write_all(STREAM_REQUEST)
        .context("cannot write to the serial line")?;
    let mut expected = bytes_of(STREAM);
    let (mut received, mut wrong) = (0, 0);
    let mut arrivals = Vec::new();
    let mut chunk = [0; 4096];
    while received < count {
        let length = read(from, &mut chunk)?;
        if length == 0 {
            break;
        }
        let right = chunk[..length].iter().zip(&mut expected);
        wrong += right.filter(|(byte, expected)| **byte != *expected).count();
        received += length;
        arrivals.push(Arrival {
            time: now(),
            bytes: received,
        });
    }
    facts.count("stream.received", received);
    facts.count("stream.wrong", wrong);
    // The emulator's line is as fast as this computer.
    if !facts.are_emulated()
        && let Some(rate) = byte_rate(&arrivals)
    {
        facts.put("stream.baud", (rate * BITS_PER_BYTE).round() as i64);
    }
    Ok(())
}

/// Returns the bytes per second: the slope of the straight line that is next to all arrivals, by least squares.
///
/// Between the first arrival and the last alone, one that a busy computer reads late would count in full. None
/// if all came at one time.
fn byte_rate(arrivals: &[Arrival]) -> Option<f64> {
    let count = arrivals.len() as f64;
    let points = arrivals
        .iter()
        .map(|arrival| (arrival.time.as_secs_f64(), arrival.bytes as f64));
    let (times, bytes) = points
        .clone()
        .fold((0.0, 0.0), |sum, point| (sum.0 + point.0, sum.1 + point.1));
    let (time, byte) = (times / count, bytes / count);
    let (products, squares) = points.fold((0.0, 0.0), |sum, point| {
        let (time, byte) = (point.0 - time, point.1 - byte);
        (sum.0 + time * byte, sum.1 + time * time)
    });
    (squares > 0.0).then(|| products / squares)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    /// Bytes of a stream.
    const BYTES: u32 = 1 << 16;

    /// A board that sends at this baud rate, in packets of an adapter, with one wrong byte; and the
    /// clock of a computer that reads one of the bytes late.
    struct Board<'a> {
        baud: f64,
        sent: usize,
        wrong: Option<usize>,
        time: &'a Cell<Duration>,
    }

    /// Bytes of a packet.
    const PACKET_BYTES: usize = 62;

    impl Read for Board<'_> {
        fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
            let length = PACKET_BYTES.min(BYTES as usize - self.sent);
            let all: Vec<u8> = bytes_of(STREAM).skip(self.sent).take(length).collect();
            bytes[..length].copy_from_slice(&all);
            if let Some(wrong) = self.wrong
                && (self.sent..self.sent + length).contains(&wrong)
            {
                bytes[wrong - self.sent] ^= 1;
            }
            self.sent += length;
            let seconds = self.sent as f64 * BITS_PER_BYTE / self.baud;
            self.time.set(Duration::from_secs_f64(seconds));
            Ok(length)
        }
    }

    fn facts_of(baud: f64, wrong: Option<usize>) -> Facts {
        let time = Cell::new(Duration::ZERO);
        let mut board = Board {
            baud,
            sent: 0,
            wrong,
            time: &time,
        };
        let (mut facts, mut sent) = (Facts::default(), Vec::new());
        let bytes = BYTES.into();
        receive(&mut board, &mut sent, || time.get(), bytes, &mut facts).unwrap();
        assert_eq!(sent, STREAM_REQUEST);
        facts
    }

    #[test]
    fn the_baud_rate_is_that_of_the_board() {
        for baud in [115_200, 115_068, 119_808, 110_592] {
            let facts = facts_of(f64::from(baud), None);
            assert_eq!(facts.get("stream.baud"), Some(baud.into()));
            assert_eq!(facts.get("stream.received"), Some(BYTES.into()));
            assert_eq!(facts.get("stream.wrong"), Some(0));
        }
        let damaged = facts_of(115_200.0, Some(1000));
        assert_eq!(damaged.get("stream.wrong"), Some(1));
    }

    #[test]
    fn what_is_read_late_once_does_not_count_in_full() {
        let at = |bytes: usize| Duration::from_secs_f64(bytes as f64 / 11_520.0);
        let packets = (1..=1000).map(|packet| packet * PACKET_BYTES);
        let mut arrivals: Vec<_> = packets
            .map(|bytes| Arrival {
                time: at(bytes),
                bytes,
            })
            .collect();
        for late in [0, 500, 999] {
            let right = arrivals[late].time;
            arrivals[late].time += Duration::from_millis(100);
            let rate = byte_rate(&arrivals).unwrap();
            // 100 ms of 5.4 s are 1.9 %.
            assert!((rate / 11_520.0 - 1.0).abs() < 0.0002, "{rate}");
            arrivals[late].time = right;
        }
        assert_eq!(byte_rate(&arrivals[..1]), None);
        assert_eq!(byte_rate(&[]), None);
    }

    #[test]
    fn a_board_that_sends_nothing_has_no_baud_rate() {
        let mut facts = Facts::default();
        receive(
            &mut &b""[..],
            Vec::new(),
            || Duration::ZERO,
            100,
            &mut facts,
        )
        .unwrap();
        assert_eq!(facts.get("stream.received"), Some(0));
        assert_eq!(facts.get("stream.baud"), None);
    }
}
