//! The conversation with the sender: the body of the `interpret` and `report` tasks.
//!
//! Each line gets exactly one answer, in order. Nothing here ever waits: what a line needs (room,
//! standstill, the end of its commands, cycle start, the flash) is kept as [`LineStage`] and checked
//! again in the next run. Read with Grbl 1.1 `protocol.c`.
//!
//! # Cost
//! [`Session`] is laid out in the order of its fields: those that each line needs come first.

mod blending;
mod commands;
mod compensation;
mod dispatch;
mod host;
mod host_bytes;
mod host_commands;
mod host_lines;
mod machine_sync;
mod notifications;
mod operator_message;
mod persistence;
mod position_stream;
mod program;
mod queued_duration;
mod reset;
mod sending;
#[cfg(arc_machine)]
mod stored_program;
mod tool_change;

use core::ops::ControlFlow;

use heapless::spsc::Producer;

use super::{
    bytes::{ByteReader, ByteWriter},
    dollar::List,
    line::Line,
    listing::FaultCounts,
    report::Feedback,
};
use crate::{
    axis::Axes,
    gcode::{
        LineError, PlainPrefix,
        interpreter::{Checked, Interpreter, Outcome},
    },
    machine::Snapshot,
    model::{Awaited, Probed, Requests, ResetCause, SelfTestFault, queues::ENTRY_RING},
    path::{Blender, Compensator, Entry, Router, TiltedArc},
    settings::{Change, Changes, Settings, StoreError, Stored, ToolTable},
    units::{FineSteps, Nm},
};
use host::Host;
use machine_sync::{LineBreak, MachineSync};
use notifications::Reports;
use operator_message::OperatorMessages;
use persistence::{AfterStore, Persistence};
use position_stream::PositionStream;
use tool_change::ToolChange;

/// Lines that one run executes, at most: moves of one line each that fill the queue of entries. More
/// would only keep `report` waiting, which has the same priority.
const MAX_LINES: usize = ENTRY_RING;

/// Whether there is more to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// Call again as soon as nothing else has to run.
    Again,
    /// Nothing can be done before the next byte, the next room, or a change of the machine.
    Waiting,
}

/// What the session is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LineStage {
    /// Power-up, or a reset that the machine has not yet acted on.
    Starting {
        /// Nothing was stored: the sender gets an error and the defaults before the welcome.
        is_first_boot: bool,
        /// The reset has interrupted a line, which gets its `ok` before the welcome.
        owes_answer: bool,
    },
    /// The defaults are being listed before the first welcome; this line is next.
    ListingDefaults(usize),
    /// The welcome is next.
    Welcoming,
    /// The first startup line from this one on that is not empty is next.
    StartingUp(usize),
    /// Receiving a line.
    Reading,
    /// The same, in a change of the tool: a line of the operator.
    ReadingManual,
    /// A line is complete but needs standstill; it has had no effect, and is dispatched again then.
    AwaitingStandstill,
    /// The commands of a line go to the machine; this one is next.
    Sending(usize),
    /// What compensation has released goes to the machine, then the line from this command on.
    Compensating(usize),
    /// All commands have gone to the machine; this follows when they are done.
    Completing(AfterCommands),
    /// The platform stores a change; this follows.
    Storing(AfterStore),
    /// A list is being sent; this line of it is next.
    Listing(List, usize),
    /// The answer to `M115` is being sent; this line of it is next.
    ListingFirmware(usize),
    /// The answer to `M503` is being sent; this line of it is next.
    ListingHostSettings(usize),
    /// The line has been answered, and ends with a reset.
    Resetting,
    /// The line leaves the travel: the alarm is to be sent to the machine.
    Faulting,
    /// Only a reset ends the line, and answers it.
    Faulted,
    /// Asleep: only a reset ends it.
    Asleep,
}

