//! A break condition on the serial line: an operator's or a cable's, after which the machine is held.

use crate::model::State;

/// A break on the serial line that has not had its whole effect yet.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum LineBreak {
    /// There is none.
    #[default]
    None,
    /// It has had no effect yet.
    Pending,
    /// It has ended a jog; the work that waits behind the jog is still to be held.
    JogEnded,
}

/// What there is for the machine to do, beside a motion that is being stopped.
#[derive(Debug, Clone, Copy)]
pub(super) struct WorkLeft {
    /// Something that has been sent is not done.
    pub(super) is_moving: bool,
    /// A line has been received.
    pub(super) has_line: bool,
    /// The line in execution, or a startup line, moves the machine at rest without another byte.
    pub(super) goes_on: bool,
}

impl LineBreak {
    /// After a break on the line, ends a jog, holds what runs or waits, as `!` does. Returns whether the machine is to
    /// be held, or nothing where something that cannot be held ends first: a homing cycle, a jog being stopped, and an
    /// alarm as long as lines wait in it.
    ///
    /// At Idle `!` holds, too, but a break with nothing to hold does not: adapters make one when a port is opened or a
    /// board is plugged in, and a machine that nobody has moved must not want a `~` first. Nor does it end a wait for
    /// the operator.
    #[cold]
    pub(super) fn take_hold(&mut self, state: State, left: WorkLeft) -> Option<bool> {
        let has_its_end_first = match state {
            State::Home => true,
            State::Jog => *self == Self::JogEnded,
            // What waits may unlock the machine, and then move it.
            State::Alarm => left.has_line || left.goes_on,
            _ => false,
        };
        if has_its_end_first {
            return None;
        }
        *self = if state == State::Jog {
            Self::JogEnded
        } else {
            Self::None
        };
        let has_work = left.is_moving || left.has_line;
        Some(match state {
            State::Idle | State::Run => has_work || left.goes_on,
            State::Jog | State::Tool => has_work,
            State::DoorRestoring => true,
            _ => false,
        })
    }
}
