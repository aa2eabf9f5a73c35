//! The conversation with the sender: the body of the `interpret` and `report` tasks.
//!
//! Owns the line in the making, the interpreter and what has been asked of the machine. Each line
//! gets exactly one answer, in order; nothing here ever waits: what a line needs (room, standstill,
//! the end of its commands, cycle start) is kept as [`Stage`] and looked at again in the next call.
//! Read with Grbl 1.1 `protocol.c`.

use heapless::spsc::{Consumer, Producer};

use super::{
    dollar::{Condition, Dollar},
    line::Line,
    realtime::Requests,
    report::{self, Cadence, Feedback, Status},
    text::{ReportUnit, Text},
};
use crate::{
    gcode::LineError,
    interpreter::{Interpreter, Message, Outcome},
    machine::{Alarm, Snapshot, State},
    planner::{BLOCKS, Command, Entry, Router, Work},
    settings::{self, Settings},
};

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
enum Stage {
    /// Power-up, or a reset that the machine has not yet acted on.
    Starting,
    /// Taking bytes.
    Reading,
    /// A line is complete and has had no effect yet.
    Judging,
    /// The commands of a line go to the machine; this many have gone.
    Entering(usize),
    /// Everything has gone to the machine; the answer comes when it has been done.
    Completing(Option<Feedback>),
    /// A list is being sent; this line of it is next.
    Listing(List, usize),
}

/// An answer of many lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum List {
    Settings,
    Parameters,
}

/// The conversation with one sender.
#[derive(Debug)]
pub struct Session {
    settings: Settings,
    interpreter: Interpreter,
    router: Router,
    line: Line,
    stage: Stage,
    /// What the line in [`Stage::Entering`] asks for, and whether its answer waits for the end.
    outcome: Outcome,
    answers_when_done: bool,
    /// A message that still needs room.
    message: Text,
    cadence: Cadence,
    /// `?` that still needs room.
    is_report_due: bool,
    /// Entries sent to the machine so far, wrapping.
    entered: u32,
    /// The reset that this session has acted on.
    epoch: u32,
    /// Whether the interpreter knows where the machine is.
    is_position_known: bool,
}

