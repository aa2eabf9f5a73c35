//! Messages to the sender, in Grbl 1.1's words.
//!
//! Pure: each function writes one message. Read with Grbl 1.1 `report.c` and its `interface.md`;
//! senders parse these texts with fixed patterns, so every byte counts.

use super::text::{ReportUnit, Text};
use crate::{
    axis::{AXES, Axes, LETTERS},
    gcode::LineError,
    machine::Snapshot,
    model::{Alarm, Coolant, Levels, Probed, ResetCause, SelfTestFault, Spindle, State},
    settings::Settings,
    units::Nm,
};

/// Status reports from one with the work offset to the next, while the machine is busy and while it
/// is not: Grbl 1.1 `config.h`.
const OFFSET_INTERVAL: (u8, u8) = (30, 10);
/// Status reports from one with the overrides to the next.
const OVERRIDES_INTERVAL: (u8, u8) = (20, 10);

/// The field of a status report besides those that every report has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extra {
    /// Nothing.
    None,
    /// `WCO:` the work offset.
    WorkOffset,
    /// `Ov:` the overrides, and `A:` spindle and coolant.
    Overrides,
}

/// The schedule of the fields that change rarely: at most one in each status report.
///
/// The default is the state after a reset: the work offset is due, then the overrides.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Cadence {
    /// Reports before the next with the work offset.
    until_offset: u8,
    /// Reports before the next with the overrides.
    until_overrides: u8,
}

impl Cadence {
    /// Schedules the work offset for the next report: it has changed.
    pub fn offset_changed(&mut self) {
        self.until_offset = 0;
    }

    /// Schedules the overrides for the next report: spindle, coolant or an override has changed.
    pub fn overrides_changed(&mut self) {
        self.until_overrides = 0;
    }

    /// Returns the field of the next report, and counts the report.
    pub fn next(&mut self, state: State) -> Extra {
        let remaining = |(busy, idle): (u8, u8)| match state {
            State::Run
            | State::HoldSlowing
            | State::HoldComplete
            | State::Jog
            | State::Home
            | State::DoorClosed
            | State::DoorAjar
            | State::DoorRetracting
            | State::DoorRestoring => busy - 1,
            State::Idle | State::Alarm | State::Check | State::Sleep | State::Tool => idle - 1,
        };
        if self.until_offset == 0 {
            self.until_offset = remaining(OFFSET_INTERVAL);
            self.until_overrides = self.until_overrides.saturating_sub(1);
            return Extra::WorkOffset;
        }
        self.until_offset -= 1;
        if self.until_overrides == 0 {
            self.until_overrides = remaining(OVERRIDES_INTERVAL);
            return Extra::Overrides;
        }
        self.until_overrides -= 1;
        Extra::None
    }
}

/// The content of a status report.
#[derive(Debug)]
pub struct Status<'a> {
    /// The machine.
    pub machine: &'a Snapshot,
    /// The settings.
    pub settings: &'a Settings,
    /// Machine position minus work position.
    pub work_offset: Axes<Nm>,
    /// The work offset depends on the position, so that every report has to have it.
    pub depends_on_place: bool,
    /// Free bytes for received lines.
    pub received_free: usize,
    /// The field besides those that every report has.
    pub extra: Extra,
    /// The tool in the spindle, if it has changed since the report before.
    pub new_tool: Option<u8>,
}

