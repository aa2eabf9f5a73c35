//! Handles requests as events of the state machine, and applies their effects.

use super::{Activity, Motion};
use crate::{
    machine::{Control, Effect, Event},
    model::{
        Alarm, Notice, OVERRIDES, Override, OverrideSwitches, Overrides, ReceivedPosition,
        Requests, State, TOOL_CHANGE,
    },
    stepper::SegmentRing,
};

impl Motion {
    /// Handles all requests since the last time.
    #[inline(never)]
    pub(super) fn handle_requests(&mut self, requests: &Requests, segments: &SegmentRing) {
        // Before the requests: one that comes meanwhile counts as new in the next run.
        self.handled.requests = requests.count();
        self.handled.ticks = segments.played_start_ticks();
        self.apply_overrides(requests);
        if requests.take_delay_end() {
            self.end_delay();
        }
        if requests.take_standstill() {
            self.watch_standstill();
        }
        let is_cancel = requests.take_jog_cancel() && self.control.state == State::Jog;
        let (is_hold, is_start) = (requests.take_hold(), requests.take_start());
        let is_door = requests.take_door();
        let is_contact = requests.take_contact() && self.is_stopped_by_contact();
        if is_cancel || is_hold || is_contact || is_door {
            if is_cancel || is_hold {
                // A hold of a jog is its end.
                self.transition(if is_cancel {
                    Event::JogCancel
                } else {
                    Event::FeedHold
                });
            }
            if is_contact {
                self.alarm(Alarm::UnexpectedContact);
            } else if is_door {
                self.open_door();
            }
        } else if is_start {
            // Of requests at the same time the stopping request counts, as in Grbl: it is the safe one.
            if self.control.state == State::Tool {
                self.published.tool_marks.end = requests.start_mark();
            }
            #[cfg(arc_machine)]
            if self.runs_stored_program && self.control.state == State::Idle {
                self.published.notices.push(Notice::CycleStart);
            }
            self.transition(Event::CycleStart);
        }
        if requests.take_laser_off() {
            let is_held = self.is_held();
            self.accessories.switch_laser_off(is_held);
        }
        self.apply_state();
    }

    /// Whether a contact of the probe stops the machine: in a move that is no probing move, with a step left at least.
    /// A move may go to a probed position, and the move that leaves it may make the contact chatter.
    fn is_stopped_by_contact(&self) -> bool {
        let may_stop = self.stops_at_contact
            && self.has_probed
            && matches!(self.activity, Activity::Path | Activity::TakeUp)
            && self.left_contact_in != Some(self.published.finished)
            && matches!(
                self.control.state,
                State::Run | State::Jog | State::HoldSlowing
            );
        may_stop && self.is_in_motion() && self.has_steps_left()
    }

    /// Whether a whole step is still to be made into a segment.
    fn has_steps_left(&self) -> bool {
        match self.plan.current() {
            None => self.takes_up_backlash(),
            Some(block) if self.plan.len() == 1 => self.executor.steps_left(block) >= 1.0,
            Some(_) => true,
        }
    }

    pub(super) fn open_door(&mut self) {
        if self.control.state == State::Home {
            self.end_homing(Alarm::HomingDoor);
            return;
        }
        if self.control.reacts_to_door() {
            self.published.notices.push(Notice::CheckDoor);
        }
        self.transition(Event::SafetyDoor);
    }

    fn apply_overrides(&mut self, requests: &Requests) {
        let before = self.accessories.overrides();
        let Some(taken) = requests.take_overrides() else {
            return;
        };
        let mut is_tool_change = false;
        for byte in taken.take(OVERRIDES) {
            is_tool_change |= byte == TOOL_CHANGE;
            if let Some(command) = Override::from_byte(byte) {
                self.apply_override(command);
            }
        }
        self.accessories.update_overrides();
        self.replan_after_override(before);
        if is_tool_change {
            self.change_tool(requests.tool_mark());
        }
    }

    /// Executes the operator's lines from a mark on, if the machine waits for a tool.
    fn change_tool(&mut self, mark: ReceivedPosition) {
        let is_waiting = matches!(self.activity, Activity::ToolPause);
        if is_waiting && self.control.state == State::HoldComplete {
            self.transition(Event::ChangeTool);
            let marks = &mut self.published.tool_marks;
            marks.begin = mark;
            marks.changes = marks.changes.wrapping_add(1);
        }
    }

    /// Whether coolant can be switched by its keys now.
    fn has_coolant_keys(&self) -> bool {
        let state = self.control.state;
        matches!(state, State::Idle | State::Run | State::Jog | State::Tool) || self.is_held()
    }

    fn apply_override(&mut self, command: Override) {
        match command {
            Override::SpindleStop => {
                if self.is_held() && self.accessories.toggle_stop() {
                    self.published.notices.push(Notice::RestoringSpindle);
                }
            }
            Override::Flood if self.has_coolant_keys() => self.accessories.toggle_flood(),
            Override::Mist if self.has_coolant_keys() => self.accessories.toggle_mist(),
            Override::Flood | Override::Mist => {}
            Override::OptionalStop
            | Override::FeedReset
            | Override::FeedMore
            | Override::FeedLess
            | Override::FeedFineMore
            | Override::FeedFineLess
            | Override::RapidFull
            | Override::RapidHalf
            | Override::RapidQuarter
            | Override::SpindleReset
            | Override::SpindleMore
            | Override::SpindleLess
            | Override::SpindleFineMore
            | Override::SpindleFineLess => self.accessories.take_override(command),
        }
    }

    pub(super) fn is_held(&self) -> bool {
        matches!(self.control.state, State::HoldSlowing | State::HoldComplete)
    }

