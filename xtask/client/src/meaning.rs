//! What the numbers of errors and alarms mean, and what to do.
//!
//! The tables are those of Leadscrew: up to 38 and 10 they are Grbl's, above as grblHAL has them where the meaning
//! fits. Other firmware has numbers of its own, which have no text here.

use leadscrew::{gcode::LineError, model::Alarm};

/// A meaning behind what has it: after a comma, or nothing where there is none.
#[must_use]
pub fn after_comma(meaning: Option<&str>) -> String {
    meaning.map_or_else(String::new, |text| format!(", {text}"))
}

/// What an operator does about an error, on one line.
#[expect(clippy::too_many_lines, reason = "each error has its line")]
#[must_use]
pub const fn remedy_of_error(error: LineError) -> &'static str {
    match error {
        LineError::ExpectedLetter => "look for a stray character or a missing letter in the line",
        LineError::BadNumber => "look for a missing or wrong number behind a letter",
        LineError::InvalidStatement => "look for a typing error: `$` lists the statements",
        LineError::NegativeValue => "give a value of 0 or more",
        LineError::HomingDisabled => "set $22=1 where the machine has limit switches",
        LineError::StepPulseTooShort => "set $0 to 3 or more",
        LineError::StorageRead => {
            "at the first start, set the machine up; later, load the saved settings, and check offsets and tools"
        }
        LineError::NotIdle => "wait for the end of the motion, then send the line again",
        LineError::Locked => {
            "after an alarm, home with $H or unlock with $X; after a jog, wait for its end"
        }
        LineError::SoftLimitsNeedHoming => "set $22=1 before $20=1",
        LineError::LineOverflow => "shorten the line, or remove its comment",
        LineError::StepRateTooHigh => "lower the maximum rate or the steps per mm of the axis",
        LineError::DoorOpen => "close the door",
        LineError::StoredLineTooLong => "shorten the startup line",
        LineError::JogBeyondTravel => "jog less far, or correct $130 to $135",
        LineError::InvalidJog => "give the jog axis words and F, and no other command",
        LineError::LaserNeedsPwm => "use a board with a variable spindle output, or set $32=0",
        LineError::NotPositive => "give a value above 0",
        LineError::Unsupported => "remove the word, or choose another post-processor",
        LineError::ModalGroupViolation => "put the two commands in two lines",
        LineError::FeedUndefined => "give F with the first feed move; in G93, with every one",
        LineError::NotInteger => "give the command a whole number",
        LineError::AxisCommandConflict => "put each command into a line with its axis words",
        LineError::RepeatedWord => "remove one of the two words",
        LineError::NoAxisWords => "give the command its axis words",
        LineError::LineNumberTooHigh => "number the lines lower, or remove the numbers",
        LineError::MissingWord => "give the command the word that it needs",
        LineError::UnknownCoordinates => "use G54 to G59.3",
        LineError::MachineCoordinatesMotion => "give G53 with G0 or G1 in its line",
        LineError::UnusedAxisWords => "give a motion command, such as G1, before the axis words",
        LineError::NoAxisWordsInPlane => "give the end point in the plane of the arc (G17 to G19)",
        LineError::InvalidTarget => "compare the end point of the move with its start and centre",
        LineError::ArcRadius => "give a larger R, or a nearer end point",
        LineError::NoOffsetsInPlane => "give I, J or K of the plane, or R",
        LineError::UnusedWords => "remove the word, or give the command that it belongs to",
        LineError::ToolLengthAxis => "give G43.1 the word of the tool axis alone",
        LineError::UnknownTool => "put the tool into the table, or correct its number",
        LineError::ValueOutOfRange => "correct the value",
        LineError::ToolChange => "end the change of the tool first",
        LineError::SpindleOff => "switch the spindle on before the cycle, the right way round",
        LineError::NotInThisPlane => "choose the plane first (G17 to G19)",
        LineError::ToolLengthWords => "leave H or the axis words away",
        LineError::SettingOutOfRange => "give a value within the range of the setting",
        LineError::RetractBelowBottom => "give an R above the bottom of the hole",
        LineError::CompensationOn => "switch compensation off (G40) before G41 or G42",
        LineError::NotWithCompensation => "switch compensation off (G40) before the line",
        LineError::CutterDoesNotFit => "use a thinner tool, or a longer entry",
        LineError::Checksum => "send the line again; if it comes often, check cable and baud rate",
        LineError::LineNumber => "send the lines again from the number that the machine asks for",
        LineError::NoPausePosition => "pause the job first: G1 R1 returns to where it was paused",
        LineError::LimitsEngaged => {
            "jog the axis off its switch ($X unlocks), or check the switch and $5"
        }
        LineError::StorageWrite => "try once more; if it stays, the memory is worn out",
        LineError::ArcAfterCompensation => "move out with G0 or G1 after G40",
        LineError::ToolTableFull => "remove tools that are no longer used",
        LineError::TooMuchWaits => {
            "move the lines between the two moves before the entry or behind G40"
        }
        LineError::CycleNeedsFeedPerMinute => "give G94 before the cycle",
        LineError::BytesLost => "check cable and baud rate, and begin the job again",
    }
}

