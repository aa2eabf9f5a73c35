//! A break on the serial line: it is low for much longer than a byte.
//!
//! The sender asks for one, or an adapter that has lost its supply pulls the line down. `inputs` looks at the level of
//! the pin, and not `serial_rx`, whose time limits the rate of steps: to that task a break is one damaged byte.
//!
//! A look may come upon a low bit of a byte, and where looks and bytes keep step, each look may. But in a break no
//! byte comes: a look behind one that came since the last look begins the count anew.

use crate::model::Requests;

/// Looks 250 µs apart for which the line is low in a break: 10 ms. A byte is low for 9 bits at most, 0.94 ms at
/// 9600 baud and 7.5 ms at 1200, and is counted before that time is over. Senders make breaks of 100 ms and more.
const BREAK_LOOKS: u8 = 40;

/// Looks that one stands for where they are 1 ms apart.
pub const LOOKS_PER_MS: u8 = 4;

/// The watch of `inputs` over the level of the line.
#[derive(Debug)]
pub struct LineBreak {
    /// Looks in a row at which the line was low; at least [`BREAK_LOOKS`] in a break that has been requested.
    low: u8,
    /// What had been received at the last of them.
    heard: u32,
}

impl LineBreak {
    /// Returns a watch that has not looked.
    #[must_use]
    pub const fn new() -> Self {
        Self { low: 0, heard: 0 }
    }

    /// Takes a look, which stands for some of 250 µs; `received` is the number of bytes of lines so far. Requests a
    /// hold, once for each break. Returns whether it has.
    #[inline]
    pub fn look(&mut self, is_low: bool, looks: u8, received: usize, requests: &Requests) -> bool {
        if !is_low {
            self.low = 0;
            return false;
        }
        if self.low >= BREAK_LOOKS {
            return false;
        }
        let heard = requests.heard(received);
        // A `?` is counted nowhere, but waits to be answered.
        if heard != self.heard || requests.wants_status() {
            self.heard = heard;
            self.low = 0;
            return false;
        }
        self.low += looks;
        let is_break = self.low >= BREAK_LOOKS;
        if is_break {
            requests.break_line();
        }
        is_break
    }
}

impl Default for LineBreak {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looks at a low line until a break is requested. Returns the number of looks.
    fn looks(line: &mut LineBreak, looks: u8, requests: &Requests) -> Option<u32> {
        (1..100).find(|_| line.look(true, looks, 0, requests))
    }

    #[test]
    fn a_line_that_is_low_for_10_ms_is_a_break_once() {
        for (each, needed) in [(LOOKS_PER_MS, 10), (1, 40)] {
            let (mut line, requests) = (LineBreak::new(), Requests::new());
            assert_eq!(looks(&mut line, each, &requests), Some(needed));
            assert!(requests.take_break() && !requests.take_break());
            assert_eq!(looks(&mut line, each, &requests), None);
            assert!(!line.look(false, each, 0, &requests));
            // The first look behind the request finds that something has come: the request.
            assert_eq!(looks(&mut line, each, &requests), Some(needed + 1));
        }
    }

    #[test]
    fn one_high_look_begins_the_count_anew() {
        let (mut line, requests) = (LineBreak::new(), Requests::new());
        for _ in 0..20 {
            for _ in 0..9 {
                assert!(!line.look(true, LOOKS_PER_MS, 0, &requests));
            }
            assert!(!line.look(false, LOOKS_PER_MS, 0, &requests));
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
                let _ = requests.accept(0x90, *received);
            },
        ];
        for come in came {
            let (mut line, requests, mut received) = (LineBreak::new(), Requests::new(), 0);
            for look in 0..200 {
                if look % 10 == 0 {
                    come(&requests, &mut received);
                }
                assert!(!line.look(true, LOOKS_PER_MS, received, &requests));
                let _ = (requests.take_status(), requests.take_override());
            }
        }
    }
}
