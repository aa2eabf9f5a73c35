//! The deliberate deviations from Grbl: what each may explain, and nothing else.
//!
//! `docs/grbl-compatibility.md` gives the reasons. Each is found by its cause in the exchange, never
//! by the name of a recording.

use serde::{Serialize, Serializer};

/// What is known of a deviation.
pub(crate) struct Row {
    /// Its short name.
    pub(crate) id: &'static str,
    /// Whether a line is executed that Grbl refuses, or the other way round, so that the exchange differs from there
    /// on.
    pub(crate) has_consequences: bool,
    /// What Leadscrew does.
    pub(crate) text: &'static str,
    /// What it lets differ, and when.
    pub(crate) rule: &'static str,
}

/// The table: each line has the fields of [`Row`] in their order.
macro_rules! deviations {
    ($($name:ident: $id:literal, $has_consequences:literal, $text:literal, $rule:literal;)*) => {
        /// A deliberate deviation.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub(crate) enum Deviation {
            $($name),*
        }

        impl Deviation {
            /// Every one, in the order of their names.
            pub(crate) const ALL: &[Self] = &[$(Self::$name),*];
            const ROWS: &[Row] = &[$(Row {
                id: $id,
                has_consequences: $has_consequences,
                text: $text,
                rule: $rule,
            }),*];
        }
    };
}

