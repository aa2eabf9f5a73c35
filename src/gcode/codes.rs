//! Every code that lines may have, with its effect, its words, and example lines.
//!
//! `docs/gcodes.md` is made from this table, and its lines are executed by `tests/interpreter/codes.rs`,
//! which also finds a code that is read and not listed here.

use super::LineError::{
    self, AxisCommandConflict, CycleNeedsFeedPerMinute, FeedUndefined, InvalidTarget,
    MachineCoordinatesMotion, MissingWord, ModalGroupViolation, NegativeValue, NoAxisWords,
    NoAxisWordsInPlane, NoOffsetsInPlane, NotInteger, NotPositive, RetractBelowBottom, SpindleOff,
    ToolLengthAxis, UnknownCoordinates, Unsupported, UnusedAxisWords, UnusedWords, ValueOutOfRange,
};

/// A code.
#[derive(Debug)]
pub struct CodeRow {
    /// The code, as programs write it.
    pub code: &'static str,
    /// The modal group, of which a line has one code at most.
    pub group: CodeGroup,
    /// What the code does.
    pub text: &'static str,
    /// The words of the code; words in brackets may be left out.
    pub words: &'static str,
    /// Lines that are all accepted; the last one shows the code.
    pub example: &'static [&'static str],
    /// Lines that are refused after the example's other lines, and why.
    pub refused: &'static [(&'static str, LineError)],
}

/// The modal group of a code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CodeGroup {
    /// Motion mode.
    Motion,
    /// Canned cycles.
    Cycle,
    /// Effect on one line only.
    NonModal,
    /// Work coordinate system.
    Coordinates,
    /// Plane of arcs.
    Plane,
    /// Unit of lengths.
    Units,
    /// Origin of coordinates, and of the centres of arcs.
    Distance,
    /// Meaning of `F`.
    FeedMode,
    /// Path control.
    PathControl,
    /// Tool length offset, and what goes with tools.
    Tool,
    /// Spindle.
    Spindle,
    /// Coolant.
    Coolant,
    /// Overrides.
    Overrides,
    /// Flow of the program.
    Program,
}

impl CodeGroup {
    /// Every group, in the order of the document.
    pub const ALL: [Self; 14] = [
        Self::Motion,
        Self::Cycle,
        Self::NonModal,
        Self::Coordinates,
        Self::Plane,
        Self::Units,
        Self::Distance,
        Self::FeedMode,
        Self::PathControl,
        Self::Tool,
        Self::Spindle,
        Self::Coolant,
        Self::Overrides,
        Self::Program,
    ];

    /// The name of the group.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Motion => "Motion",
            Self::NonModal => "One line only",
            Self::Plane => "Plane",
            Self::Units => "Units",
            Self::Distance => "Distance",
            Self::FeedMode => "Feed mode",
            Self::Tool => "Tools",
            Self::Coordinates => "Work coordinates",
            Self::PathControl => "Path control",
            Self::Cycle => "Canned cycles",
            Self::Program => "Program flow",
            Self::Spindle => "Spindle",
            Self::Coolant => "Coolant",
            Self::Overrides => "Overrides",
        }
    }
}

const fn row(
    code: &'static str,
    group: CodeGroup,
    text: &'static str,
    words: &'static str,
    example: &'static [&'static str],
    refused: &'static [(&'static str, LineError)],
) -> CodeRow {
    CodeRow {
        code,
        group,
        text,
        words,
        example,
        refused,
    }
}

