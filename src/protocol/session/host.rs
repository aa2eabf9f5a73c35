//! What a host of 3D printers needs beside its lines: its state, restarts, time.

use super::{LineStage, Links, Session, host_bytes::Scan, host_commands::LoweredLimits};
use crate::{
    axis::Axes,
    gcode::reprap::{Extruder, HostCommand},
    machine::Snapshot,
    model::{Alarm, State, timing::TICK_MS},
    path::Work,
    protocol::{Dialect, RawLine, report},
    units::Nm,
};

/// Silence after which a realtime byte counts anywhere, ms.
const SILENCE_MS: u32 = 100;
/// Silence after which a checked line without its end is asked for again, and after which a host that
/// may wait for a lost `ok` is reported that nothing is left to do, ms.
const HOST_TIMEOUT_MS: u32 = 1000;
/// Feed rate where a program sets none, mm/min.
const DEFAULT_FEED_MM_MIN: f32 = 1500.0;

/// The reset that is going on, or has been.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Restart {
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

/// The sender, where it does not speak plain Grbl.
#[derive(Debug)]
pub(super) struct Host {
    /// The dialect in effect.
    pub(super) dialect: Dialect,
    /// The line as received, and whether it has ended.
    pub(super) raw: RawLine,
    pub(super) has_ended: bool,
    /// Behind the first byte of what may be a realtime byte in UTF-8.
    pub(super) is_behind_lead: bool,
    /// Number of the line's first byte.
    pub(super) start: usize,
    /// Number of the last accepted line.
    pub(super) last: i32,
    /// Whether there has been a good line with a checksum.
    pub(super) has_begun: bool,
    /// Lines that begin before this byte were sent before a line was asked for again.
    pub(super) stale_before: Option<usize>,
    /// What the line asks for that Grbl has no words for.
    pub(super) command: Option<HostCommand>,
    /// `E` before the line and after it.
    pub(super) extruder: Extruder,
    pub(super) next_extruder: Extruder,
    /// Time that is left of a pause that ends by itself, ms.
    pub(super) pause_ms: Option<u32>,
    /// Where the machine has paused last, in machine coordinates.
    pub(super) paused_at: Option<Axes<Nm>>,
    /// The line moves single motors.
    pub(super) moves_motors: bool,
    /// The line is read again when the machine stands still: it moves motors.
    pub(super) waits_for_standstill: bool,
    /// The limit switches of the axes that move end the line.
    pub(super) ends_at_switch: bool,
    /// Limits that the program has lowered.
    pub(super) lowered: Option<LoweredLimits>,
    /// Time of standstill after which the drivers go off in place of that of the settings, s; 0 for never.
    pub(super) drivers_delay_s: Option<u16>,
    /// Time between two reports of the position, s; 0 for none.
    position_interval_s: u8,
    /// What a job has been reported once: letters of axes, and M codes.
    reported: u64,
    /// The last alarm.
    pub(super) alarm: Option<Alarm>,
    /// Time between two messages that a line is not done, s.
    pub(super) busy_interval_s: u8,
    restart: Restart,
    /// What is to be done as soon as the machine has acted on a reset.
    is_restart_due: bool,
    /// The bytes that have been looked at.
    pub(super) scan: Scan,
    timers: HostTimers,
}

/// The times by which something is due.
#[derive(Debug, Default)]
struct HostTimers {
    ticks: u32,
    /// Number of bytes received, and for how long, ms.
    received: usize,
    silent_ms: u32,
    /// For how long a line has been waiting for its answer, and nothing has been left to do, ms.
    busy_ms: u32,
    idle_ms: u32,
    /// Since the last report of the position, and of standstill, ms.
    position_ms: u32,
    still_ms: u32,
}

impl Host {
    pub(super) fn new() -> Self {
        Self {
            dialect: Dialect::Grbl,
            raw: RawLine::new(),
            has_ended: false,
            is_behind_lead: false,
            start: 0,
            last: 0,
            has_begun: false,
            stale_before: None,
            command: None,
            extruder: Extruder::START,
            next_extruder: Extruder::START,
            pause_ms: None,
            paused_at: None,
            moves_motors: false,
            waits_for_standstill: false,
            ends_at_switch: false,
            lowered: None,
            drivers_delay_s: None,
            position_interval_s: 0,
            reported: 0,
            alarm: None,
            busy_interval_s: 0,
            restart: Restart::Plain,
            is_restart_due: false,
            scan: Scan::default(),
            timers: HostTimers::default(),
        }
    }

