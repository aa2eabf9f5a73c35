//! Lines of G-code: of the sender, of a jog, of the startup lines.
//!
//! Checked completely, then carried out: nothing of a line goes to the machine before its whole way
//! is known to be inside the travel. Read with Grbl 1.1 `gcode.c`, `motion_control.c`, `jog.c`.

use heapless::spsc::Producer;

use super::{After, LineStage, Progress, Session, Source, Then};
use crate::{
    axis::Axes,
    gcode::{
        LineError, ProbeMode,
        interpreter::{Checked, Message, Refusal},
    },
    machine::Snapshot,
    model::{Alarm, Command, FeedRate, Laser, Levels, PathControl, Spindle, State, Target},
    path::{Entry, Router, Work, is_outside, leaves_travel},
    protocol::{
        ByteReader,
        report::{self, Feedback},
    },
    settings::Change,
    units::Nm,
};

/// As many bytes of a line may wait in their queue for its end. Fewer than release the session
/// without one.
const FEW_BYTES: usize = 128;

impl Session {
    /// Carries out the next line where it waits, if it is a plain one. Nothing has been taken, and
    /// nothing has changed, for any other, where more is to be asked than its words, and while it is
    /// not all there.
    pub(super) fn carry_out_plain(
        &mut self,
        machine: &Snapshot,
        received: &mut ByteReader<'_>,
    ) -> Result<(), Refusal> {
        let may_be_locked = matches!(machine.state, State::Alarm | State::Jog) || self.is_jogging;
        if !self.is_position_known || may_be_locked || !self.line.is_empty() {
            return Err(Refusal::NotPlain);
        }
        let waiting = received.len();
        if waiting <= FEW_BYTES && !received.may_have_line() {
            return Err(Refusal::Incomplete);
        }
        let (settings, interpreter) = (&self.stored.settings, &mut self.interpreter);
        let (checked, outcome) = (&mut self.checked, &mut self.outcome);
        let mut result = Err(Refusal::Incomplete);
        received.take_until(|bytes| {
            match interpreter.carry_out_plain(bytes.clone(), settings, checked, outcome) {
                Ok(rest) => {
                    *bytes = rest;
                    result = Ok(());
                }
                // The ring begins anew within the line, or so much of it waits that it must be taken.
                Err(Refusal::Incomplete) if bytes.len() < waiting || waiting > FEW_BYTES => {
                    result = Err(Refusal::NotPlain);
                }
                Err(refusal) => result = Err(refusal),
            }
            result.is_ok()
        });
        result
    }

    /// Sends the one move that a plain line asks for, unless it leaves the travel.
    pub(super) fn send_plain(
        &mut self,
        machine: &Snapshot,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        let settings = &self.stored.settings;
        if settings.soft_limits && is_outside(settings, &self.interpreter.position()) {
            self.stage = LineStage::Faulting;
            return self.fault(entries);
        }
        if machine.state == State::Check {
            self.outcome.commands.clear();
        }
        self.after = None;
        self.stage = LineStage::Entering(0);
        self.enter(machine, 0, entries)
    }

    /// The line that [`Session::source`] names: checked, and then carried out or left for later.
    pub(super) fn interpret(
        &mut self,
        machine: &Snapshot,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        if !self.is_position_known {
            self.checked = Checked::default();
            return self.rest();
        }
        let text = self.line.text().unwrap_or_default();
        let from = self.interpreter.position();
        let (checked, outcome) = (&mut self.checked, &mut self.outcome);
        let bytes = text.iter().copied().chain([b'\n']);
        if self.source == Source::Line
            && self
                .interpreter
                .carry_out_plain(bytes, &self.stored.settings, checked, outcome)
                .is_ok()
        {
            return self.send(machine, from, entries);
        }
        let line = match self.source {
            Source::Line => text,
            Source::Jog => text.get(3..).unwrap_or_default(),
            Source::NewStartup { start, .. } => text.get(start..).unwrap_or_default(),
            Source::Startup { number, .. } => match self.stored.startup.get(number) {
                Some(line) => line.as_slice(),
                None => &[],
            },
        };
        let (settings, checked) = (&self.stored.settings, &mut self.checked);
        let result = if self.source == Source::Jog {
            self.interpreter.check_jog_into(line, settings, checked)
        } else {
            self.interpreter.check_into(line, settings, checked)
        };
        if let Err(error) = result {
            return self.refuse(error);
        }
        if self.source == Source::Jog
            && settings.soft_limits
            && is_outside(settings, &self.checked.target().position)
        {
            return self.refuse(LineError::JogBeyondTravel);
        }
        if self.checked.waits_for_rest() && !self.is_done(machine) {
            return self.rest();
        }
        if let Source::NewStartup {
            number,
            start,
            is_stored: false,
        } = self.source
        {
            return self.store_startup(machine, number, start);
        }
        match self.interpreter.origins_after(&self.checked) {
            Some(origins) => self.store(machine, Change::Origins, Then::Commit, |stored| {
                stored.origins = origins;
            }),
            None => self.commit(machine, entries),
        }
    }