/// `<Idle|MPos:0.000,0.000,0.000|FS:0,0>`.
pub fn status(text: &mut Text, status: &Status<'_>) {
    let Status {
        machine, settings, ..
    } = status;
    let unit = ReportUnit::of(settings);
    let machine_position = machine_position(machine, settings);
    text.word("<").word(machine.state.name());
    if settings.report_mask & 1 != 0 {
        text.word("|MPos:").coordinates(&machine_position, unit);
    } else {
        let work_position = machine_position.zip(status.work_offset, |m, offset| m - offset);
        text.word("|WPos:").coordinates(&work_position, unit);
    }
    if settings.report_mask & 2 != 0 {
        text.word("|Bf:").natural(u32::from(machine.blocks_free));
        text.word(",").natural(status.received_free as u32);
    }
    text.word("|FS:").rate(machine.feed_mm_min, unit);
    text.word(",").number(machine.spindle_rpm, 0);
    pins(text, machine.inputs);
    if status.extra == Extra::WorkOffset || status.depends_on_place {
        text.word("|WCO:").coordinates(&status.work_offset, unit);
    }
    match status.extra {
        Extra::None | Extra::WorkOffset => {}
        Extra::Overrides => {
            let overrides = machine.overrides;
            text.word("|Ov:").natural(u32::from(overrides.feed));
            text.word(",").natural(u32::from(overrides.rapid));
            text.word(",").natural(u32::from(overrides.spindle));
            accessories(text, machine.spindle, machine.coolant);
        }
    }
    if let Some(tool) = status.new_tool {
        text.word("|T:").natural(u32::from(tool));
    }
    text.word(">").end();
}

/// Returns the position of each axis from its step counter.
#[must_use]
pub fn machine_position(machine: &Snapshot, settings: &Settings) -> Axes<Nm> {
    settings.position_of(machine.steps)
}

/// `X:45,Y:22`: the first axes of a position, steps.
pub fn stepped_position(text: &mut Text, steps: &Axes<i32>, axes: usize) {
    let shown = LETTERS.iter().zip(steps).take(axes);
    for (index, (letter, steps)) in shown.enumerate() {
        if index > 0 {
            text.byte(b',');
        }
        text.byte(*letter).byte(b':').integer(*steps);
    }
    text.end();
}

/// `|Pn:PXYZ`, nothing when no input is active.
fn pins(text: &mut Text, inputs: Levels) {
    if inputs == Levels::NONE {
        return;
    }
    text.word("|Pn:");
    if inputs.has(Levels::PROBE) {
        text.byte(b'P');
    }
    for (axis, letter) in LETTERS.iter().enumerate().take(AXES) {
        if inputs.has(Levels(1 << axis)) {
            text.byte(*letter);
        }
    }
    for (input, letter) in [
        (Levels::DOOR, b'D'),
        (Levels::RESET, b'R'),
        (Levels::HOLD, b'H'),
        (Levels::START, b'S'),
    ] {
        if inputs.has(input) {
            text.byte(letter);
        }
    }
}

/// `|A:SF`, nothing when all is off.
fn accessories(text: &mut Text, spindle: Spindle, coolant: Coolant) {
    if spindle == Spindle::Off && coolant == Coolant::default() {
        return;
    }
    text.word("|A:");
    match spindle {
        Spindle::Off => {}
        Spindle::Clockwise => {
            text.byte(b'S');
        }
        Spindle::CounterClockwise => {
            text.byte(b'C');
        }
    }
    if coolant.flood {
        text.byte(b'F');
    }
    if coolant.mist {
        text.byte(b'M');
    }
}

/// The first line after power-up and after each reset, with an empty line before it.
pub fn welcome(text: &mut Text) {
    text.end().word("Grbl 1.1h ['$' for help]").end();
}

/// `ok`.
pub fn ok(text: &mut Text) {
    text.word("ok").end();
}

/// `error:N`.
pub fn error(text: &mut Text, error: LineError) {
    text.word("error:").natural(u32::from(error.number())).end();
}

/// `ALARM:N`.
pub fn alarm(text: &mut Text, alarm: Alarm) {
    text.word("ALARM:").natural(u32::from(alarm.number())).end();
}