deviations! {
    Buffers: "D4", false,
        "free bytes and blocks are those of our own, larger buffers",
        "`Bf:`, and in `[OPT:…]` the numbers, where ours are not smaller, and further letters; an `ok` \
         that comes earlier after more than 15 moves";
    LongLines: "D5", true,
        "lines of 80 to 256 characters are read",
        "an answer other than `error:11` to a line of 80 to 256 characters";
    ExactPositions: "D6", false,
        "points half-way between two steps: exact here, rounded in single precision by Grbl",
        "one step of an axis, where the position lies half-way between two";
    JogWithoutAxes: "D7", true,
        "a jog without an axis is refused",
        "`error:26` for `ok`, to a `$J=` without an axis word";
    SettingRanges: "D8", true,
        "settings out of range are refused, not stored or cut",
        "an error for `ok`, to `$n=` with 0 steps/mm, speed or acceleration, or an integer above 255; and \
         what `$$` shows of it";
    StartupLines: "D9", true,
        "there are two startup lines",
        "`error:3` for `ok`, to `$N2=` and above";
    Arcs: "D10", true,
        "an arc is one block, not many chords",
        "an `ok` that comes earlier, to an arc or after one";
    ToolIsModal: "D13", false,
        "T stays until the next T",
        "another T than 0 where Grbl shows 0";
    SlowSteps: "D14", false,
        "moves slower than 30.5 steps per second, which Grbl's timer cannot time",
        "a time in which Grbl's steps come at 30.5 per second";
    PromptReports: "D15", false,
        "`?` is answered at once, also while homing, dwelling and after an alarm",
        "a report that Grbl sends late or never, while it homes or dwells or after an alarm; and which \
         report has `WCO` or `Ov` after it";
    NoDeafness: "D16", false,
        "no pause of 500 ms after an alarm: what is sent then is answered",
        "lines that come up to 600 ms earlier after an alarm, and answers to what was sent in that time";
    QuickStorage: "D17", false,
        "storing takes less time than Grbl's EEPROM",
        "lines that come up to 300 ms earlier, to a line that is stored";
    ShortStops: "D18", false,
        "holds and overrides act within 5 ms, resets decelerate: the axes are elsewhere then",
        "after a hold, door, cancel, override, reset or contact in motion: positions along the path, \
         within 80 ms of travel and the distance of the deceleration, and the times that go with them; at rest \
         the place must stay";
    Rounding: "D19", false,
        "the last digit of a number half-way between two",
        "one unit of the last digit of a position or an offset";
    RefusedChangesNothing: "D20", false,
        "a refused line changes nothing",
        "Grbl's state Home after a refused `$H…`";
    InverseTimeArcs: "D21", false,
        "an arc under G93 takes 1/F minutes",
        "times after an arc under `G93`";
    HomingMotion: "D22", false,
        "homing brakes each axis on its own, and keeps the limits of the slowest",
        "35 % of the time of a homing cycle";
    FarTargets: "D23", true,
        "a target that the step counters cannot hold is refused",
        "`error:33` for `ok`, to a word beyond 2^30 steps";
    NoPause: "D24", false,
        "no pause for the drivers ($1) at the end of a motion, or at a reset",
        "what comes `$1` and 5 ms earlier for each end of a motion that follows another; the welcome \
         after a reset";
    HomingOnSwitch: "D25", true,
        "homing is refused while a switch of its axes is closed",
        "everything after an `$H` that is answered `error:203`";
    SingleAxisHoming: "D26", true,
        "`$HX`, `$HY` and `$HZ` home a single axis",
        "everything after an `$HX` to which Grbl says `error:3`";
    LostBytes: "D27", true,
        "more than 128 bytes may wait to be read: Grbl loses them",
        "everything after more than 128 bytes behind an unanswered line";
    StepRates: "D11", true,
        "a step rate that is not proven is refused",
        "`error:12` for `ok`, to a resolution or a rate";
    LimitOpens: "D28", true,
        "a limit switch that opens is no alarm",
        "everything after `ALARM:1` when a limit switch opens";
    ArcLimits: "D31", true,
        "an arc that leaves the travel is refused before it begins",
        "everything after `ALARM:2` that comes earlier, to an arc";
    DarkHold: "D36", false,
        "a laser stays dark at rest in a hold",
        "no power of a laser in `Hold:0` where Grbl's has some";
    ArcTurns: "D37", true,
        "P in an arc is its number of turns",
        "an answer other than `error:36` to an arc with a P word";
    Follows: "follows", false,
        "follows from a deviation in an answer",
        "the end of an exchange in which one of D5, D7, D8, D9, D10, D23, D25, D26 and D27 explains an \
         answer, and locks and lists after it";
    Mist: "D40", true,
        "there is mist: `M7` and 0xA1",
        "an answer other than `error:20` to a line with `M7`; and after it or 0xA1, `M7` in `$G`, and \
         `Ov`, `A` and `WCO` of reports";
    BuildInfo: "D41", false,
        "`$I` tells the proven step rate",
        "the line `[MSG:Step rate: …]` of the answer to `$I`";
    PathControl: "D42", true,
        "there are the path control modes `G61.1` and `G64`",
        "an answer other than Grbl's to a line with `G61.1` or `G64`, which it refuses; and the message \
         `[MSG:Path deviation: …]`";
    Digits: "D43", true,
        "every digit of a number counts, not the first eight",
        "a line that has a number of more than eight digits, and what follows in a table";
    Dwells: "D44", false,
        "a dwell of more than 49 days is refused",
        "`error:39` for `ok`, to a `G4`";
    FeedUnits: "D45", false,
        "F is in the units of the line, also when G94 follows G93",
        "an F in a table that is 25.4 times Grbl's";
    WorkCoordinates: "D46", true,
        "there are G59.1 to G59.3, G52, G90.1, G92.2, G92.3 and `G10 L2 R`",
        "an answer other than Grbl's to a line with one of these, which it refuses; `error:28` to a `G10` \
         without P";
    AxisWordsAfterG80: "D47", true,
        "axis words after G80 belong to the command that uses them",
        "an answer other than `error:31` to a line with G10, G28, G30, G92 or G43.1";
    ProgramHabits: "D48", true,
        "what post-processors write besides motion is read",
        "an answer other than `error:20` or `error:21` to a line with G50, G80, G97, G98, G99, M48 to M51 \
         or M53; other than `error:24` to G0 or G1 beside G28 or G30, and to G49; other than Grbl's to \
         `%`, `O1234` and `:1234`";
    ToolOffsets: "D49", true,
        "the tool length offset is a vector",
        "an answer other than `error:37` to a G43.1";
    ToolChange: "D50", true,
        "tools are changed",
        "an answer other than `error:20` to a line with M6 or M61, and the message `[MSG:Tool change: \
         …]`; T in a `$G` after it";
    ToolTable: "D51", true,
        "there is a tool table: G43, G43.2 and G10 L1, L10, L11",
        "an answer other than `error:20` to a line with G43 or G43.2, and to a G10 with L1, L10 or L11; \
         and the message `[MSG:Tool table is empty: …]`";
    CannedCycles: "D52", true,
        "there are canned cycles",
        "an answer other than `error:20` to a line with G73, G74, G81 to G86, G88 or G89, and the \
         message `[MSG:… is missing]`";
    CutterCompensation: "D53", true,
        "there is cutter radius compensation",
        "an answer other than `error:20` to a line with G41, G41.1, G42 or G42.1; and errors 90, 91, 92, \
         205 and 207";
    FullCircles: "D57", true,
        "an arc without axis words in its plane is a full circle",
        "an answer other than `error:26`, `error:32` or `error:36` to a line with I, J or K";
    ArcTolerance: "D58", true,
        "arcs with rounded numbers are taken",
        "an answer other than `error:33` or `error:34` to an arc, and the message `[MSG:I J K fit as \
         absolute: …]`";
    OperatorMessages: "D60", false,
        "messages of a program reach its operator",
        "a line `[MSG:…]` after a comment `(MSG, …)`, or one beside M0 or M1";
    SpindleTime: "D61", false,
        "motion waits for a spindle that comes back",
        "positions, feeds and outputs after a `~` with `[MSG:Restoring spindle]`, up to the next rest";
    NoSpindleSpeed: "D62", false,
        "a spindle that does not turn is reported",
        "the message `[MSG:Spindle speed is 0]`";
    SpeedInMotion: "D63", false,
        "the speed of a spindle that turns changes in motion",
        "an `ok` that comes earlier after a line with an S, not in laser mode; and which report has `Ov` \
         after it";
    ProbedValue: "D74", true,
        "P in a probing move is the work coordinate of its contact",
        "an answer other than `error:36` to a G38.2 to G38.5 with a P word";
    Numbers: "D77", true,
        "a number that cannot be done as it is written is refused",
        "an error for `ok`: 23 to a G, M, T, P or L with a fraction, 20 or 29 to a G10 with P or L above 255, \
         39 to an F below 1, and to an F or S above 10000000";
    SettingNumbers: "D78", true,
        "a setting is what is written, or it is refused",
        "an error for `ok`, to `$n=` with a fraction where the setting is whole or that is no number of a \
         setting, and to one that is on or off with more than 1; and what `$$` shows of it";
}

