//! The stages of a line: what the session is doing, and what follows when the machine has done its part.

use super::{PathSender, persistence::AfterStore};
use crate::{
    model::{Awaited, Bootloader},
    protocol::{dollar::List, report::Feedback},
    settings::StoredLine,
};

/// What the session is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::protocol) enum LineStage {
    /// Power-up, or a reset that the machine has not yet acted on.
    Starting {
        /// Nothing was stored: the sender gets an error and the defaults before the welcome.
        is_first_boot: bool,
        /// The reset has interrupted a line, which gets its `ok` before the welcome.
        owes_answer: bool,
    },
    /// The defaults are being listed before the first welcome; this line is next.
    ListingDefaults(usize),
    /// The welcome is next.
    Welcoming,
    /// The first startup line from this one on that is not empty is next.
    StartingUp(usize),
    /// Receiving a line.
    Reading,
    /// The same, in a change of the tool: a line of the operator.
    ReadingManual,
    /// A line is complete but needs standstill; it has had no effect, and is dispatched again then.
    AwaitingStandstill,
    /// The commands of a line go to the machine; this one is next.
    Sending(usize),
    /// What compensation has released goes to the machine, then the line from this command on.
    Compensating(usize),
    /// All commands have gone to the machine; this follows when they are done.
    Completing(AfterCommands),
    /// The platform stores a change; this follows.
    Storing(AfterStore),
    /// A list is being sent; this line of it is next.
    Listing(List, usize),
    /// A list of another dialect is being sent; this line of it is next.
    ListingInDialect(usize),
    /// The line has been answered, and ends with a reset.
    Resetting,
    /// The line leaves the travel: the alarm is to be sent to the machine.
    Faulting,
    /// Only a reset ends the line, and answers it.
    Faulted,
    /// Asleep: only a reset ends it, or the bootloader that is wanted.
    Asleep(Option<Bootloader>),
}

/// What follows when the machine has done everything that a line asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::protocol) enum AfterCommands {
    /// The answer.
    Answer,
    /// A message and the answer.
    Message(Feedback),
    /// The position after a probing move, and the answer.
    Probe,
    /// The report of a missed probing move without a step, and the answer.
    Miss,
    /// The result of homing, and the startup lines after homing all axes.
    Home {
        /// The axes, bit 0 = X; 0 for all.
        mask: u8,
    },
    /// The return from a change of the tool.
    ToolPause,
    /// The rest of the line that has changed the tool.
    ToolReturn,
    /// The line, which has only waited so far.
    Again,
}

impl LineStage {
    /// Returns whether the welcome has been written.
    pub(in crate::protocol) const fn is_welcome_sent(self) -> bool {
        !matches!(
            self,
            Self::Starting { .. } | Self::ListingDefaults(_) | Self::Welcoming
        )
    }

    /// Returns whether a line has been begun and not been answered.
    pub(in crate::protocol) const fn is_line_begun(self) -> bool {
        matches!(
            self,
            Self::AwaitingStandstill
                | Self::Sending(_)
                | Self::Compensating(_)
                | Self::Completing(_)
                | Self::Storing(_)
                | Self::Faulting
                | Self::Faulted
        )
    }

    /// Returns whether the line in execution, or a startup line, moves the machine at rest without another byte.
    pub(super) fn goes_on(self, startup: &[StoredLine]) -> bool {
        let has_startup_from = |first| {
            let mut lines = startup.iter().enumerate();
            lines.any(|(number, line)| number >= first && !line.is_empty())
        };
        match self {
            Self::AwaitingStandstill | Self::Sending(_) | Self::Compensating(_) => true,
            Self::Completing(after) => match after {
                AfterCommands::ToolPause | AfterCommands::ToolReturn | AfterCommands::Again => true,
                AfterCommands::Home { mask } => mask == 0 && has_startup_from(0),
                _ => false,
            },
            Self::StartingUp(first) => has_startup_from(first),
            _ => false,
        }
    }

    /// Returns the events that let the stage continue, besides a change of the machine's state.
    pub(super) fn awaited(self, path: &PathSender) -> Awaited {
        match self {
            Self::Reading if path.blender.has_pending() => Awaited::LINE
                .union(Awaited::ENTRIES)
                .union(Awaited::SEGMENTS),
            Self::Reading | Self::ReadingManual => Awaited::LINE,
            Self::Sending(_) | Self::Compensating(_) if path.sync.waits_for_time => {
                Awaited::ENTRIES.union(Awaited::SEGMENTS)
            }
            Self::Sending(_) | Self::Compensating(_) => Awaited::ENTRIES_BATCHED,
            Self::Starting { .. }
            | Self::ListingDefaults(_)
            | Self::Welcoming
            | Self::StartingUp(_)
            | Self::AwaitingStandstill
            | Self::Completing(_)
            | Self::Storing(_)
            | Self::Listing(..)
            | Self::ListingInDialect(_)
            | Self::Resetting
            | Self::Faulting
            | Self::Faulted
            | Self::Asleep(_) => Awaited::ENTRIES,
        }
    }
}
