//! The conversation with the sender: the body of the `interpret` and `report` tasks.
//!
//! Owns the line in the making, the interpreter, what is stored, and what has been asked of the
//! machine. Each line gets exactly one answer, in order; nothing here ever waits: what a line needs
//! (room, standstill, the end of its commands, cycle start, the flash) is kept as [`Stage`] and
//! looked at again in the next call. Read with Grbl 1.1 `protocol.c`.

mod blending;
mod commands;
mod dispatch;
mod notifications;
mod persistence;
mod program;
mod reset;

use heapless::spsc::Producer;

use super::{
    bytes::{ByteReader, ByteWriter},
    line::Line,
    report::{self, Cadence, Feedback, Status},
    text::Text,
};
use crate::{
    axis::Axes,
    gcode::interpreter::{Checked, Interpreter, Outcome, Refusal},
    machine::Snapshot,
    model::{Awaited, Probed, Requests},
    path::{Blender, Checkpoint, Entry, Router, Work},
    settings::{Change, Settings, StoreError, Stored},
    units::Nm,
};
use dispatch::List;
use notifications::Seen;
use persistence::Then;

/// Lines that are executed in one run, at most.
const LINES: usize = 8;

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
    Starting,
    /// The welcome is next.
    Welcoming,
    /// The first startup line from this one on that is not empty is next.
    StartingUp(usize),
    /// Taking bytes.
    Reading,
    /// A line is complete but needs standstill; it has had no effect, and is judged again then.
    Resting,
    /// The commands of a line go to the machine; this many have gone.
    Entering(usize),
    /// Everything has gone to the machine; this is to follow when it has been done.
    Completing(After),
    /// The shell stores a change; this is to follow.
    Storing(Then),
    /// A list is being sent; this line of it is next.
    Listing(List, usize),
    /// The line has been answered, and ends with a reset.
    Resetting,
    /// The line leaves the travel: the machine is to be told.
    Faulting,
    /// Only a reset ends the line, and answers it.
    Faulted,
    /// Asleep: only a reset helps.
    Asleep,
}

/// What follows when the machine has done all that was asked of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum After {
    /// The answer.
    Answer,
    /// A message and the answer.
    Tell(Feedback),
    /// The position, and the answer.
    Probe,
    /// That a probing move without a step has missed, and the answer.
    Miss,
    /// What homing has come to, and the startup lines if it was that of all axes.
    Home {
        /// All axes.
        is_all: bool,
    },
}

/// Where the line comes from that is being executed.
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

/// The conversation with one sender.
///
/// In this order in memory, so that what each line needs is within the reach of one instruction.
#[derive(Debug)]
#[repr(C)]
pub struct Session {
    stage: LineStage,
    source: Source,
    /// What is to be stored, and what has come of it.
    change: Option<Change>,
    store_result: Option<Result<(), StoreError>>,
    /// Entries sent to the machine so far, wrapping.
    entered: u32,
    /// The reset that this session has acted on.
    reset_count: u32,
    /// Motions that the machine has ended before their target, as far as the position is known.
    cancelled_motions: u32,
    /// What has been seen of the machine.
    seen: Seen,
    cadence: Cadence,
    /// `?` that still needs room.
    is_report_due: bool,
    /// The entries that have not been done are jogs.
    is_jogging: bool,
    /// A reset has been asked for that `prepare` does not know of.
    has_request: bool,
    /// A reset has come before what was stored took effect.
    is_stored_due: bool,
    /// Whether the interpreter knows where the machine is.
    is_position_known: bool,
    /// The sender has been told that the machine needs a reset.
    is_fault_told: bool,
    /// Nothing was stored: the sender is told so before the welcome.
    is_first_boot: bool,
    /// A line that a reset has interrupted gets its `ok` before the welcome.
    is_answer_owed: bool,
    /// The way that the machine needs to stop after the last move that it knows of, mm.
    stop_mm: f32,
    /// What follows the line in [`Stage::Entering`].
    after: Option<After>,
    router: Router,
    interpreter: Interpreter,
    /// The line as it was checked last.
    checked: Checked,
    line: Line,
    /// A message that still needs room.
    message: Text,
    /// What the line in [`Stage::Entering`] asks for.
    outcome: Outcome,
    /// Moves on their way to the router.
    path: Blender,
    /// What is stored, or is to be.
    stored: Stored,
    /// What was stored before the change that is being stored.
    before: Stored,
    /// The last probing move, and where it began.
    probed: Probed,
    probed_from: (Axes<Nm>, Checkpoint),
}

