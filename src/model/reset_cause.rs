//! Why the firmware has begun to run.

use super::Alarm;

/// The cause of the last reset of the chip.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum ResetCause {
    /// The power was switched on, or was too low for a while.
    #[default]
    Power = 1,
    /// The reset pin.
    Pin,
    /// A debugger, or a bootloader.
    Software,
    /// The watchdog: a task did not come to its end.
    Watchdog,
    /// A panic.
    Panic,
    /// A fault of the processor, as of a stack that is too deep.
    Processor,
    /// An interrupt that no task has.
    Interrupt,
    /// The crystal has stopped.
    Clock,
    /// The supply has fallen below what the chip needs.
    Supply,
}

impl ResetCause {
    /// Every cause.
    pub const ALL: [Self; 9] = [
        Self::Power,
        Self::Pin,
        Self::Software,
        Self::Watchdog,
        Self::Panic,
        Self::Processor,
        Self::Interrupt,
        Self::Clock,
        Self::Supply,
    ];

    /// Returns the alarm with which the machine comes up: after a fault, whatever it did has ended in the
    /// middle of it.
    #[must_use]
    pub const fn alarm(self) -> Option<Alarm> {
        match self {
            Self::Power | Self::Pin | Self::Software => None,
            Self::Watchdog
            | Self::Panic
            | Self::Processor
            | Self::Interrupt
            | Self::Clock
            | Self::Supply => Some(Alarm::Restarted),
        }
    }

    /// Returns the cause in a few words.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::Power => "power",
            Self::Pin => "reset pin",
            Self::Software => "software",
            Self::Watchdog => "watchdog",
            Self::Panic => "panic",
            Self::Processor => "processor fault",
            Self::Interrupt => "unknown interrupt",
            Self::Clock => "crystal stopped",
            Self::Supply => "supply too low",
        }
    }
}
