//! Messages of a program to its operator, `(MSG, text)` and `M0 (text)`: sent when the machine comes to their line, without
//! a stop. As LinuxCNC and grblHAL do.

use heapless::Vec;

use super::{Session, Source};
use crate::{
    machine::Snapshot,
    model::State,
    protocol::{line::COMMENT_BYTES, report},
};

/// A message for which the machine has still to come to its line.
#[derive(Debug, Default)]
pub(super) struct OperatorMessage {
    text: Vec<u8, COMMENT_BYTES>,
    /// The number of entries that are finished then, wrapping; `None` without a message.
    due: Option<u32>,
}

impl OperatorMessage {
    /// Returns whether there is one.
    pub(super) const fn is_waiting(&self) -> bool {
        self.due.is_some()
    }

    /// Drops it.
    pub(super) fn clear(&mut self) {
        self.due = None;
    }
}

impl Session {
    /// Returns the message of the line, or nothing. A pause has any comment for one.
    fn operator_text(&self, is_pause: bool) -> &[u8] {
        let input = &self.line.input;
        let is_shown = self.line.source == Source::Line && !self.host.dialect.is_reprap();
        match (is_shown, input.message()) {
            (false, _) => &[],
            (true, []) if is_pause => input.comment(),
            (true, message) => message,
        }
    }

    /// Returns whether the line has a message, while another one still waits.
    #[inline]
    pub(super) fn waits_for_message(&self, is_pause: bool) -> bool {
        self.operator_message.is_waiting() && !self.operator_text(is_pause).is_empty()
    }

    /// Keeps the message of the line, if it has one, until the entries that have been sent are finished.
    #[inline]
    pub(super) fn keep_message(&mut self, is_pause: bool, machine: &Snapshot) {
        if !self.line.input.comment().is_empty() {
            self.keep_comment(is_pause, machine);
        }
    }

    #[cold]
    #[inline(never)]
    fn keep_comment(&mut self, is_pause: bool, machine: &Snapshot) {
        let text = self.operator_text(is_pause);
        if text.is_empty() {
            return;
        }
        // Too long a text has been cut before.
        let text = Vec::from_slice(text).unwrap_or_default();
        let has_passed = machine.state == State::Check || self.is_done(machine);
        if has_passed {
            report::operator_message(&mut self.reports.message, &text);
            return;
        }
        // A move that is held back may still be joined with others.
        let is_held_back = u32::from(self.blender.has_pending());
        self.operator_message = OperatorMessage {
            text,
            due: Some(self.machine_sync.entered.wrapping_add(is_held_back)),
        };
    }

    /// Writes the message that waits, if the machine has come to its line.
    #[inline]
    pub(super) fn report_passed_message(&mut self, machine: &Snapshot) {
        if let Some(due) = self.operator_message.due
            && machine.finished.wrapping_sub(due).cast_signed() >= 0
        {
            report::operator_message(&mut self.reports.message, &self.operator_message.text);
            self.operator_message.clear();
        }
    }
}
