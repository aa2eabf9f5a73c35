//! What the session knows of the machine: entries sent and done, resets acted on, the position.

use heapless::spsc::Producer;

use super::{AfterCommands, LineStage, Ports, Session, Source, queued_duration::QueuedDuration};
use crate::{
    axis::Axes,
    machine::Snapshot,
    path::{Entry, Work},
    units::Nm,
};

/// The programmed position where the path goes on from the machine's whole steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ProgrammedPosition {
    /// That of the machine.
    Machine,
    /// Another one: that where a move would have begun which has not.
    At(Axes<Nm>),
    /// The one it is, less than a step away, or the target of a probing move that has missed.
    Stays,
}

/// How far the session and the machine are in step: the interpreter runs ahead of the motion.
#[derive(Debug, Default)]
pub(super) struct MachineSync {
    /// Number of entries sent so far, wrapping.
    pub(super) entered: u32,
    /// The reset that the session has acted on.
    pub(super) reset_count: u32,
    /// Number of motions that ended before their target, as far as the position is known.
    pub(super) cancelled_motions: u32,
    /// Whether the interpreter knows the position of the machine.
    pub(super) is_position_known: bool,
    /// Whether the entries that are not done are jogs.
    pub(super) is_jogging: bool,
    /// A reset has been requested, or something else of which `prepare` does not know.
    pub(super) has_release_request: bool,
    /// The next line of the program follows a refused one, and the machine is held before it: `$796`.
    pub(super) follows_refused: bool,
    /// Distance before the end of the last blended move at which the machine must know more, mm.
    pub(super) handover_mm: f32,
    /// A command waits until what has been sent lasts no longer than `$797`.
    pub(super) waits_for_time: bool,
    /// How long what has been sent lasts.
    duration: QueuedDuration,
}

impl MachineSync {
    /// Returns whether every entry has been done.
    pub(super) fn has_finished(&self, machine: &Snapshot) -> bool {
        machine.finished == self.entered
    }

    /// Returns whether the machine has ended a motion early, and the position is not yet known again.
    pub(super) fn is_cancelled(&self, machine: &Snapshot) -> bool {
        machine.cancelled_motions != self.cancelled_motions
    }

    /// Returns the number by which `prepare` knows an entry made before a reset or a cancelled motion.
    pub(super) fn cancellation_count(&self) -> u32 {
        self.reset_count.wrapping_add(self.cancelled_motions)
    }

    /// Sends work, up to whose end all moves last so long. The caller has made sure of room; after standstill the queue
    /// is empty.
    pub(super) fn send(&mut self, work: Work, end_ms: u32, entries: &mut Producer<'_, Entry>) {
        let is_speed = matches!(work, Work::Speed(_));
        let cancellation_count = self.cancellation_count();
        let entry = Entry {
            cancellation_count,
            work,
        };
        match entries.enqueue(entry) {
            Ok(()) if is_speed => self.count_speed(),
            Ok(()) => self.count_entry(end_ms),
            Err(_) => {}
        }
    }

    /// Counts an entry that has been sent, up to whose end all moves last so long.
    #[inline]
    pub(super) fn count_entry(&mut self, end_ms: u32) {
        self.entered = self.entered.wrapping_add(1);
        self.duration.add(end_ms);
    }

    /// Counts a speed of the spindle that has been sent: it is done before the moves ahead of it.
    pub(super) fn count_speed(&mut self) {
        self.entered = self.entered.wrapping_add(1);
    }

    /// Returns whether the work behind that in execution lasts longer than a limit.
    #[inline]
    pub(super) fn lasts_longer_than(&self, limit_ms: u32, machine: &Snapshot) -> bool {
        let unfinished = self.entered.wrapping_sub(machine.finished);
        unfinished > 1 && self.duration.of_newest_ms(unfinished - 1) > limit_ms
    }
}

impl Session {
    /// Returns whether everything sent to the machine has been done, and the machine stands still.
    pub(super) fn is_done(&self, machine: &Snapshot) -> bool {
        machine.is_at_rest && self.machine_sync.has_finished(machine) && !self.blender.has_pending()
    }

    /// Sends work that needs standstill.
    pub(super) fn send_work(&mut self, work: Work, ports: &mut Ports<'_, '_>) {
        let end_ms = self.router.duration_ms();
        self.machine_sync.send(work, end_ms, ports.entries);
    }

    /// Learns at standstill where the machine is, if that is not known, and that its jogs have ended.
    pub(super) fn sync_at_standstill(&mut self, machine: &Snapshot) {
        if !self.is_done(machine) {
            return;
        }
        self.machine_sync.is_jogging = false;
        // A cancelled jog has not come to its end, and one that still waits for room is dropped.
        if self.machine_sync.is_cancelled(machine) {
            self.machine_sync.cancelled_motions = machine.cancelled_motions;
            // The alarm of a probing move is followed by what the line does at its end.
            self.machine_sync.is_position_known &=
                self.stage == LineStage::Completing(AfterCommands::Probe);
            if self.line.source == Source::Jog {
                self.line.outcome.commands.clear();
            }
        }
        if !self.machine_sync.is_position_known {
            self.adopt_position(machine);
        }
    }

    /// Makes the position of the machine the programmed one.
    pub(super) fn adopt_position(&mut self, machine: &Snapshot) {
        self.continue_from(machine, ProgrammedPosition::Machine);
        self.machine_sync.is_position_known = true;
    }

    /// Has the path go on from the whole steps of a machine at standstill, where `prepare` goes on that has dropped
    /// what was left, or takes over settings. Nothing else does where a path begins that is not the end of another.
    pub(super) fn continue_from(&mut self, machine: &Snapshot, programmed: ProgrammedPosition) {
        let position = self.router.set_steps(machine.steps);
        match programmed {
            ProgrammedPosition::Machine => self.interpreter.set_position(position),
            ProgrammedPosition::At(position) => self.interpreter.set_position(position),
            ProgrammedPosition::Stays => {}
        }
    }
}
