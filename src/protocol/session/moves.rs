//! The commands of a line, sent to the machine, and what follows when they are done; lines of moves alone from the
//! receive queue on.
//!
//! Read with Grbl 1.1 `motion_control.c` and `protocol.c`.
//!
//! # Cost
//! Nearly all moves are lines: the block of a line is made in its slot of the queue.

use heapless::spsc::Producer;

use super::{
    AfterCommands, LineExecution, LineStage, PathSender, Ports, Progress, Session, Source,
    cutter_path::SentCompensated, machine_sync::MachineSync, path::ProgrammedPosition,
};
use crate::{
    gcode::{LineError, NotPlain, PlainPrefix, interpreter::Interpreter},
    machine::Snapshot,
    model::{Alarm, Command, Laser, PathControl, Probed, Spindle, State},
    path::{Entry, Work, is_outside},
    protocol::{
        ByteReader, Dialect, Waiting,
        realtime::MAX_UNRELEASED_BYTES,
        report::{self, Feedback},
    },
    settings::Settings,
};

/// Most bytes of an unfinished line that stay in the receive queue: half of the bytes that release the session without
/// a line end, so the session moves a longer line out of the queue in time.
const MAX_WAITING_BYTES: usize = MAX_UNRELEASED_BYTES / 2;

/// Returns whether an unfinished line may stay in the receive queue: a short one in upper case, without
/// comments, and not across the end of the ring.
#[cold]
#[inline(never)]
fn may_wait(received: &ByteReader<'_>) -> bool {
    let [mut older, newer] = received.waiting();
    newer.len() == 0
        && older.len() <= MAX_WAITING_BYTES
        && !older.any(|byte| matches!(byte, b'(' | b';' | b'a'..=b'z'))
}

impl Session {
    /// Executes the next line, or, when none has come, sends the moves that `G64` holds back in time.
    pub(super) fn read_line(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        if self.dialect != Dialect::Grbl {
            let step = self.read_in_dialect(ports).unwrap_or_else(|| {
                let (input, text) = (&mut self.line.input, &mut self.reports.message);
                (self.lines).read_grbl(ports.received, ports.requests, input, text)
            });
            return self.take_step(step, ports);
        }
        let settings = &self.persistence.stored.settings;
        match self.line.execute_plain(&self.path.sync, settings, ports) {
            Ok(()) => self.send_plain(ports),
            Err(NotPlain::OtherWords) if self.line.receive(ports.received) => {
                if ports.requests.take_losses_before(ports.received.oldest()) {
                    return self.refuse_with_hold(LineError::BytesLost, ports);
                }
                self.dispatch(ports)
            }
            Err(NotPlain::OtherWords | NotPlain::Incomplete) => {
                self.path.flush_in_time(ports.machine, ports.entries);
                Progress::Waiting
            }
        }
    }

    /// Sends the move that a plain line asks for, unless the move leaves the travel.
    fn send_plain(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        let settings = &self.persistence.stored.settings;
        if settings.soft_limits && is_outside(settings, &self.line.interpreter.position()) {
            return self.send_fault(ports);
        }
        if ports.machine.state == State::Check {
            self.line.outcome.commands.clear();
        }
        self.line.after_commands = None;
        self.line.tilted = None;
        self.line.drilling = None;
        self.send_commands(0, ports)
    }

    /// Sends the commands of the line from the given one on to the machine, as far as there is room.
    pub(super) fn send_commands(&mut self, first: usize, ports: &mut Ports<'_, '_>) -> Progress {
        let mut next = first;
        if !(self.path).send_line(&mut next, &mut self.line, ports) {
            self.stage = LineStage::Sending(next);
            return Progress::Waiting;
        }
        match self.line.after_commands {
            Some(after_commands) => {
                self.stage = LineStage::Completing(after_commands);
                self.complete(ports.machine, after_commands)
            }
            None => self.accept(),
        }
    }

    /// Sends what compensation has released, and the commands of the line from the given one on, as far as there is room.
    pub(super) fn send_compensated(&mut self, first: usize, ports: &mut Ports<'_, '_>) -> Progress {
        let mut next = first;
        let (line, path) = (&mut self.line, &mut self.path);
        match (self.cutter_path).send_line(&mut next, line, path, ports) {
            SentCompensated::All => self.send_commands(0, ports),
            SentCompensated::Part => {
                self.stage = LineStage::Compensating(next);
                Progress::Waiting
            }
            SentCompensated::UpToTravel => self.send_fault(ports),
        }
    }

