//! The position stream: `X:45,Y:22` after each change of the position, for plots.
//!
//! Off with `$792=0`. A line goes out only while no other byte waits to be sent, so that an answer waits
//! for one line at most; a position for which there is no room is left out, but never the last one.
//!
//! # Cost
//! With the stream off, `interpret` tests one setting; no other task knows of it. With the stream on,
//! `prepare` releases `interpret` after each segment, as path control has it do.

use super::Session;
use crate::{
    axis::LINEAR,
    machine::Snapshot,
    model::{Awaited, Requests, core_xy},
    protocol::{ByteWriter, Progress, Text, report},
    stepper::SegmentRing,
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

impl Session {
    /// Returns the events that the stream needs.
    #[inline]
    pub(super) fn awaited_by_stream(&self) -> Awaited {
        if self.settings().stream_interval_ms < 1.0 {
            Awaited::NONE
        } else if self.stream.awaits_room {
            Awaited::SEGMENTS.union(Awaited::ROOM)
        } else {
            Awaited::SEGMENTS
        }
    }

    /// Sends the position if it has changed and a line is due: `$792` ms of motion after the last one,
    /// and at rest. After [`Session::run`], whose progress it is told.
    #[inline]
    pub fn stream_position(
        &mut self,
        progress: Progress,
        machine: &Snapshot,
        segments: &SegmentRing,
        requests: &Requests,
        sent: &mut ByteWriter<'_>,
    ) {
        if self.settings().stream_interval_ms >= 1.0 {
            self.stream_changed_position(machine, segments.played_start_ticks(), sent);
            if progress == Progress::Waiting {
                requests.wake_on(self.awaited());
            }
        }
    }

    #[inline(never)]
    fn stream_changed_position(
        &mut self,
        machine: &Snapshot,
        now_ticks: u32,
        sent: &mut ByteWriter<'_>,
    ) {
        let settings = &self.persistence.stored.settings;
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
        let stream = &mut self.stream;
        let is_changed = |(shown, steps): (&i32, &i32)| shown != steps;
        let mut both = stream.steps.iter().zip(&steps).take(axes);
        stream.awaits_room = false;
        if !both.any(is_changed) {
            return;
        }
        let interval_ticks = settings.stream_interval_ms as u32 * TICKS_PER_MS;
        let elapsed_ticks = now_ticks.wrapping_sub(stream.sent_ticks);
        if !machine.is_at_rest && elapsed_ticks < interval_ticks {
            return;
        }
        let mut text = Text::new();
        report::stepped_position(&mut text, &steps, axes);
        let is_first = sent.is_empty() && !self.reports.is_pending() && self.is_welcome_sent();
        let is_sent = is_first && sent.append(text.as_bytes());
        let stream = &mut self.stream;
        stream.awaits_room = !is_sent;
        if is_sent {
            stream.sent_ticks = now_ticks;
            for (shown, steps) in stream.steps.iter_mut().zip(&steps) {
                *shown = *steps;
            }
        }
    }
}