impl Deviation {
    /// Its row of the table.
    pub(crate) fn row(self) -> &'static Row {
        &Self::ROWS[self as usize]
    }
}

/// Characters of a line that Grbl reads, without blanks and comments, and that we read.
const GRBL_LINE: usize = 79;
const OUR_LINE: usize = 256;

/// Why a line of G-code, without blanks and comments, may have another answer.
pub(crate) fn of_answers(code: &str, ours: &str, theirs: &str) -> Option<Deviation> {
    // What comes first may be the contact, or the alarm of a miss.
    let probes = has_word(code, 'G', &[38.2, 38.3, 38.4, 38.5]);
    if theirs == "error:36" && ours != theirs && probes && code.contains('P') {
        return Some(Deviation::ProbedValue);
    }
    let is_answer = ours == "ok" || ours.starts_with("error:");
    let is_read = code.len() > GRBL_LINE && code.len() <= OUR_LINE;
    if theirs == "error:11" && is_answer && is_read {
        return Some(Deviation::LongLines);
    }
    if theirs == "error:20" && ours != theirs && is_answer && has_mist(code) {
        return Some(Deviation::Mist);
    }
    let is_refused = ["error:20", "error:23"].contains(&theirs);
    if is_refused && ours != theirs && is_answer && has_path_control(code) {
        return Some(Deviation::PathControl);
    }
    if is_answer
        && ours != theirs
        && let Some(deviation) = of_programs(code, ours, theirs)
    {
        return Some(deviation);
    }
    if theirs == "ok" && ours == "error:39" && has_word(code, 'G', &[4.0]) {
        return Some(Deviation::Dwells);
    }
    if theirs == "ok" && is_number_refused(code, ours) {
        return Some(Deviation::Numbers);
    }
    if ours != theirs && is_answer && has_long_number(code) {
        return Some(Deviation::Digits);
    }
    let is_arc = code.contains(['I', 'J', 'K', 'R']) && !code.starts_with('$');
    let has_turns = is_arc && code.contains('P') && ["ok", "error:23", "error:39"].contains(&ours);
    if theirs == "error:36" && has_turns {
        return Some(Deviation::ArcTurns);
    }
    let has_centre = is_arc && code.contains(['I', 'J', 'K']);
    match theirs {
        _ if ours == theirs || !is_answer => None,
        "error:26" | "error:32" if has_centre => Some(Deviation::FullCircles),
        "error:36" if has_centre && !code.contains(['X', 'Y', 'Z']) => Some(Deviation::FullCircles),
        "error:33" | "error:34" if is_arc => Some(Deviation::ArcTolerance),
        _ => None,
    }
}

