//! The actions of a sender and of a hand at the machine, one after the other, and the expected results.

use std::path::PathBuf;

use board_data::{Board, Input};

use crate::{chip::FittedParts, plant::Closes, usb_host::HostAction};

/// Something that is done or looked at. After a wait for something that does not come, the rest of the case is left
/// out.
#[derive(Debug, Clone)]
pub(crate) enum Act {
    /// A part of the report begins.
    Part(&'static str),
    /// A case of the part begins: the supply is switched on.
    Case(String, PowerUp),
    /// A line is sent; it is answered with `ok`.
    Line(String),
    /// A line is sent; it is answered with an error.
    Refused(&'static str),
    /// Lines are sent as long as the receive buffer has room; all are answered.
    Stream(Vec<String>),
    /// Bytes are sent; nothing is waited for.
    Bytes(&'static [u8]),
    /// A line comes that begins with this.
    Await(&'static str),
    /// Reports are asked for until one has this state.
    State(&'static str),
    /// Reports are asked for until one has this in it.
    Field(&'static str),
    /// Nothing is done for some ms.
    Pause(u64),
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
    /// What is stored from the beginning of the case on is counted.
    CountStored,
    /// The supply is cut once a part of that has been stored from here on: nothing is stored any more.
    CutAfter(Cut),
    /// The settings that were listed in this case are remembered.
    Remember,
    /// Something is done at the host of a board with USB.
    Host(HostAction),
    /// The registers are compared with the board's file.
    Compare,
    /// What must have come in this case.
    Want(Wanted),
}

/// A part of what is stored, in words, of an EEPROM in bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Cut {
    /// So many.
    After(usize),
    /// The half.
    Half,
    /// All but so many.
    Before(usize),
}

/// What is found when the supply is switched on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PowerUp {
    pub(crate) fitted: FittedParts,
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
            fitted: FittedParts::of(board),
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
    /// Resets of the chip by these causes.
    Resets(&'static [&'static str]),
    /// The listed settings equal the remembered ones, but for this setting.
    Remembered(&'static str),
    /// The supply was cut.
    Cut,
    /// The chip's own bootloader has begun so many times without a reset.
    HandedOver(usize),
    /// The mark for `TinyUF2` was in RAM at the last reset.
    Uf2Mark,
    /// So many steps of each axis, or some of motors that are driven by phases.
    Moved(usize),
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
    /// It is not.
    Off(&'static str),
    /// It was not when the chip was reset last, nor is it now.
    Inactive(&'static str),
    /// The share of time for which the PWM is high is more than none.
    PwmOn,
    /// It is none.
    PwmOff,
    /// The steps are those of a file of step events.
    Steps(PathBuf),
}

impl Act {
    pub(crate) fn line(text: &str) -> Self {
        Self::Line(text.to_owned())
    }

    /// Whether something has to come before the next.
    pub(crate) fn is_awaited(&self) -> bool {
        matches!(
            self,
            Self::Line(_)
                | Self::Refused(_)
                | Self::Stream(_)
                | Self::StopCrystal
                | Self::Compare
                | Self::Hang
                | Self::Await(_)
                | Self::State(_)
                | Self::Field(_)
                | Self::Pause(_)
        )
    }

    /// How long it may take, virtual ms.
    pub(crate) fn limit_ms(&self) -> u64 {
        match self {
            Self::Stream(_) => 900_000,
            Self::State(_) | Self::Field(_) => 30_000,
            Self::Pause(ms) => ms + 1000,
            _ => 2_000,
        }
    }

    /// What is waited for.
    pub(crate) fn awaited(&self) -> String {
        match self {
            Self::Line(line) => format!("`ok` to {line}"),
            Self::Refused(line) => format!("an error to {line}"),
            Self::Stream(lines) => format!("the answer to one of {} lines", lines.len()),
            Self::Await(line) => format!("{line:?}"),
            Self::State(state) => format!("the state {state}"),
            Self::Field(field) => format!("a report with {field}"),
            Self::Hang => "the watchdog's reset".into(),
            other => format!("the end of {other:?}"),
        }
    }
}
