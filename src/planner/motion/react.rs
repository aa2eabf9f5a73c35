//! From requests to events of the state machine, and what they ask for.

use super::Motion;
use crate::{
    machine::{Alarm, Control, Effect, Event, Notice, Override, Overrides, State},
    protocol::realtime::{OVERRIDES, Requests},
};

impl Motion {
    /// Acts on everything that has been asked for since the last run.
    #[inline]
    pub(super) fn hear(&mut self, requests: &Requests) {
        // Before the requests: one that comes meanwhile counts as new in the next run.
        let asked = requests.asked();
        if asked != self.heard {
            self.heard = asked;
            self.obey(requests);
        }
    }

    #[inline(never)]
    fn obey(&mut self, requests: &Requests) {
        self.take_overrides(requests);
        if requests.take_wake() {
            self.wake();
        }
        let is_cancel = requests.take_jog_cancel() && self.control.state == State::Jog;
        let (is_hold, is_start) = (requests.take_hold(), requests.take_start());
        let is_door = requests.take_door();
        if is_cancel {
            self.on(Event::JogCancel);
        }
        if is_hold {
            self.on(Event::Hold);
        }
        if is_door {
            self.open_door();
        }
        // Of requests at once the one that stops counts, as in Grbl: it is the safe one.
        if is_start && !is_hold && !is_door && !is_cancel {
            self.on(Event::Start);
        }
    }

    pub(super) fn open_door(&mut self) {
        if self.control.state == State::Home {
            self.end_homing(Alarm::HomingDoor);
            return;
        }
        if self.control.heeds_door() {
            self.notices.push(Notice::CheckDoor);
        }
        self.on(Event::Door);
    }

    fn take_overrides(&mut self, requests: &Requests) {
        let before = self.accessories.overrides();
        // wcet-bound: 16
        for taken in 0..OVERRIDES {
            let Some(command) = requests.take_override() else {
                if taken != 0 {
                    self.repace(before);
                }
                return;
            };
            self.take_override(command);
        }
        self.repace(before);
    }

    /// Whether coolant can be switched by its keys now.
    fn has_coolant_keys(&self) -> bool {
        matches!(self.control.state, State::Idle | State::Run | State::Jog) || self.is_held()
    }

    fn take_override(&mut self, command: Override) {
        match command {
            Override::SpindleStop => {
                if self.is_held() && self.accessories.toggle_stop() {
                    self.notices.push(Notice::RestoringSpindle);
                }
            }
            Override::Flood if self.has_coolant_keys() => self.accessories.toggle_flood(),
            Override::Mist if self.has_coolant_keys() => self.accessories.toggle_mist(),
            Override::Flood | Override::Mist => {}
            Override::FeedReset
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
            | Override::SpindleFineLess => self.accessories.take(command),
        }
    }

    pub(super) fn is_held(&self) -> bool {
        matches!(self.control.state, State::HoldSlowing | State::HoldComplete)
    }

    /// All overrides back to 100 %.
    pub(super) fn end_overrides(&mut self) {
        let before = self.accessories.overrides();
        self.accessories.end_overrides();
        self.repace(before);
    }

    /// Plans anew if the overrides of the speed along the path have changed.
    fn repace(&mut self, before: Overrides) {
        let now = self.accessories.overrides();
        if now.feed != before.feed || now.rapid != before.rapid {
            self.plan.pace(now);
            self.executor.replanned();
        }
    }

    /// An event of the state machine, and what has to be done for it.
    pub(super) fn on(&mut self, event: Event) {
        let (control, effect) = self.control.after(event);
        self.control = control;
        match effect {
            Effect::None => {}
            Effect::Resume => {
                if self.accessories.end_stop(!self.plan.is_empty()) {
                    self.notices.push(Notice::RestoringSpindle);
                }
                if self.is_paused {
                    self.is_paused = false;
                    self.finished = self.finished.wrapping_add(1);
                }
            }
            Effect::SwitchOff => {
                self.stop_restoring();
                if event == Event::Sleep {
                    self.accessories.cut();
                } else {
                    self.park();
                }
            }
            Effect::Restore => {
                if !self.unpark() {
                    self.begin_restoring();
                }
            }
            // A reset has its own count.
            Effect::Cancel if event == Event::Reset => {}
            Effect::Cancel => self.cuts = self.cuts.wrapping_add(1),
            Effect::Drop => self.drop_plan(),
            Effect::Abort => {
                self.reset_in_motion = true;
                self.releases_drivers = true;
            }
        }
    }

    /// Locks the machine. It slows down if it moves, and drops its plan.
    pub(super) fn alarm(&mut self, alarm: Alarm) {
        self.on(Event::Alarm);
        self.notices.push(Notice::Alarm(alarm));
        self.drop_wait();
        self.releases_drivers = true;
        match alarm {
            Alarm::ProbeState | Alarm::ProbeContact => {}
            Alarm::HardLimit
            | Alarm::SoftLimit
            | Alarm::ResetInMotion
            | Alarm::HomingReset
            | Alarm::HomingDoor
            | Alarm::HomingPullOff
            | Alarm::HomingNotFound
            | Alarm::HomingDualAxis => self.accessories.switch_off(),
        }
        self.is_critical |= matches!(alarm, Alarm::HardLimit | Alarm::SoftLimit);
    }

    /// The step interrupt ran out of events in motion. The axes stopped dead and may have lost
    /// steps: whatever was planned is void, and so is what still comes, up to the next reset.
    #[cold]
    #[inline(never)]
    pub(super) fn fail(&mut self) {
        self.generator.cut();
        self.homing.abandon();
        self.drop_wait();
        self.drop_plan();
        self.accessories.switch_off();
        self.fault = None;
        self.is_starved = true;
        self.releases_drivers = true;
        self.control = Control {
            state: State::Alarm,
            ..Control::IDLE
        };
    }

    /// Ends a program pause or a dwell before its time.
    pub(super) fn drop_wait(&mut self) {
        if self.is_paused || self.is_dwelling {
            self.finished = self.finished.wrapping_add(1);
        }
        self.is_paused = false;
        self.is_dwelling = false;
        self.dwell_ticks = 0;
        self.stop_restoring();
    }

    /// Everything off, everything planned void; an axis that moves slows down.
    #[cold]
    #[inline(never)]
    pub(super) fn reset(&mut self, epoch: u32) {
        self.epoch = epoch;
        self.is_starved = false;
        self.is_critical = false;
        self.fault = None;
        self.reset_in_motion = false;
        self.drop_wait();
        self.accessories.switch_off();
        self.end_overrides();
        if self.control.state == State::Home {
            self.end_homing(Alarm::HomingReset);
        }
        self.reset_parking();
        self.on(Event::Reset);
        if self.control.state == State::Idle && self.is_on_limit() {
            self.control.state = State::Alarm;
        }
        self.looks_at_door = true;
    }
}