/// A message that the sender has not asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feedback {
    /// Nothing but a reset helps.
    ResetNeeded,
    /// A move of a compensated contour waits for the next one, and nothing moves.
    CompensationWaits,
    /// The machine is locked.
    Locked,
    /// The machine is no longer locked.
    Unlocked,
    /// Check mode begins.
    CheckEnabled,
    /// Check mode ends.
    CheckDisabled,
    /// The safety door has been opened.
    CheckDoor,
    /// A break on the line has begun a hold.
    LineBreak,
    /// A line has been refused, and the next one waits for cycle start.
    LineRefused,
    /// A limit switch is closed.
    CheckLimits,
    /// A tool length is wanted, and the tool table is empty.
    EmptyToolTable,
    /// `M2` or `M30`.
    ProgramEnd,
    /// `$RST=`.
    RestoringDefaults,
    /// The spindle is switched on again.
    RestoringSpindle,
    /// Nothing moves before the spindle has come up to speed.
    SpindleDelay,
    /// Everything is off until a reset.
    Sleeping,
    /// An arc could not be made in whole steps.
    #[cfg(arc_machine)]
    ArcOffSteps,
    /// A line of the stored program was refused.
    #[cfg(arc_machine)]
    StoredProgramRefused,
    /// The probe has made contact in another move than a probing one.
    UnexpectedContact,
    /// A feed move with the spindle on at speed 0.
    NoSpindleSpeed,
    /// A `G53` move that ends before a switch.
    EndsBeforeSwitch,
    /// A feed move after a change of the tool, with the spindle off.
    SpindleOff,
    /// A change is in effect, and is stored when the flash may be erased.
    StoredLater,
    /// A change that has waited cannot be stored.
    NotStored,
}

/// `[MSG:…]`.
pub fn feedback(text: &mut Text, feedback: Feedback) {
    let words = match feedback {
        Feedback::ResetNeeded => "Reset to continue",
        Feedback::CompensationWaits => "Compensation waits for the next move",
        Feedback::Locked => "'$H'|'$X' to unlock",
        Feedback::Unlocked => "Caution: Unlocked",
        Feedback::CheckEnabled => "Enabled",
        Feedback::CheckDisabled => "Disabled",
        Feedback::CheckDoor => "Check Door",
        Feedback::LineBreak => "Break on the line",
        Feedback::LineRefused => "A line was refused: '~' goes on without it",
        Feedback::CheckLimits => "Check Limits",
        Feedback::EmptyToolTable => "Tool table is empty: tool length 0",
        Feedback::ProgramEnd => "Pgm End",
        Feedback::RestoringDefaults => "Restoring defaults",
        Feedback::RestoringSpindle => "Restoring spindle",
        Feedback::SpindleDelay => "Waiting for spindle",
        Feedback::Sleeping => "Sleeping",
        #[cfg(arc_machine)]
        Feedback::ArcOffSteps => "Arc not on steps",
        #[cfg(arc_machine)]
        Feedback::StoredProgramRefused => "The stored program cannot run here",
        Feedback::UnexpectedContact => "Probe contact outside of a probing move",
        Feedback::NoSpindleSpeed => "Spindle speed is 0",
        Feedback::EndsBeforeSwitch => "G53 ends at the pull-off, before the switch",
        Feedback::SpindleOff => "Spindle is off",
        Feedback::StoredLater => "Stored when idle with the spindle off",
        Feedback::NotStored => "Not stored: lost when power is off",
    };
    text.word("[MSG:").word(words).word("]").end();
}

/// `[MSG:Restarted: watchdog]`, after the alarm of that.
pub fn restarted(text: &mut Text, cause: ResetCause) {
    text.word("[MSG:Restarted: ").word(cause.text());
    text.word("]").end();
}

/// `[MSG:Crystal of 12.000 MHz, not 8.000: nothing moves]`, after alarm 16.
pub fn self_test_fault(text: &mut Text, fault: SelfTestFault) {
    text.word("[MSG:");
    match fault {
        SelfTestFault::NoCrystal => text.word("Crystal does not run"),
        SelfTestFault::OtherCrystal { khz, expected_khz } => {
            let mhz = |khz: u32| u64::from(khz) * 1000;
            text.word("Crystal of ").millionths(mhz(khz));
            text.word(" MHz, not ").millionths(mhz(expected_khz))
        }
        SelfTestFault::LowSupply => text.word("Supply too low"),
    };
    text.word(": nothing moves]").end();
}

