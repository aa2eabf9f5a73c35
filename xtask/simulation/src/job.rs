//! What the page shows of a job, beside its path and its text.

use serde::Serialize;

/// A job as the page gets it.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Job {
    /// Its name.
    pub title: String,
    pub(crate) axes: Vec<Axis>,
    /// Its path.
    pub path: PathInfo,
    /// Length of a stretch of the curves, s.
    pub(crate) stretch_s: f64,
    pub(crate) times: Times,
    /// Its lines.
    pub lines: u64,
    pub(crate) events: u64,
    pub(crate) hash: String,
    /// Where the machine ended: state, and the position as it tells it.
    pub(crate) end: String,
    pub(crate) refused: Vec<Refused>,
    pub(crate) refused_count: u64,
    pub(crate) alarms: Vec<Refused>,
    pub(crate) holes: Vec<HoleMark>,
    pub(crate) tool_changes: Vec<PlaceMark>,
    pub(crate) work_zeros: Vec<PlaceMark>,
    pub(crate) corners: Corners,
    /// Where tool or spindle speed change, in the order of the lines.
    pub(crate) programmed: Vec<Programmed>,
    /// Least and greatest `S` with the spindle or laser on; none without it.
    pub(crate) speeds_rpm: Option<[f32; 2]>,
    /// Whether the machine refuses what leaves its travel: `$20`.
    pub(crate) has_soft_limits: bool,
    pub(crate) settings: Vec<SettingRow>,
    pub(crate) is_laser: bool,
    /// The program, a line each.
    #[serde(skip)]
    pub text: Vec<u8>,
    /// The columns of the path, one behind the other.
    #[serde(skip)]
    pub columns: Vec<u8>,
    /// The curves, in the order of the axes that have any.
    #[serde(skip)]
    pub curves: Vec<u8>,
}

impl Job {
    /// The tools in the spindle, 0 for none, each with the first line at which it is there.
    pub fn tools(&self) -> Vec<(u8, u64)> {
        let mut tools: Vec<(u8, u64)> = Vec::new();
        for Programmed { line, tool, .. } in &self.programmed {
            if !tools.iter().any(|(known, _)| known == tool) {
                tools.push((*tool, *line));
            }
        }
        tools
    }
}

/// An axis.
#[derive(Debug, Clone, Default, Serialize)]
pub(crate) struct Axis {
    pub(crate) letter: char,
    /// Its curves are those of a motor of `CoreXY`, which has the limits.
    pub(crate) is_motor: bool,
    /// Steps per mm or degree.
    pub(crate) scale: f64,
    pub(crate) is_rotary: bool,
    /// Largest speed, mm/min, acceleration, mm/s², and jerk, mm/s³, or degrees.
    pub(crate) limits: [Option<f64>; 3],
    /// Ends of the travel in machine coordinates, mm; none without a limit.
    pub(crate) travel: Option<[f64; 2]>,
    /// Values of a level of its curves, mm/s and so on; none for an axis that stands.
    pub(crate) levels: Option<[f64; 3]>,
}

/// The path.
#[derive(Debug, Clone, Default, Serialize)]
pub struct PathInfo {
    /// Points at which something changes.
    pub vertices: usize,
    /// Segments that the machine has played.
    pub(crate) segments: u64,
}

/// What holds from a line on.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(crate) struct Programmed {
    pub(crate) line: u64,
    /// The tool in the spindle, 0 for none.
    pub(crate) tool: u8,
    /// Programmed speed of the spindle, 0 while it is off and with a laser.
    pub(crate) rpm: f32,
}

/// The corners that are passed at speed.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(crate) struct Corners {
    /// How many there are, and how many have a place in the curves.
    pub(crate) count: usize,
    pub(crate) written: usize,
    /// Least and greatest speed, mm/min.
    pub(crate) slowest: Option<f64>,
    pub(crate) fastest: Option<f64>,
    /// The greatest ratio of the speed to what `$11` allows.
    pub(crate) most_of_allowed: Option<f64>,
}

/// What the time goes into, s, and the distances, mm.
#[derive(Debug, Clone, Default, Serialize)]
pub(crate) struct Times {
    pub(crate) cutting: f64,
    pub(crate) rapids: f64,
    pub(crate) standstill: f64,
    pub(crate) other: f64,
    pub(crate) cutting_mm: f64,
    pub(crate) rapid_mm: f64,
}

/// A refused line, or an alarm behind a line.
#[derive(Debug, Clone, Default, Serialize)]
pub(crate) struct Refused {
    pub(crate) line: u64,
    /// `error:20` or `ALARM:2`.
    pub(crate) name: String,
    pub(crate) why: String,
}

/// A hole: mm in machine coordinates.
#[derive(Debug, Clone, Default, Serialize)]
pub(crate) struct HoleMark {
    pub(crate) line: u64,
    pub(crate) name: String,
    pub(crate) top: [f64; 3],
    pub(crate) bottom: [f64; 3],
}

/// Something at a place.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(crate) struct PlaceMark {
    pub(crate) line: u64,
    pub(crate) name: String,
    pub(crate) at: [f64; 3],
}

/// A setting.
#[derive(Debug, Clone, Default, Serialize)]
pub(crate) struct SettingRow {
    /// `$110=5000.000`.
    pub(crate) text: String,
    pub(crate) name: String,
    pub(crate) unit: String,
    /// Whether the value is not that of a new machine.
    pub(crate) is_changed: bool,
}
