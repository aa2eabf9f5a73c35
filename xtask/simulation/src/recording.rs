//! What is recorded of a run for its page.

use std::collections::VecDeque;

use leadscrew::{
    axis::{AXES, Axes, LETTERS, LINEAR},
    gcode::MotionMode,
    model::{Command, Spindle, core_xy},
    protocol::Session,
    settings::{Setting, Settings},
    sim::{PlayedSegment, SegmentKind, Simulator},
    units::Nm,
};

use crate::{
    columns::{ColumnWriter, varint},
    curves::Curves,
    drilled_holes,
    figures::Figures,
    job::{Axis, HoleMark, Job, PathInfo, PlaceMark, Programmed, Refused, SettingRow, Times},
    meaning,
    merge::Merger,
    playing::{self, RaisedAlarm, Recorder},
    program_reader::ProgramReader,
    sender::Response,
    settings::name,
    vertex::{Vertex, kind_number, power_of},
};

/// Most marks of a kind, and most refused lines that are listed.
const KEPT: usize = 20_000;

/// Records a run.
pub struct Recording {
    marks: MarkRecorder,
    text: Vec<u8>,
    merger: Merger,
    pub(crate) path: Path,
    pub(crate) curves: Curves,
    /// Speed, power and line of the segment before.
    before: (f32, u32, u32),
    segments: u64,
    is_begun: bool,
    /// The steps are those of the motors of `CoreXY`, not of X and Y.
    is_core_xy: bool,
    alarms: Vec<Refused>,
}

impl Recording {
    /// For a machine as it is before the program.
    pub fn new(session: &Session) -> Self {
        Self {
            marks: MarkRecorder::new(ProgramReader::of(session)),
            text: Vec::new(),
            merger: Merger::new(scales(session.settings())),
            path: Path::default(),
            curves: Curves::new(session.settings()),
            before: (0.0, 0, 0),
            segments: 0,
            is_begun: false,
            is_core_xy: session.settings().core_xy,
            alarms: Vec::new(),
        }
    }

    /// Returns the job; `settings` are those of the machine before it.
    pub fn finish(mut self, figures: &Figures, title: &str, settings: &Settings) -> Job {
        let path = &mut self.path;
        self.merger.flush(&mut |vertex| path.push(vertex));
        let seconds = path.duration_us() as f64 * 1e-6;
        let stretch_s = self.curves.finish(seconds);
        let mut curves = Vec::new();
        let axes = (0..AXES).map(|axis| {
            let has_moved = self.curves.axes[axis].has_moved();
            axis_of(
                settings,
                axis,
                has_moved.then(|| self.curves.write(axis, &mut curves)),
            )
        });
        let axes = axes.collect();
        let corners = self.curves.write_corners(&mut curves);
        let times = &figures.times;
        Job {
            title: title.into(),
            axes,
            corners,
            programmed: self.marks.programmed,
            speeds_rpm: self.marks.speeds_rpm,
            has_soft_limits: settings.soft_limits,
            path: PathInfo {
                vertices: path.vertices,
                segments: self.segments,
            },
            stretch_s,
            times: Times {
                cutting: times.cutting_s,
                rapids: times.rapid_s,
                standstill: times.standstill_s,
                other: times.other_s,
                cutting_mm: times.cutting_mm,
                rapid_mm: times.rapid_mm,
            },
            lines: figures.lines,
            events: figures.events,
            hash: figures.event_hash.clone(),
            end: figures.end.state.clone(),
            refused: refused(figures),
            refused_count: figures.responses.refused(),
            alarms: self.alarms,
            holes: self.marks.holes,
            tool_changes: self.marks.tool_changes,
            work_zeros: self.marks.work_zeros,
            settings: setting_rows(settings),
            is_laser: settings.laser,
            text: self.text,
            columns: std::mem::take(path).finish(),
            curves,
        }
    }
}

impl Recorder for Recording {
    fn line(&mut self, line: &[u8]) {
        self.text.extend_from_slice(line);
        self.text.push(b'\n');
        self.marks.line(line);
    }

    fn segment(&mut self, segment: &PlayedSegment) {
        // What is before the first motion is no part of the job.
        self.is_begun |= segment.kind != SegmentKind::Standstill;
        if !self.is_begun {
            return;
        }
        self.segments += 1;
        self.curves.push(segment);
        let (speed, power, line_before) = self.before;
        // Dwells have no line of their own.
        let is_still = segment.kind == SegmentKind::Standstill;
        let line = if is_still { line_before } else { segment.line };
        let mut vertex = Vertex::begin(segment, speed, power, line);
        if self.is_core_xy {
            vertex.steps = core_xy::steps_of(segment.steps).0;
        }
        let path = &mut self.path;
        self.merger.push(vertex, &mut |kept| path.push(kept));
        self.before = (segment.end_mm_min, power_of(segment), line);
    }

