//! What a page asks a [`Client`](super::Client) for, and what it is shown: JSON between them.

use serde::{Deserialize, Serialize};

use super::Probing;

/// What the operator asks for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case")]
pub enum Command {
    /// A line, which [`Event::Answer`] with the same number answers.
    Line {
        /// A number of the page's own.
        number: u32,
        /// The line without its end.
        text: String,
    },
    /// One of the bytes of [`realtime`](crate::realtime).
    Realtime {
        /// The byte.
        byte: u8,
    },
    /// A jog by a distance.
    Step {
        /// Of each axis, mm or degrees.
        by: Vec<f64>,
        /// mm/min.
        feed: f64,
    },
    /// A jog as long as a key is held: it has to come again within [`JOG_TIMEOUT_MS`](super::JOG_TIMEOUT_MS).
    Move {
        /// The number of the press: one that has ended begins no jog again.
        press: u32,
        /// Of each axis, -1, 0 or 1.
        along: Vec<i8>,
        /// mm/min.
        feed: f64,
    },
    /// The end of a jog.
    Halt,
    /// A program, for [`Command::Start`].
    Program {
        /// The name of its file.
        name: String,
        /// Its text.
        text: String,
    },
    /// Sends the program.
    Start {
        /// Its first line to send, counted from 0.
        #[serde(default)]
        line: usize,
        /// Lines that are sent before.
        #[serde(default)]
        approach: Vec<String>,
    },
    /// Ends a job or a probing cycle: a hold, and a reset at rest. Amid a job a probing cycle is held alone.
    Stop,
    /// Has the machine take lines in a change of the tool: jogs and probing, until cycle start.
    TakeLines,
    /// Begins a probing cycle.
    Probe {
        /// What, and how.
        probing: Probing,
    },
}

impl Command {
    /// Whether it is a line, or what becomes lines.
    pub(super) fn may_move(&self) -> bool {
        matches!(
            self,
            Self::Line { .. } | Self::Step { .. } | Self::Move { .. } | Self::Probe { .. }
        )
    }
}

/// What a page is shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "is", rename_all = "kebab-case")]
pub enum Event {
    /// The machine, when something has changed.
    State(Box<State>),
    /// A line that was sent or received.
    Line {
        /// By the page's side, and not by the machine.
        is_sent: bool,
        /// Without its end.
        text: String,
    },
    /// The answer to a line.
    Answer {
        /// That of [`Command::Line`].
        number: u32,
        /// What came before the response.
        lines: Vec<String>,
        /// `ok`, `error:9`, or nothing where the machine was reset.
        response: String,
    },
    /// What the operator is to read.
    Note {
        /// A sentence.
        text: String,
    },
}

/// What a machine does.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// It answers.
    pub is_there: bool,
    /// As reported, with its number: `Hold:0`.
    pub state: String,
    /// The machine position, mm or inches.
    pub machine: Vec<f64>,
    /// The work position, the same.
    pub work: Vec<f64>,
    /// The feed now, mm/min or inches/min.
    pub feed: f64,
    /// The spindle's speed now, rpm.
    pub spindle: f64,
    /// Of feed, rapids and spindle, %.
    pub overrides: [u16; 3],
    /// What is on: `S` or `C` spindle, `F` flood, `M` mist.
    pub accessories: String,
    /// The inputs that are active: `P` probe, `X` to `C` limits, `D` door, `H` hold, `R` reset, `S` start.
    pub pins: String,
    /// Moves that could still wait, and bytes that could still be received, where they are reported.
    pub room: Option<(u32, u32)>,
    /// The words of `$G`.
    pub modes: Vec<String>,
    /// The number of the alarm, and what it means.
    pub alarm: Option<(String, String)>,
    /// Reports are in inches, and not in mm.
    pub reports_inches: bool,
    /// A probing cycle is under way.
    pub is_probing: bool,
    /// Where the reference tool has made contact, as machine position Z, mm, once it was measured.
    pub reference_mm: Option<f64>,
    /// The machine position at the switches, in the unit of reports, since the machine was homed by this client.
    pub homed: Option<Vec<f64>>,
    /// The program, and how far the job is.
    pub job: Option<JobState>,
}

/// A program, and how far it is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JobState {
    /// The name of the file.
    pub name: String,
    /// Its lines.
    pub lines: usize,
    /// The line from which it was started, counted from 0.
    pub first: usize,
    /// Lines that the machine has answered, with those before the first.
    pub answered: usize,
    /// Lines before the one that is carried out; 0 where that is not known.
    pub executed: usize,
    /// Whether it has begun and not ended.
    pub is_running: bool,
    /// The machine stands still amid it: in a hold, a pause, behind the door or in a change of the tool.
    pub is_held: bool,
    /// For what it waits, unless the operator holds it: the machine's last message.
    pub waits: Option<String>,
    /// Lines, jogs and probing are taken now, in a change of the tool.
    pub takes_lines: bool,
    /// How it has ended, or why it is being stopped; nothing before.
    pub outcome: String,
}