/// Why there may be a message that Grbl does not have.
pub(crate) fn of_message(ours: &str) -> Option<Deviation> {
    if ours.starts_with("[MSG:Path deviation: ") {
        Some(Deviation::PathControl)
    } else if ours.starts_with("[MSG:Tool change: ") {
        Some(Deviation::ToolChange)
    } else if ours.starts_with("[MSG:Tool table is empty: ") {
        Some(Deviation::ToolTable)
    } else if ours.starts_with("[MSG:") && ours.ends_with(" is missing]") {
        Some(Deviation::CannedCycles)
    } else if ours == "[MSG:Spindle speed is 0]" {
        Some(Deviation::NoSpindleSpeed)
    } else if ours.starts_with("[MSG:I J K fit as absolute: ") {
        Some(Deviation::ArcTolerance)
    } else {
        None
    }
}

/// Why there may be a message that a program has for its operator, by the lines of the program.
pub(crate) fn of_operator_message(ours: &str, lines: &[String]) -> Option<Deviation> {
    let text = ours.strip_prefix("[MSG:")?.strip_suffix(']')?;
    let says = |line: &String| {
        let comment = line.split_once('(').map_or("", |it| it.1);
        let (kind, tail) = comment.split_once(',').unwrap_or(("MSG", comment));
        kind.trim().eq_ignore_ascii_case("MSG") && tail.trim().starts_with(text)
    };
    let is_there = !text.is_empty() && lines.iter().any(says);
    is_there.then_some(Deviation::OperatorMessages)
}

/// Why a line may have another answer that is written as for LinuxCNC or by a post-processor.
fn of_programs(code: &str, ours: &str, theirs: &str) -> Option<Deviation> {
    let has_g = |numbers: &[f64]| has_word(code, 'G', numbers);
    let has_origin = has_g(&[10.0]);
    let is_coordinates = match theirs {
        "error:20" | "error:23" => {
            has_g(&[52.0, 59.1, 59.2, 59.3, 90.1, 92.2, 92.3]) || has_origin && code.contains('R')
        }
        "error:26" => has_origin && code.contains('R'),
        "error:29" => has_origin && has_word(code, 'P', &[7.0, 8.0, 9.0]),
        "ok" => has_origin && !code.contains('P'),
        _ => false,
    };
    if is_coordinates {
        return Some(Deviation::WorkCoordinates);
    }
    if theirs == "error:31" && has_g(&[10.0, 28.0, 30.0, 43.1, 92.0]) {
        return Some(Deviation::AxisWordsAfterG80);
    }
    if theirs == "error:37" && has_g(&[43.1]) {
        return Some(Deviation::ToolOffsets);
    }
    let cycles = [73.0, 74.0, 81.0, 82.0, 83.0, 84.0, 85.0, 86.0, 88.0, 89.0];
    if theirs == "error:20" && has_g(&cycles) {
        return Some(Deviation::CannedCycles);
    }
    let is_compensated = theirs == "error:20" && has_g(&[41.0, 41.1, 42.0, 42.1]);
    let is_refused = ["error:90", "error:91", "error:92", "error:205", "error:207"].contains(&ours);
    if is_compensated || is_refused {
        return Some(Deviation::CutterCompensation);
    }
    if theirs == "error:20" && has_word(code, 'M', &[6.0, 61.0]) {
        return Some(Deviation::ToolChange);
    }
    let sets_tool = has_origin && has_word(code, 'L', &[1.0, 10.0, 11.0]);
    if theirs == "error:20" && (has_g(&[43.0, 43.2]) || sets_tool) {
        return Some(Deviation::ToolTable);
    }
    let digits = code.strip_prefix(['O', ':']).unwrap_or_default();
    let is_mark =
        code == "%" || !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    let is_habit = match theirs {
        "error:20" => {
            has_g(&[50.0, 97.0, 98.0, 99.0]) || has_word(code, 'M', &[48.0, 49.0, 50.0, 51.0, 53.0])
        }
        "error:21" => has_g(&[80.0]),
        "error:24" => has_g(&[49.0]) || has_g(&[0.0, 1.0]) && has_g(&[28.0, 30.0]),
        _ => false,
    };
    (is_habit || is_mark && theirs.starts_with("error:")).then_some(Deviation::ProgramHabits)
}

