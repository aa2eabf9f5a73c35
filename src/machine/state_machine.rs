//! The state machine: what each event makes of each state.
//!
//! Pure: [`Control::after`] is the whole of it. It knows nothing of plans and pins; what has to be
//! done beside the new state is told as an [`Effect`]. Read with Grbl 1.1 `protocol.c`,
//! `protocol_exec_rt_system`.
//!
//! ```text
//!            !            at rest            0x84
//!   Run ---------> Hold:1 -------> Hold:0 ---------> Door:1 <--> Door:0 ---> Door:3
//!    ^ \                             | ~     at rest  ^      pin         ~      |
//!    |  `-- 0x84 --> Door:2 ---------|----------------'                         | restored
//!    '------------------ Idle <------+------------------------------------------'
//! ```

use crate::model::State;

/// What happens to the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A feed hold is asked for.
    Hold,
    /// Cycle start is asked for.
    Start,
    /// The safety door has been opened.
    Door,
    /// The safety door is closed.
    DoorShut,
    /// The end of jogging is asked for.
    JogCancel,
    /// There is a block of a program to execute.
    Move,
    /// There is a block of a jog to execute.
    Jog,
    /// Every block has been executed and the machine is at rest.
    Done,
    /// A machine that was to stop is at rest.
    Stopped,
    /// Z has to be lifted out of the work.
    Park,
    /// Z is parked.
    Parked,
    /// Spindle and coolant run again after the door was open.
    Restored,
    /// A program pause.
    Pause,
    /// A soft reset.
    Reset,
    /// An alarm.
    Alarm,
    /// The alarm is unlocked, or homing has succeeded.
    Unlock,
    /// Homing begins.
    Home,
    /// Check mode begins.
    Check,
    /// The machine is put to sleep.
    Sleep,
}

/// What has to be done beside the new state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// Nothing.
    None,
    /// What waited for cycle start goes on.
    Resume,
    /// Spindle and coolant are switched off, after parking where the door was opened.
    SwitchOff,
    /// Spindle and coolant are switched on again, one after the other.
    Restore,
    /// The plan is void from now on: it is dropped at rest, and so is what was sent before the
    /// interpreter knows of it.
    Cancel,
    /// The plan is dropped.
    Drop,
    /// A reset found the machine in motion.
    Abort,
}

/// What becomes of the plan when the machine has come to rest.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Ending {
    /// It is executed further.
    #[default]
    None,
    /// It is dropped.
    Drop,
    /// It is dropped, and the safety door has been opened meanwhile.
    DropThenDoor,
}

/// The state, and how a motion that is being stopped ends.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Control {
    /// The state.
    pub state: State,
    /// Other than [`Ending::None`], the machine slows down to drop its plan.
    pub ending: Ending,
}

impl Control {
    /// At rest, with nothing to do.
    pub const IDLE: Self = Self::new(State::Idle);

    const fn new(state: State) -> Self {
        Self {
            state,
            ending: Ending::None,
        }
    }

    const fn ending(state: State, ending: Ending) -> Self {
        Self { state, ending }
    }

    /// Whether blocks are executed, as far as there are any.
    #[must_use]
    pub const fn executes(self) -> bool {
        match self.ending {
            Ending::Drop | Ending::DropThenDoor => false,
            Ending::None => match self.state {
                State::Idle | State::Run | State::Jog | State::Home => true,
                State::HoldSlowing
                | State::HoldComplete
                | State::Check
                | State::DoorClosed
                | State::DoorAjar
                | State::DoorRetracting
                | State::DoorRestoring
                | State::Sleep
                | State::Alarm => false,
            },
        }
    }

    /// Whether the state takes notice of the safety door.
    #[must_use]
    pub const fn heeds_door(self) -> bool {
        !matches!(self.state, State::Alarm | State::Check | State::Home)
    }

