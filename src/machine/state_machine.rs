//! The state machine: the new state after each event in each state.
//!
//! [`Control::after`] is a pure function. The plan and the outputs are changed by its caller, as the
//! returned [`Effect`] says. Read with Grbl 1.1 `protocol.c`,
//! `protocol_exec_rt_system`.
//!
//! ```text
//!            !            at rest            0x84
//!   Run ---------> Hold:1 -------> Hold:0 ---------> Door:1 <--> Door:0 ---> Door:3
//!    ^ \                             | ~     at rest  ^      pin   ^     ~      |
//!    |  `-- 0x84 --> Door:2 ---------|----------------'            '---- ! -----+ restored
//!    '------------------ Idle <------+------------------------------------------'
//! ```
//!
//! In a change of the tool, 0xA3 makes [`State::Tool`] of the hold: it is what Idle is otherwise, up to
//! cycle start.

use crate::model::State;

/// An event to which the machine reacts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A feed hold is requested.
    FeedHold,
    /// Cycle start is requested.
    CycleStart,
    /// The safety door has been opened.
    SafetyDoor,
    /// The safety door is closed.
    DoorClosed,
    /// The end of jogging is requested.
    JogCancel,
    /// A block of a program waits for execution.
    Move,
    /// A block of a jog waits for execution.
    Jog,
    /// Every block has been executed and the machine is at rest.
    CycleStop,
    /// The machine has come to rest after an order to stop.
    Stopped,
    /// Z is to be lifted out of the work.
    Park,
    /// Z is parked.
    Parked,
    /// Spindle and coolant run again after the door was open.
    Restored,
    /// A program pause.
    Pause,
    /// The operator's lines are to be executed while the machine waits for a tool.
    ChangeTool,
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

impl Event {
    /// Every event.
    pub const ALL: [Self; 20] = [
        Self::FeedHold,
        Self::CycleStart,
        Self::SafetyDoor,
        Self::DoorClosed,
        Self::JogCancel,
        Self::Move,
        Self::Jog,
        Self::CycleStop,
        Self::Stopped,
        Self::Park,
        Self::Parked,
        Self::Restored,
        Self::Pause,
        Self::ChangeTool,
        Self::Reset,
        Self::Alarm,
        Self::Unlock,
        Self::Home,
        Self::Check,
        Self::Sleep,
    ];
}

/// The action that a change of state requires.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// Nothing.
    None,
    /// The program goes on.
    Resume,
    /// Spindle and coolant are switched off, after parking where the door was opened.
    Suspend,
    /// Spindle and coolant are switched on again, one after the other.
    Restore,
    /// The plan is void: at rest it is dropped, with the entries that the interpreter has sent before noticing the
    /// cancellation.
    MotionCancel,
    /// The plan is dropped.
    DropPlan,
    /// A reset found the machine in motion.
    Abort,
}

/// What happens to the plan when the machine has come to rest.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Ending {
    /// It is kept.
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
    /// Other than [`Ending::None`] while the machine slows down to drop its plan.
    pub ending: Ending,
    /// In a change of the tool, where [`State::Tool`] takes the place of [`State::Idle`].
    pub is_changing_tool: bool,
}

impl Control {
    /// The state after power-up: at rest, without a plan.
    pub const IDLE: Self = Self::new(State::Idle);

    const fn new(state: State) -> Self {
        Self::ending(state, Ending::None)
    }

    const fn ending(state: State, ending: Ending) -> Self {
        Self {
            state,
            ending,
            is_changing_tool: matches!(state, State::Tool),
        }
    }

