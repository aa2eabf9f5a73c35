//! Alarms, the reasons for which the machine locks itself, with Grbl's numbers.

use core::fmt;

/// The reason for which the machine is locked until it is unlocked, homed or reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Alarm {
    /// A limit switch closed.
    HardLimit = 1,
    /// A target is outside the travel.
    SoftLimit = 2,
    /// A reset while an axis moved.
    ResetInMotion = 3,
    /// The probe was closed before probing, or open before probing away.
    ProbeState = 4,
    /// The probe did not close, or open, on its way.
    ProbeContact = 5,
    /// A reset during homing.
    HomingReset = 6,
    /// The safety door opened during homing.
    HomingDoor = 7,
    /// A limit switch was still closed after the pull-off.
    HomingPullOff = 8,
    /// No limit switch was found.
    HomingNotFound = 9,
    /// The second motor of an axis found no limit switch.
    HomingDualAxis = 10,
    /// The probe made contact in a move that is no probing move.
    UnexpectedContact = 13,
    /// The crystal does not run, or the supply is too low: nothing may move.
    SelfTest = 16,
    /// The watchdog or a fault has restarted the firmware.
    Restarted = 200,
    /// `M112`.
    Killed = 201,
}

impl Alarm {
    /// Every alarm, in the order of the numbers.
    pub const ALL: [Self; 14] = [
        Self::HardLimit,
        Self::SoftLimit,
        Self::ResetInMotion,
        Self::ProbeState,
        Self::ProbeContact,
        Self::HomingReset,
        Self::HomingDoor,
        Self::HomingPullOff,
        Self::HomingNotFound,
        Self::HomingDualAxis,
        Self::UnexpectedContact,
        Self::SelfTest,
        Self::Restarted,
        Self::Killed,
    ];

    /// Returns Grbl's number.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// Returns whether the axes are where their coordinates say, after the alarm: no steps were lost.
    #[must_use]
    pub const fn keeps_position(self) -> bool {
        match self {
            Self::SoftLimit
            | Self::ProbeState
            | Self::ProbeContact
            | Self::UnexpectedContact
            | Self::Killed => true,
            Self::HardLimit
            | Self::ResetInMotion
            | Self::HomingReset
            | Self::HomingDoor
            | Self::HomingPullOff
            | Self::HomingNotFound
            | Self::HomingDualAxis
            | Self::SelfTest
            | Self::Restarted => false,
        }
    }

    /// Returns the reason in one line.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::HardLimit => "a limit switch closed: the position is lost",
            Self::SoftLimit => "the target is outside the machine's travel",
            Self::ResetInMotion => "reset while moving",
            Self::ProbeState => "the probe was not in its expected state before the move",
            Self::ProbeContact => "the probe made no contact",
            Self::HomingReset => "homing failed: reset",
            Self::HomingDoor => "homing failed: the safety door opened",
            Self::HomingPullOff => "homing failed: the switch stayed closed after the pull-off",
            Self::HomingNotFound => "homing failed: no limit switch was found",
            Self::HomingDualAxis => "homing failed: the second motor found no limit switch",
            Self::UnexpectedContact => "the probe made contact outside of a probing move",
            Self::SelfTest => "the self-test at power-up failed: crystal, supply, chip or firmware",
            Self::Restarted => "restarted by the watchdog or after a fault: the position is lost",
            Self::Killed => "stopped by M112",
        }
    }
}

impl fmt::Display for Alarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ALARM:{}", self.number())
    }
}

impl core::error::Error for Alarm {}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn alarms_have_grbls_numbers_and_a_text_of_one_line() {
        for (alarm, number) in Alarm::ALL
            .into_iter()
            .zip((1..=10).chain([13, 16, 200, 201]))
        {
            assert_eq!(alarm.number(), number);
            assert_eq!(alarm.to_string(), std::format!("ALARM:{number}"));
            assert!(!alarm.text().is_empty() && !alarm.text().contains('\n'));
        }
    }
}