    /// Forgets what has been received and numbered.
    fn reset(&mut self) {
        self.raw.clear();
        self.has_ended = false;
        self.last = 0;
        self.has_begun = false;
        self.stale_before = None;
        self.command = None;
        self.extruder = Extruder::START;
        self.next_extruder = Extruder::START;
        self.paused_at = None;
        self.moves_motors = false;
        self.waits_for_standstill = false;
        self.ends_at_switch = false;
        self.position_interval_s = 0;
        self.begin_job();
    }

    /// Forgets what the job before was reported.
    pub(super) fn begin_job(&mut self) {
        self.reported = 0;
    }

    /// Returns whether something has not been reported to this job: an M code, or a letter.
    pub(super) fn is_first(&mut self, code: u16) -> bool {
        let bit = 1 << (code % 64);
        let is_first = self.reported & bit == 0;
        self.reported |= bit;
        is_first
    }

    /// Sets the time between two reports of the position, s; 0 for none.
    pub(super) fn report_positions(&mut self, interval_s: u8) {
        self.position_interval_s = interval_s;
        self.timers.position_ms = 0;
    }

    /// Returns whether a reset drops the lines that have been received.
    pub(super) fn drops_lines(&self) -> bool {
        self.restart != Restart::Stopping
    }

    /// Requests a reset.
    pub(super) fn restart(&mut self, restart: Restart) {
        self.restart = restart;
        self.waits_for_standstill = false;
    }
}

impl Session {
    /// Adopts the dialect, and does what cannot wait for the lines before it.
    #[inline]
    pub(super) fn attend_host(&mut self, links: &mut Links<'_, '_>) {
        let dialect = Dialect::of(self.settings());
        if dialect != self.host.dialect {
            self.adopt_dialect(dialect, links);
        }
        if dialect.is_reprap() {
            self.attend_reprap(links);
        }
    }

    /// Changes the dialect, once the line that changes it has been answered.
    #[cold]
    #[inline(never)]
    fn adopt_dialect(&mut self, dialect: Dialect, links: &mut Links<'_, '_>) {
        if !matches!(
            self.stage,
            LineStage::Starting { .. } | LineStage::Welcoming | LineStage::Reading
        ) {
            return;
        }
        self.host.dialect = dialect;
        if dialect.is_reprap() {
            self.interpreter.set_default_feed(DEFAULT_FEED_MM_MIN);
        }
        self.host.reset();
        self.host.scan.begin(links.received.oldest());
        self.host.busy_interval_s = self.settings().busy_interval_s;
        self.host.timers = HostTimers {
            ticks: links.requests.ticks(),
            ..HostTimers::default()
        };
        links.requests.sort_later(dialect.is_reprap());
    }

    #[inline(never)]
    fn attend_reprap(&mut self, links: &mut Links<'_, '_>) {
        if self.host.is_restart_due && self.ends_restart(links) {
            self.host.is_restart_due = false;
        }
        self.scan(links);
        self.pass_time(links);
    }

    /// Ends a reset on which the machine has acted. `owes_answer` tells whether it has interrupted a line.
    pub(super) fn restart_host(&mut self, owes_answer: bool, links: &Links<'_, '_>) -> bool {
        let host = &mut self.host;
        host.is_restart_due = true;
        // What has been taken of the line of an `M410` is answered behind it.
        if host.drops_lines() {
            host.raw.clear();
        }
        match host.restart {
            Restart::Plain | Restart::Unlocking => {
                host.alarm = None;
                host.reset();
                self.forget_home_after(links.machine);
                self.restart();
                self.interpreter.set_default_feed(DEFAULT_FEED_MM_MIN);
                self.restore_limits();
                self.stage = LineStage::Welcoming;
            }
            Restart::Killing => {
                self.forget_home_after(links.machine);
                self.host.command = None;
                self.restart();
                self.interpreter.set_default_feed(DEFAULT_FEED_MM_MIN);
                self.stage = LineStage::Reading;
            }
            Restart::Stopping => {
                self.interpreter.switch_off();
                if owes_answer {
                    report::ok(&mut self.reports.message);
                }
                self.begin_line();
            }
        }
        true
    }

