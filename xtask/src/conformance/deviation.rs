//! The deliberate deviations from Grbl: what each may explain, and nothing else.
//!
//! `docs/grbl-compatibility.md` gives the reasons. Each is found by its cause in the exchange, never
//! by the name of a recording.

use serde::{Serialize, Serializer};

/// A deliberate deviation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Deviation {
    /// D4.
    Buffers,
    /// D5.
    LongLines,
    /// D6.
    ExactPositions,
    /// D7.
    JogWithoutAxes,
    /// D8.
    SettingRanges,
    /// D9.
    StartupLines,
    /// D10.
    Arcs,
    /// D11.
    StepRates,
    /// D13.
    ToolIsModal,
    /// Follows from an answer that one of the others explains.
    Follows,
    SlowSteps,
    PromptReports,
    NoDeafness,
    QuickStorage,
    ShortStops,
    Rounding,
    RefusedChangesNothing,
    InverseTimeArcs,
    HomingMotion,
    FarTargets,
    NoPause,
    ClosedSwitch,
    LimitOpens,
    ArcLimits,
    SingleAxes,
    DarkHold,
    ArcTurns,
}

impl Deviation {
    /// Its short name.
    pub(crate) fn id(self) -> &'static str {
        match self {
            Self::Buffers => "D4",
            Self::LongLines => "D5",
            Self::ExactPositions => "D6",
            Self::JogWithoutAxes => "D7",
            Self::SettingRanges => "D8",
            Self::StartupLines => "D9",
            Self::Arcs => "D10",
            Self::StepRates => "D11",
            Self::ToolIsModal => "D13",
            Self::Follows => "follows",
            Self::SlowSteps => "D14",
            Self::PromptReports => "D15",
            Self::NoDeafness => "D16",
            Self::QuickStorage => "D17",
            Self::ShortStops => "D18",
            Self::Rounding => "D19",
            Self::RefusedChangesNothing => "D20",
            Self::InverseTimeArcs => "D21",
            Self::HomingMotion => "D22",
            Self::FarTargets => "D23",
            Self::NoPause => "D24",
            Self::ClosedSwitch => "D25",
            Self::LimitOpens => "D28",
            Self::ArcLimits => "D31",
            Self::SingleAxes => "D34",
            Self::DarkHold => "D35",
            Self::ArcTurns => "D36",
        }
    }

    /// Whether a line is executed that Grbl refuses, or the other way round, so that what follows
    /// differs too.
    pub(crate) fn has_consequences(self) -> bool {
        match self {
            Self::LongLines
            | Self::JogWithoutAxes
            | Self::SettingRanges
            | Self::StartupLines
            | Self::Arcs
            | Self::FarTargets
            | Self::ClosedSwitch
            | Self::LimitOpens
            | Self::ArcLimits
            | Self::SingleAxes
            | Self::ArcTurns
            | Self::StepRates => true,
            Self::Buffers
            | Self::ExactPositions
            | Self::ToolIsModal
            | Self::Follows
            | Self::SlowSteps
            | Self::PromptReports
            | Self::NoDeafness
            | Self::QuickStorage
            | Self::ShortStops
            | Self::Rounding
            | Self::RefusedChangesNothing
            | Self::InverseTimeArcs
            | Self::HomingMotion
            | Self::NoPause
            | Self::DarkHold => false,
        }
    }

    /// Whether the machine is in another state from then on, so that what is answered and reported
    /// differs too.
    pub(crate) fn changes_state(self) -> bool {
        matches!(
            self,
            Self::ClosedSwitch | Self::LimitOpens | Self::ArcLimits | Self::SingleAxes
        )
    }

    /// What it says.
    pub(crate) fn text(self) -> &'static str {
        match self {
            Self::Buffers => "free bytes and blocks are those of our own, larger buffers",
            Self::LongLines => "lines of 80 to 255 characters are read",
            Self::ExactPositions => {
                "points half-way between two steps: exact here, rounded in single precision by Grbl"
            }
            Self::JogWithoutAxes => "a jog without an axis is refused",
            Self::SettingRanges => "settings out of range are refused, not stored or cut",
            Self::StartupLines => "there are two startup lines",
            Self::Arcs => "an arc is one block, not many chords",
            Self::StepRates => "a step rate that cannot be played is refused",
            Self::ToolIsModal => "T stays until the next T",
            Self::Follows => "follows from a deviation in an answer",
            Self::SlowSteps => {
                "moves slower than 30.5 steps per second, which Grbl's timer cannot time"
            }
            Self::PromptReports => {
                "`?` is answered at once, also while homing, dwelling and after an alarm"
            }
            Self::NoDeafness => "no pause of 500 ms after an alarm: what is sent then is answered",
            Self::QuickStorage => "storing takes less time than Grbl's EEPROM",
            Self::ShortStops => {
                "holds and overrides act within 5 ms, resets decelerate: the axes are elsewhere then"
            }
            Self::Rounding => "the last digit of a number half-way between two",
            Self::RefusedChangesNothing => "a refused line changes nothing",
            Self::InverseTimeArcs => "an arc under G93 takes 1/F minutes",
            Self::HomingMotion => "homing accelerates and decelerates each axis on its own",
            Self::FarTargets => "a target that the step counters cannot hold is refused",
            Self::NoPause => "no pause for the drivers ($1) at the end of a motion, or at a reset",
            Self::ClosedSwitch => "homing is refused while a switch of its axes is closed",
            Self::LimitOpens => "a limit switch that opens is no alarm",
            Self::ArcLimits => "an arc that leaves the travel is refused before it begins",
            Self::SingleAxes => "axes can be homed one by one",
            Self::DarkHold => "a laser stays dark at rest in a hold",
            Self::ArcTurns => "P in an arc is its number of turns",
        }
    }
}

/// Characters of a line that Grbl reads, without blanks and comments, and that we read.
const GRBL_LINE: usize = 79;
const OUR_LINE: usize = 255;

/// Why a line of G-code, without blanks and comments, may have another answer.
pub(crate) fn of_answers(code: &str, ours: &str, theirs: &str) -> Option<Deviation> {
    let is_answer = ours == "ok" || ours.starts_with("error:");
    let is_read = code.len() > GRBL_LINE && code.len() <= OUR_LINE;
    if theirs == "error:11" && is_answer && is_read {
        return Some(Deviation::LongLines);
    }
    let is_arc = code.contains(['I', 'J', 'K', 'R']) && !code.starts_with('$');
    let has_turns = is_arc && code.contains('P') && ["ok", "error:23", "error:39"].contains(&ours);
    (theirs == "error:36" && has_turns).then_some(Deviation::ArcTurns)
}

impl Serialize for Deviation {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self.id())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_differ_for_a_reason_only() {
        let long = format!("G0X1.{}", "0".repeat(80));
        assert_eq!(
            of_answers(&long, "ok", "error:11"),
            Some(Deviation::LongLines)
        );
        assert_eq!(of_answers("G0X1", "ok", "error:11"), None);
        let turns = Some(Deviation::ArcTurns);
        assert_eq!(of_answers("G2X2I1P3", "ok", "error:36"), turns);
        assert_eq!(of_answers("G2X2I1P.5", "error:23", "error:36"), turns);
        assert_eq!(of_answers("G2X2I1L1", "ok", "error:36"), None);
        assert_eq!(of_answers("G0X2P1", "ok", "error:36"), None);
        assert_eq!(of_answers("G2X2I1P3", "error:33", "error:36"), None);
    }
}