    fn answer(&mut self, is_refused: bool) {
        self.marks.answer(is_refused);
    }

    fn alarm(&mut self, alarm: &RaisedAlarm) {
        if self.alarms.len() < KEPT {
            self.alarms.push(Refused {
                line: alarm.line,
                name: alarm.name.clone(),
                why: alarm.why.clone(),
            });
        }
    }

    fn wants_line_numbers(&self) -> bool {
        true
    }
}

/// The vertices that stay, as columns.
#[derive(Debug, Clone, Default)]
pub(crate) struct Path {
    pub(crate) vertices: usize,
    times: ColumnWriter,
    steps: [ColumnWriter; AXES],
    speeds: ColumnWriter,
    lines: ColumnWriter,
    kinds: Vec<u8>,
    programmed: ColumnWriter,
    /// Where a piece begins with another power than the one before has ended with, and how the power
    /// changes within a piece.
    powers: [ColumnWriter; 2],
    begun_us: Option<u64>,
    end_us: u64,
    /// All vertices, for tests.
    #[cfg(test)]
    pub(crate) kept: Vec<Vertex>,
}

impl Path {
    pub(crate) fn push(&mut self, vertex: &Vertex) {
        #[cfg(test)]
        self.kept.push(*vertex);
        let begun = *self.begun_us.get_or_insert(vertex.us);
        self.end_us = vertex.us;
        self.vertices += 1;
        self.times.push((vertex.us - begun).cast_signed());
        for (column, steps) in self.steps.iter_mut().zip(vertex.steps) {
            column.push(steps.into());
        }
        self.speeds.push(vertex.speed.into());
        self.lines.push(vertex.span.line.into());
        varint(&mut self.kinds, kind_number(vertex.span.kind));
        self.programmed.push(vertex.span.programmed.into());
        for (column, power) in self.powers.iter_mut().zip(vertex.power) {
            column.push(power.into());
        }
    }

    fn duration_us(&self) -> u64 {
        self.end_us - self.begun_us.unwrap_or(self.end_us)
    }

    /// Returns the columns, one behind the other.
    pub(crate) fn finish(self) -> Vec<u8> {
        let mut bytes = self.times.bytes;
        let steps = self.steps.into_iter().map(|column| column.bytes);
        let others = [
            self.speeds.bytes,
            self.lines.bytes,
            self.kinds,
            self.programmed.bytes,
        ];
        let powers = self.powers.map(|column| column.bytes);
        for mut column in steps.chain(others).chain(powers) {
            bytes.append(&mut column);
        }
        bytes
    }
}

/// What is marked, and what waits for the answer to its line.
struct MarkRecorder {
    reader: ProgramReader,
    lines: u64,
    /// Of each line that is not answered.
    pending: VecDeque<Marks>,
    holes: Vec<HoleMark>,
    tool_changes: Vec<PlaceMark>,
    work_zeros: Vec<PlaceMark>,
    programmed: Vec<Programmed>,
    speeds_rpm: Option<[f32; 2]>,
}

/// What a line marks.
#[derive(Default)]
struct Marks {
    /// What holds from the line on, and `S` where the spindle is on.
    programmed: Programmed,
    speed_rpm: Option<f32>,
    holes: Vec<HoleMark>,
    tool_change: Option<PlaceMark>,
    work_zero: Option<PlaceMark>,
}

impl MarkRecorder {
    fn new(reader: ProgramReader) -> Self {
        Self {
            reader,
            lines: 0,
            pending: VecDeque::new(),
            holes: Vec::new(),
            tool_changes: Vec::new(),
            work_zeros: Vec::new(),
            programmed: Vec::new(),
            speeds_rpm: None,
        }
    }