    /// Drops moves that the machine would not execute: it is locked, or has ended a motion early.
    pub(super) fn drop_cancelled(&mut self, machine: &Snapshot) {
        let is_dropped = machine.state == State::Alarm || self.path.sync.is_cancelled(machine);
        // What has left the travel can be shown up to the reset, which drops it.
        if is_dropped && self.stage != LineStage::Faulted {
            self.path.blender.clear();
            self.path.router.take_remainder();
            self.cutter_path.cancel(&self.path, &mut self.line);
        }
    }

    /// Stops and locks the machine: the line leaves the travel.
    pub(super) fn send_fault(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        self.stage = if ports.entries.ready() {
            self.path
                .send_work(Work::Fault(Alarm::SoftLimit), ports.entries);
            LineStage::Faulted
        } else {
            LineStage::Faulting
        };
        Progress::Waiting
    }

    /// Ends the line when everything that was sent has been done.
    pub(super) fn complete(
        &mut self,
        machine: &Snapshot,
        after_commands: AfterCommands,
    ) -> Progress {
        if !self.path.is_done(machine) || machine.state.is_suspended() {
            return Progress::Waiting;
        }
        match after_commands {
            AfterCommands::Answer => {}
            AfterCommands::Message(feedback) => {
                if feedback == Feedback::ProgramEnd {
                    self.path.report_deviation(&mut self.reports.message);
                }
                report::feedback(&mut self.reports.message, feedback);
            }
            AfterCommands::Probe => return self.end_probing(machine),
            AfterCommands::Miss => {
                let missed = Probed {
                    steps: machine.steps,
                    success: false,
                };
                self.report_probed(missed);
            }
            AfterCommands::Home { mask } => return self.end_homing(machine, mask),
            // `advance` calls what sends more commands.
            AfterCommands::ToolPause => return Progress::Again,
            AfterCommands::ToolReturn => {
                let interrupted = &self.tool_change.interrupted;
                self.line.interpreter.end_tool_change(interrupted);
                return self.enter(LineStage::AwaitingStandstill);
            }
            AfterCommands::Again => return self.enter(LineStage::AwaitingStandstill),
        }
        self.accept()
    }

    /// Reports the end of a probing move.
    pub(super) fn report_probed(&mut self, probed: Probed) {
        let settings = &self.persistence.stored.settings;
        let probing = self.line.checked.probing();
        let text = &mut self.reports.message;
        self.probing.report(probed, probing, text, settings);
    }

    /// Sets the position after a probing move: the position of the machine; the target, after a miss;
    /// or the start, if the move has not been begun. After a contact the offset that the line sets there is stored.
    fn end_probing(&mut self, machine: &Snapshot) -> Progress {
        let programmed = if !self.probing.has_ended {
            ProgrammedPosition::At(self.probing.start)
        } else if machine.probed.success {
            ProgrammedPosition::Machine
        } else {
            ProgrammedPosition::Stays
        };
        self.path.continue_from(machine, programmed, &mut self.line);
        if self.probing.has_ended && machine.probed.success {
            self.store_contact(machine)
        } else {
            self.accept()
        }
    }
}

impl LineExecution {
    /// Moves received bytes to the line, up to its end. Returns false when it has not come yet.
    fn receive(&mut self, received: &mut ByteReader<'_>) -> bool {
        received.take_until(|bytes| self.input.take_from(bytes))
    }