    /// The state after an event, and what has to be done.
    ///
    /// Not inlined: what a caller can rule out would trap in its tables of jumps.
    #[inline(never)]
    #[must_use]
    pub fn after(self, event: Event) -> (Self, Effect) {
        let same = (self, Effect::None);
        let is_ending = self.ending != Ending::None && self.state != State::Jog;
        if is_ending && !matches!(event, Event::Stopped | Event::Reset | Event::Alarm) {
            // Nothing else counts before the plan is dropped.
            return same;
        }
        match event {
            Event::Hold => self.hold(),
            Event::Start => self.start(),
            Event::Door => self.door(),
            Event::DoorShut if self.state == State::DoorAjar => to(State::DoorClosed),
            Event::JogCancel if self.state == State::Jog => self.cancel(Ending::Drop),
            Event::Move if self.state == State::Idle => to(State::Run),
            Event::Jog if self.state == State::Idle => to(State::Jog),
            Event::Done if self.state == State::Run => to(State::Idle),
            Event::Done if self.state == State::Jog && self.ending == Ending::None => {
                to(State::Idle)
            }
            Event::Stopped => self.stopped(),
            Event::Park if self.state == State::DoorAjar => to(State::DoorRetracting),
            Event::Parked if self.state == State::DoorRetracting => to(State::DoorAjar),
            Event::Restored if self.state == State::DoorRestoring => (Self::IDLE, Effect::Resume),
            Event::Pause if self.state == State::Idle => to(State::HoldComplete),
            Event::Reset => self.reset(),
            Event::Alarm => (Self::ending(State::Alarm, Ending::Drop), Effect::Cancel),
            Event::Unlock if matches!(self.state, State::Alarm | State::Home) => to(State::Idle),
            Event::Home if matches!(self.state, State::Idle | State::Alarm) => to(State::Home),
            Event::Check if self.state == State::Idle => to(State::Check),
            Event::Sleep if matches!(self.state, State::Idle | State::Alarm) => {
                (Self::new(State::Sleep), Effect::SwitchOff)
            }
            // Not named: a table of jumps would have places for values that there are none of, which
            // trap, in a task with a deadline.
            _ => same,
        }
    }

    fn hold(self) -> (Self, Effect) {
        match self.state {
            State::Run => to(State::HoldSlowing),
            State::Idle => to(State::HoldComplete),
            // A jog has nothing to be resumed.
            State::Jog => self.cancel(Ending::Drop),
            State::HoldSlowing
            | State::HoldComplete
            | State::Home
            | State::Check
            | State::DoorClosed
            | State::DoorAjar
            | State::DoorRetracting
            | State::DoorRestoring
            | State::Sleep
            | State::Alarm => (self, Effect::None),
        }
    }

    fn start(self) -> (Self, Effect) {
        match self.state {
            State::HoldComplete => (Self::IDLE, Effect::Resume),
            State::DoorClosed => (Self::new(State::DoorRestoring), Effect::Restore),
            State::Idle
            | State::Run
            | State::HoldSlowing
            | State::Jog
            | State::Home
            | State::Check
            | State::DoorAjar
            | State::DoorRetracting
            | State::DoorRestoring
            | State::Sleep
            | State::Alarm => (self, Effect::None),
        }
    }

    fn door(self) -> (Self, Effect) {
        match self.state {
            State::Run | State::HoldSlowing => to(State::DoorRetracting),
            State::Idle | State::HoldComplete | State::DoorRestoring => {
                (Self::new(State::DoorAjar), Effect::SwitchOff)
            }
            State::DoorClosed => to(State::DoorAjar),
            State::Jog => self.cancel(Ending::DropThenDoor),
            State::Home
            | State::Check
            | State::DoorAjar
            | State::DoorRetracting
            | State::Sleep
            | State::Alarm => (self, Effect::None),
        }
    }

    /// Ends a jog; what has been asked for before stays.
    fn cancel(self, ending: Ending) -> (Self, Effect) {
        match self.ending {
            Ending::None => (Self::ending(self.state, ending), Effect::Cancel),
            Ending::Drop => (Self::ending(self.state, ending), Effect::None),
            Ending::DropThenDoor => (self, Effect::None),
        }
    }