/// Every code.
#[rustfmt::skip]
pub static CODES: &[CodeRow] = &[
    row("G0", CodeGroup::Motion, "rapid move along a straight line", "axes", &["G0 X10 Y-5"], &[("G0 G1", AxisCommandConflict), ("G0 X1 P1", UnusedWords), ("G0 X99999999", InvalidTarget)]),
    row("G1", CodeGroup::Motion, "straight move at the feed F", "axes [F]", &["G1 X10 F600"], &[("G1 X10", FeedUndefined), ("G1 X1 F-1", NegativeValue)]),
    row("G2", CodeGroup::Motion, "clockwise arc or helix: centre by I J K from its start, or radius R (negative: the longer arc), P turns", "axes of the plane (a full circle without), I J K or R [P F]", &["G2 X10 Y0 I5 F600", "G2 I5 F600", "G2 Z1 I5 F600"], &[("G2 R5 F600", NoAxisWords), ("G2 Z1 R5 F600", NoAxisWordsInPlane), ("G2 X10 F600", NoOffsetsInPlane), ("G2 X10 I3 F600", InvalidTarget), ("G2 X10 I5 P0.5 F600", NotInteger)]),
    row("G3", CodeGroup::Motion, "counter-clockwise arc or helix", "as G2", &["G3 X10 R5 F600"], &[("G3 X10 R2 F600", LineError::ArcRadius)]),
    row("G38.2", CodeGroup::Motion, "probe until contact; alarm without", "axes F P", &["G38.2 Z-10 F100", "G38.2 Z-20 F100 P1.5"], &[("G38.2 F100", NoAxisWords), ("G38.2 X1 Z-10 F100 P1", UnusedWords), ("G38.2 Z0 F100", InvalidTarget)]),
    row("G38.3", CodeGroup::Motion, "probe until contact, if there is any", "axes F P", &["G38.3 Z-10 F100"], &[]),
    row("G38.4", CodeGroup::Motion, "probe until the contact opens; alarm without", "axes F P", &["G38.4 Z5 F100"], &[]),
    row("G38.5", CodeGroup::Motion, "probe until the contact opens, if it does", "axes F P", &["G38.5 Z5 F100"], &[]),
    row("G80", CodeGroup::Motion, "no motion mode: axis words alone are refused; beside G0 to G3 without axis words a safe start", "", &["G80"], &[("G80 X1", UnusedAxisWords), ("G80 G0 X1", ModalGroupViolation)]),

    row("G81", CodeGroup::Cycle, "drills: rapid over the hole and down to R, feed to the bottom, rapid out; the words stay for the next lines", "axes R [L]", &["F100", "G0 Z10", "G81 X5 Y5 Z-3 R2"], &[("G81 X5 Z-3", MissingWord), ("G81 X5 Z-3 R-4", RetractBelowBottom), ("G81 X5 Z-3 R2 L0", NotPositive), ("F10 G93 G81 X5 Z-3 R2", CycleNeedsFeedPerMinute), ("G81 X5 Z-3 R2", FeedUndefined)]),
    row("G82", CodeGroup::Cycle, "as G81, with a dwell of P seconds at the bottom", "axes R P [L]", &["F100", "G82 X5 Z-3 R2 P0.5"], &[("F100 G82 X5 Z-3 R2", MissingWord)]),
    row("G83", CodeGroup::Cycle, "as G81, in pecks of Q with a rapid to R after each; P dwells at the bottom", "axes R Q [P L]", &["F100", "G83 X5 Z-3 R2 Q1", "G83 X5 Z-3 R2 Q1 P0.5"], &[("F100 G83 X5 Z-3 R2 Q0", NotPositive)]),
    row("G73", CodeGroup::Cycle, "as G83, but only lifted by $28 after each peck", "axes R Q [P L]", &["F100", "G73 X5 Z-3 R2 Q1"], &[("F100 G73 X5 Z-3 R2", MissingWord)]),
    row("G84", CodeGroup::Cycle, "taps, with a floating holder: feed to the bottom, spindle reversed, feed out, overrides off meanwhile", "axes R [P L]", &["F100", "M3 S200", "G84 X5 Z-3 R2"], &[("F100 G84 X5 Z-3 R2", SpindleOff)]),
    row("G74", CodeGroup::Cycle, "as G84, for a spindle that turns the other way", "axes R [P L]", &["F100", "M4 S200", "G74 X5 Z-3 R2"], &[("F100 G74 X5 Z-3 R2", SpindleOff)]),
    row("G85", CodeGroup::Cycle, "bores: feed to the bottom and up to R, rapid out", "axes R [L]", &["F100", "G85 X5 Z-3 R2"], &[("F100 G85 X5 Z-3", MissingWord)]),
    row("G86", CodeGroup::Cycle, "bores: dwell and spindle stop at the bottom, rapid out", "axes R P [L]", &["F100", "M3 S200", "G86 X5 Z-3 R2 P0.5"], &[("F100 G86 X5 Z-3 R2 P1", SpindleOff)]),
    row("G88", CodeGroup::Cycle, "bores: dwell, spindle stop and program pause at the bottom", "axes R P [L]", &["F100", "M3 S200", "G88 X5 Z-3 R2 P0.5"], &[("F100 G88 X5 Z-3 R2 P1", SpindleOff)]),
    row("G89", CodeGroup::Cycle, "bores: dwell at the bottom, feed out", "axes R P [L]", &["F100", "G89 X5 Z-3 R2 P0.5"], &[("F100 G89 X5 Z-3 R2", MissingWord)]),
    row("G98", CodeGroup::Cycle, "canned cycles retract to where the axis was (default)", "", &["G98"], &[("G98 G99", ModalGroupViolation)]),
    row("G99", CodeGroup::Cycle, "canned cycles retract to R", "", &["G99"], &[]),
    row("G50", CodeGroup::Cycle, "no scaling: accepted, as there is none", "", &["G50"], &[("G51", Unsupported)]),

    row("G4", CodeGroup::NonModal, "dwell, P seconds", "P", &["G4 P0.5"], &[("G4", MissingWord), ("G4 P-1", NegativeValue), ("G4 P9999999", ValueOutOfRange)]),
    row("G10", CodeGroup::NonModal, "L2: sets the origin of work coordinate system P (0 for the one in use) in machine coordinates, and with R its rotation in degrees; L20: moves the origin so that the present position gets the values; L1: sets the offset and the radius R of tool P; L10: sets its offset so that with G43 the present position gets the values; L11: as L10, in G59.3 without G92", "L P [axes R]", &["G10 L2 P1 X10 Y20 R30"], &[("G10 L2 P1", NoAxisWords), ("G10 L2 X1", MissingWord), ("G10 L2 P10 X1", UnknownCoordinates), ("G10 L20 P1 X1 R5", UnusedWords), ("G10 L1 P1", NoAxisWords), ("G10 L1 P1.5 Z1", NotInteger), ("G10 L10 P0 Z1", LineError::UnknownTool), ("G10 L3 P1 X1", Unsupported)]),
    row("G28", CodeGroup::NonModal, "rapid to the first stored position, by way of the axis words; only the named axes go there", "[axes]", &["G28 Z5"], &[("G28 G2 X1", AxisCommandConflict)]),
    row("G28.1", CodeGroup::NonModal, "stores the present position for G28", "", &["G28.1"], &[]),
    row("G30", CodeGroup::NonModal, "rapid to the second stored position", "[axes]", &["G30"], &[]),
    row("G30.1", CodeGroup::NonModal, "stores the present position for G30", "", &["G30.1"], &[]),
    row("G52", CodeGroup::NonModal, "sets the offset of G92 to the values", "axes", &["G52 X5"], &[("G52", NoAxisWords)]),
    row("G53", CodeGroup::NonModal, "the line's axis words are machine coordinates", "with G0 or G1", &["G53 G0 X0"], &[("G53 G2 X1 I1", MachineCoordinatesMotion)]),
    row("G92", CodeGroup::NonModal, "an offset with which the present position gets the values", "axes", &["G92 X0 Y0"], &[("G92", NoAxisWords), ("G0 G92 X1", AxisCommandConflict)]),
    row("G92.1", CodeGroup::NonModal, "ends the offset of G92 and forgets it", "", &["G92 X5", "G92.1"], &[]),
    row("G92.2", CodeGroup::NonModal, "ends the offset of G92; G92.3 restores it", "", &["G92 X5", "G92.2"], &[]),
    row("G92.3", CodeGroup::NonModal, "restores the offset of G92", "", &["G92 X5", "G92.2", "G92.3"], &[]),

    row("G54", CodeGroup::Coordinates, "work coordinate system 1 (default)", "", &["G54"], &[("G54 G55", ModalGroupViolation)]),
    row("G55", CodeGroup::Coordinates, "work coordinate system 2", "", &["G55"], &[]),
    row("G56", CodeGroup::Coordinates, "work coordinate system 3", "", &["G56"], &[]),
    row("G57", CodeGroup::Coordinates, "work coordinate system 4", "", &["G57"], &[]),
    row("G58", CodeGroup::Coordinates, "work coordinate system 5", "", &["G58"], &[]),
    row("G59", CodeGroup::Coordinates, "work coordinate system 6", "", &["G59"], &[("G59.4", NotInteger)]),
    row("G59.1", CodeGroup::Coordinates, "work coordinate system 7", "", &["G59.1"], &[]),
    row("G59.2", CodeGroup::Coordinates, "work coordinate system 8", "", &["G59.2"], &[]),
    row("G59.3", CodeGroup::Coordinates, "work coordinate system 9", "", &["G59.3"], &[]),

    row("G17", CodeGroup::Plane, "arcs in the plane of X and Y (default)", "", &["G17"], &[("G17 G18", ModalGroupViolation)]),
    row("G18", CodeGroup::Plane, "arcs in the plane of Z and X", "", &["G18"], &[]),
    row("G19", CodeGroup::Plane, "arcs in the plane of Y and Z", "", &["G19"], &[]),
    row("G20", CodeGroup::Units, "inches", "", &["G20"], &[("G20 G21", ModalGroupViolation)]),
    row("G21", CodeGroup::Units, "millimetres (default)", "", &["G21"], &[]),
    row("G90", CodeGroup::Distance, "coordinates from the origin (default)", "", &["G90"], &[("G90 G91", ModalGroupViolation)]),
    row("G91", CodeGroup::Distance, "coordinates from the position before", "", &["G91"], &[]),
    row("G90.1", CodeGroup::Distance, "I J K from the origin", "", &["G90.1"], &[("G90.1 G2 X10 I5 F100", NoOffsetsInPlane)]),
    row("G91.1", CodeGroup::Distance, "I J K from the start of the arc (default)", "", &["G91.1"], &[]),
    row("G93", CodeGroup::FeedMode, "F is the inverse of the move's time in minutes, in every line with a feed move", "", &["G93 G1 X10 F2"], &[("G93 G1 X10", FeedUndefined)]),
    row("G94", CodeGroup::FeedMode, "F is a speed, mm or inches per minute (default)", "", &["G94"], &[]),

    row("G61", CodeGroup::PathControl, "along the programmed path, as fast as the corners allow (default)", "", &["G61"], &[("G61 G64", ModalGroupViolation)]),
    row("G61.1", CodeGroup::PathControl, "to a standstill at the end of each move", "", &["G61.1"], &[]),
    row("G64", CodeGroup::PathControl, "rounds corners, P at most from the path ($785 without P), and merges lines within Q (P without Q)", "[P Q]", &["G64 P0.05"], &[("G64 P-1", NegativeValue), ("G1 X1 F100 Q1", Unsupported)]),

    row("G40", CodeGroup::Tool, "no cutter compensation (default); the next move, a straight one, leaves the contour", "", &["G40"], &[("G40.1", NotInteger)]),
    row("G41", CodeGroup::Tool, "keeps the cutter of tool D to the left of the programmed path, without D of the tool in the spindle; the next move is the entry. In G17 and G18, until G40 without G28, G30, G53, G92, other work coordinates, tool lengths, probing and cycles", "[D]", &["G10 L1 P2 R3", "G41 D2 G1 X10 F100"], &[("G41 D1.5", NotInteger), ("G41 D3", LineError::UnknownTool), ("G41 D-1", NegativeValue), ("G19 G41", LineError::NotInThisPlane), ("G1 D2", Unsupported)]),
    row("G41.1", CodeGroup::Tool, "as G41, with a cutter of the diameter D; a negative one is on the other side", "D", &["G41.1 D6"], &[("G41.1", MissingWord)]),
    row("G42", CodeGroup::Tool, "as G41, to the right", "[D]", &["G10 L1 P2 R3", "G42 D2 G1 X10 F100"], &[("G42.2", Unsupported)]),
    row("G42.1", CodeGroup::Tool, "as G41.1, to the right", "D", &["G42.1 D6"], &[("G42.1 D5000", InvalidTarget)]),
    row("G43", CodeGroup::Tool, "uses the offset of tool H in the tool table, without H of the tool in the spindle", "[H]", &["G10 L1 P2 Z50.5", "G43 H2"], &[("G43 H256", LineError::UnknownTool), ("G43 H1.5", NotInteger), ("G0 H2", Unsupported)]),
    row("G43.1", CodeGroup::Tool, "sets the tool length offset of the given axes", "axes", &["G43.1 Z-12.5"], &[("G43.1", ToolLengthAxis)]),
    row("G43.2", CodeGroup::Tool, "adds the offset of tool H, or the axis words, to the tool length offset", "H or axes", &["G10 L1 P2 Z50.5", "G43 H2", "G43.2 Z-0.1"], &[("G43.2", MissingWord), ("G43.2 H2 Z1", LineError::ToolLengthWords)]),
    row("G49", CodeGroup::Tool, "no tool length offset (default)", "", &["G49"], &[]),

    row("M6", CodeGroup::Tool, "loads tool T: spindle and coolant off, then waits for cycle start ($341); coolant comes back, the spindle does not", "[T]", &["T2 M6"], &[("M6 M61 Q2", ModalGroupViolation), ("T256 M6", LineError::UnknownTool)]),
    row("M61", CodeGroup::Tool, "tool Q is in the spindle; nothing moves", "Q", &["M61 Q2"], &[("M61", MissingWord), ("M61 Q1.5", NotInteger), ("M61 Q-1", NegativeValue), ("M61 Q256", LineError::UnknownTool)]),

    row("M3", CodeGroup::Spindle, "spindle clockwise at S rpm; laser at constant power", "[S]", &["M3 S1000"], &[("M3 M4", ModalGroupViolation)]),
    row("M4", CodeGroup::Spindle, "spindle counter-clockwise; laser in proportion to the speed", "[S]", &["M4 S500"], &[]),
    row("M5", CodeGroup::Spindle, "spindle off", "", &["M5"], &[]),
    row("G97", CodeGroup::Spindle, "S is rpm: accepted, as it always is", "", &["G97 S1000"], &[("G96 S100", Unsupported)]),
    row("M7", CodeGroup::Coolant, "mist on", "", &["M7"], &[]),
    row("M8", CodeGroup::Coolant, "flood on", "", &["M8"], &[]),
    row("M9", CodeGroup::Coolant, "coolant off", "", &["M9"], &[]),
    row("M48", CodeGroup::Overrides, "overrides of feed and spindle count (default)", "", &["M48"], &[("M48 M49", ModalGroupViolation)]),
    row("M49", CodeGroup::Overrides, "overrides of feed and spindle do not count", "", &["M49"], &[]),
    row("M50", CodeGroup::Overrides, "the override of the feed counts; with P0 it does not", "[P]", &["M50 P0"], &[]),
    row("M51", CodeGroup::Overrides, "the override of the spindle counts; with P0 it does not", "[P]", &["M51 P0"], &[]),
    row("M53", CodeGroup::Overrides, "accepted; a feed hold always works", "[P]", &["M53 P1"], &[]),

    row("M0", CodeGroup::Program, "waits for cycle start", "", &["M0"], &[]),
    row("M1", CodeGroup::Program, "waits for cycle start while optional stops are on (0x88)", "", &["M1"], &[]),
    row("M2", CodeGroup::Program, "end of the program: spindle and coolant off, G1, G17, G54, G90, G94, overrides 100 %", "", &["M2"], &[]),
    row("M30", CodeGroup::Program, "as M2", "", &["M30"], &[]),
];
