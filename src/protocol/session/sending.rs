//! The commands of a line, sent to the machine, and what follows when they are done.
//!
//! Read with Grbl 1.1 `motion_control.c` and `protocol.c`.
//!
//! # Cost
//! Nearly all moves are lines: the block of a line is made in its slot of the queue.

use heapless::spsc::Producer;

use super::{
    AfterCommands, LineStage, Ports, Progress, Session, Source,
    machine_sync::{MachineSync, ProgrammedPosition},
};
use crate::{
    machine::Snapshot,
    model::{Alarm, Command, Laser, PathControl, Probed, Spindle},
    path::{Entry, Router, Work},
    protocol::report::{self, Feedback},
};

impl Session {
    /// Stops and locks the machine: the line leaves the travel.
    pub(super) fn send_fault(&mut self, ports: &mut Ports<'_, '_>) -> Progress {
        self.stage = if ports.entries.ready() {
            self.send_work(Work::Fault(Alarm::SoftLimit), ports);
            LineStage::Faulted
        } else {
            LineStage::Faulting
        };
        Progress::Waiting
    }

    /// Sends the commands of the line from the given one on to the machine, as far as there is room.
    pub(super) fn send_commands(&mut self, first: usize, ports: &mut Ports<'_, '_>) -> Progress {
        let mut next = first;
        if !self.send_remaining(&mut next, ports) {
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

    /// Sends the commands from `next` on, and counts them. Returns false when there is no room.
    fn send_remaining(&mut self, next: &mut usize, ports: &mut Ports<'_, '_>) -> bool {
        let control = self.line.path_control(&self.interpreter);
        while let Some(command) = self.line.outcome.commands.get(*next) {
            let is_blended = is_blended(control, command);
            if !is_blended {
                self.router.flush(&mut self.blender);
            }
            if !self.has_room(ports) {
                return false;
            }
            let drills = self.line.drilling == Some(*next);
            // Of one that has begun, the remainder follows.
            if !self.router.is_within_command() {
                if drills
                    && !self
                        .line
                        .take_drilling_command(*next, &mut self.interpreter)
                {
                    *next += 1;
                    continue;
                }
                self.line.take_chord(*next);
            }
            if !is_blended && !self.send_before(*next, ports) {
                return false;
            }
            self.send_command(*next, is_blended, ports);
            *next += usize::from(!drills && !self.line.has_chord(*next));
        }
        if self.line.after_commands.is_some() {
            self.router.flush(&mut self.blender);
        }
        if !(self.machine_sync).drain(&mut self.router, &mut self.blender, ports.entries) {
            return false;
        }
        if self.line.after_commands == Some(AfterCommands::Message(Feedback::ProgramEnd)) {
            if !ports.entries.ready() {
                return false;
            }
            self.send_work(Work::EndOverrides, ports);
        }
        true
    }

    /// Returns whether another command may be sent: all that is ready has been, there is room for an entry, and what
    /// waits in the machine does not last too long.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "a call for each move costs as much again"
    )]
    fn has_room(&mut self, ports: &mut Ports<'_, '_>) -> bool {
        self.machine_sync.waits_for_time = self.is_enough_queued(ports.machine);
        (self.machine_sync).drain(&mut self.router, &mut self.blender, ports.entries)
            && ports.entries.ready()
            && !self.machine_sync.waits_for_time
    }

    /// Returns whether what the machine has to do behind the work in execution lasts longer than `$797`, and longer than
    /// it takes to brake: no move becomes slower because one behind it is not known yet.
    ///
    /// The rest of a command that backlash divides does not wait for that, as its line has no answer yet. A jog does not: one that waited here would begin when those before have been cancelled.
    #[inline]
    fn is_enough_queued(&self, machine: &Snapshot) -> bool {
        let slowest = machine.overrides.feed.min(machine.overrides.rapid);
        let limit_ms = 10 * u32::from(slowest) * u32::from(self.settings().queued_motion_s);
        self.machine_sync.lasts_longer_than(limit_ms, machine)
            && limit_ms != 0
            && !self.router.is_within_command()
            && self.line.source != Source::Jog
            && self.is_braking_known(machine)
    }

    #[inline(never)]
    fn is_braking_known(&self, machine: &Snapshot) -> bool {
        let braking_ms = 1_000.0 * self.router.longest_braking_s();
        self.machine_sync
            .lasts_longer_than(braking_ms as u32, machine)
    }

    /// Sends what comes before a command of the line on a machine with backlash. Returns false when there is no room
    /// for it or for the command.
    fn send_before(&mut self, number: usize, ports: &mut Ports<'_, '_>) -> bool {
        if !self.router.has_backlash() {
            return true;
        }
        let Some(command) = self.line.outcome.commands.get(number).copied() else {
            return true;
        };
        self.machine_sync.is_jogging |= self.line.source == Source::Jog;
        let control = self.line.path_control(&self.interpreter);
        (self.machine_sync).send_take_up(&mut self.router, &command, control, ports.entries)
    }