/// What follows when the machine has done everything that a line asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AfterCommands {
    /// The answer.
    Answer,
    /// A message and the answer.
    Message(Feedback),
    /// The position after a probing move, and the answer.
    Probe,
    /// The report of a missed probing move without a step, and the answer.
    Miss,
    /// The result of homing, and the startup lines after homing all axes.
    Home {
        /// The axes, bit 0 = X; 0 for all.
        mask: u8,
    },
    /// The return from a change of the tool.
    ToolPause,
    /// The rest of the line that has changed the tool.
    ToolReturn,
    /// The line, which has only waited so far.
    Again,
}

/// The origin of the line in execution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    /// The sender.
    Line,
    /// The sender, after `$J=`.
    Jog,
    /// The sender, after `$Nn=`: to be stored as startup line `number`, from byte `start` on, and
    /// then executed.
    NewStartup {
        number: usize,
        start: usize,
        is_stored: bool,
    },
    /// This startup line. Afterwards the `ok` of `$H` is due, or nothing.
    Startup { number: usize, is_homed: bool },
}

/// The line in execution.
#[derive(Debug)]
struct LineExecution {
    source: Source,
    /// What follows the commands of the line.
    after_commands: Option<AfterCommands>,
    /// The result of the last check.
    checked: Checked,
    /// The plain words that the line begins with.
    prefix: PlainPrefix,
    /// The line as received.
    input: Line,
    /// The commands of the line.
    outcome: Outcome,
    /// Whether these are compensated.
    is_compensated: bool,
    /// The arc of which chords are being sent.
    tilted: Option<TiltedArc>,
    /// The command in whose place those of the holes are sent, of a line that drills.
    drilling: Option<usize>,
}

/// The last probing move.
#[derive(Debug, Default)]
struct ProbeRecord {
    /// What was reported last.
    reported: Probed,
    /// Where the move in execution began.
    start: Axes<Nm>,
    /// Whether the move in execution has ended.
    has_ended: bool,
}

