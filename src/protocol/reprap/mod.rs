//! The RepRap dialect, as Marlin speaks it: a layer between bytes and lines on one side, and answers on the other.
//!
//! Bytes are looked at before their lines ([`bytes`]). A line is taken whole, judged by its number and its checksum,
//! and then written out in Grbl's words for the session ([`lines`]). A code without words in Grbl is a [`HostCommand`]:
//! [`commands`] answers it, or has the session do the work. Every line that is not blank gets exactly one `ok`.
//! [`clock`] has what is due by time, [`replies`] the words of all answers.
//!
//! The session knows the layer by [`SenderDialect`] alone, and the layer reaches the session through a
//! [`SessionContext`] alone: the session decides the order of the work. Without the feature `reprap` the dialect is off
//! at compile time, and nothing of the layer is in the image.

mod bytes;
mod clock;
mod commands;
mod lines;
pub mod replies;

use super::{
    ByteReader, Text,
    checked_lines::CheckedLines,
    dialect::{DialectRules, NextStep, Restart, SenderDialect, SenderMessage, SessionContext},
    report,
    session::Reports,
};
use crate::{
    axis::{Axes, LINEAR},
    gcode::{
        LineError,
        interpreter::Interpreter,
        reprap::{Extruder, HostCommand},
    },
    model::{Alarm, HAS_REPRAP, State, timing::IDLE_DELAY_INFINITE},
    path::Work,
    settings::Settings,
    units::Nm,
};
use bytes::Scan;
use clock::Timers;
use commands::LoweredLimits;

/// Feed rate where a program sets none, mm/min.
const DEFAULT_FEED_MM_MIN: f32 = 1500.0;

/// The reset that is going on, or has been.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum RestartKind {
    /// By 0x18, or at power-up.
    #[default]
    Plain,
    /// `M999`: the lock ends, too.
    Unlocking,
    /// `M112`: the machine is locked.
    Killing,
    /// `M410`: the lines go on.
    Stopping,
}

/// What a host of 3D printers needs beside its lines.
#[derive(Debug, Default)]
pub(super) struct RepRap {
    /// The dialect is in effect.
    is_on: bool,
    /// Lines that begin before this byte were sent before a line was asked for again.
    stale_before: Option<usize>,
    /// What the line asks for that Grbl has no words for.
    command: Option<HostCommand>,
    /// `E` before the line and after it.
    extruder: Extruder,
    next_extruder: Extruder,
    /// Time that is left of a pause that ends by itself, ms.
    pause_ms: Option<u32>,
    /// Where the machine has paused last, in machine coordinates.
    paused_at: Option<Axes<Nm>>,
    /// The line moves single motors.
    moves_motors: bool,
    /// The line homes these axes, 0 for all.
    homes: Option<u8>,
    /// The line is read again when the machine stands still: it moves motors.
    waits_for_standstill: bool,
    /// The limit switches of the axes that move end the line.
    ends_at_switch: bool,
    /// Limits that the program has lowered.
    lowered: Option<LoweredLimits>,
    /// Time of standstill after which the drivers go off in place of that of the settings, s; 0 for never.
    drivers_delay_s: Option<u16>,
    /// Time between two reports of the position, s; 0 for none.
    position_interval_s: u8,
    /// What a job has been reported once: letters of axes, and M codes.
    reported: u64,
    /// The last alarm.
    alarm: Option<Alarm>,
    /// Time between two messages that a line is not done, s.
    busy_interval_s: u8,
    restart: RestartKind,
    /// What is to be done as soon as the machine has acted on a reset.
    is_restart_due: bool,
    /// The bytes that have been looked at.
    scan: Scan,
    timers: Timers,
}

impl SenderDialect for RepRap {
    #[inline]
    fn attend(
        &mut self,
        session: &mut SessionContext<'_>,
        received: &mut ByteReader<'_>,
        has_room: bool,
    ) -> Option<Work> {
        let is_on = session.dialect.is_reprap();
        if HAS_REPRAP && is_on != self.is_on {
            self.is_on = is_on;
            self.begin(session, received);
        }
        if self.is_on() {
            self.attend_host(session, received, has_room)
        } else {
            None
        }
    }