    /// Executes the next line in the receive queue, if it is plain; else keeps the plain words that the line begins
    /// with.
    ///
    /// # Errors
    /// [`NotPlain`] for an incomplete line, a line with other words, and where the state of the machine decides. Nothing
    /// is dequeued, and only the plain words are kept.
    fn execute_plain(
        &mut self,
        sync: &MachineSync,
        settings: &Settings,
        ports: &mut Ports<'_, '_>,
    ) -> Result<(), NotPlain> {
        let received = &mut *ports.received;
        if !self.input.is_empty() {
            return Err(NotPlain::OtherWords);
        }
        let may_wait_or_be_locked = matches!(ports.machine.state, State::Alarm | State::Jog)
            || sync.is_jogging
            || sync.follows_refused;
        if !sync.is_position_known || may_wait_or_be_locked {
            self.prefix = PlainPrefix::default();
            return Err(NotPlain::OtherWords);
        }
        if !received.may_have_line() {
            self.prefix = PlainPrefix::default();
            let may_wait = received.len() <= MAX_WAITING_BYTES;
            return Err(if may_wait {
                NotPlain::Incomplete
            } else {
                NotPlain::OtherWords
            });
        }
        let waiting = received.waiting();
        let n = waiting.iter().map(Waiting::len).sum::<usize>();
        // Asked behind the look at the bytes: a loss is noted before the bytes that follow it.
        if ports.requests.has_losses() {
            self.prefix = PlainPrefix::default();
            return Err(NotPlain::OtherWords);
        }
        match self.interpreter.execute_plain(
            waiting,
            settings,
            &mut self.prefix,
            &mut self.checked,
            &mut self.outcome,
        ) {
            Ok(remaining) => {
                received.consume(n - remaining);
                Ok(())
            }
            Err(NotPlain::Incomplete) if !may_wait(received) => Err(NotPlain::OtherWords),
            Err(refusal) => Err(refusal),
        }
    }
}

impl PathSender {
    /// Learns at standstill where the machine is, if that is not known, and that its jogs have ended.
    pub(super) fn sync_at_standstill(
        &mut self,
        machine: &Snapshot,
        stage: LineStage,
        line: &mut LineExecution,
    ) {
        if !self.is_done(machine) {
            return;
        }
        self.sync.is_jogging = false;
        // A cancelled jog has not come to its end, and one that still waits for room is dropped.
        if self.sync.is_cancelled(machine) {
            self.sync.cancelled_motions = machine.cancelled_motions;
            // The alarm of a probing move is followed by what the line does at its end.
            self.sync.is_position_known &= stage == LineStage::Completing(AfterCommands::Probe);
            if line.source == Source::Jog {
                line.outcome.commands.clear();
            }
        }
        if !self.sync.is_position_known {
            self.adopt_position(machine, line);
        }
    }

    /// Sends the commands of a line from `next` on, and counts them. Returns false when there is no room.
    fn send_line(
        &mut self,
        next: &mut usize,
        line: &mut LineExecution,
        ports: &mut Ports<'_, '_>,
    ) -> bool {
        let control = line.path_control();
        while let Some(command) = line.outcome.commands.get(*next) {
            let is_blended = is_blended(control, command);
            if !is_blended {
                self.router.flush(&mut self.blender);
            }
            if !self.has_room(line, ports) {
                return false;
            }
            let drills = line.drilling == Some(*next);
            // Where a take-up of backlash has divided the command, the remainder follows: no new hole or chord.
            if !self.router.is_within_command() {
                if drills && !line.take_drilling_command(*next) {
                    *next += 1;
                    continue;
                }
                line.take_chord(*next);
            }
            let Some(command) = line.outcome.commands.get(*next) else {
                return true;
            };
            let is_jog = line.source == Source::Jog;
            self.sync.is_jogging |= is_jog && self.router.has_backlash();
            match self.send_command(command, control, ports.entries) {
                Some(true) => self.sync.is_jogging |= is_jog,
                Some(false) => {
                    let laser_rpm = self.constant_laser_rpm(&line.interpreter);
                    if let Some(work) = line.work_without_steps(ports.machine, *next, laser_rpm) {
                        self.sync.is_jogging |= is_jog;
                        self.send_work(work, ports.entries);
                    }
                }
                None => return false,
            }
            *next += usize::from(!drills && !line.has_chord(*next));
        }
        if line.after_commands.is_some() {
            self.router.flush(&mut self.blender);
        }
        if !self.drain(ports.entries) {
            return false;
        }
        if line.after_commands == Some(AfterCommands::Message(Feedback::ProgramEnd)) {
            if !ports.entries.ready() {
                return false;
            }
            self.send_work(Work::EndOverrides, ports.entries);
        }
        true
    }

