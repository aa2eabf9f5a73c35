//! The conversation with the sender: the body of the `interpret` and `report` tasks.
//!
//! Each line gets exactly one answer, in order. Nothing here ever waits: what a line needs (room,
//! standstill, the end of its commands, cycle start, the flash) is kept as [`LineStage`] and checked
//! again in the next run. Read with Grbl 1.1 `protocol.c`.
//!
//! [`Session`] owns the order: what comes before each line (`attend_machine`), and the stage that is
//! next (`advance`). Each part with a state of its own is a type that takes the rest as arguments: the
//! line in execution ([`LineExecution`]), the path on its way to the machine ([`PathSender`]), the path beside
//! the programmed one ([`CutterPath`]), changes to be stored ([`Persistence`]), the change of a tool
//! ([`ToolChange`]), reports, messages to the operator, a break on the line, probing moves, the stream of
//! positions. Seven more files with an `impl Session` join them: `dispatch` and `program` begin a line, `moves`
//! sends its commands, `persistence` stores its changes, `reset` and `notifications` do what no line asks
//! for, and `dialect` obeys [`SenderDialect`].
//!
//! # Cost
//! [`Session`] is laid out in the order of its fields: those that each line needs come first.

mod cutter_path;
mod dialect;
mod dispatch;
mod line_break;
mod line_execution;
mod machine_sync;
mod moves;
mod notifications;
mod operator_message;
mod path;
mod persistence;
mod position_stream;
mod power_up;
mod probing;
mod program;
mod queued_duration;
mod reports;
mod reset;
mod stage;
#[cfg(arc_machine)]
mod stored_program;
mod tool_change;

use core::ops::ControlFlow;

use heapless::spsc::Producer;

use super::{
    Dialect,
    bytes::{ByteReader, ByteWriter},
    checked_lines::CheckedLines,
    dialect::SenderDialect,
    listing::FaultCounts,
    report::{self, Feedback},
    reprap::RepRap,
};
use crate::{
    axis::Axes,
    gcode::{LineError, interpreter::Interpreter},
    machine::Snapshot,
    model::{
        Awaited, Bootloader, Bootloaders, Requests, ResetCause, SelfTestFault, State,
        queues::ENTRY_RING,
    },
    path::Entry,
    settings::{Change, Changes, Settings, StoreError, Stored, ToolTable},
    stepper::SegmentRing,
    units::FineSteps,
};
use cutter_path::CutterPath;
use line_break::{LineBreak, WorkLeft};
use line_execution::{LineExecution, Source};
use operator_message::OperatorMessages;
use path::PathSender;
use persistence::Persistence;
use position_stream::PositionStream;
use power_up::PowerUp;
use probing::ProbeRecord;
pub(super) use reports::Reports;
use stage::AfterCommands;
pub(super) use stage::LineStage;
use tool_change::ToolChange;

/// Most lines that a run executes: the moves of one line each to fill the queue of entries. More would only keep
/// `report` waiting, which has the same priority.
const MAX_LINES: usize = ENTRY_RING;

/// Whether there is more to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// Call again as soon as nothing else has to run.
    Again,
    /// Nothing can be done before the next byte, the next room, or a change of the machine.
    Waiting,
}

/// The state and the ends of queues that one run of the session works with.
struct Ports<'a, 'q> {
    machine: &'a Snapshot,
    requests: &'a Requests,
    received: &'a mut ByteReader<'q>,
    sent: &'a mut ByteWriter<'q>,
    entries: &'a mut Producer<'q, Entry>,
}

/// The conversation with one sender.
#[derive(Debug)]
#[repr(C)]
pub struct Session {
    stage: LineStage,
    path: PathSender,
    line: LineExecution,
    reports: Reports,
    persistence: Persistence,
    operator_messages: OperatorMessages,
    cutter_path: CutterPath,
    probing: ProbeRecord,
    tool_change: ToolChange,
    /// The last break on the serial line.
    line_break: LineBreak,
    /// The link to the sender is lost, and a laser has not been switched off yet.
    is_link_lost: bool,
    /// The loss of a link may have cut a line off, and nothing is held for it: `$787`.
    is_line_torn: bool,
    /// The dialect in effect, lines with numbers, and what the dialect beside Grbl's needs.
    dialect: Dialect,
    lines: CheckedLines,
    host: RepRap,
    /// The position as it was sent last, unasked.
    stream: PositionStream,
    power_up: PowerUp,
    /// What should never happen, and has happened.
    faults: FaultCounts,
    /// The tool that is in the spindle while programs are only checked.
    tool_before_check: Option<u8>,
    #[cfg(arc_machine)]
    stored_program: stored_program::StoredProgram,
}

