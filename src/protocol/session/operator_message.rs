//! Messages of a program to its operator, `(MSG, text)` and `M0 (text)`: sent when the machine comes to their line, without
//! a stop. As LinuxCNC and grblHAL do.

use heapless::{Deque, Vec};

use super::{Session, Source};
use crate::{
    machine::Snapshot,
    model::State,
    protocol::{line::COMMENT_BYTES, report},
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

/// Those of the program, in their order.
#[derive(Debug, Default)]
pub(super) struct OperatorMessages(Deque<OperatorMessage, MAX_WAITING>);

impl OperatorMessages {
    /// Returns whether there is one.
    pub(super) fn are_waiting(&self) -> bool {
        !self.0.is_empty()
    }

    /// Drops all.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }
}

impl Session {
    /// Returns the message of the line, or nothing. A pause has any comment for one.
    fn operator_text(&self, is_pause: bool) -> &[u8] {
        let input = &self.line.input;
        let is_shown = self.line.source == Source::Line && !self.host.dialect.is_reprap();
        match (is_shown, is_pause) {
            (false, _) => &[],
            (true, true) => input.comment_text(),
            (true, false) => input.message(),
        }
    }

    /// Returns whether the line has a message for which there is no room.
    #[inline]
    pub(super) fn waits_for_message(&self, is_pause: bool) -> bool {
        self.operator_messages.0.is_full() && !self.operator_text(is_pause).is_empty()
    }

    /// Keeps the message of the line, if it has one, until the entries that have been sent are finished.
    #[inline]
    pub(super) fn queue_message(&mut self, is_pause: bool, machine: &Snapshot) {
        if !self.line.input.comment().is_empty() {
            self.queue_comment(is_pause, machine);
        }
    }

    #[cold]
    #[inline(never)]
    fn queue_comment(&mut self, is_pause: bool, machine: &Snapshot) {
        let text = self.operator_text(is_pause);
        if text.is_empty() {
            return;
        }
        // Too long a text has been cut before.
        let text = Vec::from_slice(text).unwrap_or_default();
        // A move that is held back may still be joined with others, or be changed by the next one.
        let is_held_back = self.blender.has_pending() || self.compensator.is_waiting();
        let has_passed = self.is_done(machine) && !is_held_back;
        if machine.state == State::Check || has_passed {
            report::operator_message(&mut self.reports.message, &text);
            return;
        }
        let due = self.machine_sync.entered;
        let due = due.wrapping_add(u32::from(is_held_back));
        // There is room: else the line would have waited.
        let _ = self
            .operator_messages
            .0
            .push_back(OperatorMessage { text, due });
    }

    /// Writes the oldest message that waits, if the machine has come to its line.
    #[inline]
    pub(super) fn report_due_message(&mut self, machine: &Snapshot) {
        let has_passed = |message: &OperatorMessage| {
            machine.finished.wrapping_sub(message.due).cast_signed() >= 0
        };
        let messages = &mut self.operator_messages.0;
        if messages.front().is_some_and(has_passed)
            && let Some(message) = messages.pop_front()
        {
            report::operator_message(&mut self.reports.message, &message.text);
        }
    }
}