    /// Returns whether another command of a line may be sent: all that is ready has been, there is room for an entry,
    /// and what waits in the machine does not last too long.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "a call for each move costs as much again"
    )]
    fn has_room(&mut self, line: &LineExecution, ports: &mut Ports<'_, '_>) -> bool {
        self.sync.waits_for_time = self.is_enough_queued(line, ports.machine);
        self.drain(ports.entries) && ports.entries.ready() && !self.sync.waits_for_time
    }

    /// Returns whether the queued work behind the work in execution lasts longer than `$797`, and longer than braking:
    /// no move becomes slower because a later move is not known yet.
    ///
    /// The rest of a command that backlash divides does not wait for that, as its line has no answer yet. Nor does a
    /// jog: a jog that waited here would begin when the jogs before have been cancelled.
    fn is_enough_queued(&self, line: &LineExecution, machine: &Snapshot) -> bool {
        let slowest = machine.overrides.feed.min(machine.overrides.rapid);
        let queued_motion_s = self.router.settings().queued_motion_s;
        let limit_ms = 10 * u32::from(slowest) * u32::from(queued_motion_s);
        self.sync.lasts_longer_than(limit_ms, machine)
            && limit_ms != 0
            && !self.router.is_within_command()
            && line.source != Source::Jog
            && self.is_braking_known(machine)
    }

    fn is_braking_known(&self, machine: &Snapshot) -> bool {
        let braking_ms = 1_000.0 * self.router.longest_braking_s();
        self.sync.lasts_longer_than(braking_ms as u32, machine)
    }

    /// Sends a command released by the compensation, perhaps of an earlier line, to the machine or to the blender.
    /// Returns false when there is no room.
    pub(super) fn send_one(
        &mut self,
        command: &Command,
        control: PathControl,
        line: &mut LineExecution,
        ports: &mut Ports<'_, '_>,
    ) -> bool {
        if !is_blended(control, command) {
            self.router.flush(&mut self.blender);
        }
        if !self.has_room(line, ports) {
            return false;
        }
        let is_sent = self.send_command(command, control, ports.entries);
        if is_sent == Some(false)
            && let Command::Line { feed_rate, .. } | Command::Arc { feed_rate, .. } = command
        {
            let laser_rpm = self.constant_laser_rpm(&line.interpreter);
            if let Some(work) = line.power_without_steps(*feed_rate, laser_rpm) {
                self.send_work(work, ports.entries);
            }
        }
        is_sent.is_some()
    }

    /// Sends a command, for which there is room, to the machine or to the blender, on a machine with backlash after the
    /// take-up of the backlash. Returns whether there was something to send, and `None` when the take-up has left no
    /// room.
    fn send_command(
        &mut self,
        command: &Command,
        control: PathControl,
        entries: &mut Producer<'_, Entry>,
    ) -> Option<bool> {
        if is_blended(control, command) {
            self.router.blend(&mut self.blender, control, command);
            return Some(true);
        }
        let router = &mut self.router;
        router.set_exact_stop(control == PathControl::ExactStop);
        while let Some(work) = router.work_before(command) {
            self.sync.send(work, router.duration_ms(), entries);
            if !entries.ready() {
                return None;
            }
        }
        Some(self.enqueue(command, entries))
    }

    /// Enqueues the work of a command, and counts it; there is room. Returns false for a move without a step.
    fn enqueue(&mut self, command: &Command, entries: &mut Producer<'_, Entry>) -> bool {
        let cancellation_count = self.sync.cancellation_count();
        let enqueue = |work| {
            let entry = Entry {
                cancellation_count,
                work,
            };
            entries.enqueue(entry).is_ok()
        };
        let router = &mut self.router;
        let remainder;
        let command = if router.is_within_command() {
            remainder = router.take_remainder();
            remainder.as_ref().unwrap_or(command)
        } else {
            command
        };
        let is_sent = router.route_to(command, enqueue).unwrap_or(false);
        match command {
            _ if !is_sent => {}
            Command::Speed(_) => self.sync.count_speed(),
            _ => self.sync.count_entry(router.duration_ms()),
        }
        is_sent
    }

    /// Returns the speed that is the power of a laser that is on whatever moves.
    fn constant_laser_rpm(&self, interpreter: &Interpreter) -> Option<f32> {
        let is_on = interpreter.modal().spindle == Spindle::Clockwise;
        match self.router.laser() {
            Laser::Constant(rpm) if self.router.settings().laser && is_on => Some(rpm),
            _ => None,
        }
    }
}

/// Returns whether a command goes through the blender, in which `G64` may change it.
fn is_blended(control: PathControl, command: &Command) -> bool {
    matches!(control, PathControl::Continuous { .. })
        && matches!(
            command,
            Command::Line { .. } | Command::Arc { .. } | Command::Power(_) | Command::Speed(_)
        )
}
