//! The dialect of the sender, `$780`, and what the session knows of one beside Grbl's.

use super::{
    ByteReader, Line, Text,
    checked_lines::CheckedLines,
    session::{LineStage, Reports},
};
use crate::{
    gcode::{LineError, interpreter::Interpreter},
    machine::Snapshot,
    model::{Alarm, HAS_REPRAP, Requests},
    path::Work,
    settings::{Changes, Settings, ToolTable},
};

/// What lines mean, and how they are answered.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Dialect {
    /// Grbl 1.1.
    #[default]
    Grbl,
    /// RepRap, as Marlin speaks it: lines with numbers and checksums, and without.
    RepRap,
    /// Grbl 1.1; a line may have a number and a checksum.
    CheckedGrbl,
}

impl Dialect {
    /// Returns whether lines and answers are those of a 3D printer's host. Ask by no comparison: this is also
    /// what keeps the code for them out of firmware without the feature `reprap`.
    #[must_use]
    pub const fn is_reprap(self) -> bool {
        HAS_REPRAP && matches!(self, Self::RepRap)
    }

    /// Returns the dialect that the settings ask for.
    #[must_use]
    pub const fn of(settings: &Settings) -> Self {
        match settings.dialect {
            1 => Self::RepRap,
            2 => Self::CheckedGrbl,
            _ => Self::Grbl,
        }
    }
}

/// What the session lets a dialect beside Grbl's work with.
#[derive(Debug)]
pub(super) struct SessionContext<'a> {
    pub(super) machine: &'a Snapshot,
    pub(super) requests: &'a Requests,
    pub(super) settings: &'a Settings,
    pub(super) interpreter: &'a mut Interpreter,
    pub(super) reports: &'a mut Reports,
    pub(super) lines: &'a mut CheckedLines,
    /// The line in Grbl's words.
    pub(super) input: &'a mut Line,
    /// The dialect in effect.
    pub(super) dialect: Dialect,
    pub(super) stage: LineStage,
    /// Everything that has been sent is done, and the machine stands still.
    pub(super) is_done: bool,
    /// The machine and the session have acted on all resets.
    pub(super) has_reset: bool,
    /// `prepare` has to run.
    pub(super) has_release_request: &'a mut bool,
}

/// What the session does for a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NextStep {
    /// Waits for a line.
    Wait,
    /// Goes on with the next line, as this one is blank or has been answered.
    Skip,
    /// Executes the line, which is in Grbl's words.
    Execute,
    /// Answers the line.
    Answer(Result<(), LineError>),
    /// Refuses the line, of which bytes are lost, and holds a program that moves the machine.
    RefuseLost,
    /// Goes on with the line at standstill.
    AwaitStandstill,
    /// Goes on with this line of a list.
    List(usize),
    /// Homes the axes of a mask, 0 for all.
    Home(u8),
    /// Switches the drivers on or off.
    Drivers(bool),
    /// Has the machine adopt the settings.
    Configure,
    /// Answers the line, if that is due, and resets.
    Reset { is_answered: bool },
}

/// A message that dialects have different words for.
#[derive(Debug, Clone, Copy)]
pub(super) enum SenderMessage<'a> {
    /// The first one after a reset.
    Welcome,
    /// What is damaged where it is stored.
    Damage(Changes, &'a ToolTable),
    /// The machine is locked, behind the welcome.
    Locked,
    /// An alarm.
    Alarm(Alarm),
}

/// How the session begins again after a reset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Restart {
    /// As in Grbl.
    Grbl,
    /// With these modes of power-up, and the welcome where it is due.
    Anew {
        /// The feed rate of a program that sets none, mm/min.
        feed_mm_min: f32,
        /// The welcome is due, and the settings are in effect again that were stored.
        is_welcomed: bool,
        /// Other settings than those have been in effect.
        has_limits: bool,
    },
    /// With the lines behind the stop.
    GoesOn,
}

/// What a dialect does otherwise than Grbl.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct DialectRules {
    /// A machine that has stopped still answers lines: it refuses them.
    pub(super) answers_when_stopped: bool,
    /// A locked machine executes lines that move nothing and switch nothing on.
    pub(super) executes_when_locked: bool,
    /// A reset leaves the lines that have been received.
    pub(super) keeps_lines: bool,
    /// A reset is going on, of which lines wait for the end.
    pub(super) is_restarting: bool,
    /// The limit switches of the axes that move end the line.
    pub(super) ends_at_switch: bool,
    /// A pause ends by itself.
    pub(super) is_timed: bool,
    /// Number of the next received byte that has to be looked at.
    pub(super) next_byte: Option<usize>,
}

/// A dialect beside Grbl's: how bytes and lines are read and answered. A session knows the dialect by this trait alone;
/// where the dialect is not in effect, each method leaves everything to the session.
pub(super) trait SenderDialect {
    /// Begins or ends to be in effect, and does what cannot wait for the lines before it. Returns work for the machine,
    /// if there is room for it.
    fn attend(
        &mut self,
        session: &mut SessionContext<'_>,
        received: &mut ByteReader<'_>,
        has_room: bool,
    ) -> Option<Work>;

    /// Reads the next line, or goes on with the one that has been begun. `None` in Grbl.
    fn read_line(
        &mut self,
        session: &mut SessionContext<'_>,
        received: &mut ByteReader<'_>,
    ) -> Option<NextStep>;

    /// Ends the line, and writes why it is refused. Returns false where its answer is that of Grbl.
    fn end_line(
        &mut self,
        result: Result<(), LineError>,
        lines: &CheckedLines,
        settings: &Settings,
        interpreter: &mut Interpreter,
        reports: &mut Reports,
    ) -> bool;

    /// Writes a message. Returns false where its words are those of Grbl.
    fn write(&mut self, text: &mut Text, message: SenderMessage<'_>, settings: &Settings) -> bool;

    /// Ends the reset on which the machine has acted.
    fn restart(&mut self, lines: &mut CheckedLines) -> Restart;

    /// Lets a pause that would end by itself wait for the operator. Returns whether there is one.
    fn end_timed_pause(&mut self) -> bool;

    /// Returns the settings with what a program has changed until a reset.
    fn settings_in_effect(&self, stored: &Settings) -> Settings;

    /// Returns what the dialect does otherwise than Grbl.
    fn rules(&self) -> DialectRules;
}