impl Session {
    /// A session with a machine that has just been switched on, and what it has stored. When that
    /// are defaults because nothing could be read, the sender is told so (`is_first_boot`).
    #[must_use]
    pub fn new(stored: &Stored, is_first_boot: bool) -> Self {
        let mut interpreter = Interpreter::new();
        interpreter.set_origins(&stored.origins);
        Self {
            router: Router::new(&stored.settings),
            stored: stored.clone(),
            before: Stored::default(),
            change: None,
            store_result: None,
            interpreter,
            path: Blender::new(),
            stop_mm: 0.0,
            line: Line::new(),
            stage: LineStage::Starting,
            source: Source::Line,
            checked: Checked::default(),
            outcome: Outcome::default(),
            after: None,
            message: Text::new(),
            cadence: Cadence::default(),
            is_report_due: false,
            entered: 0,
            is_jogging: false,
            reset_count: 0,
            cancelled_motions: 0,
            has_request: false,
            is_stored_due: false,
            is_position_known: false,
            is_fault_told: false,
            is_first_boot,
            is_answer_owed: false,
            seen: Seen::default(),
            probed: Probed::default(),
            probed_from: (Axes::default(), Checkpoint::default()),
        }
    }

    /// Entries given to the machine so far, wrapping.
    #[must_use]
    pub fn entered(&self) -> u32 {
        self.entered
    }

    /// The modal state, the offsets and the programmed position.
    #[must_use]
    pub fn interpreter(&self) -> &Interpreter {
        &self.interpreter
    }