impl Session {
    /// A session with a machine that has just been switched on.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            interpreter: Interpreter::new(),
            router: Router::new(&settings),
            line: Line::new(),
            stage: Stage::Starting,
            outcome: Outcome {
                commands: heapless::Vec::new(),
                message: None,
            },
            answers_when_done: false,
            message: Text::new(),
            cadence: Cadence::default(),
            is_report_due: false,
            entered: 0,
            epoch: 0,
            is_position_known: false,
        }
    }

    /// The settings in effect.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// One bounded piece of work: at most one line.
    ///
    /// The first call welcomes the sender. Room in `sent` must be possible for one message of
    /// [`super::MESSAGE_BYTES`].
    pub fn run(
        &mut self,
        machine: &Snapshot,
        requests: &Requests,
        received: &mut Consumer<'_, u8>,
        sent: &mut Producer<'_, u8>,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        let epoch = requests.epoch();
        if epoch != self.epoch {
            self.begin_reset(epoch);
        }
        if self.stage == Stage::Starting && !self.start(machine, received) {
            return Progress::Waiting;
        }
        self.find_position(machine);
        if !self.flush(sent) {
            return Progress::Waiting;
        }
        let received_free = received.capacity() - received.len();
        if self.is_report_due && !self.send_status(machine, received_free, sent) {
            return Progress::Waiting;
        }
        let progress = self.advance(machine, received, entries);
        if self.flush(sent) {
            progress
        } else {
            Progress::Waiting
        }
    }

    /// Answers a `?`. Where it must wait, for room or for the welcome, [`Session::run`] does it.
    pub fn report(
        &mut self,
        machine: &Snapshot,
        requests: &Requests,
        received_free: usize,
        sent: &mut Producer<'_, u8>,
    ) -> Progress {
        self.is_report_due |= requests.take_status();
        let is_starting = self.stage == Stage::Starting || requests.epoch() != self.epoch;
        let is_next = !is_starting && self.message.is_empty();
        if self.is_report_due && is_next && self.send_status(machine, received_free, sent) {
            Progress::Again
        } else {
            Progress::Waiting
        }
    }

    /// Drops everything that the reset makes void.
    fn begin_reset(&mut self, epoch: u32) {
        self.epoch = epoch;
        self.stage = Stage::Starting;
        self.message.clear();
        self.is_position_known = false;
    }

    /// Welcomes the sender as soon as the machine has acted on the reset; false before.
    ///
    /// What is received between the reset and the welcome is lost, as in Grbl.
    fn start(&mut self, machine: &Snapshot, received: &mut Consumer<'_, u8>) -> bool {
        if self.epoch != 0 {
            for _ in 0..received.capacity() {
                if received.dequeue().is_none() {
                    break;
                }
            }
        }
        if machine.epoch != self.epoch {
            return false;
        }
        self.line.clear();
        self.interpreter.reset();
        self.cadence = Cadence::default();
        if machine.reset_in_motion {
            report::alarm(&mut self.message, Alarm::ResetInMotion);
        }
        report::welcome(&mut self.message);
        if machine.state == State::Alarm {
            report::feedback(&mut self.message, Feedback::Locked);
        }
        self.stage = Stage::Reading;
        true
    }

    /// Takes the position from the machine once it is at rest.
    fn find_position(&mut self, machine: &Snapshot) {
        if !self.is_position_known && self.is_done(machine) {
            let position = self.router.set_steps(machine.steps);
            self.interpreter.set_position(position);
            self.is_position_known = true;
        }
    }

    /// Sends the message that is waiting; false when there is no room.
    fn flush(&mut self, sent: &mut Producer<'_, u8>) -> bool {
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
        sent: &mut Producer<'_, u8>,
    ) -> bool {
        // What the report shows is counted only once it has been sent.
        let mut cadence = self.cadence;
        let mut text = Text::new();
        let status = Status {
            machine,
            settings: &self.settings,
            modal: self.interpreter.modal(),
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
        received: &mut Consumer<'_, u8>,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        match self.stage {
            Stage::Starting => Progress::Waiting,
            // In a feed hold no line is begun; the bytes stay where the sender counts them.
            Stage::Reading | Stage::Judging if is_held(machine) => Progress::Waiting,
            Stage::Reading => {
                if !self.read(received) {
                    return Progress::Waiting;
                }
                self.stage = Stage::Judging;
                let received_bytes = received.capacity();
                self.judge(machine, received_bytes, entries)
            }
            Stage::Judging => self.judge(machine, received.capacity(), entries),
            Stage::Entering(first) => self.enter(machine, first, entries),
            Stage::Completing(feedback) => self.complete(machine, feedback),
            Stage::Listing(list, line) => self.list(list, line),
        }
    }

    /// Takes bytes up to the end of the line; false when it has not come yet.
    fn read(&mut self, received: &mut Consumer<'_, u8>) -> bool {
        for _ in 0..received.capacity() {
            match received.dequeue() {
                Some(byte) if self.line.take(byte) => return true,
                Some(_) => {}
                None => return false,
            }
        }
        false
    }

    /// Judges the line: an error, a list, or something to do. A line that must wait is judged
    /// again, so that what it is judged by is never out of date.
    fn judge(
        &mut self,
        machine: &Snapshot,
        received_bytes: usize,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        match self.line.text() {
            Err(_) => self.refuse(LineError::LineOverflow),
            Ok([]) => self.accept(),
            Ok([b'$', statement @ ..]) => {
                match Dollar::read(statement, self.condition(machine), &self.settings) {
                    Err(error) => self.refuse(error),
                    Ok(Dollar::Assign(assignment)) => {
                        let mut changed = self.settings;
                        match settings::assign(&mut changed, assignment) {
                            Err(error) => self.refuse(error.into()),
                            Ok(()) => self.configure(machine, changed, entries),
                        }
                    }
                    Ok(Dollar::Unlock) => self.unlock(machine, entries),
                    Ok(Dollar::Settings) => self.list(List::Settings, 0),
                    Ok(Dollar::Parameters) => self.list(List::Parameters, 0),
                    Ok(Dollar::Help) => self.tell(report::help),
                    Ok(Dollar::StartupLines) => self.tell(report::startup_lines),
                    Ok(Dollar::Modes) => {
                        let modal = *self.interpreter.modal();
                        let unit = ReportUnit::of(&self.settings);
                        self.tell(|text| report::modes(text, &modal, unit))
                    }
                    Ok(Dollar::BuildInfo) => {
                        self.tell(|text| report::build_info(text, BLOCKS, received_bytes))
                    }
                }
            }
            Ok(_) if machine.state == State::Alarm => self.refuse(LineError::Locked),
            Ok(_) => self.interpret(machine, entries),
        }
    }

    /// What `$` statements may ask of the machine now.
    fn condition(&self, machine: &Snapshot) -> Condition {
        match machine.state {
            State::Alarm => Condition::Alarm,
            State::Idle if machine.finished == self.entered => Condition::Idle,
            State::Idle | State::Run | State::HoldSlowing | State::HoldComplete => Condition::Busy,
        }
    }

    /// A line of G-code.
    fn interpret(&mut self, machine: &Snapshot, entries: &mut Producer<'_, Entry>) -> Progress {
        if !self.is_position_known {
            return Progress::Waiting;
        }
        let Ok(line) = self.line.text() else {
            return self.refuse(LineError::LineOverflow);
        };
        let checked = match self.interpreter.check(line, &self.settings) {
            Ok(checked) => checked,
            Err(error) => return self.refuse(error),
        };
        if checked.waits_for_rest() && !self.is_done(machine) {
            return Progress::Waiting;
        }
        let offset = self.interpreter.work_offset();
        let coordinates = self.interpreter.modal().coordinates;
        self.outcome = self.interpreter.commit(&checked);
        self.answers_when_done = checked.answers_when_done();
        if offset != self.interpreter.work_offset()
            || coordinates != self.interpreter.modal().coordinates
            || self.outcome.message == Some(Message::ProgramEnd)
        {
            self.cadence.offset_changed();
        }
        self.stage = Stage::Entering(0);
        self.enter(machine, 0, entries)
    }

    /// Sends the commands of a line from the given one on to the machine.
    fn enter(
        &mut self,
        machine: &Snapshot,
        first: usize,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        let mut next = first;
        // wcet-bound: 8
        while let Some(command) = self.outcome.commands.get(next) {
            if !entries.ready() {
                self.stage = Stage::Entering(next);
                return Progress::Waiting;
            }
            if matches!(command, Command::Spindle { .. } | Command::Coolant(_)) {
                self.cadence.overrides_changed();
            }
            if let Some(work) = self.router.work(command) {
                self.send_entry(work, entries);
            }
            next += 1;
        }
        if self.answers_when_done {
            let feedback = self.outcome.message.map(|message| match message {
                Message::ProgramEnd => Feedback::ProgramEnd,
            });
            self.stage = Stage::Completing(feedback);
            self.complete(machine, feedback)
        } else {
            self.accept()
        }
    }

    /// Answers a line that everything has been done for, with a message before it.
    fn complete(&mut self, machine: &Snapshot, feedback: Option<Feedback>) -> Progress {
        if !self.is_done(machine) || is_held(machine) {
            return Progress::Waiting;
        }
        if let Some(feedback) = feedback {
            report::feedback(&mut self.message, feedback);
        }
        self.accept()
    }

    /// New settings: the machine takes them at standstill.
    fn configure(
        &mut self,
        machine: &Snapshot,
        changed: Settings,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        if !self.is_done(machine) || !entries.ready() {
            return Progress::Waiting;
        }
        // The steps stay where they are; with another resolution they are another position.
        let position = self.router.configure(&changed, machine.steps);
        if changed.steps_per_mm != self.settings.steps_per_mm {
            self.interpreter.set_position(position);
        }
        self.settings = changed;
        self.send_entry(Work::Configure(changed), entries);
        self.stage = Stage::Completing(None);
        Progress::Again
    }

    /// Takes the lock of an alarm off, once the machine has come to rest.
    fn unlock(&mut self, machine: &Snapshot, entries: &mut Producer<'_, Entry>) -> Progress {
        if machine.state != State::Alarm {
            return self.accept();
        }
        if !self.is_done(machine) || !entries.ready() {
            return Progress::Waiting;
        }
        self.send_entry(Work::Unlock, entries);
        self.stage = Stage::Completing(Some(Feedback::Unlocked));
        Progress::Again
    }

    /// Writes the next line of a list, and the answer after the last.
    fn list(&mut self, list: List, line: usize) -> Progress {
        let unit = ReportUnit::of(&self.settings);
        let offsets = self.interpreter.offsets();
        let has_line = match list {
            List::Settings => report::setting(&mut self.message, &self.settings, line),
            List::Parameters => report::parameters(&mut self.message, offsets, line, unit),
        };
        if has_line {
            self.stage = Stage::Listing(list, line + 1);
            Progress::Again
        } else {
            self.accept()
        }
    }

    /// Answers with a text and `ok`.
    fn tell(&mut self, write: impl FnOnce(&mut Text)) -> Progress {
        write(&mut self.message);
        self.accept()
    }

    fn accept(&mut self) -> Progress {
        report::ok(&mut self.message);
        self.begin_line()
    }

    fn refuse(&mut self, error: LineError) -> Progress {
        report::error(&mut self.message, error);
        self.begin_line()
    }

    fn begin_line(&mut self) -> Progress {
        self.line.clear();
        self.stage = Stage::Reading;
        Progress::Again
    }

    /// The caller has made sure of room.
    fn send_entry(&mut self, work: Work, entries: &mut Producer<'_, Entry>) {
        let epoch = self.epoch;
        if entries.enqueue(Entry { epoch, work }).is_ok() {
            self.entered = self.entered.wrapping_add(1);
        }
    }

    /// Whether everything sent to the machine has been done and it stands still.
    fn is_done(&self, machine: &Snapshot) -> bool {
        machine.is_at_rest && machine.finished == self.entered
    }
}

fn is_held(machine: &Snapshot) -> bool {
    matches!(machine.state, State::HoldSlowing | State::HoldComplete)
}

/// Sends a message completely or, when there is no room for it, not at all.
fn send(text: &Text, sent: &mut Producer<'_, u8>) -> bool {
    let bytes = text.as_bytes();
    if sent.capacity() - sent.len() < bytes.len() {
        return false;
    }
    // wcet-bound: 256
    for &byte in bytes {
        let _ = sent.enqueue(byte);
    }
    true
}
