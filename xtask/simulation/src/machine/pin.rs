//! The inputs of the machine by the names that recordings have for them.

use std::{fmt, str::FromStr};

use anyhow::{Result, bail};
use leadscrew::{axis::LETTERS, model::Levels};

/// An input of the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pin {
    /// The limit switch of an axis.
    Limit(usize),
    /// The probe.
    Probe,
    /// The button that resets.
    Reset,
    /// The button for a feed hold.
    FeedHold,
    /// The button for cycle start.
    CycleStart,
    /// The safety door.
    Door,
}

impl Pin {
    /// The contact.
    pub fn level(self) -> Levels {
        match self {
            Self::Limit(axis) => Levels(1 << axis),
            Self::Probe => Levels::PROBE,
            Self::Reset => Levels::RESET,
            Self::FeedHold => Levels::HOLD,
            Self::CycleStart => Levels::START,
            Self::Door => Levels::DOOR,
        }
    }
}

impl FromStr for Pin {
    type Err = anyhow::Error;

    fn from_str(name: &str) -> Result<Self> {
        if let Some(letter) = name.strip_suffix("LIM")
            && let Some(axis) = LETTERS
                .iter()
                .position(|known| letter.as_bytes() == [*known])
        {
            return Ok(Self::Limit(axis));
        }
        Ok(match name {
            "PROBE" => Self::Probe,
            "RESET" => Self::Reset,
            "FEED_HOLD" | "FEEDHOLD" | "HOLD" => Self::FeedHold,
            "CYCLE_START" | "CYCLESTART" | "START" => Self::CycleStart,
            "SAFETY_DOOR" | "SAFETYDOOR" | "DOOR" => Self::Door,
            _ => bail!(
                "there is no input called {name:?}: XLIM, YLIM, …, PROBE, RESET, FEED_HOLD, \
                 CYCLE_START and DOOR are"
            ),
        })
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Limit(axis) => write!(formatter, "{}LIM", char::from(LETTERS[*axis])),
            Self::Probe => formatter.write_str("PROBE"),
            Self::Reset => formatter.write_str("RESET"),
            Self::FeedHold => formatter.write_str("FEED_HOLD"),
            Self::CycleStart => formatter.write_str("CYCLE_START"),
            Self::Door => formatter.write_str("DOOR"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_input_has_its_names() {
        for (name, pin) in [
            ("XLIM", Pin::Limit(0)),
            ("ZLIM", Pin::Limit(2)),
            ("PROBE", Pin::Probe),
            ("FEEDHOLD", Pin::FeedHold),
            ("SAFETY_DOOR", Pin::Door),
        ] {
            assert_eq!(name.parse::<Pin>().unwrap(), pin);
            assert_eq!(pin.to_string().parse::<Pin>().unwrap(), pin);
        }
        assert!("QLIM".parse::<Pin>().is_err());
        assert!("LIM".parse::<Pin>().is_err());
    }
}