impl Session {
    /// A session with a machine that has just been switched on, and what is stored: the defaults, which
    /// the sender is sent, when nothing could be read (`is_first_boot`). The tool table is empty.
    #[must_use]
    pub fn new(stored: &Stored, is_first_boot: bool) -> Self {
        Self {
            stage: LineStage::Starting {
                is_first_boot,
                owes_answer: false,
            },
            path: PathSender::new(&stored.settings),
            line: LineExecution::new(&stored.origins),
            reports: Reports::default(),
            cutter_path: CutterPath::default(),
            persistence: Persistence::new(stored),
            operator_messages: OperatorMessages::default(),
            probing: ProbeRecord::default(),
            tool_change: ToolChange::new(),
            line_break: LineBreak::None,
            is_link_lost: false,
            is_line_torn: false,
            dialect: Dialect::Grbl,
            lines: CheckedLines::new(),
            host: RepRap::default(),
            stream: PositionStream::default(),
            power_up: PowerUp::default(),
            faults: FaultCounts::default(),
            tool_before_check: None,
            #[cfg(arc_machine)]
            stored_program: stored_program::StoredProgram::default(),
        }
    }

    /// Sets why the firmware has begun to run.
    pub const fn set_reset_cause(&mut self, cause: ResetCause) {
        self.power_up.reset_cause = cause;
    }

    /// Sets what the self-test at power-up has found wrong, for which the machine comes up in alarm 16.
    pub const fn set_self_test_fault(&mut self, fault: Option<SelfTestFault>) {
        self.power_up.self_test_fault = fault;
    }

    /// Sets the bootloaders that `$DFU` and `$UF2` may start: none, unless the platform has some.
    pub const fn set_bootloaders(&mut self, bootloaders: Bootloaders) {
        self.power_up.bootloaders = bootloaders;
    }

    /// Returns the bootloader to which the platform has to hand over now, once what is sent has left: the machine is
    /// asleep.
    #[must_use]
    pub fn wanted_bootloader(&self, machine: &Snapshot) -> Option<Bootloader> {
        match self.stage {
            LineStage::Asleep(until) if machine.state == State::Sleep => until,
            _ => None,
        }
    }

    /// Sets which records are damaged, for which the machine comes up locked.
    pub const fn set_damaged(&mut self, damaged: Changes) {
        self.persistence.damaged = damaged;
    }

    /// Returns the changes whose records are damaged, and have not been stored anew.
    #[must_use]
    pub const fn damaged(&self) -> Changes {
        self.persistence.damaged
    }

    /// Sets the number of late step events so far, wrapping, before each run.
    pub const fn set_late_events(&mut self, late: u32) {
        self.faults.late_events = late;
    }

    /// Returns the number of entries sent to the machine so far, wrapping.
    #[must_use]
    pub fn entered(&self) -> u32 {
        self.path.sync.entered
    }

    /// Returns the modal state, the offsets and the programmed position.
    #[must_use]
    pub fn interpreter(&self) -> &Interpreter {
        &self.line.interpreter
    }

    /// Returns the end of the path that has been sent, in steps: at standstill [`Motion::position`] is there.
    ///
    /// [`Motion::position`]: crate::motion::Motion::position
    #[must_use]
    pub const fn path_end(&self) -> &Axes<FineSteps> {
        self.path.router.block_end_steps()
    }

