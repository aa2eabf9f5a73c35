//! The path on its way to the machine: what has been sent, and the moves that `G64` holds back.
//!
//! A move waits for the next line, which may change it; but never longer than the machine has
//! something to do. It goes to the machine when anything else than a line comes, when something waits
//! for standstill, and, while no line comes, when the machine would soon begin to brake for the end of
//! the known motion: docs/path-control.md.
//!
//! # Cost
//! Sending a blended move is out of line, so that a line under `G61` does not pay for it.

use heapless::spsc::Producer;

use super::{LineExecution, machine_sync::MachineSync};
use crate::{
    axis::Axes,
    machine::Snapshot,
    model::State,
    path::{Blender, Entry, Router, Work},
    protocol::{dollar::Condition, report, text::Text},
    settings::Settings,
    units::Nm,
};

/// Unfinished entries with which the machine is far from braking: with fewer, the distance decides.
/// Bounded from below, by 2, by the test `what_is_held_back_does_not_slow_the_machine_down` in
/// `tests/motion/path_control.rs`; a greater number only has the distance computed more often.
const HANDOVER_ENTRIES: u32 = 8;
/// Time for a move that is held back to reach the machine before it brakes, s: the segments made in
/// advance (3 ms), and the interpretation of a line. Bounded from below by the test
/// `what_is_held_back_does_not_slow_the_machine_down` in `tests/motion/path_control.rs`.
const HANDOVER_S: f32 = 0.03;

/// The programmed position where the path goes on from the machine's whole steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ProgrammedPosition {
    /// That of the machine.
    Machine,
    /// Another one: that where a move would have begun which has not.
    At(Axes<Nm>),
    /// Unchanged: less than a step away, or the target of a probing move that has missed.
    Stays,
}

/// The path, and how far the machine has come along it.
#[derive(Debug)]
#[repr(C)]
pub(super) struct PathSender {
    pub(super) sync: MachineSync,
    pub(super) router: Router,
    /// Moves that `G64` may still change.
    pub(super) blender: Blender,
}