/// Whether an error is that of a number which a line without blanks and comments has.
fn is_number_refused(code: &str, ours: &str) -> bool {
    let is_beyond_byte = |number: f64| number > 255.0;
    let has = |letters: &str, is: &dyn Fn(f64) -> bool| {
        letters
            .chars()
            .any(|letter| numbers_of(code, letter).any(is))
    };
    match ours {
        "error:23" => has("GMTPL", &|number| number.fract() != 0.0),
        "error:20" => has_word(code, 'G', &[10.0]) && has("L", &is_beyond_byte),
        "error:29" => has_word(code, 'G', &[10.0]) && has("P", &is_beyond_byte),
        "error:39" => {
            has("F", &|number| 0.0 < number && number < 1.0) || has("FS", &|number| number > 1.0e7)
        }
        _ => false,
    }
}

/// Digits of a number that Grbl reads.
const GRBL_DIGITS: usize = 8;

/// Whether a line without blanks and comments has a number with more digits than Grbl reads.
pub(crate) fn has_long_number(code: &str) -> bool {
    let numbers = code.split(|letter: char| !letter.is_ascii_digit() && letter != '.');
    let digits = |number: &str| number.bytes().filter(u8::is_ascii_digit).count();
    numbers.map(digits).any(|count| count > GRBL_DIGITS)
}

/// Whether a line without blanks and comments has an `M7`.
pub(crate) fn has_mist(code: &str) -> bool {
    has_word(code, 'M', &[7.0])
}

/// Whether a line without blanks and comments has a `G61.1` or a `G64`.
fn has_path_control(code: &str) -> bool {
    has_word(code, 'G', &[61.1, 64.0])
}

/// Whether a line without blanks and comments has a letter with one of some numbers.
fn has_word(code: &str, letter: char, numbers: &[f64]) -> bool {
    numbers_of(code, letter).any(|number| numbers.contains(&number))
}

/// The numbers of a letter.
fn numbers_of(code: &str, letter: char) -> impl Iterator<Item = f64> {
    let is_letter = move |other: char| other.to_ascii_uppercase() == letter;
    code.split(is_letter).skip(1).filter_map(|tail| {
        let number: String = tail
            .chars()
            .take_while(|letter| letter.is_ascii_digit() || *letter == '.')
            .collect();
        number.parse().ok()
    })
}