    /// Locks the machine after a reset, or unlocks it. Returns false until it stands still.
    fn ends_restart(&mut self, links: &mut Links<'_, '_>) -> bool {
        let machine = links.machine;
        let has_reset = machine.reset_count == self.machine_sync.reset_count
            && links.requests.reset_count() == self.machine_sync.reset_count;
        let is_starting = matches!(self.stage, LineStage::Starting { .. });
        if !has_reset || is_starting || !self.is_done(machine) || !links.entries.ready() {
            return false;
        }
        let is_locked =
            machine.state == State::Alarm && !machine.is_critical && !machine.failed_self_test;
        match self.host.restart {
            Restart::Plain => return true,
            Restart::Killing => self.send_work(Work::Fault(Alarm::Killed), links),
            Restart::Unlocking | Restart::Stopping if is_locked => {
                self.send_work(Work::Unlock, links);
            }
            Restart::Unlocking | Restart::Stopping => {}
        }
        self.machine_sync.has_release_request = true;
        self.host.restart = Restart::Plain;
        false
    }

    /// A reset in motion may have cost steps.
    fn forget_home_after(&mut self, machine: &Snapshot) {
        if machine.reset_in_motion {
            self.interpreter.forget_home();
        }
    }

    /// Returns whether lines have to wait for the end of a reset.
    pub(super) fn is_restarting_host(&self) -> bool {
        self.host.is_restart_due
    }

    /// Returns whether the machine has stopped for a reason that only a restart ends.
    pub(super) fn is_stopped_host(&self, machine: &Snapshot) -> bool {
        self.host.dialect.is_reprap() && (machine.is_critical || machine.has_underrun)
    }

    /// Returns whether a locked machine only waits for `G28`: lines that move nothing and switch nothing on
    /// may come before it.
    pub(super) fn awaits_host_homing(&self) -> bool {
        self.host.dialect.is_reprap() && self.host.alarm.is_none()
    }

    /// Returns whether the lock is about to end: a restart unlocks the machine.
    pub(super) fn is_unlocking_host(&self) -> bool {
        self.host.is_restart_due && self.host.restart == Restart::Unlocking
    }

    /// Returns whether the session needs the clock of `interpret`.
    #[must_use]
    pub fn needs_clock(&self) -> bool {
        self.host.dialect.is_reprap()
    }

    /// Returns whether there is something to do at the next tick of the clock, whatever else comes.
    /// `received` is the number of bytes received so far, wrapping.
    #[must_use]
    pub fn awaits_tick(&self, received: usize) -> bool {
        self.needs_clock() && (received != self.host.scan.next || self.host.pause_ms.is_some())
    }

    /// Does what is due by the clock.
    fn pass_time(&mut self, links: &mut Links<'_, '_>) {
        let timers = &mut self.host.timers;
        let ticks = links.requests.ticks();
        let passed_ms = ticks.wrapping_sub(timers.ticks).saturating_mul(TICK_MS);
        timers.ticks = ticks;
        let received = links.received.written();
        if received == timers.received {
            timers.silent_ms = timers.silent_ms.saturating_add(passed_ms);
        } else {
            timers.received = received;
            timers.silent_ms = 0;
        }
        if passed_ms == 0 {
            return;
        }
        // A byte may have come directly behind a tick: one tick more is surely that long.
        if timers.silent_ms > SILENCE_MS {
            self.host.scan.silent_at = Some(received);
        }
        if links.machine.state == State::HoldComplete {
            let settings = &self.persistence.stored.settings;
            self.host.paused_at = Some(report::machine_position(links.machine, settings));
        }
        self.pass_pause(passed_ms, links);
        self.pass_standstill(passed_ms, links);
        if self.reports.message.is_empty() && !self.report_position_in_time(passed_ms, links) {
            self.report_waiting(passed_ms, links);
        }
    }