    fn stopped(self) -> (Self, Effect) {
        let next = match self.state {
            State::HoldSlowing => State::HoldComplete,
            State::DoorRetracting => {
                return (Self::new(State::DoorAjar), Effect::SwitchOff);
            }
            State::Jog if self.ending == Ending::DropThenDoor => State::DoorRetracting,
            State::Jog if self.ending == Ending::Drop => State::Idle,
            State::Idle
            | State::Run
            | State::Jog
            | State::HoldComplete
            | State::Home
            | State::Check
            | State::DoorClosed
            | State::DoorAjar
            | State::DoorRestoring
            | State::Sleep
            | State::Alarm => self.state,
        };
        match self.ending {
            Ending::None => to(next),
            Ending::Drop | Ending::DropThenDoor => (Self::new(next), Effect::Drop),
        }
    }

    fn reset(self) -> (Self, Effect) {
        match self.state {
            State::Run | State::HoldSlowing | State::Jog | State::Home | State::DoorRetracting => {
                (Self::ending(State::Alarm, Ending::Drop), Effect::Abort)
            }
            State::Alarm | State::Sleep => {
                (Self::ending(State::Alarm, Ending::Drop), Effect::Cancel)
            }
            State::Idle
            | State::HoldComplete
            | State::Check
            | State::DoorClosed
            | State::DoorAjar
            | State::DoorRestoring => (Self::ending(State::Idle, Ending::Drop), Effect::Cancel),
        }
    }
}

fn to(state: State) -> (Control, Effect) {
    (Control::new(state), Effect::None)
}

#[cfg(test)]
mod tests {
    use super::{Effect as Do, Event as On, State as Is, *};

    const STATES: [Is; 13] = [
        Is::Idle,
        Is::Run,
        Is::HoldSlowing,
        Is::HoldComplete,
        Is::Jog,
        Is::Home,
        Is::Check,
        Is::DoorClosed,
        Is::DoorAjar,
        Is::DoorRetracting,
        Is::DoorRestoring,
        Is::Sleep,
        Is::Alarm,
    ];

    /// Every change there is: before, event, after, effect. Whatever is not here changes nothing.
    const CHANGES: &[(Is, On, Is, Do)] = &[
        (Is::Run, On::Hold, Is::HoldSlowing, Do::None),
        (Is::Idle, On::Hold, Is::HoldComplete, Do::None),
        (Is::Jog, On::Hold, Is::Jog, Do::Cancel),
        (Is::HoldComplete, On::Start, Is::Idle, Do::Resume),
        (Is::DoorClosed, On::Start, Is::DoorRestoring, Do::Restore),
        (Is::Run, On::Door, Is::DoorRetracting, Do::None),
        (Is::HoldSlowing, On::Door, Is::DoorRetracting, Do::None),
        (Is::Idle, On::Door, Is::DoorAjar, Do::SwitchOff),
        (Is::HoldComplete, On::Door, Is::DoorAjar, Do::SwitchOff),
        (Is::DoorRestoring, On::Door, Is::DoorAjar, Do::SwitchOff),
        (Is::DoorClosed, On::Door, Is::DoorAjar, Do::None),
        (Is::Jog, On::Door, Is::Jog, Do::Cancel),
        (Is::DoorAjar, On::DoorShut, Is::DoorClosed, Do::None),
        (Is::Jog, On::JogCancel, Is::Jog, Do::Cancel),
        (Is::Idle, On::Move, Is::Run, Do::None),
        (Is::Idle, On::Jog, Is::Jog, Do::None),
        (Is::Run, On::Done, Is::Idle, Do::None),
        (Is::Jog, On::Done, Is::Idle, Do::None),
        (Is::HoldSlowing, On::Stopped, Is::HoldComplete, Do::None),
        (Is::DoorRetracting, On::Stopped, Is::DoorAjar, Do::SwitchOff),
        (Is::DoorAjar, On::Park, Is::DoorRetracting, Do::None),
        (Is::DoorRetracting, On::Parked, Is::DoorAjar, Do::None),
        (Is::DoorRestoring, On::Restored, Is::Idle, Do::Resume),
        (Is::Idle, On::Pause, Is::HoldComplete, Do::None),
        (Is::Run, On::Reset, Is::Alarm, Do::Abort),
        (Is::HoldSlowing, On::Reset, Is::Alarm, Do::Abort),
        (Is::Jog, On::Reset, Is::Alarm, Do::Abort),
        (Is::Home, On::Reset, Is::Alarm, Do::Abort),
        (Is::DoorRetracting, On::Reset, Is::Alarm, Do::Abort),
        (Is::Alarm, On::Reset, Is::Alarm, Do::Cancel),
        (Is::Sleep, On::Reset, Is::Alarm, Do::Cancel),
        (Is::Idle, On::Reset, Is::Idle, Do::Cancel),
        (Is::HoldComplete, On::Reset, Is::Idle, Do::Cancel),
        (Is::Check, On::Reset, Is::Idle, Do::Cancel),
        (Is::DoorClosed, On::Reset, Is::Idle, Do::Cancel),
        (Is::DoorAjar, On::Reset, Is::Idle, Do::Cancel),
        (Is::DoorRestoring, On::Reset, Is::Idle, Do::Cancel),
        (Is::Alarm, On::Unlock, Is::Idle, Do::None),
        (Is::Home, On::Unlock, Is::Idle, Do::None),
        (Is::Idle, On::Home, Is::Home, Do::None),
        (Is::Alarm, On::Home, Is::Home, Do::None),
        (Is::Idle, On::Check, Is::Check, Do::None),
        (Is::Idle, On::Sleep, Is::Sleep, Do::SwitchOff),
        (Is::Alarm, On::Sleep, Is::Sleep, Do::SwitchOff),
    ];

