//! Cutter compensation (`G41`, `G42`): moves offset from the programmed path, and when they are sent.
//!
//! A line is answered when it has been accepted, although its move waits for the next move: a sender that waits for
//! each answer would stand still otherwise. The machine stops at the start of a move that waits when nothing follows.
//! What needs standstill looks at the motion, not at the move that waits.

use super::{LineExecution, PathSender, Ports};
use crate::{
    axis::Axes,
    gcode::{
        LineError,
        interpreter::{CheckedLine, Interpreter},
    },
    machine::Snapshot,
    model::{Requests, State},
    path::{Compensator, Misfit},
    settings::Settings,
    units::Nm,
};

/// The path of the cutter, where it is not the programmed one.
#[derive(Debug, Default)]
pub(super) struct CutterPath {
    pub(super) compensator: Compensator,
    /// The report that a compensated move waits is due, or has been sent.
    has_reported_wait: bool,
}

/// How far a line has gone to the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SentCompensated {
    /// All of it that is compensated.
    All,
    /// As far as there was room.
    Part,
    /// No more: it leaves the travel.
    UpToTravel,
}

impl CutterPath {
    /// Plans what a line moves beside the programmed path. Nothing changes that has been accepted.
    ///
    /// # Errors
    /// 92 where the cutter does not fit, 33 for an end that an axis cannot count, 207 where too much waits.
    pub(super) fn plan(
        &mut self,
        line: &LineExecution,
        settings: &Settings,
    ) -> Result<(), LineError> {
        self.compensator.drop_plan();
        if line.checked.is_compensated() {
            self.plan_off_path(line, settings)
        } else {
            Ok(())
        }
    }

    fn plan_off_path(
        &mut self,
        line: &LineExecution,
        settings: &Settings,
    ) -> Result<(), LineError> {
        let (checked, interpreter) = (&line.checked, &line.interpreter);
        let programmed = interpreter.compensated_move(checked);
        if self.waits_after_move(checked) {
            let moves = usize::from(checked.moves() && programmed.is_none());
            let waits = interpreter.commands_before_move(checked) + moves;
            if waits > self.compensator.room(checked.path_control()) {
                return Err(LineError::TooMuchWaits);
            }
        }
        let Some(programmed) = programmed else {
            return Ok(());
        };
        let planned = self.compensator.plan(&programmed, &settings.farthest());
        planned.map_err(|misfit| match misfit {
            Misfit::Cutter => LineError::CutterDoesNotFit,
            Misfit::Reach => LineError::InvalidTarget,
        })
    }

    /// Returns whether a move waits.
    pub(super) const fn is_waiting(&self) -> bool {
        self.compensator.is_waiting()
    }

    /// Returns whether a line waits behind a move, and is answered at once.
    pub(super) fn waits_after_move(&self, checked: &CheckedLine) -> bool {
        self.is_waiting() && checked.may_wait()
    }

    /// Has the sender told, once, if it leaves the machine standing where a move waits.
    pub(super) fn watch_standstill(
        &mut self,
        machine: &Snapshot,
        path: &mut PathSender,
        requests: &Requests,
    ) {
        let is_left = machine.state == State::Idle && path.is_done(machine);
        if is_left && !self.has_reported_wait {
            self.has_reported_wait = true;
            requests.watch_standstill();
            path.sync.has_release_request = true;
        }
    }

    /// Ends compensation where the last move has led, and forgets what waits. Nothing that has been sent is dropped:
    /// `prepare` goes on from the exact end, and not from the whole steps.
    pub(super) fn cancel(&mut self, path: &PathSender, line: &mut LineExecution) {
        let interpreter = &mut line.interpreter;
        if interpreter.is_compensating() || interpreter.is_off_path() {
            interpreter.cancel_compensation();
            interpreter.set_position(path.router.position());
        }
        self.compensator.clear();
        self.has_reported_wait = false;
    }

    /// Returns where the cutter is that is still beside the path, with compensation off.
    pub(super) fn cutter(&self, interpreter: &Interpreter) -> Option<Axes<Nm>> {
        let is_only_off_path = interpreter.is_off_path() && !interpreter.is_compensating();
        is_only_off_path.then(|| self.compensator.end())
    }

    /// Sends what is released, and the commands of the line from `next` on that are compensated, as far as there is
    /// room.
    pub(super) fn send_line(
        &mut self,
        next: &mut usize,
        line: &mut LineExecution,
        path: &mut PathSender,
        ports: &mut Ports<'_, '_>,
    ) -> SentCompensated {
        loop {
            if !self.send_released(line, path, ports) {
                return SentCompensated::Part;
            }
            if !self.push_next(next, line) {
                break;
            }
            let settings = path.router.settings();
            if settings.soft_limits && self.compensator.leaves_travel(settings) {
                return SentCompensated::UpToTravel;
            }
        }
        let is_off_path = line.is_compensated || line.checked.stays_off_path();
        if line.checked.ends_program() && is_off_path {
            line.interpreter.set_position(self.compensator.end());
        }
        if line.is_compensated {
            line.outcome.commands.clear();
        }
        SentCompensated::All
    }

    /// Adds the next command of the line to what is compensated, or releases what waits where the contour
    /// ends or the program stops. Returns false when nothing is left to do.
    fn push_next(&mut self, next: &mut usize, line: &LineExecution) -> bool {
        let compensator = &mut self.compensator;
        let is_over =
            !line.is_compensated || line.checked.stops_program() && !compensator.has_plan();
        if is_over && compensator.is_waiting() {
            compensator.release();
            return true;
        }
        match line.outcome.commands.get(*next) {
            Some(command) if line.is_compensated => {
                compensator.push(command, line.interpreter.modal().path);
                *next += 1;
                true
            }
            Some(_) | None => false,
        }
    }

    /// Sends what is released, as far as there is room. Returns whether all of it has been sent.
    fn send_released(
        &mut self,
        line: &mut LineExecution,
        path: &mut PathSender,
        ports: &mut Ports<'_, '_>,
    ) -> bool {
        while let Some(command) = self.compensator.front() {
            let is_checking = ports.machine.state == State::Check;
            let control = self.compensator.control();
            if !is_checking && !path.send_one(&command, control, line, ports) {
                return false;
            }
            self.compensator.dequeue();
            self.has_reported_wait = false;
        }
        true
    }
}