    fn line(&mut self, line: &[u8]) {
        self.lines += 1;
        let from = self.reader.interpreter().position();
        let commands = self.reader.line(line);
        let interpreter = self.reader.interpreter();
        let modal = interpreter.modal();
        let is_on = modal.spindle != Spindle::Off;
        let speed_rpm = is_on.then_some(modal.speed_rpm);
        let is_laser = self.reader.settings().laser;
        let mut marks = Marks {
            // The power of a laser is that of its moves.
            programmed: Programmed {
                line: self.lines,
                tool: interpreter.loaded_tool(),
                rpm: speed_rpm.filter(|_| !is_laser).unwrap_or_default(),
            },
            speed_rpm,
            ..Marks::default()
        };
        if let MotionMode::Cycle(cycle) = modal.motion {
            let found = drilled_holes::holes_of_line(interpreter, cycle, from, &commands);
            let named = found.into_iter().map(|hole| HoleMark {
                line: self.lines,
                name: format!("G{}", hole.cycle as u8),
                top: hole.top,
                bottom: hole.bottom,
            });
            marks.holes.extend(named);
        }
        let mark = |name: String, at: &Axes<Nm>| PlaceMark {
            line: self.lines,
            name,
            at: std::array::from_fn(|axis| at[axis].0 as f64 * 1e-6),
        };
        let changed = self.reader.changed_tool();
        marks.tool_change = changed.map(|tool| mark(format!("T{tool}"), &from));
        let moves =
            |command: &Command| matches!(command, Command::Line { .. } | Command::Arc { .. });
        if commands.iter().any(moves) {
            let zero = interpreter.work_offset(&interpreter.position());
            marks.work_zero = Some(mark(modal.coordinates.word().into(), &zero));
        }
        self.pending.push_back(marks);
    }

    fn answer(&mut self, is_refused: bool) {
        let marks = self.pending.pop_front().unwrap_or_default();
        if is_refused {
            return;
        }
        let programmed = marks.programmed;
        let is_same =
            |before: &Programmed| (before.tool, before.rpm) == (programmed.tool, programmed.rpm);
        if !self.programmed.last().is_some_and(is_same) && self.programmed.len() < KEPT {
            self.programmed.push(programmed);
        }
        if let Some(rpm) = marks.speed_rpm {
            let [least, greatest] = self.speeds_rpm.unwrap_or([rpm; 2]);
            self.speeds_rpm = Some([least.min(rpm), greatest.max(rpm)]);
        }
        self.holes.extend(marks.holes);
        self.holes.truncate(KEPT);
        self.tool_changes.extend(marks.tool_change);
        self.tool_changes.truncate(KEPT);
        let known = |zero: &PlaceMark, all: &[PlaceMark]| {
            all.iter()
                .any(|one| (&one.name, one.at) == (&zero.name, zero.at))
        };
        let zeros = &mut self.work_zeros;
        let is_new = |zero: &PlaceMark| !known(zero, zeros);
        if let Some(zero) = marks.work_zero.filter(is_new) {
            zeros.push(zero);
            zeros.truncate(KEPT);
        }
    }
}

/// Steps per mm or degree of each axis.
pub(crate) fn scales(settings: &Settings) -> [f64; AXES] {
    settings
        .steps_per_mm
        .0
        .map(|scale| scale.millionths() as f64 * 1e-6)
}

fn axis_of(settings: &Settings, axis: usize, levels: Option<[f64; 3]>) -> Axis {
    let jerk = Some(settings.jerk_mm_s3[axis]).filter(|jerk| *jerk > 0.0);
    let limits = [
        Some(settings.max_rate_mm_min[axis]),
        Some(settings.acceleration_mm_s2[axis]),
        jerk,
    ];
    Axis {
        letter: char::from(LETTERS[axis]),
        is_motor: settings.core_xy && axis < 2,
        scale: scales(settings)[axis],
        is_rotary: axis >= LINEAR,
        limits: limits.map(|limit| limit.map(f64::from)),
        travel: settings.travel(axis).map(|ends| ends.map(Nm::to_mm_f64)),
        levels,
    }
}

/// The refused lines, and why.
fn refused(figures: &Figures) -> Vec<Refused> {
    let answers = figures.responses.iter();
    let refused = answers.filter_map(|(line, answer)| match answer {
        Response::Ok => None,
        Response::Error(number) => Some(Refused {
            line,
            name: answer.to_string(),
            why: meaning::error_with_remedy(number).unwrap_or_else(|| "an unknown error".into()),
        }),
    });
    refused.take(KEPT).collect()
}

/// All settings, as the machine lists them.
fn setting_rows(settings: &Settings) -> Vec<SettingRow> {
    let listed = |settings: &Settings| {
        let mut simulator = Box::new(Simulator::new(settings));
        let mut answer = playing::ask(&mut simulator, b"$+\n");
        // The welcome comes first.
        answer.retain(|line| line.starts_with('$'));
        answer
    };
    let (used, new) = (listed(settings), listed(&Settings::new(settings.step_rate)));
    let rows = Setting::all().zip(used.into_iter().zip(new));
    let rows = rows.map(|(setting, (text, default))| SettingRow {
        is_changed: text != default,
        name: name(&setting),
        unit: setting.row.unit.into(),
        text,
    });
    rows.collect()
}