    /// Carries out the line that has been checked.
    pub(super) fn commit(
        &mut self,
        machine: &Snapshot,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        let from = self.interpreter.position();
        self.interpreter
            .commit_into(&self.checked, &mut self.outcome);
        self.send(machine, from, entries)
    }

    /// Sends what the line asks for that began at a position, unless it leaves the travel.
    fn send(
        &mut self,
        machine: &Snapshot,
        from: Axes<Nm>,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        if self.leaves_travel(machine, from) {
            self.stage = LineStage::Faulting;
            return self.fault(entries);
        }
        let is_checking = machine.state == State::Check;
        let ends_program = self.outcome.message == Some(Message::ProgramEnd);
        if self.outcome.shows_offset && !(is_checking && ends_program) {
            self.cadence.offset_changed();
        }
        if is_checking {
            self.outcome.commands.clear();
        }
        self.after = if ends_program {
            Some(After::Tell(Feedback::ProgramEnd))
        } else if is_checking {
            None
        } else if self.checked.probe().is_some() {
            self.seen.is_probed = false;
            self.probed_from = (from, self.router.checkpoint());
            Some(After::Probe)
        } else {
            // What is switched at standstill has been switched when the answer comes.
            let switches = !self.checked.moves() && !self.outcome.commands.is_empty();
            // A startup line is stored when its motion is over.
            let is_stored = matches!(self.source, Source::NewStartup { .. });
            (switches || is_stored || self.checked.answers_when_done()).then_some(After::Answer)
        };
        self.stage = LineStage::Entering(0);
        self.enter(machine, 0, entries)
    }

    /// Makes the machine stop and lock itself: the line's way leaves the travel.
    pub(super) fn fault(&mut self, entries: &mut Producer<'_, Entry>) -> Progress {
        if entries.ready() {
            self.send_entry(Work::Fault(Alarm::SoftLimit), entries);
            self.stage = LineStage::Faulted;
        }
        Progress::Waiting
    }

    /// Whether some move of the line leaves the travel of the machine, where that is an error.
    fn leaves_travel(&self, machine: &Snapshot, from: Axes<Nm>) -> bool {
        if !self.stored.settings.soft_limits {
            return false;
        }
        let is_checking = machine.state == State::Check;
        let mut from = from;
        self.outcome.commands.iter().any(|command| {
            // Check mode ends a probing move before it has begun.
            let is_skipped = is_checking && matches!(command, Command::Probe { .. });
            let leaves = !is_skipped && leaves_travel(&self.stored.settings, &from, command);
            if let Command::Line { target, .. } | Command::Arc { target, .. } = command {
                from = target.position;
            }
            leaves
        })
    }

    /// Whether the line in execution ends the program.
    pub(super) fn ends_program(&self) -> bool {
        let is_code = match self.source {
            Source::Line => !self.line.text().unwrap_or_default().starts_with(b"$"),
            Source::Startup { .. } | Source::NewStartup { .. } => true,
            Source::Jog => false,
        };
        is_code && self.checked.ends_program()
    }

    /// Sends the commands of a line from the given one on to the machine.
    pub(super) fn enter(
        &mut self,
        machine: &Snapshot,
        first: usize,
        entries: &mut Producer<'_, Entry>,
    ) -> Progress {
        let control = self.path_control();
        let mut next = first;
        while let Some(command) = self.outcome.commands.get(next) {
            let is_led = is_led(control, command);
            if !is_led {
                self.router.flush(&mut self.path);
            }
            if !self.drain(entries) || !entries.ready() {
                self.stage = LineStage::Entering(next);
                return Progress::Waiting;
            }
            self.send_command(machine, next, is_led, entries);
            next += 1;
        }
        if self.after.is_some() {
            self.router.flush(&mut self.path);
        }
        if !self.drain(entries) {
            self.stage = LineStage::Entering(next);
            return Progress::Waiting;
        }
        if self.after == Some(After::Tell(Feedback::ProgramEnd)) {
            if !entries.ready() {
                self.stage = LineStage::Entering(next);
                return Progress::Waiting;
            }
            self.send_entry(Work::EndOverrides, entries);
        }
        match self.after {
            Some(after) => {
                self.stage = LineStage::Completing(after);
                self.complete(machine, after)
            }
            None => self.accept(),
        }
    }

    /// Sends a command of the line to the machine, or to the path before it. There is room.
    fn send_command(
        &mut self,
        machine: &Snapshot,
        number: usize,
        is_led: bool,
        entries: &mut Producer<'_, Entry>,
    ) {
        let Some(command) = self.outcome.commands.get(number) else {
            return;
        };
        let control = self.path_control();
        if is_led {
            return self.router.blend(&mut self.path, control, command);
        }
        self.router
            .set_exact_stop(control == PathControl::ExactStop);
        let epoch = self.entry().reset_count;
        if put(&mut self.router, command, epoch, entries) {
            self.is_jogging |= self.source == Source::Jog;
            self.entered = self.entered.wrapping_add(1);
        } else if let Some(work) = self.instead(machine, number) {
            self.is_jogging |= self.source == Source::Jog;
            self.send_entry(work, entries);
        }
    }

