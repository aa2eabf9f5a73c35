//! Moves that `G64` holds back, and when the machine gets them.
//!
//! A move waits for the next line, which may change it; but never longer than the machine has
//! something to do. It goes to the machine when anything else than a line comes, when something waits
//! for standstill, and, while no line comes, when the machine would soon begin to brake for the end of
//! the known motion: docs/path-control.md.
//!
//! # Cost
//! Sending a blended move is out of line, so that a line under `G61` does not pay for it.

use heapless::spsc::Producer;

use super::{LineStage, Ports, Session, machine_sync::MachineSync};
use crate::{
    machine::Snapshot,
    model::{Command, PathControl, State},
    path::{Blender, Entry, Router, Work},
    protocol::report,
};

/// Unfinished entries with which the machine is far from braking: with fewer, the distance decides.
/// Bounded from below, by 2, by the test `what_is_held_back_does_not_slow_the_machine_down` in
/// `tests/motion/path_control.rs`; a greater number only has the distance computed more often.
const HANDOVER_ENTRIES: u32 = 8;
/// Time for a move that is held back to reach the machine before it brakes, s: the segments made in
/// advance (3.5 ms), and the interpretation of a line. Bounded from below by the test
/// `what_is_held_back_does_not_slow_the_machine_down` in `tests/motion/path_control.rs`.
const HANDOVER_S: f32 = 0.03;

impl Session {
    /// Drops moves that the machine would not execute: it is locked, or has ended a motion early.
    pub(super) fn drop_cancelled(&mut self, machine: &Snapshot) {
        let is_dropped = machine.state == State::Alarm || self.machine_sync.is_cancelled(machine);
        // What has left the travel can be shown up to the reset, which drops it.
        if is_dropped && self.stage != LineStage::Faulted {
            self.blender.clear();
            self.router.take_remainder();
            self.cancel_compensation();
        }
    }

    /// Sends the moves that are held back, as far as there is room.
    pub(super) fn flush_moves(&mut self, entries: &mut Producer<'_, Entry>) {
        if self.blender.has_pending() {
            self.router.flush(&mut self.blender);
            self.machine_sync
                .drain(&mut self.router, &mut self.blender, entries);
        }
    }

    /// Sends the moves that are held back, if the machine would soon brake without them.
    pub(super) fn flush_moves_in_time(&mut self, ports: &mut Ports<'_, '_>) {
        if self.blender.has_pending() {
            let (router, blender) = (&mut self.router, &mut self.blender);
            (self.machine_sync).flush_near_end(ports.machine, router, blender, ports.entries);
        }
    }

    /// Reports the greatest deviation from the programmed path, if there was any.
    pub(super) fn report_deviation(&mut self) {
        let deviation_mm = self.blender.take_deviation_mm();
        if deviation_mm > 0.0 {
            report::path_deviation(&mut self.reports.message, deviation_mm);
        }
    }
}

impl MachineSync {
    /// Sends the moves that are held back, if the machine would soon brake without them.
    #[inline(never)]
    pub(super) fn flush_near_end(
        &mut self,
        machine: &Snapshot,
        router: &mut Router,
        blender: &mut Blender,
        entries: &mut Producer<'_, Entry>,
    ) {
        let waiting = self.entered.wrapping_sub(machine.finished);
        let is_near_end = waiting < HANDOVER_ENTRIES
            && router.distance_from_mm(&machine.steps) <= self.handover_mm;
        if waiting == 0 || is_near_end {
            router.flush(blender);
        }
        self.drain(router, blender, entries);
    }

    /// Sends the moves that are ready. Returns false when there is no room for all of them.
    #[inline]
    pub(super) fn drain(
        &mut self,
        router: &mut Router,
        blender: &mut Blender,
        entries: &mut Producer<'_, Entry>,
    ) -> bool {
        blender.front().is_none() || self.drain_ready(router, blender, entries)
    }

    #[inline(never)]
    fn drain_ready(
        &mut self,
        router: &mut Router,
        blender: &mut Blender,
        entries: &mut Producer<'_, Entry>,
    ) -> bool {
        while let Some(output) = blender.front() {
            if !entries.ready() {
                return false;
            }
            router.set_exact_stop(false);
            while let Some(work) = router.work_before_blended(output) {
                let end_ms = router.duration_ms();
                self.send(work, end_ms, entries);
                if !entries.ready() {
                    return false;
                }
            }
            if let Some(work) = router.route_blended(output) {
                if let Work::Move(block) = &work {
                    let speed = block.limit_mm_s.min(block.programmed_mm_s);
                    let braking_s = 0.5 * speed / block.acceleration_mm_s2;
                    self.handover_mm = speed * (braking_s + HANDOVER_S);
                }
                let end_ms = router.duration_ms();
                self.send(work, end_ms, entries);
            }
            blender.dequeue();
        }
        true
    }

    /// Sends what comes before a command on a machine with backlash. Returns false when there is no room for it or for
    /// the command.
    pub(super) fn send_take_up(
        &mut self,
        router: &mut Router,
        command: &Command,
        control: PathControl,
        entries: &mut Producer<'_, Entry>,
    ) -> bool {
        router.set_exact_stop(control == PathControl::ExactStop);
        while let Some(work) = router.work_before(command) {
            let end_ms = router.duration_ms();
            self.send(work, end_ms, entries);
            if !entries.ready() {
                return false;
            }
        }
        true
    }
}
