//! Work due by the clock: the end of a pause, drivers switched off, messages to a waiting host.

use super::RepRap;
use crate::{
    model::{State, timing::TICK_MS},
    path::Work,
    protocol::{ByteReader, dialect::SessionContext, report, session::LineStage},
};

/// Silence after which a realtime byte counts anywhere, ms.
const SILENCE_MS: u32 = 100;
/// Silence after which a checked line without its end is asked for again, and after which a host that
/// may wait for a lost `ok` is reported that nothing is left to do, ms.
const HOST_TIMEOUT_MS: u32 = 1000;

/// The times by which something is due.
#[derive(Debug, Default)]
pub(super) struct Timers {
    ticks: u32,
    /// Number of bytes received, and for how long, ms.
    received: usize,
    silent_ms: u32,
    /// For how long a line has been waiting for its answer, and nothing has been left to do, ms.
    busy_ms: u32,
    idle_ms: u32,
    /// Since the last report of the position, and of standstill, ms.
    pub(super) position_ms: u32,
    still_ms: u32,
}

impl Timers {
    /// Times that begin at a tick.
    pub(super) fn since(ticks: u32) -> Self {
        Self {
            ticks,
            ..Self::default()
        }
    }
}

/// Returns a time that goes on while something lasts.
const fn lasting(before_ms: u32, passed_ms: u32, lasts: bool) -> u32 {
    if lasts {
        before_ms.saturating_add(passed_ms)
    } else {
        0
    }
}

impl RepRap {
    /// Does what is due by the clock. Returns work for the machine.
    pub(super) fn pass_time(
        &mut self,
        session: &mut SessionContext<'_>,
        bytes: &ByteReader<'_>,
    ) -> Option<Work> {
        let timers = &mut self.timers;
        let ticks = session.requests.ticks();
        let passed_ms = ticks.wrapping_sub(timers.ticks).saturating_mul(TICK_MS);
        timers.ticks = ticks;
        let received = bytes.written();
        if received == timers.received {
            timers.silent_ms = timers.silent_ms.saturating_add(passed_ms);
        } else {
            timers.received = received;
            timers.silent_ms = 0;
        }
        if passed_ms == 0 {
            return None;
        }
        // A byte may have come directly behind a tick: one tick more is surely that long.
        if timers.silent_ms > SILENCE_MS {
            self.scan.silent_at = Some(received);
        }
        if session.machine.state == State::HoldComplete {
            let position = report::machine_position(session.machine, session.settings);
            self.paused_at = Some(position);
        }
        self.pass_pause(passed_ms, session, bytes);
        let work = self.pass_standstill(passed_ms, session);
        session.is_done &= work.is_none();
        if session.reports.message.is_empty() && !self.report_position_in_time(passed_ms, session) {
            self.report_waiting(passed_ms, session, bytes);
        }
        work
    }

    /// Reports the position where that is due. Returns whether it is.
    fn report_position_in_time(
        &mut self,
        passed_ms: u32,
        session: &mut SessionContext<'_>,
    ) -> bool {
        let timers = &mut self.timers;
        timers.position_ms = timers.position_ms.saturating_add(passed_ms);
        let interval_ms = u32::from(self.position_interval_s) * 1000;
        let is_due = interval_ms != 0
            && timers.position_ms >= interval_ms
            && session.stage.is_welcome_sent();
        if is_due {
            timers.position_ms = 0;
            self.write_position(session, true);
        }
        is_due
    }

    /// Reports to a sender that its line waits, or, where the sender may wait for a lost `ok`, that no line waits.
    fn report_waiting(
        &mut self,
        passed_ms: u32,
        session: &mut SessionContext<'_>,
        received: &ByteReader<'_>,
    ) {
        let state = session.machine.state;
        // A line waits in the queue while the machine is held.
        let has_held_line = state.is_suspended() && received.may_have_line();
        let is_waiting = session.stage.is_line_begun() || has_held_line;
        let is_idle = session.lines.has_begun
            && received.is_empty()
            && session.lines.is_empty()
            && session.stage == LineStage::Reading
            && state == State::Idle
            && session.is_done;
        let interval_ms = u32::from(self.busy_interval_s) * 1000;
        let timers = &mut self.timers;
        timers.busy_ms = lasting(timers.busy_ms, passed_ms, is_waiting);
        timers.idle_ms = lasting(timers.idle_ms, passed_ms, is_idle);
        if interval_ms != 0 && timers.busy_ms >= interval_ms {
            timers.busy_ms = 0;
            let reason = if state.is_suspended() {
                "echo:busy: paused for user"
            } else {
                "echo:busy: processing"
            };
            session.reports.message.word(reason).end();
        }
        if timers.idle_ms.min(timers.silent_ms) >= HOST_TIMEOUT_MS {
            timers.idle_ms = 0;
            session.reports.message.word("wait").end();
        }
    }

    /// Switches the drivers off after the time of standstill that a program has set.
    fn pass_standstill(
        &mut self,
        passed_ms: u32,
        session: &mut SessionContext<'_>,
    ) -> Option<Work> {
        let is_still = matches!(session.machine.state, State::Idle | State::Alarm)
            && session.stage == LineStage::Reading
            && session.is_done;
        let before_ms = self.timers.still_ms;
        self.timers.still_ms = lasting(before_ms, passed_ms, is_still);
        let delay_ms = u32::from(self.drivers_delay_s.unwrap_or_default()) * 1000;
        let is_due = before_ms < delay_ms && self.timers.still_ms >= delay_ms;
        *session.has_release_request |= is_due;
        is_due.then_some(Work::Drivers(false))
    }

    /// Ends a pause whose time is over.
    fn pass_pause(
        &mut self,
        passed_ms: u32,
        session: &mut SessionContext<'_>,
        received: &ByteReader<'_>,
    ) {
        let is_paused = session.machine.state == State::HoldComplete
            && matches!(session.stage, LineStage::Completing(_));
        let Some(left_ms) = self.pause_ms.filter(|_| is_paused) else {
            return;
        };
        let left_ms = left_ms.saturating_sub(passed_ms);
        self.pause_ms = (left_ms != 0).then_some(left_ms);
        if left_ms == 0 {
            session
                .requests
                .accept_from_interpret(b'~', received.oldest());
            *session.has_release_request = true;
        }
    }

    /// Returns whether the end of a checked line has been lost: nothing has come for a second.
    pub(super) fn has_lost_line_end(&self, session: &SessionContext<'_>) -> bool {
        let lines = &session.lines;
        self.timers.silent_ms >= HOST_TIMEOUT_MS
            && lines.has_begun
            && !lines.is_empty()
            && lines.raw.is_checked()
    }
}
