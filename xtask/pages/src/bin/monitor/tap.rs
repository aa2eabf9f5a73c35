//! The tap between a sender and the machine: only the bytes of these two pass.
//!
//! Pure. The monitor takes out only the answers to its own requests: the report for its `?`, and the position
//! stream where the monitor has switched the stream on. While a sender sends `?` itself, the monitor sends none
//! and reads the reports of the sender, so that each report reaches its receiver with all fields.

use std::time::Duration;

/// How often the monitor asks.
const REPORT_INTERVAL: Duration = Duration::from_millis(100);
/// How long an answer may take; then it is lost.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(1);
/// How long after its last `?` a sender counts as one that asks by itself.
const SENDER_ASKS: Duration = Duration::from_secs(2);

/// What passes, and what is asked.
#[derive(Debug, Default)]
pub(crate) struct Tap {
    /// Whether lines of the position stream are the monitor's own.
    has_stream: bool,
    /// When the monitor asked; nothing while no answer is due.
    asked: Option<Duration>,
    /// When the sender asked last.
    sender_asked: Option<Duration>,
    /// When the monitor may ask again.
    next: Duration,
    /// `?` of the sender that wait until the monitor has its answer.
    held: u32,
    /// The beginning of a line that may be the monitor's own.
    line: Vec<u8>,
    is_within_line: bool,
}

impl Tap {
    pub(crate) fn new(has_stream: bool) -> Self {
        Self {
            has_stream,
            ..Self::default()
        }
    }

    /// Returns whether the monitor asks for a report now.
    pub(crate) fn asks(&mut self, now: Duration) -> bool {
        let has_asked = |since: Option<Duration>, time| {
            since.is_some_and(|since| now.saturating_sub(since) < time)
        };
        let is_time = now >= self.next && !has_asked(self.asked, ANSWER_TIMEOUT);
        if !is_time || has_asked(self.sender_asked, SENDER_ASKS) {
            return false;
        }
        self.asked = Some(now);
        self.next = now + REPORT_INTERVAL;
        true
    }

    /// Passes bytes of the sender on to the machine.
    pub(crate) fn sent(&mut self, bytes: &[u8], now: Duration, machine: &mut Vec<u8>) {
        for &byte in bytes {
            if byte != b'?' {
                machine.push(byte);
                continue;
            }
            self.sender_asked = Some(now);
            if self.asked.is_some() {
                self.held += 1;
            } else {
                machine.push(byte);
            }
        }
    }

    /// Passes bytes of the machine on to the sender, and questions that have waited to the machine.
    pub(crate) fn received(
        &mut self,
        bytes: &[u8],
        now: Duration,
        sender: &mut Vec<u8>,
        machine: &mut Vec<u8>,
    ) {
        for &byte in bytes {
            let is_first = !self.is_within_line && self.line.is_empty();
            let is_own = is_first && (byte == b'<' && self.asked.is_some())
                || is_first && byte == b'X' && self.has_stream;
            if !is_own && self.line.is_empty() {
                sender.push(byte);
            } else {
                self.line.push(byte);
            }
            self.is_within_line = byte != b'\n';
            if self.line.last() == Some(&b'\n') {
                self.end_line(now, sender, machine);
            }
        }
        if self
            .asked
            .is_some_and(|asked| now.saturating_sub(asked) >= ANSWER_TIMEOUT)
        {
            // The answer is lost.
            self.release(now, machine);
        }
    }

    /// A line is whole that may be the monitor's own.
    fn end_line(&mut self, now: Duration, sender: &mut Vec<u8>, machine: &mut Vec<u8>) {
        let line = std::mem::take(&mut self.line);
        let is_report = line.starts_with(b"<");
        let is_position = line.starts_with(b"X:");
        if !is_report && !is_position {
            sender.extend(line);
        }
        if is_report {
            self.release(now, machine);
        }
    }

    /// Lets the questions go that have waited for the monitor's answer.
    fn release(&mut self, now: Duration, machine: &mut Vec<u8>) {
        self.asked = None;
        for _ in 0..std::mem::take(&mut self.held) {
            machine.push(b'?');
            self.sender_asked = Some(now);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const REPORT: &[u8] = b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n";

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    /// What goes to the sender and to the machine of bytes that come from the machine in pieces.
    fn received(tap: &mut Tap, now: Duration, bytes: &[u8], size: usize) -> (Vec<u8>, Vec<u8>) {
        let (mut sender, mut machine) = (Vec::new(), Vec::new());
        for piece in bytes.chunks(size) {
            tap.received(piece, now, &mut sender, &mut machine);
        }
        (sender, machine)
    }

    #[test]
    fn only_the_answer_to_the_own_question_is_taken_out() {
        for size in [1, 2, 7, 1000] {
            let mut tap = Tap::default();
            let text = [
                b"ok\r\n",
                REPORT,
                b"X:1,Y:2\r\n[MSG:<a>]\r\n$0=10\r\nno end",
            ]
            .concat();
            // Nobody has asked: the machine reports by itself.
            assert_eq!(received(&mut tap, ms(0), &text, size).0, text);
            assert!(tap.asks(ms(10)));
            tap.is_within_line = false;
            let without = [&b"ok\r\n"[..], b"X:1,Y:2\r\n[MSG:<a>]\r\n$0=10\r\nno end"].concat();
            assert_eq!(received(&mut tap, ms(20), &text, size).0, without);
            tap.is_within_line = false;
            assert_eq!(received(&mut tap, ms(30), &text, size).0, text);
        }
    }

    #[test]
    fn a_question_of_the_sender_waits_for_the_own_answer_and_has_its_own() {
        let mut tap = Tap::default();
        assert!(tap.asks(ms(0)));
        let mut machine = Vec::new();
        tap.sent(b"G1 X1?\n!", ms(1), &mut machine);
        assert_eq!(machine, b"G1 X1\n!");
        assert_eq!(
            received(&mut tap, ms(2), REPORT, 5),
            (vec![], b"?".to_vec())
        );
        assert_eq!(
            received(&mut tap, ms(3), REPORT, 5),
            (REPORT.to_vec(), vec![])
        );
        // Who asks is listened to; once he does no more, the monitor asks again.
        assert!(!tap.asks(ms(200)));
        assert!(!tap.asks(ms(1990)));
        assert!(tap.asks(ms(2100)));
    }

    #[test]
    fn a_lost_answer_is_asked_for_again() {
        let mut tap = Tap::default();
        assert!(tap.asks(ms(0)));
        assert!(!tap.asks(ms(900)));
        assert!(tap.asks(ms(1100)));
        let mut machine = Vec::new();
        tap.sent(b"?", ms(1110), &mut machine);
        assert!(machine.is_empty());
        assert_eq!(
            received(&mut tap, ms(2200), b"ok\r\n", 1),
            (b"ok\r\n".to_vec(), b"?".to_vec())
        );
    }

    #[test]
    fn the_stream_that_the_monitor_has_switched_on_is_its_own() {
        let mut tap = Tap::new(true);
        let text = b"X:1,Y:2\r\nok\r\nX:1,Y:3\r\nX is no axis\r\n";
        for size in [1, 4, 100] {
            assert_eq!(
                received(&mut tap, ms(0), text, size).0,
                b"ok\r\nX is no axis\r\n"
            );
        }
    }

    #[test]
    fn ten_questions_a_second_are_asked() {
        let mut tap = Tap::default();
        let mut asked = 0;
        for now in 0..1000 {
            if tap.asks(ms(now)) {
                asked += 1;
                received(&mut tap, ms(now), REPORT, 100);
            }
        }
        assert_eq!(asked, 10);
    }
}