    /// Returns the settings in effect.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.persistence.stored.settings
    }

    /// Returns the tool table, to be filled with what is stored, before the first run.
    pub const fn tools_mut(&mut self) -> &mut ToolTable {
        self.line.interpreter.tools_mut()
    }

    /// Returns the change to be stored now: the platform writes [`Self::stored`] and [`Self::tools`], and
    /// reports the result with [`Self::has_stored`]. Only ever requested at standstill; the line's answer
    /// waits for it.
    #[must_use]
    pub fn wants_store(&self) -> Option<Change> {
        self.persistence.requested()
    }

    /// Returns the changes that are in effect, and wait to be stored.
    #[must_use]
    pub const fn waiting_changes(&self) -> Changes {
        self.persistence.waiting
    }

    /// Returns what is stored, with the requested change.
    #[must_use]
    pub fn stored(&self) -> &Stored {
        &self.persistence.stored
    }

    /// Returns the tool table, with the requested change.
    #[must_use]
    pub const fn tools(&self) -> &ToolTable {
        self.line.interpreter.tools()
    }

    /// Ends the requested change. After an error everything is as before.
    ///
    /// After [`StoreError::MustWait`] the change is in effect, and requested again when
    /// [`Self::erasing`] allows it.
    pub fn has_stored(&mut self, result: Result<(), StoreError>) {
        self.persistence.finish(result);
    }

    /// Takes the request for a reset, or another one, since the last call: `prepare` has to run.
    pub fn takes_release(&mut self) -> bool {
        core::mem::take(&mut self.path.sync.has_release_request)
    }

    /// One bounded piece of work: a line, or a few while entries wait for the machine.
    ///
    /// The first call welcomes the sender. The capacity of `sent` must be at least one message,
    /// [`super::MESSAGE_BYTES`].
    pub fn run<'q>(
        &mut self,
        machine: &Snapshot,
        requests: &Requests,
        received: &mut ByteReader<'q>,
        sent: &mut ByteWriter<'q>,
        entries: &mut Producer<'q, Entry>,
    ) -> Progress {
        requests.begin_batch();
        requests.wake_on(Awaited::ALL);
        let mut ports = Ports {
            machine,
            requests,
            received,
            sent,
            entries,
        };
        self.faults.lost_bytes = requests.lost();
        self.attend_dialect(&mut ports);
        let progress = match self.attend_machine(&mut ports) {
            ControlFlow::Continue(()) => self.execute_lines(&mut ports),
            ControlFlow::Break(()) => Progress::Waiting,
        };
        let is_left = progress == Progress::Waiting && self.stage == LineStage::Reading;
        if is_left && self.cutter_path.is_waiting() {
            (self.cutter_path).watch_standstill(machine, &mut self.path, requests);
        }
        requests.wake_on(match progress {
            Progress::Again => Awaited::NONE,
            Progress::Waiting => self.awaited(),
        });
        progress
    }

    /// Answers a `?`. When the report must wait, for room or for the welcome, [`Session::run`] sends it.
    pub fn report(
        &mut self,
        machine: &Snapshot,
        requests: &Requests,
        received_free: usize,
        sent: &mut ByteWriter<'_>,
    ) -> Progress {
        requests.wake_on(Awaited::ALL);
        self.reports.is_status_due |= requests.take_status();
        self.reports.observe(machine, &mut self.line.interpreter);
        let is_next = self.stage.is_welcome_sent()
            && requests.reset_count() == self.path.sync.reset_count
            && self.reports.message.is_empty()
            && !self.reports.has_notices(machine);
        let is_sent =
            self.reports.is_status_due && is_next && self.send_status(machine, received_free, sent);
        requests.wake_on(self.awaited());
        if is_sent {
            Progress::Again
        } else {
            Progress::Waiting
        }
    }

    /// Sends the position if it has changed and a line is due: `$792` ms of motion after the last one,
    /// and at rest. After [`Session::run`], whose progress it is told.
    pub fn stream_position(
        &mut self,
        progress: Progress,
        machine: &Snapshot,
        segments: &SegmentRing,
        requests: &Requests,
        sent: &mut ByteWriter<'_>,
    ) {
        if self.settings().stream_interval_ms >= 1.0 {
            let is_free = !self.reports.is_pending() && self.stage.is_welcome_sent();
            let settings = &self.persistence.stored.settings;
            let now_ticks = segments.played_start_ticks();
            let sent = is_free.then_some(sent);
            self.stream.send_changed(machine, settings, now_ticks, sent);
            if progress == Progress::Waiting {
                requests.wake_on(self.awaited());
            }
        }
    }

    /// Returns the events that let the session continue, besides a change of the machine's state.
    fn awaited(&self) -> Awaited {
        let when = |is_so, events| if is_so { events } else { Awaited::NONE };
        let progress = Awaited::ENTRIES.union(Awaited::SEGMENTS);
        (self.stage.awaited(&self.path))
            .union(when(self.reports.is_pending(), Awaited::ROOM))
            .union(when(self.operator_messages.are_waiting(), progress))
            .union(when(self.persistence.has_postponed(), Awaited::ENTRIES))
            .union(self.stream.awaited(self.settings()))
            // Each line may be the command of an emergency.
            .union(when(self.needs_clock(), Awaited::LINE))
    }

    /// What comes before each line, in Grbl's order: the flash, resets, notices, the welcome, the
    /// position, a status report, faults. Breaks when the session has to wait.
    fn attend_machine(&mut self, ports: &mut Ports<'_, '_>) -> ControlFlow<()> {
        let machine = ports.machine;
        continue_if(self.persistence.requested().is_none())?;
        let is_reverted = (self.persistence).end(self.line.interpreter.tools_mut());
        if is_reverted && matches!(self.stage, LineStage::Storing(_)) {
            self.refuse(LineError::StorageWrite);
        }
        if self.persistence.has_postponed() {
            let erasing = self.erasing(machine);
            (self.persistence).store_postponed(erasing, &mut self.reports.message);
            continue_if(self.persistence.requested().is_none())?;
        }
        self.begin_reset(ports.requests.reset_count());
        self.reports.observe(machine, &mut self.line.interpreter);
        self.drop_cancelled(machine);
        continue_if(self.send_pending(ports))?;
        continue_if(self.start(ports))?;
        self.apply_stored(ports);
        (self.path).sync_at_standstill(machine, self.stage, &mut self.line);
        continue_if(self.send_pending(ports))?;
        if ports.requests.take_greeting() && self.stage.is_welcome_sent() {
            self.greet_again(machine);
            continue_if(self.send_pending(ports))?;
        }
        if ports.requests.take_line_break() {
            self.line_break = LineBreak::Pending;
        }
        if ports.requests.take_link_loss() {
            self.is_link_lost = true;
            self.is_line_torn = !self.settings().holds_without_link;
            if self.settings().holds_without_link {
                self.line_break = LineBreak::Pending;
            }
        }
        if self.line_break != LineBreak::None {
            self.attend_line_break(ports);
            continue_if(self.send_pending(ports))?;
        }
        if self.is_link_lost {
            self.attend_link_loss(ports);
        }
        if self.reports.is_status_due && self.stage.is_welcome_sent() {
            let received_free = ports.received.capacity() - ports.received.len();
            continue_if(self.send_status(machine, received_free, ports.sent))?;
        }
        continue_if(!(machine.has_underrun || machine.is_critical) || self.report_fault(ports))
    }

    /// Sends a status report. Returns false when there is no room.
    fn send_status(
        &mut self,
        machine: &Snapshot,
        received_free: usize,
        sent: &mut ByteWriter<'_>,
    ) -> bool {
        let settings = &self.persistence.stored.settings;
        let interpreter = &self.line.interpreter;
        (self.reports).send_status(machine, settings, interpreter, received_free, sent)
    }

    /// Holds the machine after a break on the line; a pause that would end by itself waits for the operator.
    #[cold]
    fn attend_line_break(&mut self, ports: &Ports<'_, '_>) {
        let machine = ports.machine;
        if self.path.sync.is_cancelled(machine) || self.host.rules().is_restarting {
            return;
        }
        let is_first = self.line_break == LineBreak::Pending;
        let left = WorkLeft {
            is_moving: !self.path.is_done(machine),
            has_line: ports.received.may_have_line(),
            goes_on: self.stage.goes_on(&self.persistence.stored.startup),
        };
        let Some(holds) = self.line_break.take_hold(machine.state, left) else {
            return;
        };
        if holds {
            self.request_hold(ports);
        }
        let was_timed = self.host.end_timed_pause();
        if (holds || was_timed) && is_first {
            report::feedback(&mut self.reports.message, Feedback::LineBreak);
        }
    }

    /// Switches a laser off after the loss of the link: at once where the loss holds the machine, otherwise when
    /// everything has been played out.
    #[cold]
    fn attend_link_loss(&mut self, ports: &Ports<'_, '_>) {
        let is_played_out = self.path.is_done(ports.machine) && !ports.received.may_have_line();
        if self.settings().holds_without_link || is_played_out {
            self.is_link_lost = false;
            ports.requests.switch_laser_off();
            self.path.sync.has_release_request = true;
        }
    }

    /// Executes lines while entries wait for the machine, else one stage of one line.
    fn execute_lines(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        for _ in 0..MAX_LINES {
            let is_busy = !ports.entries.is_empty();
            let progress = self.advance(ports);
            if !self.reports.flush(ports.sent) {
                return Progress::Waiting;
            }
            // With entries waiting, the machine need not be attended to before each line.
            let continues =
                is_busy && self.stage == LineStage::Reading && progress == Progress::Again;
            // An arc in whole steps is gone through before it begins: one in a run.
            #[cfg(arc_machine)]
            let continues = continues && self.settings().arc_rule == 0;
            if !continues || ports.requests.reset_count() != self.path.sync.reset_count {
                return progress;
            }
        }
        Progress::Again
    }

    /// Continues the present stage.
    fn advance(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let machine = ports.machine;
        // While the machine is held, or ends a jog, no line is begun; the bytes stay where the sender
        // counts them.
        let is_cancelled = self.path.sync.is_cancelled(machine);
        let is_held = machine.state.is_suspended() || is_cancelled;
        match self.stage {
            LineStage::Reading
            | LineStage::ReadingManual
            | LineStage::AwaitingStandstill
            | LineStage::StartingUp(_)
                if is_held =>
            {
                Progress::Waiting
            }
            LineStage::Sending(_) | LineStage::Compensating(_) if is_cancelled => Progress::Waiting,
            LineStage::Faulted if self.is_refusing(machine) => self.refuse(LineError::Locked),
            LineStage::Asleep(_) | LineStage::ListingInDialect(_) => {
                let stage = self.stage;
                let step = self.read_in_dialect(ports);
                let progress = step.map_or(Progress::Waiting, |step| self.take_step(step, ports));
                if matches!(stage, LineStage::Asleep(_)) && self.stage == LineStage::Reading {
                    self.stage = stage;
                }
                progress
            }
            LineStage::Starting { .. } | LineStage::Faulted => Progress::Waiting,
            #[cfg(arc_machine)]
            LineStage::Reading if self.stored_program.is_running() => {
                let step = (self.stored_program).take_line(&mut self.line.input, ports);
                step.map_or(Progress::Again, |step| self.take_step(step, ports))
            }
            LineStage::Reading => self.read_line(ports),
            LineStage::ReadingManual => self.read_manual_line(ports),
            LineStage::Sending(first) => self.send_commands(first, ports),
            LineStage::Compensating(first) => self.send_compensated(first, ports),
            LineStage::ListingDefaults(line) => self.list_defaults(line),
            LineStage::Welcoming => self.welcome(machine),
            LineStage::StartingUp(number) => self.start_up(number, ports),
            LineStage::AwaitingStandstill => self.dispatch_at_standstill(ports),
            LineStage::Completing(AfterCommands::ToolPause) => self.continue_tool_change(ports),
            LineStage::Completing(after_commands) => self.complete(machine, after_commands),
            LineStage::Storing(then) => self.continue_stored(then, ports),
            LineStage::Listing(list, line) => self.list(list, line, ports.received.capacity()),
            LineStage::Faulting => self.send_fault(ports),
            LineStage::Resetting => {
                ports.requests.reset();
                self.path.sync.has_release_request = true;
                Progress::Again
            }
        }
    }
}

/// Returns `Continue` where a condition holds.
const fn continue_if(condition: bool) -> ControlFlow<()> {
    if condition {
        ControlFlow::Continue(())
    } else {
        ControlFlow::Break(())
    }
}
