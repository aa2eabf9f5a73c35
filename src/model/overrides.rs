//! Overrides of feed, rapid and spindle speed, in per cent. Read with Grbl 1.1 `config.h`.

/// Smallest and largest feed and spindle override, %: Grbl's.
const RANGE: (u8, u8) = (10, 200);

/// The realtime command that has the operator's lines executed while the machine waits for a tool.
pub const TOOL_CHANGE: u8 = 0xa3;

/// A realtime command that changes an override or an accessory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Override {
    /// Optional stops on, or off.
    OptionalStop = 0x88,
    /// Feed to 100 %.
    FeedReset = 0x90,
    /// Feed + 10 %.
    FeedMore = 0x91,
    /// Feed - 10 %.
    FeedLess = 0x92,
    /// Feed + 1 %.
    FeedFineMore = 0x93,
    /// Feed - 1 %.
    FeedFineLess = 0x94,
    /// Rapids to 100 %.
    RapidFull = 0x95,
    /// Rapids to 50 %.
    RapidHalf = 0x96,
    /// Rapids to 25 %.
    RapidQuarter = 0x97,
    /// Spindle to 100 %.
    SpindleReset = 0x99,
    /// Spindle + 10 %.
    SpindleMore = 0x9a,
    /// Spindle - 10 %.
    SpindleLess = 0x9b,
    /// Spindle + 1 %.
    SpindleFineMore = 0x9c,
    /// Spindle - 1 %.
    SpindleFineLess = 0x9d,
    /// Spindle off, or on again, in a hold.
    SpindleStop = 0x9e,
    /// Flood on, or off.
    Flood = 0xa0,
    /// Mist on, or off.
    Mist = 0xa1,
}

impl Override {
    /// Every command, in the order of the bytes.
    pub const ALL: [Self; 17] = [
        Self::OptionalStop,
        Self::FeedReset,
        Self::FeedMore,
        Self::FeedLess,
        Self::FeedFineMore,
        Self::FeedFineLess,
        Self::RapidFull,
        Self::RapidHalf,
        Self::RapidQuarter,
        Self::SpindleReset,
        Self::SpindleMore,
        Self::SpindleLess,
        Self::SpindleFineMore,
        Self::SpindleFineLess,
        Self::SpindleStop,
        Self::Flood,
        Self::Mist,
    ];

    /// The first byte that may be such a command.
    pub const FIRST: u8 = 0x88;

    /// Returns the command of a realtime byte.
    #[must_use]
    pub fn from_byte(byte: u8) -> Option<Self> {
        Some(match byte {
            0x88 => Self::OptionalStop,
            0x90 => Self::FeedReset,
            0x91 => Self::FeedMore,
            0x92 => Self::FeedLess,
            0x93 => Self::FeedFineMore,
            0x94 => Self::FeedFineLess,
            0x95 => Self::RapidFull,
            0x96 => Self::RapidHalf,
            0x97 => Self::RapidQuarter,
            0x99 => Self::SpindleReset,
            0x9a => Self::SpindleMore,
            0x9b => Self::SpindleLess,
            0x9c => Self::SpindleFineMore,
            0x9d => Self::SpindleFineLess,
            0x9e => Self::SpindleStop,
            0xa0 => Self::Flood,
            0xa1 => Self::Mist,
            _ => return None,
        })
    }
}

/// The overrides in effect, %.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Overrides {
    /// Of programmed feeds, 10 to 200.
    pub feed: u8,
    /// Of rapids: 25, 50 or 100.
    pub rapid: u8,
    /// Of the spindle speed, 10 to 200.
    pub spindle: u8,
    /// `M1` is a program pause.
    pub optional_stop: bool,
}

impl Overrides {
    /// Every override at 100 %.
    pub const NONE: Self = Self {
        feed: 100,
        rapid: 100,
        spindle: 100,
        optional_stop: false,
    };

    /// Returns the overrides after a command. Commands to accessories change none.
    #[must_use]
    pub fn after(self, command: Override) -> Self {
        let changed = |value: u8, change: i16| {
            let (least, most) = RANGE;
            (i16::from(value) + change).clamp(i16::from(least), i16::from(most)) as u8
        };
        let mut new = self;
        match command {
            Override::OptionalStop => new.optional_stop = !self.optional_stop,
            Override::FeedReset => new.feed = 100,
            Override::FeedMore => new.feed = changed(self.feed, 10),
            Override::FeedLess => new.feed = changed(self.feed, -10),
            Override::FeedFineMore => new.feed = changed(self.feed, 1),
            Override::FeedFineLess => new.feed = changed(self.feed, -1),
            Override::RapidFull => new.rapid = 100,
            Override::RapidHalf => new.rapid = 50,
            Override::RapidQuarter => new.rapid = 25,
            Override::SpindleReset => new.spindle = 100,
            Override::SpindleMore => new.spindle = changed(self.spindle, 10),
            Override::SpindleLess => new.spindle = changed(self.spindle, -10),
            Override::SpindleFineMore => new.spindle = changed(self.spindle, 1),
            Override::SpindleFineLess => new.spindle = changed(self.spindle, -1),
            Override::SpindleStop | Override::Flood | Override::Mist => {}
        }
        new
    }

    /// The overrides in effect where a program switches some of them off: they count as 100 %.
    #[must_use]
    pub const fn allowed_by(self, switches: OverrideSwitches) -> Self {
        Self {
            feed: if switches.feed { self.feed } else { 100 },
            rapid: self.rapid,
            spindle: if switches.spindle { self.spindle } else { 100 },
            optional_stop: self.optional_stop,
        }
    }
}

/// The overrides that a program allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OverrideSwitches {
    /// Of programmed feeds, `M50`.
    pub feed: bool,
    /// Of the spindle speed, `M51`.
    pub spindle: bool,
}

impl OverrideSwitches {
    /// Every override is allowed, `M48`.
    pub const ALL: Self = Self {
        feed: true,
        spindle: true,
    };
    /// None is allowed, `M49`.
    pub const NONE: Self = Self {
        feed: false,
        spindle: false,
    };
}

impl Default for OverrideSwitches {
    fn default() -> Self {
        Self::ALL
    }
}

impl Default for Overrides {
    fn default() -> Self {
        Self::NONE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overrides_stay_within_their_ranges() {
        let many = |command, times| {
            (0..times).fold(Overrides::NONE, |overrides, _| overrides.after(command))
        };
        assert_eq!(many(Override::FeedMore, 11).feed, 200);
        assert_eq!(many(Override::FeedLess, 10).feed, 10);
        assert_eq!(many(Override::FeedFineMore, 3).feed, 103);
        assert_eq!(many(Override::SpindleFineLess, 95).spindle, 10);
        assert_eq!(many(Override::RapidQuarter, 1).rapid, 25);
        assert_eq!(many(Override::Flood, 1), Overrides::NONE);
    }

    #[test]
    fn every_command_has_its_byte() {
        for command in Override::ALL {
            assert_eq!(Override::from_byte(command as u8), Some(command));
        }
        assert_eq!(Override::from_byte(0x98), None);
        assert_eq!(Override::from_byte(0x9f), None);
        for byte in 0..=u8::MAX {
            assert!(
                (Override::FIRST..TOOL_CHANGE).contains(&byte)
                    || Override::from_byte(byte).is_none(),
                "{byte}"
            );
        }
    }
}
