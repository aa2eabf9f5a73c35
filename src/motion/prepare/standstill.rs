//! Standstill: what has been executed ends, and work other than moves begins.

use super::{Activity, Motion, delays::Restoring};
use crate::{
    machine::{Ending, Event, Inputs},
    model::{Levels, Notice, State},
    path::Work,
    units::TICKS_PER_MS,
};

impl Motion {
    /// Enters the state for which the machine was stopped, at rest.
    fn finish_stop(&mut self) {
        if self.parking.is_moving() && self.control.ending == Ending::None {
            self.next_parking_stage();
            return;
        }
        let before = self.control.ending;
        self.transition(Event::Stopped);
        if before != Ending::None {
            self.drop_plan();
        }
        if before == Ending::DropThenDoor {
            // The door was opened in a jog, which has just been dropped: Z is not parked.
            self.control = self.control.after(Event::Stopped).0;
            self.accessories.suspend();
        }
    }

    /// Ends what has been executed, at rest.
    #[inline(never)]
    fn end_motion(&mut self, inputs: &Inputs) {
        if matches!(self.activity, Activity::Dwell(0)) {
            self.finish_activity();
        }
        if let Some(alarm) = self.faults.at_standstill.take() {
            self.alarm(alarm);
        }
        self.finish_stop();
        self.end_cycles(inputs);
        if !self.has_path() {
            self.transition(Event::CycleStop);
        }
    }

    /// Enters the state of standstill, when everything has been played.
    #[inline(never)]
    pub(super) fn enter_standstill(&mut self, inputs: &Inputs) {
        self.end_motion(inputs);
        let is_door_open = self.inputs.has(Levels::DOOR);
        if core::mem::take(&mut self.faults.checks_door) && is_door_open {
            self.open_door();
        }
        if !is_door_open && self.control.state == State::DoorAjar {
            self.transition(Event::DoorClosed);
        }
        self.apply_state();
        if self.control.state == State::HoldComplete {
            self.accessories.stop_in_hold();
        }
        if !self.has_path() && !self.control.state.is_suspended() {
            self.accessories.apply_speed();
        }
        if self.delays.restoring != Restoring::None {
            self.restore();
        }
        self.watch_spindle();
        self.begin_moves();
        self.start_idle_delay();
    }

    /// Begins work other than a move.
    #[inline(never)]
    pub(super) fn begin_work(&mut self, work: &Work, inputs: &Inputs) {
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
}