    /// Sets all overrides back to 100 %.
    pub(super) fn reset_overrides(&mut self) {
        let before = self.accessories.overrides();
        // The end of a program that is only checked shows nothing, as in Grbl.
        let is_shown = self.control.state != State::Check;
        self.accessories.reset_overrides(is_shown);
        self.replan_after_override(before);
    }

    /// Allows some overrides, and no others.
    pub(super) fn switch_overrides(&mut self, switches: OverrideSwitches) {
        let before = self.accessories.overrides();
        self.accessories.switch_overrides(switches);
        self.replan_after_override(before);
    }

    /// Plans anew if the overrides of the speed along the path have changed.
    #[inline]
    fn replan_after_override(&mut self, before: Overrides) {
        let now = self.accessories.overrides();
        if now.feed != before.feed || now.rapid != before.rapid {
            self.plan.replan(now, self.executor.replanned());
        }
    }

    /// Continues a pass over the plan.
    #[inline(never)]
    pub(super) fn continue_planning(&mut self) {
        let changes_speeds = self.plan.changes_speeds();
        self.plan.continue_pass();
        if changes_speeds {
            self.executor.replanned();
        }
    }

    /// Takes the state machine through an event, and applies the effect.
    pub(super) fn transition(&mut self, event: Event) {
        let (control, effect) = self.control.after(event);
        self.control = control;
        match effect {
            // Only a standstill drops the plan, and does it itself: `finish_stop`.
            Effect::None | Effect::DropPlan => {}
            Effect::Resume => self.resume(),
            Effect::Suspend => {
                self.stop_restoring();
                if event == Event::Sleep {
                    self.accessories.suspend();
                } else {
                    self.park();
                }
            }
            Effect::Restore => {
                if !self.parking.begin_return() {
                    self.begin_restoring();
                }
            }
            Effect::MotionCancel => {
                // A reset has its own count.
                if event != Event::Reset {
                    let cancelled = &mut self.published.cancelled_motions;
                    *cancelled = cancelled.wrapping_add(1);
                }
            }
            Effect::Abort => {
                self.faults.reset_in_motion = true;
                self.delays.disables_drivers = true;
            }
        }
    }

    /// Resumes what waited for cycle start.
    fn resume(&mut self) {
        if self.accessories.end_stop(self.has_path()) {
            self.published.notices.push(Notice::RestoringSpindle);
        }
        if self.takes_up_backlash() {
            self.go_on_taking_up();
        }
        if matches!(self.activity, Activity::Pause | Activity::ToolPause) {
            self.finish_activity();
        }
    }

    /// Locks the machine. It slows down if it moves, and drops its plan.
    pub(super) fn alarm(&mut self, alarm: Alarm) {
        self.transition(Event::Alarm);
        self.published.notices.push(Notice::Alarm(alarm));
        self.cancel_pause();
        // The position is kept: nothing may turn by itself.
        self.delays.disables_drivers |= alarm != Alarm::UnexpectedContact;
        match alarm {
            Alarm::ProbeState | Alarm::ProbeContact => {
                if self.probing_alarm_switches_off {
                    self.accessories.switch_off();
                }
            }
            Alarm::HardLimit | Alarm::SoftLimit | Alarm::UnexpectedContact | Alarm::Killed => {
                self.accessories.switch_off();
                self.faults.is_critical = true;
            }
            Alarm::ResetInMotion
            | Alarm::HomingReset
            | Alarm::HomingDoor
            | Alarm::HomingPullOff
            | Alarm::HomingNotFound
            | Alarm::HomingDualAxis
            | Alarm::SelfTest
            | Alarm::Restarted => self.accessories.switch_off(),
        }
    }

    /// Handles an underrun of the step interrupt in motion. The axes stopped dead and may have lost
    /// steps: the plan is void, and so are entries up to the next reset.
    #[cold]
    #[inline(never)]
    pub(super) fn handle_underrun(&mut self, segments: &SegmentRing) {
        segments.clear_underrun();
        self.generator.discard_open_segment();
        self.homing.abandon();
        self.cancel_pause();
        self.drop_plan();
        self.accessories.switch_off();
        self.faults.at_standstill = None;
        self.faults.has_underrun = true;
        self.delays.disables_drivers = true;
        self.control = Control {
            state: State::Alarm,
            ..Control::IDLE
        };
    }

    /// Ends a program pause or a dwell before its time.
    pub(super) fn cancel_pause(&mut self) {
        match self.activity {
            Activity::Pause | Activity::ToolPause | Activity::Dwell(_) => self.finish_activity(),
            Activity::Path | Activity::TakeUp | Activity::Homing | Activity::Probing(_) => {}
        }
        self.stop_restoring();
    }

    /// Handles a reset: everything off, the plan void; an axis that moves slows down.
    #[cold]
    #[inline(never)]
    pub(super) fn handle_reset(&mut self, requests: &Requests, segments: &SegmentRing) {
        self.handled.reset_count = requests.reset_count();
        self.handled.ticks = segments.played_start_ticks();
        self.faults.has_underrun = false;
        self.faults.is_critical = false;
        self.faults.at_standstill = None;
        self.faults.reset_in_motion = false;
        self.cancel_pause();
        self.accessories.switch_off();
        self.reset_overrides();
        if self.control.state == State::Home {
            self.end_homing(Alarm::HomingReset);
        }
        self.reset_parking();
        self.transition(Event::Reset);
        if self.control.state == State::Idle && self.is_on_limit() {
            self.control.state = State::Alarm;
        }
        if self.faults.failed_self_test {
            self.alarm(Alarm::SelfTest);
        }
        self.faults.checks_door = true;
        self.apply_state();
    }
}