    /// Reports the position where that is due. Returns whether it is.
    fn report_position_in_time(&mut self, passed_ms: u32, links: &Links<'_, '_>) -> bool {
        let is_welcome_sent = self.stage.is_welcome_sent();
        let host = &mut self.host;
        let timers = &mut host.timers;
        timers.position_ms = timers.position_ms.saturating_add(passed_ms);
        let interval_ms = u32::from(host.position_interval_s) * 1000;
        let is_due = interval_ms != 0 && timers.position_ms >= interval_ms && is_welcome_sent;
        if is_due {
            timers.position_ms = 0;
            self.write_position(links.machine, true);
        }
        is_due
    }

    /// Tells a sender whose line waits that it does, and one that may wait for a lost `ok` that no line
    /// does.
    fn report_waiting(&mut self, passed_ms: u32, links: &Links<'_, '_>) {
        let machine = links.machine;
        // A line waits in the queue while the machine is held.
        let has_held_line = machine.state.is_suspended() && links.received.may_have_line();
        let is_waiting = self.stage.is_line_begun() || has_held_line;
        let is_idle = self.host.has_begun
            && links.received.is_empty()
            && self.host.raw_is_empty()
            && self.stage == LineStage::Reading
            && machine.state == State::Idle
            && self.is_done(machine);
        let interval_ms = u32::from(self.host.busy_interval_s) * 1000;
        let text = &mut self.reports.message;
        let timers = &mut self.host.timers;
        timers.busy_ms = if is_waiting {
            timers.busy_ms.saturating_add(passed_ms)
        } else {
            0
        };
        timers.idle_ms = if is_idle {
            timers.idle_ms.saturating_add(passed_ms)
        } else {
            0
        };
        if interval_ms != 0 && timers.busy_ms >= interval_ms {
            timers.busy_ms = 0;
            text.word(if machine.state.is_suspended() {
                "echo:busy: paused for user"
            } else {
                "echo:busy: processing"
            });
            text.end();
        }
        if timers.idle_ms.min(timers.silent_ms) >= HOST_TIMEOUT_MS {
            timers.idle_ms = 0;
            text.word("wait").end();
        }
    }

    /// Switches the drivers off after the time of standstill that a program has set.
    fn pass_standstill(&mut self, passed_ms: u32, links: &mut Links<'_, '_>) {
        let is_still = matches!(links.machine.state, State::Idle | State::Alarm)
            && self.stage == LineStage::Reading
            && self.is_done(links.machine);
        let before_ms = self.host.timers.still_ms;
        let still_ms = if is_still {
            before_ms.saturating_add(passed_ms)
        } else {
            0
        };
        self.host.timers.still_ms = still_ms;
        let delay_ms = u32::from(self.host.drivers_delay_s.unwrap_or_default()) * 1000;
        if before_ms < delay_ms && still_ms >= delay_ms {
            self.send_work(Work::Drivers(false), links);
            self.machine_sync.has_release_request = true;
        }
    }

    /// Ends a pause whose time is over.
    fn pass_pause(&mut self, passed_ms: u32, links: &Links<'_, '_>) {
        let is_paused = links.machine.state == State::HoldComplete
            && matches!(self.stage, LineStage::Completing(_));
        let Some(left_ms) = self.host.pause_ms.filter(|_| is_paused) else {
            return;
        };
        let left_ms = left_ms.saturating_sub(passed_ms);
        self.host.pause_ms = (left_ms != 0).then_some(left_ms);
        if left_ms == 0 {
            links.requests.accept_later(b'~', links.received.oldest());
            self.machine_sync.has_release_request = true;
        }
    }

    /// Returns whether the end of a checked line has been lost: nothing has come for a second.
    pub(super) fn has_lost_line_end(&self) -> bool {
        self.host.timers.silent_ms >= HOST_TIMEOUT_MS
            && self.host.has_begun
            && !self.host.raw_is_empty()
            && self.host.raw.is_checked()
    }
}

impl Host {
    /// Returns whether no line has begun.
    pub(super) fn raw_is_empty(&self) -> bool {
        self.has_ended || self.raw.is_empty()
    }

    /// Begins a line with the next byte, at a place in what has been looked at.
    pub(super) fn drop_unfinished(&mut self) {
        self.raw.clear();
        self.scan.line.clear();
    }
}