    const EVENTS: [On; 19] = [
        On::Hold,
        On::Start,
        On::Door,
        On::DoorShut,
        On::JogCancel,
        On::Move,
        On::Jog,
        On::Done,
        On::Stopped,
        On::Park,
        On::Parked,
        On::Restored,
        On::Pause,
        On::Reset,
        On::Alarm,
        On::Unlock,
        On::Home,
        On::Check,
        On::Sleep,
    ];

    #[test]
    fn every_event_does_to_every_state_what_the_table_says() {
        for state in STATES {
            for event in EVENTS {
                let (after, effect) = Control::new(state).after(event);
                let row = CHANGES.iter().find(|row| row.0 == state && row.1 == event);
                let expected = match (event, row) {
                    (On::Alarm, _) => (Is::Alarm, Do::Cancel),
                    (_, Some(row)) => (row.2, row.3),
                    (_, None) => (state, Do::None),
                };
                assert_eq!((after.state, effect), expected, "{state:?}, {event:?}");
                let drops = matches!(effect, Do::Cancel | Do::Abort);
                assert_eq!(after.ending != Ending::None, drops, "{state:?}, {event:?}");
            }
        }
    }

    #[test]
    fn a_jog_that_is_ended_ends_in_rest_or_with_the_door_open() {
        let jog = Control::new(Is::Jog);
        for first in [On::Hold, On::JogCancel] {
            let (ending, _) = jog.after(first);
            assert_eq!(ending.after(On::Stopped), (Control::IDLE, Do::Drop));
            let (door, effect) = ending.after(On::Door);
            assert_eq!(effect, Do::None);
            assert_eq!(door.after(first).0, door);
            let (stopped, effect) = door.after(On::Stopped);
            assert_eq!((stopped.state, effect), (Is::DoorRetracting, Do::Drop));
        }
    }

    #[test]
    fn nothing_begins_before_a_plan_that_is_void_is_dropped() {
        for event in EVENTS {
            if !matches!(event, On::Stopped | On::Reset | On::Alarm) {
                for state in [Is::Idle, Is::Alarm] {
                    let ending = Control::ending(state, Ending::Drop);
                    assert_eq!(ending.after(event), (ending, Do::None), "{event:?}");
                }
            }
        }
        let jog = Control::ending(Is::Jog, Ending::Drop);
        for event in [On::Move, On::Jog, On::Start, On::Hold, On::JogCancel] {
            assert_eq!(jog.after(event), (jog, Do::None), "{event:?}");
        }
    }

    #[test]
    fn nothing_is_executed_in_a_hold_or_an_alarm_or_while_the_plan_is_void() {
        for state in STATES {
            let is_locked = matches!(state, Is::Check | Is::Alarm);
            let executes = !state.is_suspended() && !is_locked;
            assert_eq!(Control::new(state).executes(), executes);
            assert!(!Control::ending(state, Ending::Drop).executes());
        }
    }
}