    #[inline]
    fn read_line(
        &mut self,
        session: &mut SessionContext<'_>,
        received: &mut ByteReader<'_>,
    ) -> Option<NextStep> {
        self.is_on().then(|| self.next_step(session, received))
    }

    #[inline]
    fn end_line(
        &mut self,
        result: Result<(), LineError>,
        lines: &CheckedLines,
        settings: &Settings,
        interpreter: &mut Interpreter,
        reports: &mut Reports,
    ) -> bool {
        if !self.is_on() {
            return false;
        }
        self.command = None;
        self.pause_ms = None;
        let homes = self.homes.take();
        match result {
            Ok(()) => {
                if let Some(mask) = homes {
                    end_homing(mask, settings, interpreter);
                    reports.cadence.offset_changed();
                }
                self.extruder = self.next_extruder;
                if core::mem::take(&mut self.moves_motors) {
                    interpreter.forget_home();
                }
            }
            Err(error) => {
                self.next_extruder = self.extruder;
                let text = &mut reports.message;
                let is_homing = settings.is_homing_on();
                replies::refusal(text, error, lines.raw.words(), self.alarm, is_homing);
                report::ok(text);
            }
        }
        result.is_err()
    }

    #[inline]
    fn write(&mut self, text: &mut Text, message: SenderMessage<'_>, settings: &Settings) -> bool {
        if HAS_REPRAP && let SenderMessage::Alarm(alarm) = message {
            self.alarm = Some(alarm);
        }
        self.is_on() && self.write_message(text, message, settings)
    }

    #[inline]
    fn restart(&mut self, lines: &mut CheckedLines) -> Restart {
        if self.is_on() {
            self.restart_host(lines)
        } else {
            Restart::Grbl
        }
    }

    #[inline]
    fn end_timed_pause(&mut self) -> bool {
        self.is_on() && self.pause_ms.take().is_some()
    }

    #[inline]
    fn settings_in_effect(&self, stored: &Settings) -> Settings {
        let mut settings = *stored;
        if !self.is_on() {
            return settings;
        }
        if let Some(lowered) = &self.lowered {
            lowered.apply(&mut settings);
        }
        if self.drivers_delay_s.is_some() {
            settings.idle_delay_ms = IDLE_DELAY_INFINITE;
        }
        settings
    }

    #[inline]
    fn rules(&self) -> DialectRules {
        if !self.is_on() {
            return DialectRules::default();
        }
        DialectRules {
            answers_when_stopped: true,
            executes_when_locked: self.alarm.is_none(),
            keeps_lines: !self.drops_lines(),
            is_restarting: self.is_restart_due,
            ends_at_switch: self.ends_at_switch,
            is_timed: self.pause_ms.is_some(),
            next_byte: Some(self.scan.next),
        }
    }
}

impl RepRap {
    /// Returns whether the dialect is in effect: never without the feature `reprap`.
    const fn is_on(&self) -> bool {
        HAS_REPRAP && self.is_on
    }

    /// Begins or ends to be in effect.
    #[cold]
    #[inline(never)]
    fn begin(&mut self, session: &mut SessionContext<'_>, received: &ByteReader<'_>) {
        if self.is_on {
            session.interpreter.set_default_feed(DEFAULT_FEED_MM_MIN);
        }
        self.reset(session.lines);
        self.scan.begin(received.oldest());
        self.busy_interval_s = session.settings.busy_interval_s;
        self.timers = Timers::since(session.requests.ticks());
        session.requests.defer(self.is_on);
    }

    /// Forgets what has been received and numbered.
    fn reset(&mut self, lines: &mut CheckedLines) {
        lines.reset();
        self.stale_before = None;
        self.command = None;
        self.extruder = Extruder::default();
        self.next_extruder = Extruder::default();
        self.paused_at = None;
        self.moves_motors = false;
        self.waits_for_standstill = false;
        self.ends_at_switch = false;
        self.position_interval_s = 0;
        self.reported = 0;
    }