impl Serialize for Deviation {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self.row().id)
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
        let circle = Some(Deviation::FullCircles);
        for (code, theirs) in [
            ("G2I5", "error:26"),
            ("G2Z1I5", "error:32"),
            ("I5", "error:36"),
        ] {
            assert_eq!(of_answers(code, "ok", theirs), circle);
            assert_eq!(of_answers(code, theirs, theirs), None);
        }
        assert_eq!(of_answers("G2R5", "ok", "error:26"), None);
        let rounded = Some(Deviation::ArcTolerance);
        assert_eq!(of_answers("G2X10I5.01", "ok", "error:33"), rounded);
        assert_eq!(of_answers("G2X10R4.999", "ok", "error:34"), rounded);
        assert_eq!(of_answers("G38.2X10", "ok", "error:33"), None);
        let probed = of_answers("G38.2Z-9P1", "[PRB:0.000,0.000,-5.000:1]", "error:36");
        assert_eq!(probed, Some(Deviation::ProbedValue));
        assert_eq!(of_answers("G0X2P1", "ok", "error:36"), None);
        assert_eq!(of_answers("G2X2I1P3", "error:33", "error:36"), None);
        let mist = Some(Deviation::Mist);
        assert_eq!(of_answers("M7", "ok", "error:20"), mist);
        assert_eq!(of_answers("G0X1M07.", "ok", "error:20"), mist);
        assert_eq!(of_answers("M7.1", "ok", "error:20"), None);
        assert_eq!(of_answers("M70", "ok", "error:20"), None);
        assert_eq!(of_answers("M7", "error:20", "ok"), None);
        let control = Some(Deviation::PathControl);
        assert_eq!(of_answers("G64P.1", "ok", "error:20"), control);
        assert_eq!(of_answers("G21G90G64G40", "ok", "error:20"), control);
        assert_eq!(of_answers("G61.1", "ok", "error:20"), control);
        assert_eq!(of_answers("G61", "error:20", "ok"), None);
        assert_eq!(of_answers("G0X64", "ok", "error:20"), None);
        let digits = Some(Deviation::Digits);
        assert_eq!(of_answers("G1X1F0.00000001", "ok", "error:22"), digits);
        assert_eq!(of_answers("G1X1F0.0000001", "ok", "error:22"), None);
        let dwells = Some(Deviation::Dwells);
        assert_eq!(of_answers("G4P9999999", "error:39", "ok"), dwells);
        assert_eq!(of_answers("G64P9999999", "error:39", "ok"), None);
    }

    #[test]
    fn numbers_differ_for_a_reason_only() {
        let reason = Some(Deviation::Numbers);
        for (line, ours, expected) in [
            ("T1.5", "error:23", reason),
            ("G10L2P1X1.5", "error:23", None),
            ("G10L258P1X1", "error:20", reason),
            ("G10L2P1X258", "error:20", None),
            ("G10L2P257X1", "error:29", reason),
            ("G4P257", "error:29", None),
            ("G1X1F.5", "error:39", reason),
            ("G1X1F1.5", "error:39", None),
            ("S20000000", "error:39", reason),
        ] {
            assert_eq!(of_answers(line, ours, "ok"), expected, "{line}");
            assert_eq!(of_answers(line, "ok", ours), None, "{line}");
        }
    }

    #[test]
    fn cutter_compensation_differs_for_a_reason_only() {
        let reason = Some(Deviation::CutterCompensation);
        for (line, ours, theirs, expected) in [
            ("G41D1", "ok", "error:20", reason),
            ("G42.1D4G1X1", "error:22", "error:20", reason),
            ("G28", "error:91", "ok", reason),
            ("G40.1", "error:20", "error:23", None),
            ("D1", "error:36", "error:20", None),
        ] {
            assert_eq!(of_answers(line, ours, theirs), expected, "{line}");
        }
    }

    #[test]
    fn programs_for_other_machines_differ_for_a_reason_only() {
        for (line, ours, theirs, expected) in [
            (
                "G10L2P1R30",
                "ok",
                "error:26",
                Some(Deviation::WorkCoordinates),
            ),
            (
                "G10L2P8X1",
                "ok",
                "error:29",
                Some(Deviation::WorkCoordinates),
            ),
            ("G10L2P1X1", "ok", "error:29", None),
            (
                "G10L2X1",
                "error:28",
                "ok",
                Some(Deviation::WorkCoordinates),
            ),
            ("G59.2", "ok", "error:23", Some(Deviation::WorkCoordinates)),
            ("G59", "ok", "error:23", None),
            (
                "G28X1",
                "ok",
                "error:31",
                Some(Deviation::AxisWordsAfterG80),
            ),
            ("X1", "ok", "error:31", None),
            ("G43.1X1", "ok", "error:37", Some(Deviation::ToolOffsets)),
            ("G98", "ok", "error:20", Some(Deviation::ProgramHabits)),
            ("G0G80", "ok", "error:21", Some(Deviation::ProgramHabits)),
            ("G0G1", "ok", "error:21", None),
            ("G0G28X1", "ok", "error:24", Some(Deviation::ProgramHabits)),
            ("G0G92X1", "ok", "error:24", None),
            ("O1234", "ok", "error:20", Some(Deviation::ProgramHabits)),
            ("O12SUB", "ok", "error:20", None),
            (
                "G99G81X1Z-1R2",
                "ok",
                "error:20",
                Some(Deviation::CannedCycles),
            ),
            ("G87X1Z-1R2", "error:28", "error:20", None),
            ("M60", "ok", "error:20", None),
            ("T2M6", "ok", "error:20", Some(Deviation::ToolChange)),
            ("M61Q2", "ok", "error:20", Some(Deviation::ToolChange)),
            ("G43H1Z5", "ok", "error:20", Some(Deviation::ToolTable)),
            ("G10L10P1Z0", "ok", "error:20", Some(Deviation::ToolTable)),
            ("G10L12P1Z0", "ok", "error:20", None),
            ("H1", "error:36", "error:20", None),
        ] {
            assert_eq!(of_answers(line, ours, theirs), expected, "{line}");
        }
    }

    #[test]
    fn a_message_is_one_of_the_program() {
        let lines = ["G0 X1 (MSG, turn it over)", "M0 (and go on)"].map(str::to_owned);
        for ours in ["[MSG:turn it over]", "[MSG:and go on]"] {
            let expected = Some(Deviation::OperatorMessages);
            assert_eq!(of_operator_message(ours, &lines), expected);
        }
        for other in ["[MSG:Pgm End]", "[MSG:]", "turn it over", "[PRB:and go on]"] {
            assert_eq!(of_operator_message(other, &lines), None);
        }
    }

    #[test]
    fn no_two_deviations_have_one_name() {
        for (index, deviation) in Deviation::ALL.iter().enumerate() {
            let others = &Deviation::ALL[index + 1..];
            assert!(
                others
                    .iter()
                    .all(|other| other.row().id != deviation.row().id)
            );
        }
    }
}