    /// What has to be done where a move makes no step.
    fn instead(&mut self, machine: &Snapshot, number: usize) -> Option<Work> {
        match self.outcome.commands.get(number)? {
            // The power of a laser that is on must be switched, as nothing carries it.
            Command::Line { feed_rate, .. } | Command::Arc { feed_rate, .. } => {
                let Laser::Constant(rpm) = self.router.laser() else {
                    return None;
                };
                let is_on = self.interpreter.modal().spindle == Spindle::Clockwise;
                if !is_on || matches!(feed_rate, FeedRate::Jog(_)) {
                    return None;
                }
                self.after = self.after.or(Some(After::Answer));
                Some(Work::Spindle(Spindle::Clockwise, rpm))
            }
            // The probe cannot change on no way at all.
            Command::Probe { probing, .. } => {
                let is_early = machine.inputs.has(Levels::PROBE) != probing.is_away;
                if is_early {
                    return Some(Work::Fault(Alarm::ProbeState));
                }
                self.after = Some(After::Miss);
                (!probing.may_miss).then_some(Work::Fault(Alarm::ProbeContact))
            }
            Command::Power(_)
            | Command::Dwell { .. }
            | Command::Spindle { .. }
            | Command::Coolant(_)
            | Command::Pause => None,
        }
    }

    /// Goes on when everything that was sent has been done.
    pub(super) fn complete(&mut self, machine: &Snapshot, after: After) -> Progress {
        if !self.is_done(machine) || machine.state.is_suspended() {
            return Progress::Waiting;
        }
        match after {
            After::Answer => {}
            After::Tell(feedback) => {
                if feedback == Feedback::ProgramEnd {
                    self.tell_deviation();
                }
                report::feedback(&mut self.message, feedback);
            }
            After::Probe => self.end_probing(machine),
            After::Miss => self.miss(machine),
            After::Home { is_all } => return self.end_homing(machine, is_all),
        }
        self.accept()
    }

    /// The position after a probing move: that of the machine; the target, if it was missed; or that
    /// before, if the move has not been begun.
    fn end_probing(&mut self, machine: &Snapshot) {
        if !self.seen.is_probed {
            let (position, mark) = &self.probed_from;
            self.interpreter.set_position(*position);
            self.router.restore(mark);
            return;
        }
        let position = self.router.set_steps(machine.steps);
        if self.probed.success {
            self.interpreter.set_position(position);
        }
    }

    /// Tells that a probing move without a step has missed. The position stays its target.
    fn miss(&mut self, machine: &Snapshot) {
        self.probed.success = false;
        if !self.is_alarmed_by_a_miss() {
            self.probed.steps = machine.steps;
        }
        report::probed(&mut self.message, &self.probed, &self.stored.settings);
    }

    /// Whether a miss of the probing move in execution is an alarm.
    pub(super) fn is_alarmed_by_a_miss(&self) -> bool {
        match self.checked.probe() {
            Some((_, ProbeMode::Contact | ProbeMode::Release)) => true,
            Some((_, ProbeMode::TryContact | ProbeMode::TryRelease)) | None => false,
        }
    }
}

/// Puts what a command asks for into the queue, which has room; false for a move without a step.
///
/// A line is made in its place in the queue: nearly all moves are lines.
fn put(
    router: &mut Router,
    command: &Command,
    epoch: u32,
    entries: &mut Producer<'_, Entry>,
) -> bool {
    if let Command::Line {
        target,
        feed_rate,
        line,
    } = command
    {
        return put_line(router, target, *feed_rate, *line, epoch, entries);
    }
    put_other(router, command, epoch, entries)
}

#[inline(never)]
fn put_line(
    router: &mut Router,
    target: &Target,
    feed_rate: FeedRate,
    line: u32,
    epoch: u32,
    entries: &mut Producer<'_, Entry>,
) -> bool {
    let Some(block) = router.line_block(target, feed_rate, line) else {
        return false;
    };
    let work = Work::Move(block);
    entries
        .enqueue(Entry {
            reset_count: epoch,
            work,
        })
        .is_ok()
}

#[inline(never)]
fn put_other(
    router: &mut Router,
    command: &Command,
    epoch: u32,
    entries: &mut Producer<'_, Entry>,
) -> bool {
    let mut work = Work::Pause;
    router.route(command, &mut work)
        && entries
            .enqueue(Entry {
                reset_count: epoch,
                work,
            })
            .is_ok()
}

/// Whether a command goes through the path, which `G64` may change.
fn is_led(control: PathControl, command: &Command) -> bool {
    match (control, command) {
        (
            PathControl::Continuous { .. },
            Command::Line { .. } | Command::Arc { .. } | Command::Power(_),
        ) => true,
        (
            PathControl::ExactPath | PathControl::ExactStop | PathControl::Continuous { .. },
            Command::Line { .. }
            | Command::Arc { .. }
            | Command::Power(_)
            | Command::Probe { .. }
            | Command::Dwell { .. }
            | Command::Spindle { .. }
            | Command::Coolant(_)
            | Command::Pause,
        ) => false,
    }
}