impl PathSender {
    /// A path at the origin.
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            sync: MachineSync::default(),
            router: Router::new(settings),
            blender: Blender::new(),
        }
    }

    /// Returns whether every entry has been done, and no move is held back.
    pub(super) fn has_finished(&self, machine: &Snapshot) -> bool {
        self.sync.has_finished(machine) && !self.blender.has_pending()
    }

    /// Returns whether everything sent to the machine has been done, and the machine stands still.
    pub(super) fn is_done(&self, machine: &Snapshot) -> bool {
        machine.is_at_rest && self.has_finished(machine)
    }

    /// Returns what `$` statements may ask of the machine now.
    pub(super) fn condition(&self, machine: &Snapshot) -> Condition {
        let has_finished = self.has_finished(machine);
        match machine.state {
            State::Alarm => Condition::Alarm,
            State::Check => Condition::Check,
            State::Jog => Condition::Jog,
            State::Idle | State::Tool if has_finished => Condition::Idle,
            State::Idle | State::Tool | State::Run if self.sync.is_jogging && !has_finished => {
                Condition::Jog
            }
            State::Idle
            | State::Tool
            | State::Run
            | State::HoldSlowing
            | State::HoldComplete
            | State::Home
            | State::DoorClosed
            | State::DoorAjar
            | State::DoorRetracting
            | State::DoorRestoring
            | State::Sleep => Condition::Run,
        }
    }

    /// Sends work that needs standstill.
    pub(super) fn send_work(&mut self, work: Work, entries: &mut Producer<'_, Entry>) {
        let end_ms = self.router.duration_ms();
        self.sync.send(work, end_ms, entries);
    }

    /// Makes the position of the machine the programmed one.
    pub(super) fn adopt_position(&mut self, machine: &Snapshot, line: &mut LineExecution) {
        self.continue_from(machine, ProgrammedPosition::Machine, line);
        self.sync.is_position_known = true;
    }

    /// Continues the path from the whole steps of the machine, at standstill. `prepare` does the same after it has
    /// dropped its plan or adopted settings. Only here does a path begin elsewhere than at the end of the last one.
    pub(super) fn continue_from(
        &mut self,
        machine: &Snapshot,
        programmed: ProgrammedPosition,
        line: &mut LineExecution,
    ) {
        let position = self.router.set_steps(machine.steps);
        match programmed {
            ProgrammedPosition::Machine => line.interpreter.set_position(position),
            ProgrammedPosition::At(position) => line.interpreter.set_position(position),
            ProgrammedPosition::Stays => {}
        }
    }

    /// Applies settings at standstill, which the machine adopts there, too.
    pub(super) fn configure(
        &mut self,
        settings: &Settings,
        machine: &Snapshot,
        line: &mut LineExecution,
        entries: &mut Producer<'_, Entry>,
    ) {
        let before = self.router.settings();
        if settings.laser != before.laser {
            line.interpreter.switch_spindle_off();
        }
        // The steps stay the same; with another resolution they are another position.
        let are_elsewhere =
            settings.steps_per_mm != before.steps_per_mm || settings.core_xy != before.core_xy;
        let programmed = if are_elsewhere {
            ProgrammedPosition::Machine
        } else {
            ProgrammedPosition::Stays
        };
        self.router.configure(settings);
        self.continue_from(machine, programmed, line);
        self.send_work(Work::Configure(*settings), entries);
    }

    /// Reports the greatest deviation from the programmed path, if there was any.
    pub(super) fn report_deviation(&mut self, text: &mut Text) {
        let deviation_mm = self.blender.take_deviation_mm();
        if deviation_mm > 0.0 {
            report::path_deviation(text, deviation_mm);
        }
    }

    /// Sends the moves that are held back, as far as there is room.
    pub(super) fn flush(&mut self, entries: &mut Producer<'_, Entry>) {
        if self.blender.has_pending() {
            self.router.flush(&mut self.blender);
            self.drain(entries);
        }
    }

    /// Sends the moves that are held back, if the machine would soon brake without them.
    pub(super) fn flush_in_time(&mut self, machine: &Snapshot, entries: &mut Producer<'_, Entry>) {
        if self.blender.has_pending() {
            self.flush_near_end(machine, entries);
        }
    }

    fn flush_near_end(&mut self, machine: &Snapshot, entries: &mut Producer<'_, Entry>) {
        let waiting = self.sync.entered.wrapping_sub(machine.finished);
        let is_near_end = waiting < HANDOVER_ENTRIES
            && self.router.distance_from_mm(&machine.steps) <= self.sync.handover_mm;
        if waiting == 0 || is_near_end {
            self.router.flush(&mut self.blender);
        }
        self.drain(entries);
    }

    /// Sends the moves that are ready. Returns false when there is no room for all of them.
    pub(super) fn drain(&mut self, entries: &mut Producer<'_, Entry>) -> bool {
        self.blender.front().is_none() || self.drain_ready(entries)
    }

    #[inline(never)]
    fn drain_ready(&mut self, entries: &mut Producer<'_, Entry>) -> bool {
        let (sync, router) = (&mut self.sync, &mut self.router);
        while let Some(output) = self.blender.front() {
            if !entries.ready() {
                return false;
            }
            router.set_exact_stop(false);
            while let Some(work) = router.work_before_blended(output) {
                let end_ms = router.duration_ms();
                sync.send(work, end_ms, entries);
                if !entries.ready() {
                    return false;
                }
            }
            if let Some(work) = router.route_blended(output) {
                if let Work::Move(block) = &work {
                    let speed = block.limit_mm_s.min(block.programmed_mm_s);
                    let braking_s = 0.5 * speed / block.acceleration_mm_s2;
                    sync.handover_mm = speed * (braking_s + HANDOVER_S);
                }
                let end_ms = router.duration_ms();
                sync.send(work, end_ms, entries);
            }
            self.blender.dequeue();
        }
        true
    }
}