    /// Returns whether blocks are executed.
    #[must_use]
    pub const fn executes(self) -> bool {
        match self.ending {
            Ending::Drop | Ending::DropThenDoor => false,
            Ending::None => match self.state {
                State::Idle | State::Run | State::Jog | State::Home | State::Tool => true,
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

    /// Returns whether the opened safety door changes the state.
    #[must_use]
    pub const fn reacts_to_door(self) -> bool {
        !matches!(self.state, State::Alarm | State::Check | State::Home)
    }

    /// Returns the state after an event, and the effect.
    #[inline(never)]
    #[must_use]
    pub fn after(self, event: Event) -> (Self, Effect) {
        let is_tool = self.state == State::Tool;
        match event {
            Event::CycleStart if is_tool => return to(State::Idle),
            Event::Check if is_tool => return (self, Effect::None),
            _ => {}
        }
        let mut before = self;
        if is_tool {
            before.state = State::Idle;
        }
        let (mut after, effect) = before.after_in_program(event);
        after.is_changing_tool |= self.is_changing_tool && event != Event::Reset;
        if after.is_changing_tool && after.state == State::Idle {
            after.state = State::Tool;
        }
        (after, effect)
    }

    /// The same outside of a change of the tool.
    #[inline]
    fn after_in_program(self, event: Event) -> (Self, Effect) {
        let same = (self, Effect::None);
        let is_ending = self.ending != Ending::None && self.state != State::Jog;
        if is_ending && !matches!(event, Event::Stopped | Event::Reset | Event::Alarm) {
            // Other events are ignored until the plan is dropped.
            return same;
        }
        match event {
            Event::FeedHold => self.hold(),
            Event::CycleStart => self.start(),
            Event::SafetyDoor => self.door(),
            Event::DoorClosed if self.state == State::DoorAjar => to(State::DoorClosed),
            Event::JogCancel if self.state == State::Jog => self.cancel(Ending::Drop),
            Event::Move if self.state == State::Idle => to(State::Run),
            Event::Jog if self.state == State::Idle => to(State::Jog),
            Event::CycleStop if self.state == State::Run => to(State::Idle),
            Event::CycleStop if self.state == State::Jog && self.ending == Ending::None => {
                to(State::Idle)
            }
            Event::Stopped => self.stopped(),
            Event::Park if self.state == State::DoorAjar => to(State::DoorRetracting),
            Event::Parked if self.state == State::DoorRetracting => to(State::DoorAjar),
            Event::Restored if self.state == State::DoorRestoring => (Self::IDLE, Effect::Resume),
            Event::Pause if self.state == State::Idle => to(State::HoldComplete),
            Event::ChangeTool if self.state == State::HoldComplete => {
                (Self::new(State::Tool), Effect::Resume)
            }
            Event::Reset => self.reset(),
            Event::Alarm => (
                Self::ending(State::Alarm, Ending::Drop),
                Effect::MotionCancel,
            ),
            Event::Unlock if matches!(self.state, State::Alarm | State::Home) => to(State::Idle),
            Event::Home if matches!(self.state, State::Idle | State::Alarm) => to(State::Home),
            Event::Check if self.state == State::Idle => to(State::Check),
            Event::Sleep if matches!(self.state, State::Idle | State::Alarm) => {
                (Self::new(State::Sleep), Effect::Suspend)
            }
            Event::DoorClosed
            | Event::JogCancel
            | Event::Move
            | Event::Jog
            | Event::CycleStop
            | Event::Park
            | Event::Parked
            | Event::Restored
            | Event::Pause
            | Event::ChangeTool
            | Event::Unlock
            | Event::Home
            | Event::Check
            | Event::Sleep => same,
        }
    }

    fn hold(self) -> (Self, Effect) {
        match self.state {
            State::Run => to(State::HoldSlowing),
            State::Idle | State::Tool => to(State::HoldComplete),
            // A jog is not resumed.
            State::Jog => self.cancel(Ending::Drop),
            // Nothing comes on again before another cycle start.
            State::DoorRestoring => (Self::new(State::DoorAjar), Effect::Suspend),
            State::HoldSlowing
            | State::HoldComplete
            | State::Home
            | State::Check
            | State::DoorClosed
            | State::DoorAjar
            | State::DoorRetracting
            | State::Sleep
            | State::Alarm => (self, Effect::None),
        }
    }

    fn start(self) -> (Self, Effect) {
        match self.state {
            State::HoldComplete => (Self::IDLE, Effect::Resume),
            State::DoorClosed => (Self::new(State::DoorRestoring), Effect::Restore),
            State::Idle
            | State::Tool
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
            State::Idle | State::Tool | State::HoldComplete | State::DoorRestoring => {
                (Self::new(State::DoorAjar), Effect::Suspend)
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

    /// Ends a jog. An opened door is not forgotten.
    fn cancel(self, ending: Ending) -> (Self, Effect) {
        match self.ending {
            Ending::None => (Self::ending(self.state, ending), Effect::MotionCancel),
            Ending::Drop => (Self::ending(self.state, ending), Effect::None),
            Ending::DropThenDoor => (self, Effect::None),
        }
    }

    fn stopped(self) -> (Self, Effect) {
        let next = match self.state {
            State::HoldSlowing => State::HoldComplete,
            State::DoorRetracting => {
                return (Self::new(State::DoorAjar), Effect::Suspend);
            }
            State::Jog if self.ending == Ending::DropThenDoor => State::DoorRetracting,
            State::Jog if self.ending == Ending::Drop => State::Idle,
            State::Idle
            | State::Tool
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
            Ending::Drop | Ending::DropThenDoor => (Self::new(next), Effect::DropPlan),
        }
    }

    fn reset(self) -> (Self, Effect) {
        match self.state {
            State::Run | State::HoldSlowing | State::Jog | State::Home | State::DoorRetracting => {
                (Self::ending(State::Alarm, Ending::Drop), Effect::Abort)
            }
            State::Alarm | State::Sleep => (
                Self::ending(State::Alarm, Ending::Drop),
                Effect::MotionCancel,
            ),
            State::Idle
            | State::Tool
            | State::HoldComplete
            | State::Check
            | State::DoorClosed
            | State::DoorAjar
            | State::DoorRestoring => (
                Self::ending(State::Idle, Ending::Drop),
                Effect::MotionCancel,
            ),
        }
    }
}

fn to(state: State) -> (Control, Effect) {
    (Control::new(state), Effect::None)
}

#[cfg(test)]
mod tests {
    use super::{Effect as Do, Event as On, State as Is, *};

    /// Every change: before, event, after, effect. All other events change nothing.
    #[rustfmt::skip]
    const CHANGES: &[(Is, On, Is, Do)] = &[
        (Is::Run, On::FeedHold, Is::HoldSlowing, Do::None),
        (Is::Idle, On::FeedHold, Is::HoldComplete, Do::None),
        (Is::Jog, On::FeedHold, Is::Jog, Do::MotionCancel),
        (Is::DoorRestoring, On::FeedHold, Is::DoorAjar, Do::Suspend),
        (Is::HoldComplete, On::CycleStart, Is::Idle, Do::Resume),
        (Is::DoorClosed, On::CycleStart, Is::DoorRestoring, Do::Restore),
        (Is::Run, On::SafetyDoor, Is::DoorRetracting, Do::None),
        (Is::HoldSlowing, On::SafetyDoor, Is::DoorRetracting, Do::None),
        (Is::Idle, On::SafetyDoor, Is::DoorAjar, Do::Suspend),
        (Is::HoldComplete, On::SafetyDoor, Is::DoorAjar, Do::Suspend),
        (Is::DoorRestoring, On::SafetyDoor, Is::DoorAjar, Do::Suspend),
        (Is::DoorClosed, On::SafetyDoor, Is::DoorAjar, Do::None),
        (Is::Jog, On::SafetyDoor, Is::Jog, Do::MotionCancel),
        (Is::DoorAjar, On::DoorClosed, Is::DoorClosed, Do::None),
        (Is::Jog, On::JogCancel, Is::Jog, Do::MotionCancel),
        (Is::Idle, On::Move, Is::Run, Do::None),
        (Is::Idle, On::Jog, Is::Jog, Do::None),
        (Is::Run, On::CycleStop, Is::Idle, Do::None),
        (Is::Jog, On::CycleStop, Is::Idle, Do::None),
        (Is::HoldSlowing, On::Stopped, Is::HoldComplete, Do::None),
        (Is::DoorRetracting, On::Stopped, Is::DoorAjar, Do::Suspend),
        (Is::DoorAjar, On::Park, Is::DoorRetracting, Do::None),
        (Is::DoorRetracting, On::Parked, Is::DoorAjar, Do::None),
        (Is::DoorRestoring, On::Restored, Is::Idle, Do::Resume),
        (Is::Idle, On::Pause, Is::HoldComplete, Do::None),
        (Is::Run, On::Reset, Is::Alarm, Do::Abort),
        (Is::HoldSlowing, On::Reset, Is::Alarm, Do::Abort),
        (Is::Jog, On::Reset, Is::Alarm, Do::Abort),
        (Is::Home, On::Reset, Is::Alarm, Do::Abort),
        (Is::DoorRetracting, On::Reset, Is::Alarm, Do::Abort),
        (Is::Alarm, On::Reset, Is::Alarm, Do::MotionCancel),
        (Is::Sleep, On::Reset, Is::Alarm, Do::MotionCancel),
        (Is::Idle, On::Reset, Is::Idle, Do::MotionCancel),
        (Is::HoldComplete, On::Reset, Is::Idle, Do::MotionCancel),
        (Is::Check, On::Reset, Is::Idle, Do::MotionCancel),
        (Is::DoorClosed, On::Reset, Is::Idle, Do::MotionCancel),
        (Is::DoorAjar, On::Reset, Is::Idle, Do::MotionCancel),
        (Is::DoorRestoring, On::Reset, Is::Idle, Do::MotionCancel),
        (Is::Alarm, On::Unlock, Is::Idle, Do::None),
        (Is::Home, On::Unlock, Is::Idle, Do::None),
        (Is::Idle, On::Home, Is::Home, Do::None),
        (Is::Alarm, On::Home, Is::Home, Do::None),
        (Is::Idle, On::Check, Is::Check, Do::None),
        (Is::Idle, On::Sleep, Is::Sleep, Do::Suspend),
        (Is::Alarm, On::Sleep, Is::Sleep, Do::Suspend),
        (Is::HoldComplete, On::ChangeTool, Is::Tool, Do::Resume),
        (Is::Tool, On::CycleStart, Is::Idle, Do::None),
        (Is::Tool, On::FeedHold, Is::HoldComplete, Do::None),
        (Is::Tool, On::SafetyDoor, Is::DoorAjar, Do::Suspend),
        (Is::Tool, On::Move, Is::Run, Do::None),
        (Is::Tool, On::Jog, Is::Jog, Do::None),
        (Is::Tool, On::Pause, Is::HoldComplete, Do::None),
        (Is::Tool, On::Reset, Is::Idle, Do::MotionCancel),
        (Is::Tool, On::Home, Is::Home, Do::None),
        (Is::Tool, On::Sleep, Is::Sleep, Do::Suspend),
    ];

    #[test]
    fn every_event_does_to_every_state_what_the_table_says() {
        for state in Is::ALL {
            for event in On::ALL {
                let (after, effect) = Control::new(state).after(event);
                let row = CHANGES.iter().find(|row| row.0 == state && row.1 == event);
                let expected = match (event, row) {
                    (On::Alarm, _) => (Is::Alarm, Do::MotionCancel),
                    (_, Some(row)) => (row.2, row.3),
                    (_, None) => (state, Do::None),
                };
                assert_eq!((after.state, effect), expected, "{state:?}, {event:?}");
                let drops = matches!(effect, Do::MotionCancel | Do::Abort);
                assert_eq!(after.ending != Ending::None, drops, "{state:?}, {event:?}");
            }
        }
    }

    #[test]
    fn a_jog_that_is_ended_ends_in_rest_or_with_the_door_open() {
        let jog = Control::new(Is::Jog);
        for first in [On::FeedHold, On::JogCancel] {
            let (ending, _) = jog.after(first);
            assert_eq!(ending.after(On::Stopped), (Control::IDLE, Do::DropPlan));
            let (door, effect) = ending.after(On::SafetyDoor);
            assert_eq!(effect, Do::None);
            assert_eq!(door.after(first).0, door);
            let (stopped, effect) = door.after(On::Stopped);
            assert_eq!((stopped.state, effect), (Is::DoorRetracting, Do::DropPlan));
        }
    }

    #[test]
    fn in_a_change_of_the_tool_everything_comes_back_to_it_but_cycle_start_and_a_reset() {
        let tool = Control::new(Is::HoldComplete).after(On::ChangeTool).0;
        for events in [
            &[On::Jog, On::CycleStop][..],
            &[On::Jog, On::JogCancel, On::Stopped],
            &[On::Move, On::CycleStop],
            &[
                On::Move,
                On::FeedHold,
                On::Stopped,
                On::CycleStart,
                On::Move,
                On::CycleStop,
            ],
            &[On::FeedHold, On::CycleStart],
            &[On::SafetyDoor, On::DoorClosed, On::CycleStart, On::Restored],
            &[On::Jog, On::Alarm, On::Stopped, On::Unlock],
            &[On::Home, On::Unlock],
        ] {
            let after = events
                .iter()
                .fold(tool, |state, event| state.after(*event).0);
            assert_eq!(after, tool, "{events:?}");
            let left = after.after(On::CycleStart).0;
            assert_eq!(left, Control::IDLE);
        }
        let reset = tool.after(On::Jog).0.after(On::Reset).0;
        let unlocked = reset.after(On::Stopped).0.after(On::Unlock).0;
        assert_eq!(unlocked, Control::IDLE);
    }

    #[test]
    fn nothing_begins_before_a_plan_that_is_void_is_dropped() {
        for event in On::ALL {
            if !matches!(event, On::Stopped | On::Reset | On::Alarm) {
                for state in [Is::Idle, Is::Alarm] {
                    let ending = Control::ending(state, Ending::Drop);
                    assert_eq!(ending.after(event), (ending, Do::None), "{event:?}");
                }
            }
        }
        let jog = Control::ending(Is::Jog, Ending::Drop);
        for event in [
            On::Move,
            On::Jog,
            On::CycleStart,
            On::FeedHold,
            On::JogCancel,
        ] {
            assert_eq!(jog.after(event), (jog, Do::None), "{event:?}");
        }
    }

    #[test]
    fn nothing_is_executed_in_a_hold_or_an_alarm_or_while_the_plan_is_void() {
        for state in Is::ALL {
            let is_locked = matches!(state, Is::Check | Is::Alarm);
            let executes = !state.is_suspended() && !is_locked;
            assert_eq!(Control::new(state).executes(), executes);
            assert!(!Control::ending(state, Ending::Drop).executes());
        }
    }
}
