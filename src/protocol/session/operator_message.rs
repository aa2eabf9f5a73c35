//! Messages of a program to its operator, `(MSG, text)` and `M0 (text)`: sent when the machine comes to their line, without
//! a stop. As LinuxCNC and grblHAL do.

use heapless::{Deque, Vec};

use crate::{
    machine::Snapshot,
    protocol::{line::COMMENT_BYTES, report, text::Text},
};

/// Messages that may wait: before one more, the machine comes to rest.
const MAX_WAITING: usize = 4;

/// A message for which the machine has still to come to its line.
#[derive(Debug)]
struct OperatorMessage {
    text: Vec<u8, COMMENT_BYTES>,
    /// The number of entries that are finished then, wrapping.
    due: u32,
}

/// The messages that wait, in the order of their lines.
#[derive(Debug, Default)]
pub(super) struct OperatorMessages(Deque<OperatorMessage, MAX_WAITING>);

impl OperatorMessages {
    /// Returns whether there is one.
    pub(super) fn are_waiting(&self) -> bool {
        !self.0.is_empty()
    }

    /// Returns whether there is no room for another one.
    pub(super) fn is_full(&self) -> bool {
        self.0.is_full()
    }

    /// Drops all.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Keeps a message until this number of entries is finished. There is room: else the line would have waited.
    pub(super) fn push(&mut self, text: &[u8], due: u32) {
        // Too long a text has been cut before.
        let text = Vec::from_slice(text).unwrap_or_default();
        let _ = self.0.push_back(OperatorMessage { text, due });
    }

    /// Writes the oldest message, if the machine has come to its line.
    pub(super) fn write_due(&mut self, machine: &Snapshot, text: &mut Text) {
        let has_passed = |message: &OperatorMessage| {
            machine.finished.wrapping_sub(message.due).cast_signed() >= 0
        };
        if self.0.front().is_some_and(has_passed)
            && let Some(message) = self.0.pop_front()
        {
            report::operator_message(text, &message.text);
        }
    }
}
