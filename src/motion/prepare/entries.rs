//! Dequeues the entries of `interpret` and begins their work.

use heapless::spsc::Consumer;

use super::{Activity, Motion};
use crate::{
    machine::{Ending, Event, Inputs},
    model::{Notice, State},
    path::{Entry, MoveKind, Work},
    units::TICKS_PER_MS,
};

impl Motion {
    /// Whether an entry is a move for which the plan has no room, as it is most of the time.
    #[inline]
    pub(super) fn is_move_without_room(&self, entry: &Entry) -> bool {
        self.plan.free() == 0 && matches!(entry.work, Work::Move(_)) && !self.is_void(entry)
    }

    /// Whether an entry can be dequeued now: its work can begin, or is void.
    #[inline(never)]
    pub(super) fn can_dequeue(&self, entry: &Entry, is_still: bool) -> bool {
        let is_ending = self.control.ending != Ending::None;
        if matches!(entry.work, Work::Move(_)) {
            let waits = is_ending || self.is_occupied();
            return !waits && self.plan.free() != 0 || self.is_void(entry);
        }
        if self.is_void(entry) {
            return true;
        }
        match entry.work {
            Work::Move(_) | Work::Fault(_) => true,
            Work::Speed(_) => !is_ending && !self.is_occupied(),
            Work::TakeUp(_) => {
                let is_on_path = matches!(self.activity, Activity::Path);
                !is_ending && self.plan.is_empty() && is_on_path && !self.is_occupied()
            }
            // A hold that comes while they are on their way does not keep the old ones in effect.
            Work::Configure(_) if self.control.state == State::HoldComplete => {
                is_still && !is_ending && self.plan.is_empty() && !self.is_occupied()
            }
            Work::Dwell(_)
            | Work::Probe(..)
            | Work::Spindle(..)
            | Work::ReverseTap(..)
            | Work::Coolant(_)
            | Work::Overrides(_)
            | Work::Drivers(_)
            | Work::Pause
            | Work::ToolPause
            | Work::Unlock
            | Work::Home(_)
            | Work::Check
            | Work::Sleep
            | Work::EndOverrides
            | Work::Configure(_) => is_still && !is_ending && !self.is_busy(),
        }
    }

    /// Whether something has to end before work other than a move begins.
    fn is_busy(&self) -> bool {
        // A machine that has just come to rest has to enter the state of standstill first.
        let is_settled = !matches!(self.control.state, State::Run | State::Jog);
        let is_waiting = self.is_occupied() || !is_settled;
        !self.plan.is_empty() || is_waiting || self.control.state.is_suspended()
    }

    /// Whether an entry comes too late: after a reset, a cancelled motion or an alarm.
    #[inline]
    fn is_void(&self, entry: &Entry) -> bool {
        // Settings are never void: the session has taken them over already, at rest.
        let is_old = entry.cancellation_count
            != self
                .handled
                .reset_count
                .wrapping_add(self.published.cancelled_motions);
        let is_move = matches!(entry.work, Work::Move(_));
        let is_locked = self.faults.has_underrun || is_move && self.control.state == State::Alarm;
        (is_old || is_locked) && !matches!(entry.work, Work::Configure(_))
    }

    /// Dequeues one entry, for which that is possible.
    #[inline(never)]
    pub(super) fn dequeue_entry(&mut self, entries: &mut Consumer<'_, Entry>, inputs: &Inputs) {
        let Some(entry) = entries.peek() else {
            return;
        };
        if self.is_void(entry) {
            self.finish_entries(1);
        } else if let Work::Move(block) = &entry.work {
            self.plan.push(block);
        } else if let Work::Speed(rpm) = entry.work {
            self.accessories.queue_speed(rpm);
            self.finish_entries(1);
        } else if let Work::TakeUp(take_up) = entry.work {
            self.begin_take_up(take_up);
        } else {
            // What the moves before have not brought with them comes before this.
            self.accessories.apply_speed();
            self.begin_work(&entry.work, inputs);
        }
        let _ = entries.dequeue();
        self.apply_state();
    }

    /// Begins work other than a move.
    #[inline(never)]
    fn begin_work(&mut self, work: &Work, inputs: &Inputs) {
        match work {
            Work::Fault(alarm) => {
                // Not one more block than is needed to stop.
                self.faults.at_standstill = Some(*alarm);
                self.transition(Event::FeedHold);
            }
            Work::Probe(block, probing) if self.begin_probe(block, *probing, inputs) => return,
            Work::Home(axes) if self.begin_homing(*axes, inputs) => return,
            Work::Move(_) | Work::TakeUp(_) | Work::Speed(_) | Work::Probe(..) | Work::Home(_) => {}
            Work::Dwell(milliseconds) => {
                let ticks = u64::from(*milliseconds) * u64::from(TICKS_PER_MS);
                self.activity = Activity::Dwell(ticks);
                return;
            }
            Work::Pause | Work::ToolPause => {
                self.transition(Event::Pause);
                if self.control.state == State::HoldComplete {
                    self.activity = match work {
                        Work::ToolPause => Activity::ToolPause,
                        _ => Activity::Pause,
                    };
                    return;
                }
            }
            Work::Spindle(spindle, rpm) => self.accessories.set_spindle(*spindle, *rpm),
            Work::ReverseTap(spindle, rpm) => {
                self.accessories.set_spindle(*spindle, *rpm);
                self.skip_spindle_delay();
            }
            Work::Coolant(coolant) => self.accessories.set_coolant(*coolant),
            Work::Overrides(switches) => self.switch_overrides(*switches),
            Work::Drivers(are_on) => self.switch_drivers(*are_on),
            Work::Unlock => self.transition(Event::Unlock),
            Work::Check => self.transition(Event::Check),
            Work::Sleep => self.sleep(),
            Work::EndOverrides => self.reset_overrides(),
            Work::Configure(settings) => {
                self.configure(settings, inputs);
                self.snap_to_steps();
            }
        }
        self.finish_entries(1);
    }

    fn sleep(&mut self) {
        self.transition(Event::Sleep);
        if self.control.state == State::Sleep {
            self.published.notices.push(Notice::Sleeping);
            self.disable_drivers();
        }
    }

    /// Leaves the idle state as soon as there is something to execute.
    pub(super) fn begin_moves(&mut self) {
        if self.is_dwelling() || !matches!(self.control.state, State::Idle | State::Tool) {
            return;
        }
        if let Some(block) = self.plan.current() {
            self.delays.disables_drivers = false;
            let is_jog = block.kind == MoveKind::Jog;
            self.transition(if is_jog { Event::Jog } else { Event::Move });
        }
    }
}