/// What an operator does about an alarm, on one line.
#[must_use]
pub const fn remedy_of_alarm(alarm: Alarm) -> &'static str {
    match alarm {
        Alarm::HardLimit => {
            "reset, unlock with $X, jog off the switch, and home; if no switch was touched, look for noise"
        }
        Alarm::SoftLimit => {
            "reset, home or unlock with $X, then set the work zero so that the job is within the travel ($130 to $135)"
        }
        Alarm::ResetInMotion => {
            "home, as the position is not certain; next time hold before the reset"
        }
        Alarm::ProbeState => "unlock with $X, and check the probe, its cable and its polarity ($6)",
        Alarm::ProbeContact => "unlock with $X, then begin nearer, or probe farther",
        Alarm::HomingReset => "home again",
        Alarm::HomingDoor => "close the door, and home again",
        Alarm::HomingPullOff => "set a longer pull-off ($27), or check the switch, and home again",
        Alarm::HomingNotFound => {
            "check switch, direction ($23) and travel ($130 to $135), and home again"
        }
        Alarm::HomingDualAxis => "check both switches and the squareness, and home again",
        Alarm::UnexpectedContact => {
            "reset, unlock with $X, and move off the contact; if nothing was touched, check the probe's cable, or set $798=0"
        }
        Alarm::SelfTest => {
            "the message behind it names the cause: check supply and crystal, and whether the firmware is for this board"
        }
        Alarm::Restarted => "the message behind it names the cause: remove it, and home",
        Alarm::Killed => "remove the reason of the stop, then M999, and home with G28",
    }
}

/// The line of a program at which an alarm rises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineOfAlarm {
    /// The first one without an answer, which comes after the alarm. More lines may have been sent.
    Unanswered,
    /// One that has been answered, and perhaps not been carried out, or the next one.
    InExecution,
}

/// Returns at which line an alarm rises; `None` for one that no line raises, and for an unknown number.
#[must_use]
pub fn line_of_alarm(number: &str) -> Option<LineOfAlarm> {
    Some(match known_alarm(number)? {
        Alarm::SoftLimit
        | Alarm::ProbeState
        | Alarm::ProbeContact
        | Alarm::HomingReset
        | Alarm::HomingDoor
        | Alarm::HomingPullOff
        | Alarm::HomingNotFound
        | Alarm::HomingDualAxis => LineOfAlarm::Unanswered,
        Alarm::HardLimit
        | Alarm::ResetInMotion
        | Alarm::UnexpectedContact
        | Alarm::Restarted
        | Alarm::Killed => LineOfAlarm::InExecution,
        Alarm::SelfTest => return None,
    })
}

fn known_alarm(number: &str) -> Option<Alarm> {
    let number: u8 = number.parse().ok()?;
    let mut alarms = Alarm::ALL.into_iter();
    alarms.find(|alarm| alarm.number() == number)
}

fn known_error(number: u16) -> Option<LineError> {
    let mut errors = LineError::ALL.into_iter();
    errors.find(|error| u16::from(error.number()) == number)
}

/// What is wrong with a line that has `error:N`, and what to do, on one line.
#[must_use]
pub fn error_with_remedy(number: u16) -> Option<String> {
    let error = known_error(number)?;
    Some(format!("{}: {}", error.text(), remedy_of_error(error)))
}

/// Why a machine is locked that says `ALARM:N`, with details in parentheses, and what to do, on one line.
#[must_use]
pub fn alarm_with_remedy(number: &str, details: Option<&str>) -> Option<String> {
    let alarm = known_alarm(number)?;
    let details = details.map_or_else(String::new, |details| format!(" ({details})"));
    let (text, remedy) = (alarm.text(), remedy_of_alarm(alarm));
    Some(format!("{text}{details}: {remedy}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_meaning_follows_a_comma() {
        assert_eq!(after_comma(Some("why")), ", why");
        assert_eq!(after_comma(None), "");
    }

    #[test]
    fn every_error_and_every_alarm_has_a_remedy_of_one_line() {
        let errors = LineError::ALL.map(remedy_of_error);
        let alarms = Alarm::ALL.map(remedy_of_alarm);
        for remedy in errors.into_iter().chain(alarms) {
            assert!(
                !remedy.is_empty() && !remedy.contains(['\n', '|']),
                "{remedy}"
            );
        }
        let limit = alarm_with_remedy("2", None).unwrap();
        assert!(
            limit.contains("travel: ") && limit.contains("work zero"),
            "{limit}"
        );
        let detailed = alarm_with_remedy("2", Some("X 5 is too far")).unwrap();
        assert!(detailed.contains("travel (X 5 is too far): "), "{detailed}");
        assert!(error_with_remedy(22).is_some_and(|text| text.contains("give F")));
        assert_eq!(
            (error_with_remedy(999), alarm_with_remedy("99", None)),
            (None, None)
        );
        assert_eq!(alarm_with_remedy("Hard limit", None), None);
    }

    #[test]
    fn an_alarm_of_a_command_rises_before_the_answer_to_its_line() {
        let at = |numbers: &[&str]| {
            numbers
                .iter()
                .map(|one| line_of_alarm(one))
                .collect::<Vec<_>>()
        };
        let commands = ["2", "4", "5", "6", "7", "8", "9", "10"];
        assert_eq!(at(&commands), [Some(LineOfAlarm::Unanswered); 8]);
        assert_eq!(
            at(&["1", "3", "200", "201"]),
            [Some(LineOfAlarm::InExecution); 4]
        );
        assert_eq!(at(&["16", "99", "Hard limit"]), [None; 3]);
    }
}
