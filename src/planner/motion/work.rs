//! Takes entries from `interpret` and begins what they ask for.

use heapless::spsc::Consumer;

use super::Motion;
use crate::{
    machine::{Ending, Event, Inputs, Notice, State},
    planner::{Entry, Pacing, Work},
    stepper::StepCounts,
    units::TICKS_PER_MS,
};

/// Entries taken in one run, so that a run stays short.
pub(super) const ENTRIES_PER_RUN: usize = 4;

impl Motion {
    /// Takes entries, and tells how many.
    pub(super) fn take(
        &mut self,
        entries: &mut Consumer<'_, Entry>,
        inputs: &Inputs,
        counts: &StepCounts,
    ) -> usize {
        // wcet-bound: 4
        for taken in 0..ENTRIES_PER_RUN {
            let Some(entry) = entries.peek() else {
                return taken;
            };
            // Settings are void for nobody: the session has taken them over already, at rest.
            let is_old = entry.epoch != self.epoch.wrapping_add(self.cuts);
            let is_move = matches!(entry.work, Work::Move(_));
            let is_locked = self.is_starved || is_move && self.control.state == State::Alarm;
            let is_void = (is_old || is_locked) && !matches!(entry.work, Work::Configure(_));
            if is_void {
                self.finished = self.finished.wrapping_add(1);
            } else if !self.accept(&entry.work, inputs, counts) {
                return taken;
            }
            let _ = entries.dequeue();
        }
        ENTRIES_PER_RUN
    }

    /// Begins the work if it can begin now.
    #[inline]
    fn accept(&mut self, work: &Work, inputs: &Inputs, counts: &StepCounts) -> bool {
        if let Work::Move(block) = work {
            let is_ending = self.control.ending != Ending::None;
            let has_room =
                !is_ending && !self.is_dwelling && !self.is_in_cycle() && self.plan.free() > 0;
            if has_room {
                self.plan.push(block);
            }
            return has_room;
        }
        self.begin(work, inputs, counts)
    }

    /// Begins work other than a move.
    #[inline(never)]
    fn begin(&mut self, work: &Work, inputs: &Inputs, counts: &StepCounts) -> bool {
        if let Work::Fault(alarm) = work {
            // Not one more block than is needed to stop.
            self.fault = Some(*alarm);
            self.on(Event::Hold);
            self.finished = self.finished.wrapping_add(1);
            return true;
        }
        // A machine that has just come to rest is settled at the end of the run.
        let is_settled = !matches!(self.control.state, State::Run | State::Jog);
        let is_waiting = self.is_dwelling || self.is_in_cycle() || !is_settled;
        let is_busy = !self.plan.is_empty() || is_waiting || !self.is_still(counts);
        let is_ending = self.control.ending != Ending::None;
        if self.control.state.is_suspended() || is_busy || is_ending {
            return false;
        }
        match work {
            Work::Probe(block, probing) if self.begin_probe(block, *probing, inputs) => {
                return true;
            }
            Work::Home(axes) if self.begin_homing(*axes, inputs) => return true,
            Work::Move(_) | Work::Fault(_) | Work::Probe(..) | Work::Home(_) => {}
            Work::Dwell(milliseconds) => {
                self.dwell_ticks = u64::from(*milliseconds) * u64::from(TICKS_PER_MS);
                self.is_dwelling = true;
                return true;
            }
            Work::Pause => {
                self.on(Event::Pause);
                self.is_paused = self.control.state == State::HoldComplete;
                if self.is_paused {
                    return true;
                }
            }
            Work::Spindle(spindle, rpm) => self.accessories.set_spindle(*spindle, *rpm),
            Work::Coolant(coolant) => self.accessories.set_coolant(*coolant),
            Work::Unlock => self.on(Event::Unlock),
            Work::Check => self.on(Event::Check),
            Work::Sleep => self.sleep(),
            Work::EndOverrides => self.end_overrides(),
            Work::Configure(settings) => {
                self.configure(settings, inputs);
                self.settle_on_steps();
            }
        }
        self.finished = self.finished.wrapping_add(1);
        true
    }

    fn sleep(&mut self) {
        self.on(Event::Sleep);
        if self.control.state == State::Sleep {
            self.notices.push(Notice::Sleeping);
            self.release_drivers();
        }
    }

    /// Leaves the idle state as soon as there is something to execute.
    pub(super) fn begin_moves(&mut self) {
        if self.is_dwelling || self.control.state != State::Idle {
            return;
        }
        if let Some(block) = self.plan.current() {
            self.releases_drivers = false;
            let is_jog = block.pacing == Pacing::Jog;
            self.on(if is_jog { Event::Jog } else { Event::Move });
        }
    }
}
