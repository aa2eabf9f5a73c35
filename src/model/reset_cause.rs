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

    /// Returns the cause of a reset from the fault recorded before the reset, if any, and from the flags of the chip.
    /// Several flags may be set: the reset pin moves in each reset, and power that is switched on is a low supply.
    #[must_use]
    pub fn of(recorded: Option<Self>, is_flagged: impl Fn(Self) -> bool) -> Self {
        /// What the flags of the chip show besides [`Self::Power`], the most special first.
        const BY_PRECEDENCE: [ResetCause; 4] = [
            ResetCause::Watchdog,
            ResetCause::Supply,
            ResetCause::Software,
            ResetCause::Pin,
        ];
        // Memory that has had no power is no record.
        if is_flagged(Self::Power) {
            return Self::Power;
        }
        recorded
            .or_else(|| BY_PRECEDENCE.into_iter().find(|cause| is_flagged(*cause)))
            .unwrap_or_default()
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    /// The cause where the chip flags these, and the reset pin.
    fn cause(flags: &[ResetCause], recorded: Option<ResetCause>) -> ResetCause {
        ResetCause::of(recorded, |cause| {
            flags.contains(&cause) || cause == ResetCause::Pin
        })
    }

    #[test]
    fn power_is_told_before_a_record_and_a_record_before_what_the_chip_says() {
        let all = &ResetCause::ALL;
        assert_eq!(cause(all, Some(ResetCause::Panic)), ResetCause::Power);
        for flag in [
            ResetCause::Pin,
            ResetCause::Software,
            ResetCause::Supply,
            ResetCause::Watchdog,
        ] {
            assert_eq!(cause(&[flag], None), flag);
            assert_eq!(cause(&[flag], Some(ResetCause::Panic)), ResetCause::Panic);
        }
        assert_eq!(ResetCause::of(None, |_| false), ResetCause::Power);
    }

    #[test]
    fn a_supply_that_falls_without_being_switched_off_locks_the_machine() {
        let fallen = [ResetCause::Supply];
        let is_locked = |flags: &[ResetCause]| cause(flags, None).alarm().is_some();
        assert!(is_locked(&fallen));
        assert!(!is_locked(&[ResetCause::Power, ResetCause::Supply]));
    }
}