    /// Sends a command of the line to the machine, or to the blender before it. There is room.
    fn send_command(&mut self, number: usize, is_blended: bool, ports: &mut Ports<'_, '_>) {
        let Some(command) = self.line.outcome.commands.get(number) else {
            return;
        };
        let control = self.line.path_control(&self.interpreter);
        if is_blended {
            return self.router.blend(&mut self.blender, control, command);
        }
        self.router
            .set_exact_stop(control == PathControl::ExactStop);
        if enqueue(
            &mut self.router,
            command,
            &mut self.machine_sync,
            ports.entries,
        ) {
            self.machine_sync.is_jogging |= self.line.source == Source::Jog;
        } else {
            let laser_rpm = self.constant_laser_rpm();
            let work = (self.line).work_without_steps(ports.machine, number, laser_rpm);
            if let Some(work) = work {
                self.machine_sync.is_jogging |= self.line.source == Source::Jog;
                self.send_work(work, ports);
            }
        }
    }

    /// Sends a command of a line before, which may have waited, to the machine, or to the blender before
    /// it. Returns false when there is no room.
    pub(super) fn send_one(
        &mut self,
        command: &Command,
        control: PathControl,
        ports: &mut Ports<'_, '_>,
    ) -> bool {
        let is_blended = is_blended(control, command);
        if !is_blended {
            self.router.flush(&mut self.blender);
        }
        if !self.has_room(ports) {
            return false;
        }
        if is_blended {
            self.router.blend(&mut self.blender, control, command);
            return true;
        }
        if !(self.machine_sync).send_take_up(&mut self.router, command, control, ports.entries) {
            return false;
        }
        let is_sent = enqueue(
            &mut self.router,
            command,
            &mut self.machine_sync,
            ports.entries,
        );
        if !is_sent
            && let Command::Line { feed_rate, .. } | Command::Arc { feed_rate, .. } = command
        {
            let laser_rpm = self.constant_laser_rpm();
            if let Some(work) = self.line.power_without_steps(*feed_rate, laser_rpm) {
                self.send_work(work, ports);
            }
        }
        true
    }

    /// Returns the speed that is the power of a laser that is on whatever moves.
    fn constant_laser_rpm(&self) -> Option<f32> {
        let is_on = self.interpreter.modal().spindle == Spindle::Clockwise;
        match self.router.laser() {
            Laser::Constant(rpm) if self.settings().laser && is_on => Some(rpm),
            _ => None,
        }
    }

    /// Ends the line when everything that was sent has been done.
    pub(super) fn complete(
        &mut self,
        machine: &Snapshot,
        after_commands: AfterCommands,
    ) -> Progress {
        if !self.is_done(machine) || machine.state.is_suspended() {
            return Progress::Waiting;
        }
        match after_commands {
            AfterCommands::Answer => {}
            AfterCommands::Message(feedback) => {
                if feedback == Feedback::ProgramEnd {
                    self.report_deviation();
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
            AfterCommands::ToolReturn => return self.end_tool_change(),
            AfterCommands::Again => return self.dispatch_again(),
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
    /// or the start, if the move has not been begun. Behind a contact the offset follows that is to be set there.
    fn end_probing(&mut self, machine: &Snapshot) -> Progress {
        let programmed = if !self.probing.has_ended {
            ProgrammedPosition::At(self.probing.start)
        } else if machine.probed.success {
            ProgrammedPosition::Machine
        } else {
            ProgrammedPosition::Stays
        };
        self.continue_from(machine, programmed);
        if self.probing.has_ended && machine.probed.success {
            self.store_contact(machine)
        } else {
            self.accept()
        }
    }
}

/// Enqueues the work of a command, and counts it; there is room. Returns false for a move without a step.
#[inline(never)]
fn enqueue(
    router: &mut Router,
    command: &Command,
    machine_sync: &mut MachineSync,
    entries: &mut Producer<'_, Entry>,
) -> bool {
    let cancellation_count = machine_sync.cancellation_count();
    let enqueue = |work| {
        entries
            .enqueue(Entry {
                cancellation_count,
                work,
            })
            .is_ok()
    };
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
        Command::Speed(_) => machine_sync.count_speed(),
        _ => machine_sync.count_entry(router.duration_ms()),
    }
    is_sent
}

/// Returns whether a command goes through the blender, in which `G64` may change it.
fn is_blended(control: PathControl, command: &Command) -> bool {
    matches!(control, PathControl::Continuous { .. })
        && matches!(
            command,
            Command::Line { .. } | Command::Arc { .. } | Command::Power(_) | Command::Speed(_)
        )
}
