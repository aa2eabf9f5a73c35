//! What has been reported to the sender, and is to be: the message that waits for room, and status reports.

use crate::{
    gcode::interpreter::Interpreter,
    machine::Snapshot,
    protocol::{
        ByteWriter,
        report::{self, Cadence, Status},
        text::Text,
    },
    settings::Settings,
};

/// What has been reported, and is to be.
#[derive(Debug, Default)]
pub(in crate::protocol) struct Reports {
    /// A message that still needs room.
    pub(in crate::protocol) message: Text,
    pub(in crate::protocol) cadence: Cadence,
    /// A `?` has not been answered.
    pub(in crate::protocol) is_status_due: bool,
    /// The tool in the spindle has changed, and has not been reported.
    pub(super) is_tool_due: bool,
    /// The message that the machine needs a reset has been written.
    pub(super) has_reported_fault: bool,
    /// Number of notices seen, wrapping.
    pub(super) notices: u32,
    /// [`Snapshot::accessory_changes`] as seen last.
    accessory_changes: u8,
    /// [`Snapshot::coolant_toggles`] as seen last.
    coolant_toggles: u8,
}

impl Reports {
    /// Returns whether a message or a status report waits.
    pub(super) fn is_pending(&self) -> bool {
        self.is_status_due || !self.message.is_empty()
    }

    /// Returns whether there is a notice that has not been sent.
    pub(super) fn has_notices(&self, machine: &Snapshot) -> bool {
        machine.notices.count() != self.notices
    }

    /// Sends the message that waits. Returns false when there is no room.
    pub(super) fn flush(&mut self, sent: &mut ByteWriter<'_>) -> bool {
        let has_room = sent.append(self.message.as_bytes());
        if has_room {
            self.message.clear();
        }
        has_room
    }

    /// Adopts what has changed at the machine, and makes the next status report show it.
    pub(super) fn observe(&mut self, machine: &Snapshot, interpreter: &mut Interpreter) {
        if self.accessory_changes != machine.accessory_changes {
            self.accessory_changes = machine.accessory_changes;
            self.cadence.overrides_changed();
        }
        if self.coolant_toggles != machine.coolant_toggles {
            self.coolant_toggles = machine.coolant_toggles;
            interpreter.set_coolant(machine.programmed_coolant);
        }
    }

    /// Sends a status report. Returns false when there is no room.
    pub(super) fn send_status(
        &mut self,
        machine: &Snapshot,
        settings: &Settings,
        interpreter: &Interpreter,
        received_free: usize,
        sent: &mut ByteWriter<'_>,
    ) -> bool {
        // A report counts only once it has been sent.
        let mut cadence = self.cadence;
        let mut text = Text::new();
        let position = report::machine_position(machine, settings);
        let status = Status {
            machine,
            settings,
            work_offset: interpreter.work_offset(&position),
            depends_on_place: interpreter.is_rotated(),
            received_free,
            extra: cadence.next(machine.state),
            new_tool: self.is_tool_due.then_some(interpreter.loaded_tool()),
        };
        report::status(&mut text, &status);
        let has_room = sent.append(text.as_bytes());
        if has_room {
            self.cadence = cadence;
            self.is_status_due = false;
            self.is_tool_due = false;
        }
        has_room
    }
}