/// The state and the ends of queues that one run of the session works with.
struct Links<'a, 'q> {
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
    machine_sync: MachineSync,
    router: Router,
    interpreter: Interpreter,
    line: LineExecution,
    reports: Reports,
    /// Moves that `G64` may still change.
    blender: Blender,
    persistence: Persistence,
    operator_messages: OperatorMessages,
    compensator: Compensator,
    probing: ProbeRecord,
    tool_change: ToolChange,
    /// What senders of other dialects than Grbl's need.
    host: Host,
    /// The position as it was sent last, unasked.
    stream: PositionStream,
    /// Why the firmware has begun to run.
    reset_cause: ResetCause,
    /// What the self-test at power-up has found wrong.
    self_test_fault: Option<SelfTestFault>,
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
        let mut interpreter = Interpreter::new();
        interpreter.set_origins(&stored.origins);
        Self {
            stage: LineStage::Starting {
                is_first_boot,
                owes_answer: false,
            },
            machine_sync: MachineSync::default(),
            router: Router::new(&stored.settings),
            interpreter,
            line: LineExecution {
                source: Source::Line,
                after_commands: None,
                checked: Checked::default(),
                prefix: PlainPrefix::default(),
                input: Line::new(),
                outcome: Outcome::default(),
                is_compensated: false,
                tilted: None,
                drilling: None,
            },
            reports: Reports::default(),
            blender: Blender::new(),
            compensator: Compensator::new(),
            persistence: Persistence::new(stored),
            operator_messages: OperatorMessages::default(),
            probing: ProbeRecord::default(),
            tool_change: ToolChange::new(),
            host: Host::new(),
            stream: PositionStream::default(),
            reset_cause: ResetCause::Power,
            self_test_fault: None,
            faults: FaultCounts::default(),
            tool_before_check: None,
            #[cfg(arc_machine)]
            stored_program: stored_program::StoredProgram::default(),
        }
    }

    /// Sets why the firmware has begun to run.
    pub const fn set_reset_cause(&mut self, cause: ResetCause) {
        self.reset_cause = cause;
    }

    /// Sets what the self-test at power-up has found wrong, for which the machine comes up in alarm 16.
    pub const fn set_self_test_fault(&mut self, fault: Option<SelfTestFault>) {
        self.self_test_fault = fault;
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
        self.machine_sync.entered
    }

    /// Returns the modal state, the offsets and the programmed position.
    #[must_use]
    pub fn interpreter(&self) -> &Interpreter {
        &self.interpreter
    }

    /// Returns the end of the path that has been sent, in steps: at standstill [`Motion::position`] is there.
    ///
    /// [`Motion::position`]: crate::motion::Motion::position
    #[must_use]
    pub const fn path_end(&self) -> &Axes<FineSteps> {
        self.router.block_end_steps()
    }

    /// Returns the settings in effect.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.persistence.stored.settings
    }

    /// Returns the tool table, to be filled with what is stored, before the first run.
    pub const fn tools_mut(&mut self) -> &mut ToolTable {
        self.interpreter.tools_mut()
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
        self.persistence.waiting()
    }

    /// Returns what is stored, with the requested change.
    #[must_use]
    pub fn stored(&self) -> &Stored {
        &self.persistence.stored
    }

    /// Returns the tool table, with the requested change.
    #[must_use]
    pub const fn tools(&self) -> &ToolTable {
        self.interpreter.tools()
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
        core::mem::take(&mut self.machine_sync.has_release_request)
    }

    /// One bounded piece of work: a line, or a few while entries wait for the machine.
    ///
    /// The first call welcomes the sender. Room in `sent` must be possible for one message of
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
        let mut links = Links {
            machine,
            requests,
            received,
            sent,
            entries,
        };
        self.faults.lost_bytes = requests.lost();
        self.attend_host(&mut links);
        let progress = match self.attend_machine(&mut links) {
            ControlFlow::Continue(()) => self.execute_lines(&mut links),
            ControlFlow::Break(()) => Progress::Waiting,
        };
        if progress == Progress::Waiting && self.compensator.is_waiting() {
            self.watch_standstill(machine, requests);
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
        self.observe(machine);
        let is_next = self.is_welcome_sent()
            && requests.reset_count() == self.machine_sync.reset_count
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

    /// Returns the events that let the session continue, besides a change of the machine's state.
    fn awaited(&self) -> Awaited {
        let work = match self.stage {
            LineStage::Reading if self.blender.has_pending() => Awaited::LINE
                .union(Awaited::ENTRIES)
                .union(Awaited::SEGMENTS),
            LineStage::Reading | LineStage::ReadingManual => Awaited::LINE,
            LineStage::Sending(_) | LineStage::Compensating(_)
                if self.machine_sync.waits_for_time =>
            {
                Awaited::ENTRIES.union(Awaited::SEGMENTS)
            }
            LineStage::Sending(_) | LineStage::Compensating(_) => Awaited::ENTRIES_BATCHED,
            LineStage::Starting { .. }
            | LineStage::ListingDefaults(_)
            | LineStage::Welcoming
            | LineStage::StartingUp(_)
            | LineStage::AwaitingStandstill
            | LineStage::Completing(_)
            | LineStage::Storing(_)
            | LineStage::Listing(..)
            | LineStage::ListingFirmware(_)
            | LineStage::ListingHostSettings(_)
            | LineStage::Resetting
            | LineStage::Faulting
            | LineStage::Faulted
            | LineStage::Asleep => Awaited::ENTRIES,
        };
        let work = if self.reports.is_pending() {
            work.union(Awaited::ROOM)
        } else {
            work
        };
        let work = if self.operator_messages.are_waiting() {
            work.union(Awaited::ENTRIES).union(Awaited::SEGMENTS)
        } else {
            work
        };
        let work = if self.persistence.has_postponed() {
            work.union(Awaited::ENTRIES)
        } else {
            work
        };
        let work = work.union(self.awaited_by_stream());
        if self.host.dialect.is_reprap() {
            // Each line may be the command of an emergency.
            work.union(Awaited::LINE)
        } else {
            work
        }
    }

    /// What comes before each line, in Grbl's order: the flash, resets, notices, the welcome, the
    /// position, a status report, faults. Breaks when the session has to wait.
    fn attend_machine(&mut self, links: &mut Links<'_, '_>) -> ControlFlow<()> {
        let machine = links.machine;
        continue_if(self.persistence.requested().is_none())?;
        self.end_store();
        if self.persistence.has_postponed() {
            self.store_postponed(machine);
            continue_if(self.persistence.requested().is_none())?;
        }
        self.begin_reset(links.requests.reset_count());
        self.observe(machine);
        self.drop_cancelled(machine);
        continue_if(self.send_pending(links))?;
        continue_if(self.start(links))?;
        self.apply_stored(links);
        self.sync_at_standstill(machine);
        continue_if(self.send_pending(links))?;
        if links.requests.take_line_break() {
            self.machine_sync.line_break = LineBreak::Pending;
        }
        if self.machine_sync.line_break != LineBreak::None {
            self.hold_after_break(links);
            continue_if(self.send_pending(links))?;
        }
        continue_if(self.answer_status(links))?;
        continue_if(!(machine.has_underrun || machine.is_critical) || self.report_fault(links))
    }

    /// Executes lines while entries wait for the machine, else one stage of one line.
    fn execute_lines(&mut self, links: &mut Links<'_, '_>) -> Progress {
        for _ in 0..MAX_LINES {
            let is_busy = !links.entries.is_empty();
            let progress = self.advance(links);
            if !self.reports.flush(links.sent) {
                return Progress::Waiting;
            }
            // With entries waiting, the machine need not be attended to before each line.
            let continues =
                is_busy && self.stage == LineStage::Reading && progress == Progress::Again;
            // An arc in whole steps is gone through before it begins: one in a run.
            #[cfg(arc_machine)]
            let continues = continues && self.settings().arc_rule == 0;
            if !continues || links.requests.reset_count() != self.machine_sync.reset_count {
                return progress;
            }
        }
        Progress::Again
    }

    /// Continues the present stage.
    fn advance(&mut self, links: &mut Links<'_, '_>) -> Progress {
        let machine = links.machine;
        // While the machine is held, or ends a jog, no line is begun; the bytes stay where the sender
        // counts them.
        let is_cancelled = self.machine_sync.is_cancelled(machine);
        let is_held = machine.state.is_suspended() || is_cancelled;
        let is_reprap = self.host.dialect.is_reprap();
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
            LineStage::Faulted if self.is_stopped_host(machine) => self.refuse(LineError::Locked),
            LineStage::Asleep if is_reprap => self.read_line_asleep(links),
            LineStage::ListingFirmware(line) if is_reprap => self.list_firmware(line),
            LineStage::ListingHostSettings(line) if is_reprap => self.list_host_settings(line),
            LineStage::Starting { .. }
            | LineStage::Faulted
            | LineStage::Asleep
            | LineStage::ListingFirmware(_)
            | LineStage::ListingHostSettings(_) => Progress::Waiting,
            #[cfg(arc_machine)]
            LineStage::Reading if self.stored_program.is_running() => {
                self.execute_stored_line(links)
            }
            LineStage::Reading => self.read_line(links),
            LineStage::ReadingManual => self.read_manual_line(links),
            LineStage::Sending(first) => self.send_commands(first, links),
            LineStage::Compensating(first) => self.send_compensated(first, links),
            LineStage::ListingDefaults(line) => self.list_defaults(line),
            LineStage::Welcoming => self.welcome(machine),
            LineStage::StartingUp(number) => self.start_up(number, links),
            LineStage::AwaitingStandstill => self.dispatch_at_standstill(links),
            LineStage::Completing(AfterCommands::ToolPause) => self.continue_tool_change(links),
            LineStage::Completing(after_commands) => self.complete(machine, after_commands),
            LineStage::Storing(then) => self.continue_stored(then, links),
            LineStage::Listing(list, line) => self.list(list, line, links.received.capacity()),
            LineStage::Faulting => self.send_fault(links),
            LineStage::Resetting => {
                links.requests.reset();
                self.machine_sync.has_release_request = true;
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