    /// The settings in effect.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.stored.settings
    }

    /// What is to be stored now: the shell takes it from [`Self::stored`] and tells what has come
    /// of it ([`Self::has_stored`]). Only ever asked for at rest; the line's answer waits for it.
    #[must_use]
    pub fn wants_store(&self) -> Option<Change> {
        self.change
    }

    /// What is stored, with the change that is wanted.
    #[must_use]
    pub fn stored(&self) -> &Stored {
        &self.stored
    }

    /// The change has been stored, or has not. After an error everything is as it was before.
    pub fn has_stored(&mut self, result: Result<(), StoreError>) {
        if self.change.take().is_some() {
            self.store_result = Some(result);
        }
    }

    /// Whether a reset has been asked for since the last call: `prepare` has to run.
    pub fn takes_release(&mut self) -> bool {
        core::mem::take(&mut self.has_request)
    }

    /// One bounded piece of work: a line, or a few while the machine has something to take.
    ///
    /// The first call welcomes the sender. Room in `sent` must be possible for one message of
    /// [`super::MESSAGE_BYTES`].
    pub fn run(
        &mut self,
        machine: &Snapshot,
        requests: &Requests,
        received: &mut ByteReader<'_>,
        sent: &mut ByteWriter<'_>,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        requests.coalesce();
        requests.wake_on(Awaited::ALL);
        let progress = self.go_on(machine, requests, received, sent, entries);
        requests.wake_on(match progress {
            Progress::Again => Awaited::NONE,
            Progress::Waiting => self.awaited(),
        });
        progress
    }

    /// What brings the session further, besides a change of the machine's state.
    fn awaited(&self) -> Awaited {
        let work = if self.stage == LineStage::Reading && self.path.has_pending() {
            Awaited::LINE.and(Awaited::ENTRIES).and(Awaited::SEGMENTS)
        } else {
            match self.stage {
                LineStage::Reading => Awaited::LINE,
                LineStage::Entering(_) => Awaited::ENTRIES_BATCHED,
                _ => Awaited::ENTRIES,
            }
        };
        if self.is_report_due || !self.message.is_empty() {
            work.and(Awaited::ROOM)
        } else {
            work
        }
    }

    fn go_on(
        &mut self,
        machine: &Snapshot,
        requests: &Requests,
        received: &mut ByteReader<'_>,
        sent: &mut ByteWriter<'_>,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        if self.change.is_some() {
            return Progress::Waiting;
        }
        self.take_store_result();
        let epoch = requests.reset_count();
        if epoch != self.reset_count {
            self.begin_reset(epoch);
        }
        self.look_at(machine);
        self.drop_void(machine);
        if !self.flush(sent) || !self.tell_notices(machine, sent) {
            return Progress::Waiting;
        }
        if self.stage == LineStage::Starting && !self.start(machine, received) {
            return Progress::Waiting;
        }
        self.take_stored(machine, entries);
        self.find_position(machine);
        let received_free = received.capacity() - received.len();
        let has_told = self.flush(sent) && self.tell_notices(machine, sent);
        let may_report = has_told && self.is_welcome_told();
        if may_report && self.is_report_due && !self.send_status(machine, received_free, sent) {
            return Progress::Waiting;
        }
        if !self.message.is_empty() {
            return Progress::Waiting;
        }
        if machine.has_underrun || machine.is_critical {
            self.tell_fault(machine);
            self.flush(sent);
            return Progress::Waiting;
        }
        for _ in 0..LINES {
            let is_busy = !entries.is_empty();
            let progress = self.advance(machine, requests, received, entries);
            if !self.flush(sent) {
                return Progress::Waiting;
            }
            // While the machine has something to take, it need not look at what there is for each line.
            let goes_on =
                is_busy && self.stage == LineStage::Reading && progress == Progress::Again;
            if !goes_on || requests.reset_count() != self.reset_count {
                return progress;
            }
        }
        Progress::Again
    }

    /// Answers a `?`. Where it must wait, for room or for the welcome, [`Session::run`] does it.
    pub fn report(
        &mut self,
        machine: &Snapshot,
        requests: &Requests,
        received_free: usize,
        sent: &mut ByteWriter<'_>,
    ) -> Progress {
        requests.wake_on(Awaited::ALL);
        self.is_report_due |= requests.take_status();
        self.look_at(machine);
        let is_next = self.is_welcome_told()
            && requests.reset_count() == self.reset_count
            && self.message.is_empty()
            && !self.has_notices(machine);
        let has_told =
            self.is_report_due && is_next && self.send_status(machine, received_free, sent);
        requests.wake_on(self.awaited());
        if has_told {
            Progress::Again
        } else {
            Progress::Waiting
        }
    }

    /// Whether the welcome has been written.
    fn is_welcome_told(&self) -> bool {
        !matches!(
            self.stage,
            LineStage::Starting | LineStage::Welcoming | LineStage::Listing(List::FirstSettings, _)
        )
    }

    /// Takes the position from the machine once it is at rest.
    fn find_position(&mut self, machine: &Snapshot) {
        if !self.is_done(machine) {
            return;
        }
        self.is_jogging = false;
        // A jog that was cancelled has not come to its end, and one that still waits for room has
        // none any more.
        if self.cancelled_motions != machine.cancelled_motions {
            self.cancelled_motions = machine.cancelled_motions;
            self.is_position_known = false;
            if self.source == Source::Jog {
                self.outcome.commands.clear();
            }
        }
        if !self.is_position_known {
            self.take_position(machine);
        }
    }

    /// The machine's position becomes the programmed one.
    fn take_position(&mut self, machine: &Snapshot) {
        let position = self.router.set_steps(machine.steps);
        self.interpreter.set_position(position);
        self.is_position_known = true;
    }

    /// Sends the message that is waiting; false when there is no room.
    fn flush(&mut self, sent: &mut ByteWriter<'_>) -> bool {
        let has_room = send(&self.message, sent);
        if has_room {
            self.message.clear();
        }
        has_room
    }

    /// Sends a status report; false when there is no room.
    fn send_status(
        &mut self,
        machine: &Snapshot,
        received_free: usize,
        sent: &mut ByteWriter<'_>,
    ) -> bool {
        // What the report shows is counted only once it has been sent.
        let mut cadence = self.cadence;
        let mut text = Text::new();
        let status = Status {
            machine,
            settings: &self.stored.settings,
            work_offset: self.interpreter.work_offset(),
            received_free,
            extra: cadence.next(machine.state),
        };
        report::status(&mut text, &status);
        let has_room = send(&text, sent);
        if has_room {
            self.cadence = cadence;
            self.is_report_due = false;
        }
        has_room
    }

    /// Goes on from the present stage.
    fn advance(
        &mut self,
        machine: &Snapshot,
        requests: &Requests,
        received: &mut ByteReader<'_>,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        // While the machine is held, or ends a jog, no line is begun; the bytes stay where the sender
        // counts them.
        let is_cut = machine.cancelled_motions != self.cancelled_motions;
        let is_held = machine.state.is_suspended() || is_cut;
        match self.stage {
            LineStage::Starting | LineStage::Faulted | LineStage::Asleep => Progress::Waiting,
            LineStage::Welcoming => self.welcome(machine),
            LineStage::Reading | LineStage::Resting | LineStage::StartingUp(_) if is_held => {
                Progress::Waiting
            }
            LineStage::Resting => {
                if self.comes_to_rest(machine, entries) {
                    self.judge(machine, received.capacity(), entries)
                } else {
                    Progress::Waiting
                }
            }
            LineStage::StartingUp(number) => self.start_up(machine, number, entries),
            LineStage::Reading => match self.carry_out_plain(machine, received) {
                Ok(()) => self.send_plain(machine, entries),
                Err(Refusal::NotPlain) if self.read(received) => {
                    self.judge(machine, received.capacity(), entries)
                }
                Err(Refusal::NotPlain | Refusal::Incomplete) => {
                    self.release_in_time(machine, entries);
                    Progress::Waiting
                }
            },
            LineStage::Entering(_) if is_cut => Progress::Waiting,
            LineStage::Entering(first) => self.enter(machine, first, entries),
            LineStage::Completing(after) => self.complete(machine, after),
            LineStage::Storing(then) => self.go_on_stored(machine, then, entries),
            LineStage::Listing(list, line) => self.list(list, line, received.capacity()),
            LineStage::Faulting => self.fault(entries),
            LineStage::Resetting => {
                requests.reset();
                self.has_request = true;
                Progress::Again
            }
        }
    }

    /// Takes bytes up to the end of the line; false when it has not come yet.
    fn read(&mut self, received: &mut ByteReader<'_>) -> bool {
        received.take_until(|bytes| self.line.take_from(bytes))
    }

    /// Whether everything sent to the machine has been done and it stands still.
    fn is_done(&self, machine: &Snapshot) -> bool {
        machine.is_at_rest && machine.finished == self.entered && !self.path.has_pending()
    }

    /// Sends work. The caller has made sure of room; after standstill the queue is empty.
    fn send_entry(&mut self, work: Work, entries: &mut Producer<'_, Entry>) {
        let epoch = self.entry().reset_count;
        if entries
            .enqueue(Entry {
                reset_count: epoch,
                work,
            })
            .is_ok()
        {
            self.entered = self.entered.wrapping_add(1);
        }
    }

    /// An entry still to be filled in.
    fn entry(&self) -> Entry {
        Entry {
            reset_count: self.reset_count.wrapping_add(self.cancelled_motions),
            work: Work::Pause,
        }
    }
}

/// Sends a message completely or, when there is no room for it, not at all.
fn send(text: &Text, sent: &mut ByteWriter<'_>) -> bool {
    sent.append(text.as_bytes())
}
