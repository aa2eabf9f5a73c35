//! What a sender and a hand at the machine do, one after the other, and what must have come of it.

use std::path::PathBuf;

use board_data::{Board, Input};

use crate::{chip::Fitted, world::Closes};

/// Something that is done or looked at. Where it waits for something that does not come, what follows in its case is
/// left out.
#[derive(Debug, Clone)]
pub(crate) enum Act {
    /// A part begins, of which is told at its end ...
    Part(&'static str),
    /// ... and a case of it: the supply is switched on.
    Case(String, PowerUp),
    /// A line is sent; it is answered with `ok` or an error.
    Line(String),
    /// Lines are sent as long as the receive buffer has room; all are answered.
    Stream(Vec<String>),
    /// Bytes are sent; nothing is waited for.
    Bytes(&'static [u8]),
    /// A line comes that begins with this.
    Await(&'static str),
    /// Reports are asked for until one has this state.
    State(&'static str),
    /// Nothing is done for some ms.
    Rest(u64),
    /// A contact closes.
    Press(Input),
    /// It opens.
    Release(Input),
    /// A contact is mounted that a motor closes.
    Mount(Input, Closes),
    /// The supply has another voltage, mV.
    Supply(u32),
    /// The crystal stops.
    StopCrystal,
    /// The core does nothing more until the chip is reset.
    Hang,
    /// The reset pin is pulled.
    Reset,
    /// The supply is cut once the firmware has stored so many words from here on: nothing is stored any more.
    CutAfter(usize),
    /// The registers are compared with the board's file.
    Compare,
    /// What must have come in this case.
    Want(Wanted),
}

/// What is found when the supply is switched on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PowerUp {
    pub(crate) fitted: Fitted,
    /// The number of the bootloader that runs first; without one, the firmware begins.
    pub(crate) bootloader: Option<usize>,
    /// One letter of the firmware is another.
    pub(crate) is_damaged: bool,
    /// The EEPROM answers.
    pub(crate) has_eeprom: bool,
    /// Another firmware has left something in the sectors of the settings.
    pub(crate) is_used: bool,
}

impl PowerUp {
    /// What the board's file says, and a firmware that has just been written.
    pub(crate) fn of(board: &Board) -> Self {
        Self {
            fitted: Fitted::of(board),
            bootloader: None,
            is_damaged: false,
            has_eeprom: true,
            is_used: false,
        }
    }
}

/// What must be so, in the case that runs.
#[derive(Debug, Clone)]
pub(crate) enum Wanted {
    /// A line that begins with this, so many times.
    Lines(String, usize),
    /// A line that begins with one of these.
    OneOf(&'static [&'static str]),
    /// No line that begins with this.
    No(&'static str),
    /// So many resets of the chip.
    Resets(usize),
    /// So many sectors that are erased.
    Erased(usize),
    /// No step.
    NoStep,
    /// The core's frequency, MHz.
    CoreMhz(u64),
    /// X is where the last report has it.
    Position,
    /// An output was active.
    Active(&'static str),
    /// The steps are those of a file of step events.
    Steps(PathBuf),
}

impl Act {
    pub(crate) fn line(text: &str) -> Self {
        Self::Line(text.to_owned())
    }

    /// How long it may take, virtual ms.
    pub(crate) fn limit_ms(&self) -> u64 {
        match self {
            Self::Stream(_) => 900_000,
            Self::State(_) => 30_000,
            Self::Rest(ms) => ms + 1000,
            _ => 2_000,
        }
    }

    /// What is waited for.
    pub(crate) fn awaited(&self) -> String {
        match self {
            Self::Line(line) => format!("the answer to {line}"),
            Self::Stream(lines) => format!("the answer to one of {} lines", lines.len()),
            Self::Await(line) => format!("{line:?}"),
            Self::State(state) => format!("the state {state}"),
            Self::Hang => "the watchdog's reset".into(),
            other => format!("the end of {other:?}"),
        }
    }
}
