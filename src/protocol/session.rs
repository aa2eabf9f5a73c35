//! The conversation with the sender: the body of the `interpret` and `report` tasks.
//!
//! Owns the line in the making, the interpreter and what has been asked of the machine. Each line
//! gets exactly one answer, in order; nothing here ever waits: what a line needs (room, standstill,
//! the end of its commands, cycle start) is kept as [`Stage`] and looked at again in the next call.
//! Read with Grbl 1.1 `protocol.c`.

mod judge;

use heapless::spsc::{Consumer, Producer};

use super::{
    line::Line,
    realtime::Requests,
    report::{self, Cadence, Feedback, Status},
    text::Text,
};
use crate::{
    interpreter::{Checked, Interpreter, Outcome},
    machine::{Alarm, Snapshot, State},
    planner::{Entry, Router},
    settings::Settings,
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
    /// A line is complete but needs standstill; it has had no effect, and is judged again then.
    Resting,
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
    /// The line as it was checked last.
    checked: Checked,
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
    /// Motions that the machine has ended before their target, as far as the position is known.
    cuts: u32,
    /// Whether the interpreter knows where the machine is.
    is_position_known: bool,
    /// The sender has been told that the machine needs a reset.
    is_fault_told: bool,
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
            checked: Checked::default(),
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
            cuts: 0,
            is_position_known: false,
            is_fault_told: false,
        }
    }

    /// Entries given to the machine so far, wrapping.
    #[must_use]
    pub fn entered(&self) -> u32 {
        self.entered
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
        let progress = if machine.is_starved {
            self.tell_fault();
            Progress::Waiting
        } else {
            self.advance(machine, received, entries)
        };
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
        self.is_fault_told = false;
    }

    /// Welcomes the sender as soon as the machine has acted on the reset; false before.
    ///
    /// What is received between the reset and the welcome is lost, as in Grbl.
    fn start(&mut self, machine: &Snapshot, received: &mut Consumer<'_, u8>) -> bool {
        if self.epoch != 0 {
            // As many as the queue holds, at most.
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

    /// The machine stopped dead in motion. No line is answered any more, as in Grbl; only a reset
    /// ends this. Grbl's alarm 3 says what it means for the sender: the position may be lost.
    fn tell_fault(&mut self) {
        if !self.is_fault_told {
            report::alarm(&mut self.message, Alarm::ResetInMotion);
            report::feedback(&mut self.message, Feedback::ResetNeeded);
            self.is_fault_told = true;
        }
    }

    /// Takes the position from the machine once it is at rest.
    fn find_position(&mut self, machine: &Snapshot) {
        if !self.is_done(machine) {
            return;
        }
        // A jog that was cancelled has not come to its end.
        if self.cuts != machine.cuts {
            self.cuts = machine.cuts;
            self.is_position_known = false;
        }
        if !self.is_position_known {
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
            Stage::Reading | Stage::Resting if is_held(machine) => Progress::Waiting,
            Stage::Resting if !self.is_done(machine) => Progress::Waiting,
            Stage::Resting => self.judge(machine, received.capacity(), entries),
            Stage::Reading => {
                if self.read(received) {
                    self.judge(machine, received.capacity(), entries)
                } else {
                    Progress::Waiting
                }
            }
            Stage::Entering(first) => self.enter(machine, first, entries),
            Stage::Completing(feedback) => self.complete(machine, feedback),
            Stage::Listing(list, line) => self.list(list, line),
        }
    }

    /// Takes bytes up to the end of the line; false when it has not come yet.
    fn read(&mut self, received: &mut Consumer<'_, u8>) -> bool {
        // As many as the queue holds, at most.
        for _ in 0..received.capacity() {
            match received.dequeue() {
                Some(byte) if self.line.take(byte) => return true,
                Some(_) => {}
                None => return false,
            }
        }
        false
    }

    /// Whether everything sent to the machine has been done and it stands still.
    fn is_done(&self, machine: &Snapshot) -> bool {
        machine.is_at_rest && machine.finished == self.entered
    }
}

fn is_held(machine: &Snapshot) -> bool {
    machine.state.is_suspended()
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
