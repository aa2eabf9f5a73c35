//! The states of the machine, with Grbl's names, and how a probing move ended.

use crate::axis::Axes;

/// The state of the machine, with Grbl's names.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum State {
    /// At rest, without a block to execute.
    #[default]
    Idle,
    /// Executing blocks.
    Run,
    /// Feed hold: still slowing down (`Hold:1`).
    HoldSlowing,
    /// Feed hold: at rest (`Hold:0`).
    HoldComplete,
    /// Jogging.
    Jog,
    /// Homing.
    Home,
    /// Checking a program without moving.
    Check,
    /// The safety door is closed again, ready to resume (`Door:0`).
    DoorClosed,
    /// Stopped, the safety door is open (`Door:1`).
    DoorAjar,
    /// The safety door was opened: slowing down, or parking (`Door:2`).
    DoorRetracting,
    /// Resuming: returning from parking, spindle and coolant starting (`Door:3`).
    DoorRestoring,
    /// Everything off until a reset.
    Sleep,
    /// Locked until unlocked or homed; the machine may still be slowing down.
    Alarm,
    /// At rest in a change of the tool, while the operator's lines are executed.
    Tool,
}

impl State {
    /// Every state.
    pub const ALL: [Self; 14] = [
        Self::Idle,
        Self::Run,
        Self::HoldSlowing,
        Self::HoldComplete,
        Self::Jog,
        Self::Home,
        Self::Check,
        Self::DoorClosed,
        Self::DoorAjar,
        Self::DoorRetracting,
        Self::DoorRestoring,
        Self::Sleep,
        Self::Alarm,
        Self::Tool,
    ];

    /// Returns Grbl's name, as reports have it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Idle => "Idle",
            Self::Run => "Run",
            Self::HoldSlowing => "Hold:1",
            Self::HoldComplete => "Hold:0",
            Self::Jog => "Jog",
            Self::Home => "Home",
            Self::Check => "Check",
            Self::DoorClosed => "Door:0",
            Self::DoorAjar => "Door:1",
            Self::DoorRetracting => "Door:2",
            Self::DoorRestoring => "Door:3",
            Self::Sleep => "Sleep",
            Self::Alarm => "Alarm",
            Self::Tool => "Tool",
        }
    }

    /// Returns whether no line is begun: in a feed hold, with the door open, and asleep.
    #[must_use]
    pub const fn is_suspended(self) -> bool {
        match self {
            Self::HoldSlowing
            | Self::HoldComplete
            | Self::DoorClosed
            | Self::DoorAjar
            | Self::DoorRetracting
            | Self::DoorRestoring
            | Self::Sleep => true,
            Self::Idle
            | Self::Run
            | Self::Jog
            | Self::Home
            | Self::Check
            | Self::Alarm
            | Self::Tool => false,
        }
    }
}

/// How the last probing move ended.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Probed {
    /// Position at which the probe changed, steps. If it did not, the position at rest; or, where
    /// that is an error, the position of the probing move before.
    pub steps: Axes<i32>,
    /// Whether the probe changed.
    pub success: bool,
}
