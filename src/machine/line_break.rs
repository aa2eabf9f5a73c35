//! A break on the serial line: it is low for much longer than a byte.
//!
//! The sender asks for one, or an adapter that has lost its supply pulls the line down. `idle` looks at the level of
//! the pin, and not `serial_rx`, whose time limits the rate of steps: to that task a break is one damaged byte.
//!
//! A look may come upon a low bit of a byte, and where looks and bytes keep step, each look may. But in a break no
//! byte comes: a look behind one that came since the last look begins the count anew.

use crate::model::Requests;

/// Time for which the line is low in a break, ms. A byte is low for 9 bits at most, 0.94 ms at 9600 baud and 7.5 ms at
/// 1200: it ends, and begins the count anew, long before. Senders make breaks of 100 ms and more.
const BREAK_MS: u8 = 40;

/// The watch of `idle` over the level of the line.
#[derive(Debug)]
pub struct BreakDetector {
    /// Milliseconds for which the line was low at each sample; at least [`BREAK_MS`] in a break that has been requested.
    low: u8,
    /// [`Requests::activity`] when the count last began.
    activity: u32,
}

impl BreakDetector {
    /// Returns a watch without samples.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            low: 0,
            activity: 0,
        }
    }

    /// Takes a sample, so many milliseconds after the last; `received` is the number of bytes of lines so far. Requests a
    /// hold, once for each break. Returns whether it has.
    pub fn sample(
        &mut self,
        is_low: bool,
        elapsed_ms: u8,
        received: usize,
        requests: &Requests,
    ) -> bool {
        if !is_low {
            self.low = 0;
            return false;
        }
        if self.low >= BREAK_MS {
            return false;
        }
        let activity = requests.activity(received);
        // A `?` is counted nowhere, but waits to be answered.
        if activity != self.activity || requests.wants_status() {
            self.activity = activity;
            self.low = 0;
            return false;
        }
        self.low = self.low.saturating_add(elapsed_ms);
        let is_break = self.low >= BREAK_MS;
        if is_break {
            requests.request_line_break();
        }
        is_break
    }
}

impl Default for BreakDetector {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looks at a low line until a break is requested. Returns the number of looks.
    fn samples_to_break(line: &mut BreakDetector, requests: &Requests) -> Option<u32> {
        (1..100).find(|_| line.sample(true, 1, 0, requests))
    }

    #[test]
    fn a_line_that_is_low_for_40_ms_is_a_break_once() {
        let (mut line, requests) = (BreakDetector::new(), Requests::new());
        // However many looks there are in a period.
        assert!((0..1000).all(|_| !line.sample(true, 0, 0, &requests)));
        assert_eq!(samples_to_break(&mut line, &requests), Some(40));
        assert!(requests.take_line_break() && !requests.take_line_break());
        assert_eq!(samples_to_break(&mut line, &requests), None);
        assert!(!line.sample(false, 1, 0, &requests));
        assert_eq!(samples_to_break(&mut line, &requests), Some(40));
    }

    #[test]
    fn one_high_look_begins_the_count_anew() {
        let (mut line, requests) = (BreakDetector::new(), Requests::new());
        for _ in 0..20 {
            for _ in 0..39 {
                assert!(!line.sample(true, 1, 0, &requests));
            }
            assert!(!line.sample(false, 1, 0, &requests));
        }
    }

    #[test]
    fn whatever_has_come_since_the_last_look_begins_the_count_anew() {
        let came: [fn(&Requests, &mut usize); 4] = [
            |_, received| *received = received.wrapping_add(1),
            |requests, received| requests.lose(*received),
            |requests, received| {
                let _ = requests.accept(b'?', *received);
            },
            |requests, received| {
                let _ = requests.accept_from_0x80(0x90, *received);
            },
        ];
        for come in came {
            let (mut line, requests, mut received) = (BreakDetector::new(), Requests::new(), 0);
            for number in 0..200 {
                if number % 40 == 0 {
                    come(&requests, &mut received);
                }
                assert!(!line.sample(true, 1, received, &requests));
                let _ = (requests.take_status(), requests.take_overrides().is_some());
            }
        }
    }
}