/// `[MSG:Tool change: T2]`, with a message of the program behind it.
pub fn tool_change(text: &mut Text, tool: u8, message: &[u8]) {
    text.word("[MSG:Tool change: T").natural(u32::from(tool));
    if !message.is_empty() {
        text.word(" ").bytes(message);
    }
    text.word("]").end();
}

/// `[MSG:text]`: what a program says to its operator.
pub fn operator_message(text: &mut Text, message: &[u8]) {
    text.word("[MSG:").bytes(message).word("]").end();
}

/// `[MSG:Dwell of 789 s]`: what a program in which `P` is meant in ms would wait at each hole.
pub fn long_dwell(text: &mut Text, seconds: u32) {
    text.word("[MSG:Dwell of ").natural(seconds);
    text.word(" s]").end();
}

/// `[MSG:Q is missing]`: the word that a line with a canned cycle lacks.
pub fn missing_word(text: &mut Text, letter: u8) {
    text.word("[MSG:").byte(letter).word(" is missing]").end();
}

/// `[MSG:I J K fit as absolute: G90.1]`: a refused arc is one with absolute centres.
pub fn absolute_centre(text: &mut Text) {
    text.word("[MSG:I J K fit as absolute: G90.1]").end();
}

/// `[MSG:Path deviation: … mm]`: the greatest distance from the programmed path, under `G64`.
pub fn path_deviation(text: &mut Text, deviation_mm: f32) {
    text.word("[MSG:Path deviation: ");
    text.number(deviation_mm, 3).word(" mm]").end();
}

/// `[PRB:x,y,z:1]`: where the probe changed, in machine coordinates.
pub fn probed(text: &mut Text, probed: &Probed, settings: &Settings) {
    let position = settings.position_of(probed.steps);
    text.word("[PRB:");
    text.coordinates(&position, ReportUnit::of(settings));
    text.word(if probed.success { ":1]" } else { ":0]" }).end();
}

/// `>line:`, before the answer of a startup line.
pub fn startup(text: &mut Text, line: &[u8]) {
    text.byte(b'>').bytes(line).byte(b':');
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_pushed_message_looks_like_an_answer() {
        for one in [
            Feedback::ResetNeeded,
            Feedback::CompensationWaits,
            Feedback::Locked,
            Feedback::Unlocked,
            Feedback::CheckEnabled,
            Feedback::CheckDisabled,
            Feedback::CheckDoor,
            Feedback::LineBreak,
            Feedback::LineRefused,
            Feedback::CheckLimits,
            Feedback::EmptyToolTable,
            Feedback::ProgramEnd,
            Feedback::RestoringDefaults,
            Feedback::RestoringSpindle,
            Feedback::SpindleDelay,
            Feedback::Sleeping,
            Feedback::ArcOffSteps,
            Feedback::StoredProgramRefused,
            Feedback::NoSpindleSpeed,
            Feedback::EndsBeforeSwitch,
            Feedback::SpindleOff,
        ] {
            let mut text = Text::new();
            feedback(&mut text, one);
            let text = std::string::String::from_utf8_lossy(text.as_bytes()).to_lowercase();
            assert!(!text.contains("ok") && !text.contains("error"), "{text}");
        }
    }

    #[test]
    fn each_input_has_its_letter_in_the_order_of_grbl() {
        let all = [
            (Levels::PROBE, "P"),
            (Levels(1), "X"),
            (Levels(2), "Y"),
            (Levels(4), "Z"),
            (Levels::DOOR, "D"),
            (Levels::RESET, "R"),
            (Levels::HOLD, "H"),
            (Levels::START, "S"),
        ];
        let shown = |inputs| {
            let mut text = Text::new();
            pins(&mut text, inputs);
            std::string::String::from_utf8_lossy(text.as_bytes()).into_owned()
        };
        for (input, letter) in all {
            assert_eq!(shown(input), std::format!("|Pn:{letter}"));
        }
        let closed = all
            .iter()
            .fold(Levels::NONE, |closed, (input, _)| closed | *input);
        assert_eq!(shown(closed), "|Pn:PXYZDRHS");
        assert_eq!(shown(Levels::NONE), "");
    }
}
