//! Moves beside the programmed path, and when the machine gets them.
//!
//! A line is answered when it has been accepted, although its move waits for the next one: a sender that
//! waits for each answer would stand still otherwise. The machine stops at the start of a move that waits
//! when nothing follows. What needs standstill looks at the motion, not at the move that waits.

use super::{LineStage, Ports, Progress, Session};
use crate::{
    axis::Axes,
    gcode::LineError,
    machine::Snapshot,
    model::{Requests, State},
    path::Misfit,
    units::Nm,
};

impl Session {
    /// Plans what the line moves beside the programmed path. Nothing changes that has been accepted.
    ///
    /// # Errors
    /// 92 where the cutter does not fit, 33 for an end that an axis cannot count, 207 where too much waits.
    #[inline]
    pub(super) fn plan_compensated(&mut self) -> Result<(), LineError> {
        self.compensator.drop_plan();
        let checked = &self.line.checked;
        if checked.is_compensated() {
            self.plan_beside_path()
        } else {
            Ok(())
        }
    }

    #[inline(never)]
    fn plan_beside_path(&mut self) -> Result<(), LineError> {
        let checked = &self.line.checked;
        let programmed = self.interpreter.compensated_move(checked);
        if self.compensator.is_waiting() && checked.may_wait() {
            let moves = usize::from(checked.moves() && programmed.is_none());
            let waits = self.interpreter.commands_before_move(checked) + moves;
            if waits > self.compensator.room(checked.path_control()) {
                return Err(LineError::TooMuchWaits);
            }
        }
        let Some(programmed) = programmed else {
            return Ok(());
        };
        let farthest = self.settings().farthest();
        match self.compensator.plan(&programmed, &farthest) {
            Ok(()) => Ok(()),
            Err(Misfit::Cutter) => Err(LineError::CutterDoesNotFit),
            Err(Misfit::Reach) => Err(LineError::InvalidTarget),
        }
    }

    /// Returns whether the line waits behind a move, and is answered at once.
    pub(super) fn waits_behind_move(&self) -> bool {
        self.compensator.is_waiting() && self.line.checked.may_wait()
    }

    /// Has the sender told, once, if it leaves the machine standing where a move waits.
    #[inline(never)]
    pub(super) fn watch_standstill(&mut self, machine: &Snapshot, requests: &Requests) {
        let is_left = self.stage == LineStage::Reading && machine.state == State::Idle;
        if is_left && !self.reports.has_reported_wait && self.path.is_done(machine) {
            self.reports.has_reported_wait = true;
            requests.watch_standstill();
            self.path.sync.has_release_request = true;
        }
    }

    /// Ends compensation where the last move has led, and forgets what waits. Nothing that has been sent is dropped:
    /// `prepare` goes on from the exact end, and not from the whole steps.
    #[inline(never)]
    pub(super) fn cancel_compensation(&mut self) {
        if self.interpreter.is_compensating() || self.interpreter.is_beside_path() {
            self.interpreter.cancel_compensation();
            self.interpreter.set_position(self.path.router.position());
        }
        self.compensator.clear();
        self.reports.has_reported_wait = false;
    }

    /// Ends compensation at standstill where the last move has led, and answers.
    pub(super) fn end_compensation(&mut self, machine: &Snapshot) -> Progress {
        if self.interpreter.is_compensating() || self.interpreter.is_beside_path() {
            if !self.path.is_done(machine) {
                return self.await_standstill();
            }
            self.cancel_compensation();
        }
        self.accept()
    }

    /// Returns where the next move begins: after `G40` where the cutter is.
    pub(super) fn start_of_move(&self) -> Axes<Nm> {
        if self.is_only_beside_path() {
            self.compensator.end()
        } else {
            self.interpreter.position()
        }
    }

    /// Whether the cutter is still beside the path, with compensation off.
    pub(super) const fn is_only_beside_path(&self) -> bool {
        self.interpreter.is_beside_path() && !self.interpreter.is_compensating()
    }

    /// Sends what is released, and the commands of the line from the given one on, as far as there is room.
    #[inline(never)]
    pub(super) fn send_compensated(&mut self, first: usize, ports: &mut Ports<'_, '_>) -> Progress {
        let mut next = first;
        loop {
            if !self.send_released(ports) {
                self.stage = LineStage::Compensating(next);
                return Progress::Waiting;
            }
            if !self.push_next(&mut next) {
                break;
            }
            let settings = &self.persistence.stored.settings;
            if settings.soft_limits && self.compensator.leaves_travel(settings) {
                return self.send_fault(ports);
            }
        }
        let line = &mut self.line;
        let is_beside = line.is_compensated || line.checked.stays_beside_path();
        if line.checked.ends_program() && is_beside {
            self.interpreter.set_position(self.compensator.end());
        }
        if line.is_compensated {
            line.outcome.commands.clear();
        }
        self.send_commands(0, ports)
    }

    /// Adds the next command of the line to what is compensated, or releases what waits where the contour
    /// ends or the program stops. Returns false when nothing is left to do.
    fn push_next(&mut self, next: &mut usize) -> bool {
        let line = &self.line;
        let compensator = &mut self.compensator;
        let is_over =
            !line.is_compensated || line.checked.stops_program() && !compensator.has_plan();
        if is_over && compensator.is_waiting() {
            compensator.release();
            return true;
        }
        match line.outcome.commands.get(*next) {
            Some(command) if line.is_compensated => {
                compensator.push(command, self.interpreter.modal().path);
                *next += 1;
                true
            }
            Some(_) | None => false,
        }
    }

    /// Sends what is released, as far as there is room. Returns whether all of it has been sent.
    fn send_released(&mut self, ports: &mut Ports<'_, '_>) -> bool {
        while let Some(command) = self.compensator.front() {
            let is_checking = ports.machine.state == State::Check;
            let control = self.compensator.control();
            if !is_checking
                && !self
                    .path
                    .send_one(&command, control, &mut self.line, &self.interpreter, ports)
            {
                return false;
            }
            self.compensator.dequeue();
            self.reports.has_reported_wait = false;
        }
        true
    }
}
