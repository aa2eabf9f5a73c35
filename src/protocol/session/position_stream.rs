//! The position stream: `X:45,Y:22` after each change of the position, for plots.
//!
//! Off with `$792=0`. A line goes out only while no other byte waits to be sent, so an answer waits for one line at
//! most; a position without room is left out, but never the last position.
//!
//! # Cost
//! With the stream off, `interpret` tests one setting; no other task knows of it. With the stream on,
//! `prepare` releases `interpret` after each segment, as path control has it do.

use crate::{
    axis::LINEAR,
    machine::Snapshot,
    model::{Awaited, core_xy},
    protocol::{ByteWriter, Text, report},
    settings::Settings,
    units::TICKS_PER_MS,
};

/// What the stream has sent.
#[derive(Debug, Default)]
pub(super) struct PositionStream {
    /// The steps of X, Y and Z in the last line, or at its time.
    steps: [i32; LINEAR],
    /// Start of the segment that the last line shows, ticks on the generator's clock.
    sent_ticks: u32,
    /// A position waits for the bytes before it.
    awaits_room: bool,
}

impl PositionStream {
    /// Returns the events that the stream needs.
    pub(super) fn awaited(&self, settings: &Settings) -> Awaited {
        if settings.stream_interval_ms < 1.0 {
            Awaited::NONE
        } else if self.awaits_room {
            Awaited::SEGMENTS.union(Awaited::ROOM)
        } else {
            Awaited::SEGMENTS
        }
    }

    /// Sends the position if it has changed and a line is due; or, where other messages wait, leaves it out.
    pub(super) fn send_changed(
        &mut self,
        machine: &Snapshot,
        settings: &Settings,
        now_ticks: u32,
        sent: Option<&mut ByteWriter<'_>>,
    ) {
        let axes = if settings.stream_z {
            LINEAR
        } else {
            LINEAR - 1
        };
        let steps = if settings.core_xy {
            core_xy::steps_of(machine.steps)
        } else {
            machine.steps
        };
        let is_changed = |(shown, steps): (&i32, &i32)| shown != steps;
        let mut both = self.steps.iter().zip(&steps).take(axes);
        self.awaits_room = false;
        if !both.any(is_changed) {
            return;
        }
        let interval_ticks = settings.stream_interval_ms as u32 * TICKS_PER_MS;
        let elapsed_ticks = now_ticks.wrapping_sub(self.sent_ticks);
        if !machine.is_at_rest && elapsed_ticks < interval_ticks {
            return;
        }
        let mut text = Text::new();
        report::stepped_position(&mut text, &steps, axes);
        let is_sent = sent.is_some_and(|sent| sent.is_empty() && sent.append(text.as_bytes()));
        self.awaits_room = !is_sent;
        if is_sent {
            self.sent_ticks = now_ticks;
            for (shown, steps) in self.steps.iter_mut().zip(&steps) {
                *shown = *steps;
            }
        }
    }
}