    /// Does what cannot wait for the lines before it.
    #[inline(never)]
    fn attend_host(
        &mut self,
        session: &mut SessionContext<'_>,
        received: &mut ByteReader<'_>,
        has_room: bool,
    ) -> Option<Work> {
        let mut work = None;
        if self.is_restart_due && session.has_reset && session.is_done && has_room {
            work = self.end_restart(session);
        }
        session.is_done &= work.is_none();
        self.scan(session, received);
        work.or(self.pass_time(session, received))
    }

    /// Begins a reset.
    fn begin_restart(&mut self, kind: RestartKind) {
        self.restart = kind;
        self.waits_for_standstill = false;
    }

    /// Returns whether a reset drops the lines that have been received.
    fn drops_lines(&self) -> bool {
        self.restart != RestartKind::Stopping
    }

    /// Ends a reset on which the machine has acted.
    fn restart_host(&mut self, lines: &mut CheckedLines) -> Restart {
        self.is_restart_due = true;
        self.command = None;
        self.pause_ms = None;
        self.homes = None;
        // What has been taken of the line of an `M410` is answered behind it.
        if self.drops_lines() {
            lines.raw.clear();
        }
        match self.restart {
            RestartKind::Plain | RestartKind::Unlocking => {
                self.alarm = None;
                self.reset(lines);
                let has_delay = self.drivers_delay_s.take().is_some();
                Restart::Anew {
                    feed_mm_min: DEFAULT_FEED_MM_MIN,
                    is_welcomed: true,
                    has_limits: self.lowered.take().is_some() || has_delay,
                }
            }
            RestartKind::Killing => Restart::Anew {
                feed_mm_min: DEFAULT_FEED_MM_MIN,
                is_welcomed: false,
                has_limits: false,
            },
            RestartKind::Stopping => Restart::GoesOn,
        }
    }

    /// Locks the machine after a reset, or unlocks it; else ends the reset.
    fn end_restart(&mut self, session: &mut SessionContext<'_>) -> Option<Work> {
        let machine = session.machine;
        let is_locked =
            machine.state == State::Alarm && !machine.is_critical && !machine.failed_self_test;
        let work = match self.restart {
            RestartKind::Plain => {
                self.is_restart_due = false;
                return None;
            }
            RestartKind::Killing => Some(Work::Fault(Alarm::Killed)),
            RestartKind::Unlocking | RestartKind::Stopping if is_locked => Some(Work::Unlock),
            RestartKind::Unlocking | RestartKind::Stopping => None,
        };
        *session.has_release_request = true;
        self.restart = RestartKind::Plain;
        work
    }

    /// Writes a message in the words of the dialect. Returns true.
    fn write_message(
        &self,
        text: &mut Text,
        message: SenderMessage<'_>,
        settings: &Settings,
    ) -> bool {
        match message {
            SenderMessage::Welcome => replies::welcome(text, settings.is_homing_on()),
            SenderMessage::Damage(damaged, tools) => replies::damage(text, damaged, tools),
            SenderMessage::Locked
                if self.is_restart_due && self.restart == RestartKind::Unlocking => {}
            SenderMessage::Locked => replies::locked(text, settings.is_homing_on()),
            SenderMessage::Alarm(alarm) => replies::stopped(text, alarm),
        }
        true
    }
}

/// Ends homing by `G28`: the axes are at their travel from its negative end.
fn end_homing(mask: u8, settings: &Settings, interpreter: &mut Interpreter) {
    let mask = if mask == 0 { (1 << LINEAR) - 1 } else { mask };
    let position = interpreter.position();
    let work = Axes::from_fn(|axis| {
        let [lowest, _] = settings.travel(axis).unwrap_or_default();
        position[axis] - lowest
    });
    interpreter.place(mask, &work);
}
