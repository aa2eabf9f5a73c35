//! Where a job can be continued, and the lines that bring the machine there.
//!
//! The state before a line is that of the firmware's own interpreter, which has read all lines before it.
//! It does so twice, from two different positions wherever a position is unknown: where both agree, the
//! state does not depend on it. The lines of the approach are then read by a third interpreter that stands
//! as the machine does now, and the lines of the job that follow must be the same commands to both.

use anyhow::{Result, bail, ensure};
use leadscrew::{
    axis::{AXES, Axes, LETTERS, LINEAR, Z},
    gcode::{
        ArcDistance, FeedMode, Modal, RetractMode,
        interpreter::{Interpreter, Offsets},
    },
    model::{Coolant, PathControl, Plane, Spindle, WorkCoordinates},
    protocol::{ReportUnit, Text, listing},
    settings::Settings,
    units::Nm,
};

use crate::replay::{Effect, Replay};

/// How far apart the two interpreters stand where a position is unknown.
const APART: Nm = Nm(17_123_457);
/// Lines of the job by which the approach is checked, at most.
const CHECKED: usize = 200;
/// A stored offset is shown with three decimals: the farthest that one may be off, nm.
const SHOWN: i64 = 1_000;
/// Earlier lines that are tried where an approach does not lead to one.
const TRIES: usize = 20;

/// How the tool goes down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Descent {
    /// Highest feed, mm/min.
    pub(crate) feed_mm_min: f32,
    /// How long the spindle gets before, s.
    pub(crate) spin_up_s: f32,
}

/// What a job began with, as far as it is known.
pub(crate) struct Beginning {
    pub(crate) interpreter: Interpreter,
    /// Whether the position is known.
    pub(crate) is_placed: bool,
}

/// Where a job is continued.
#[derive(Debug)]
pub(crate) struct Entry {
    /// The line, counted from 0.
    pub(crate) line: usize,
    /// What is sent before it.
    pub(crate) approach: Vec<String>,
    /// The modes before it, as `$G` lists them.
    pub(crate) modes: String,
    /// The tool that must be in the spindle.
    pub(crate) tool: u8,
    /// The work position at which it begins, mm and degrees.
    pub(crate) position: Vec<String>,
}

/// Finds the last line up to `wanted` at which a job can be continued by a machine that stands as `now`.
///
/// # Errors
/// There is none.
pub(crate) fn entry(
    lines: &[Vec<u8>],
    wanted: usize,
    beginning: &Beginning,
    now: &Interpreter,
    settings: &Settings,
    descent: Descent,
) -> Result<Entry> {
    ensure!(wanted < lines.len(), "the job has {} lines", lines.len());
    let mut most = wanted;
    let mut reason = String::from(
        ": the place depends on where the machine stood, or where a probe met something",
    );
    for _ in 0..TRIES {
        let Some(Begin {
            line,
            state,
            highest,
        }) = last_begin(lines, most, beginning, settings)
        else {
            break;
        };
        let top = top(highest.max(now.position()[Z]), settings);
        let tried = approach(&state, now, top, settings, descent);
        match check(&lines[line..], &state, now, settings, &tried) {
            Ok(()) => {
                return Ok(Entry {
                    line,
                    approach: tried,
                    modes: modes(state.interpreter.modal(), settings),
                    tool: state.interpreter.loaded_tool(),
                    position: words(&work_position(&state.interpreter), 0..AXES),
                });
            }
            Err(error) => reason = format!(": line {}: {error}", line + 1),
        }
        let Some(earlier) = line.checked_sub(1) else {
            break;
        };
        most = earlier;
    }
    bail!(
        "the job cannot be continued at line {} or before it{reason}",
        wanted + 1
    )
}

/// A line at which a job may begin.
struct Begin {
    line: usize,
    /// The state before it.
    state: Replay,
    /// The highest machine position of Z that the job has had until then.
    highest: Nm,
}

/// The last line up to `most` before which the state is known and a job may begin, and that state.
fn last_begin(
    lines: &[Vec<u8>],
    most: usize,
    beginning: &Beginning,
    settings: &Settings,
) -> Option<Begin> {
    let mut one = Replay::new(beginning.interpreter.clone(), *settings);
    let mut other = one.clone();
    if !beginning.is_placed {
        // An axis that the job does not move at all is where it is now.
        move_apart(&one, &mut other, [true; AXES]);
        let moved = moved_axes(lines, other.clone());
        other = one.clone();
        move_apart(&one, &mut other, moved);
    }
    let mut found = None;
    let mut highest = one.interpreter.position()[Z];
    for (index, line) in lines.iter().enumerate().take(most + 1) {
        highest = highest.max(one.interpreter.position()[Z]);
        if one.may_begin() && agree(&one.interpreter, &other.interpreter) {
            found = Some(Begin {
                line: index,
                state: one.clone(),
                highest,
            });
        }
        let is_lost = one.read(line) == Effect::Lost;
        other.read(line);
        if is_lost {
            move_apart(&one, &mut other, [true; AXES]);
        }
    }
    found
}

/// The axes that lines move from where nothing leads by chance.
fn moved_axes(lines: &[Vec<u8>], mut replay: Replay) -> [bool; AXES] {
    let mut moved = [false; AXES];
    for line in lines {
        let before = replay.interpreter.position();
        let is_lost = replay.read(line) == Effect::Lost;
        let after = replay.interpreter.position();
        for (axis, moved) in moved.iter_mut().enumerate() {
            *moved |= is_lost || before[axis] != after[axis];
        }
    }
    moved
}

/// Makes the positions of two interpreters differ in some axes.
fn move_apart(one: &Replay, other: &mut Replay, axes: [bool; AXES]) {
    let position = one.interpreter.position();
    let apart = |axis: usize| Nm(APART.0 * (1 + i64::from(axis as u8)) * i64::from(axes[axis]));
    let moved = Axes::from_fn(|axis| position[axis] + apart(axis));
    other.interpreter.set_position(moved);
}

/// Whether two interpreters are in the same state.
fn agree(one: &Interpreter, other: &Interpreter) -> bool {
    one.modal() == other.modal()
        && one.position() == other.position()
        && one.offsets() == other.offsets()
        && one.loaded_tool() == other.loaded_tool()
}

/// The lines that lead a machine in its power-up modes to a state: Z to the top, the other axes at rapid
/// speed, the spindle and a dwell, Z down at feed, and the modes.
fn approach(
    state: &Replay,
    now: &Interpreter,
    top: Nm,
    settings: &Settings,
    descent: Descent,
) -> Vec<String> {
    let interpreter = &state.interpreter;
    let modal = interpreter.modal();
    let target = work_position(interpreter);
    let mut lines = vec![format!(
        "G21 G90 G94 G17 G40 G49 G80 {}",
        modal.coordinates.word()
    )];
    lines.extend(offsets(interpreter.offsets(), now.offsets()));
    if interpreter.loaded_tool() != now.loaded_tool() {
        lines.push(format!("M61 Q{}", interpreter.loaded_tool()));
    }
    lines.push(format!("G53 G0 Z{}", decimal(top)));
    let others = (0..AXES).filter(|axis| *axis != Z);
    lines.push(format!("G0 {}", words(&target, others).join(" ")));
    let accessories = accessories(modal, settings, descent);
    let feed = if modal.feed > 0.0 && modal.feed_mode == FeedMode::PerMinute {
        modal.feed.min(descent.feed_mm_min)
    } else {
        descent.feed_mm_min
    };
    let down = format!("G1 Z{} F{feed}", decimal(target[Z]));
    if settings.laser {
        // The beam stays off until the head is where it has to be.
        lines.push(down);
        lines.extend(accessories);
    } else {
        lines.extend(accessories);
        lines.push(down);
    }
    lines.extend(last_modes(modal));
    lines
}

/// The height at which the machine travels: the top where homing is on; elsewhere the highest that the job
/// has had, and that the machine has now.
fn top(highest: Nm, settings: &Settings) -> Nm {
    let homes_upwards = settings.homing && settings.homing_direction >> Z & 1 == 0;
    let top = Nm(0) - Nm::from_mm(settings.homing_pull_off_mm);
    if homes_upwards {
        highest.max(top)
    } else {
        highest
    }
}

/// Lines that put the offset of the tool and that of `G92` into effect.
fn offsets(wanted: &Offsets, now: &Offsets) -> Vec<String> {
    let mut lines = Vec::new();
    if wanted.tool != Axes::all(Nm(0)) {
        lines.push(format!(
            "G43.1 {}",
            words(&wanted.tool, 0..LINEAR).join(" ")
        ));
    }
    if wanted.work != now.work {
        lines.push(format!("G52 {}", words(&wanted.work, 0..AXES).join(" ")));
    }
    lines
}

/// Lines that switch spindle and coolant on, with a dwell behind.
fn accessories(modal: &Modal, settings: &Settings, descent: Descent) -> Vec<String> {
    let mut lines = Vec::new();
    let spindle = match modal.spindle {
        Spindle::Clockwise => "M3",
        Spindle::CounterClockwise => "M4",
        Spindle::Off => "M5",
    };
    lines.push(format!("{spindle} S{}", modal.speed_rpm));
    let Coolant { flood, mist, .. } = modal.coolant;
    let coolant = [(mist, "M7"), (flood, "M8")]
        .into_iter()
        .filter(|(is_on, _)| *is_on);
    lines.extend(coolant.map(|(_, word)| word.to_owned()));
    if modal.spindle != Spindle::Off && !settings.laser {
        lines.push(format!("G4 P{}", descent.spin_up_s));
    }
    lines
}

/// Lines for the modes that the approach itself does not use.
fn last_modes(modal: &Modal) -> Vec<String> {
    let mut words = vec![format!("F{}", modal.feed), format!("T{}", modal.tool)];
    words.push(match modal.path {
        PathControl::ExactPath => "G61".into(),
        PathControl::ExactStop => "G61.1".into(),
        PathControl::Continuous {
            tolerance_nm,
            merging_nm,
        } => {
            let [tolerance, merging] = [tolerance_nm, merging_nm].map(|nm| decimal(Nm(nm.into())));
            format!("G64 P{tolerance} Q{merging}")
        }
    });
    let mut lines = vec![words.join(" ")];
    let mut words = vec![
        modal.units.word(),
        modal.distance.word(),
        modal.feed_mode.word(),
    ];
    words.push(match modal.plane {
        Plane::Xy => "G17",
        Plane::Zx => "G18",
        Plane::Yz => "G19",
    });
    words.push(match modal.retract {
        RetractMode::InitialLevel => "G98",
        RetractMode::ReferencePlane => "G99",
    });
    words.push(match modal.arc_distance {
        ArcDistance::Absolute => "G90.1",
        ArcDistance::Incremental => "G91.1",
    });
    lines.push(words.join(" "));
    if !modal.overrides.feed {
        lines.push("M50 P0".into());
    }
    if !modal.overrides.spindle {
        lines.push("M51 P0".into());
    }
    lines
}

/// Fails where the approach, and the job after it, would not do what the job does undisturbed.
fn check(
    rest: &[Vec<u8>],
    state: &Replay,
    now: &Interpreter,
    settings: &Settings,
    approach: &[String],
) -> Result<()> {
    let wanted = state.interpreter.offsets();
    let shown = now.offsets();
    let is_near = |one: Nm, other: Nm| (one.0 - other.0).abs() <= SHOWN;
    for system in WorkCoordinates::ALL {
        let (wanted, shown) = (wanted.origin(system), shown.origin(system));
        ensure!(
            (0..AXES).all(|axis| is_near(wanted[axis], shown[axis])),
            "the origin of {} is not where the job has it",
            system.word()
        );
    }
    let mut one = state.clone();
    let mut other = Replay::new(now.clone(), *settings);
    other.interpreter.set_origins(&wanted.origins);
    for line in approach {
        let is_read = matches!(other.read(line.as_bytes()), Effect::Commands(_));
        ensure!(is_read, "the approach would need {line}, which is refused");
    }
    ensure!(
        one.interpreter.position() == other.interpreter.position(),
        "the approach would end elsewhere"
    );
    for line in rest.iter().take(CHECKED) {
        let (wanted, done) = (one.read(line), other.read(line));
        let text = String::from_utf8_lossy(line);
        ensure!(wanted == done, "{text} would do something else");
        if wanted == Effect::Lost {
            break;
        }
    }
    Ok(())
}

/// The programmed position in work coordinates.
fn work_position(interpreter: &Interpreter) -> Axes<Nm> {
    let position = interpreter.position();
    position.zip(interpreter.work_offset(&position), |position, offset| {
        position - offset
    })
}

/// A length as it is written: exactly.
fn decimal(value: Nm) -> String {
    let sign = if value.0 < 0 { "-" } else { "" };
    let size = value.0.unsigned_abs();
    let text = format!("{sign}{}.{:06}", size / 1_000_000, size % 1_000_000);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn words(values: &Axes<Nm>, axes: impl IntoIterator<Item = usize>) -> Vec<String> {
    let word = |axis: usize| format!("{}{}", char::from(LETTERS[axis]), decimal(values[axis]));
    axes.into_iter().map(word).collect()
}

/// The modes as `$G` lists them.
fn modes(modal: &Modal, settings: &Settings) -> String {
    let mut text = Text::new();
    listing::modes(&mut text, modal, false, ReportUnit::of(settings));
    String::from_utf8_lossy(text.as_bytes()).trim().to_owned()
}

#[cfg(test)]
mod tests {
    use leadscrew::{
        settings::TOOL_CHANGE_IGNORED,
        sim::{Edge, Simulator, Stream, StreamEnd, Watcher},
    };

    use super::*;
    use crate::facts::FAST;

    const DESCENT: Descent = Descent {
        feed_mm_min: 150.0,
        spin_up_s: 2.0,
    };

    fn lines(text: &str) -> Vec<Vec<u8>> {
        text.lines().map(|line| line.as_bytes().to_vec()).collect()
    }

    fn entry_with(text: &str, line: usize, is_placed: bool, settings: &Settings) -> Result<Entry> {
        let beginning = Beginning {
            interpreter: Interpreter::new(),
            is_placed,
        };
        let now = Interpreter::new();
        entry(&lines(text), line - 1, &beginning, &now, settings, DESCENT)
    }

    fn entry_of(text: &str, line: usize) -> Result<Entry> {
        entry_with(text, line, true, &Settings::default())
    }

    /// The line, counted from 1, at which a job is continued.
    fn first(text: &str, line: usize) -> usize {
        entry_of(text, line).unwrap().line + 1
    }

    #[test]
    fn a_job_is_never_continued_within_a_contour_or_a_cycle_but_at_the_line_that_enters_it() {
        let contour = "G0 X0 Y0\nG41.1 D4\nG1 X10 F100\nY10\nX20\nG40 G0 X30\nG0 X40\nG0 X50";
        assert_eq!(
            [1, 2, 3, 4, 5, 6, 7, 8].map(|line| first(contour, line)),
            [1, 2, 2, 2, 2, 2, 7, 8]
        );
        let holes = "G0 Z10 F100\nG81 X5 Z-3 R2\nX10\nX20\nG80\nG0 X0\nG0 X1";
        assert_eq!(
            [2, 3, 4, 5, 6, 7].map(|line| first(holes, line)),
            [2, 2, 2, 2, 6, 7]
        );
    }

    #[test]
    fn z_is_up_before_the_other_axes_move_and_down_at_feed_behind_the_spindle() {
        let job = "G0 Z8\nM3 S900 M8\nG0 X3 Y4\nG1 Z-2 F500\nG1 X9\nG1 Y9";
        let entry = entry_of(job, 6).unwrap();
        let expected = [
            "G21 G90 G94 G17 G40 G49 G80 G54",
            "G53 G0 Z8",
            "G0 X9 Y4",
            "M3 S900",
            "M8",
            "G4 P2",
            "G1 Z-2 F150",
            "F500 T0 G61",
            "G21 G90 G94 G17 G98 G91.1",
        ];
        assert_eq!(entry.approach, expected);
        assert_eq!(entry.position, ["X9", "Y4", "Z-2"]);
        assert!(
            entry.modes.starts_with("[GC:G1 G54") && entry.modes.contains("M3 M8"),
            "{}",
            entry.modes
        );
    }

    #[test]
    fn z_goes_to_the_top_of_a_machine_that_homes_and_a_beam_stays_off_until_the_end() {
        let mut settings = Settings {
            homing: true,
            homing_pull_off_mm: 2.0,
            ..Settings::default()
        };
        let mut below = Interpreter::new();
        below.set_position(Axes::all(Nm(-5_000_000)));
        let beginning = Beginning {
            interpreter: below.clone(),
            is_placed: true,
        };
        let job = lines("M4 S900\nG0 X3 Z-9\nG1 X9 F500\nG1 Y9");
        let approach = |settings: &Settings| {
            let entry = entry(&job, 3, &beginning, &below, settings, DESCENT);
            entry.unwrap().approach
        };
        assert_eq!(approach(&settings)[1], "G53 G0 Z-2");
        settings.homing_direction = 1 << Z;
        assert_eq!(approach(&settings)[1], "G53 G0 Z-5");
        settings.laser = true;
        let lines = approach(&settings);
        let index = |begin: &str| lines.iter().position(|line| line.starts_with(begin));
        assert!(
            index("G1 Z-9").unwrap() < index("M4 S900").unwrap(),
            "{lines:?}"
        );
        assert_eq!(index("G4"), None);
    }

    #[test]
    fn a_place_that_depends_on_where_the_job_began_is_refused_until_it_no_longer_does() {
        let job = "G91\nG1 X5 F100\nG1 Y5\nG90\nG0 X1 Y1\nG0 Z1\nG0 X2";
        for line in 1..=6 {
            assert!(
                entry_with(job, line, false, &Settings::default()).is_err(),
                "{line}"
            );
        }
        let entry = entry_with(job, 7, false, &Settings::default()).unwrap();
        assert_eq!(entry.line, 6);
        assert_eq!(first(job, 3), 3);
    }

    #[test]
    fn an_axis_that_the_job_never_moves_is_where_it_is() {
        let entry = |job: &str| entry_with(job, 3, false, &Settings::default());
        assert_eq!(entry("G0 X1 Y1\nG0 X2\nG0 X3").unwrap().line, 2);
        // Z has moved since, or comes back to where it is now.
        assert!(entry("G0 X1 Y1\nG0 X2\nG0 X3\nG0 Z5").is_err());
        assert!(entry("G0 X1 Y1\nG0 X2\nG0 X3\nG0 Z0").is_err());
    }

    #[test]
    fn behind_a_probing_move_a_job_is_continued_only_where_nothing_depends_on_it() {
        let job = "G0 X1\nG38.2 Z-5 F50\nG0 Z5\nG0 X2 Y2\nG0 X3";
        assert_eq!([2, 3, 4, 5].map(|line| first(job, line)), [2, 2, 2, 5]);
        let offset = "G0 X1\nG38.2 Z-5 F50\nG92 Z0\nG0 X0 Y0 Z5\nG0 X3";
        assert_eq!(first(offset, 5), 2);
    }

    #[test]
    fn the_tool_and_the_offsets_of_the_line_are_put_into_effect() {
        let job = "T2 M6\nG43.1 Z-1.5\nG52 X4\nG0 X1 Y1 Z1\nG0 X2";
        let entry = entry_of(job, 5).unwrap();
        assert_eq!((entry.line, entry.tool), (4, 2));
        for line in ["M61 Q2", "G43.1 X0 Y0 Z-1.5", "G52 X4 Y0 Z0"] {
            assert!(
                entry.approach.iter().any(|sent| sent == line),
                "{:?}",
                entry.approach
            );
        }
    }

    #[test]
    fn behind_a_change_of_the_tool_the_spindle_is_off_unless_the_machine_ignores_it() {
        let job = "M3 S500\nG0 X1 Y1 Z1\nT2 M6\nG0 X2";
        assert!(entry_of(job, 4).unwrap().modes.contains(" M5 "));
        let settings = Settings {
            tool_change: TOOL_CHANGE_IGNORED,
            ..Settings::default()
        };
        let entry = entry_with(job, 4, true, &settings).unwrap();
        assert!(entry.modes.contains(" M3 "), "{}", entry.modes);
    }

    #[test]
    fn an_origin_that_the_machine_does_not_have_is_told() {
        let error = entry_of("G10 L2 P1 X5\nG0 X1\nG0 Y1", 3).map(|entry| entry.line);
        // Nothing but the line that sets it can begin.
        assert_eq!(error.unwrap(), 0);
    }

    /// The last word of a machine: where it stands, in steps.
    fn ends_at(text: &str) -> Vec<i32> {
        struct Silent;
        impl Watcher for Silent {
            fn edge(&mut self, _: &Edge) {}
            fn answer(&mut self, line: u64, answer: &[u8]) {
                assert_eq!(answer, b"ok", "line {line}");
            }
            fn message(&mut self, _: u64, message: &[u8]) {
                assert!(!message.starts_with(b"ALARM"));
            }
        }
        let mut simulator = Box::new(Simulator::new(&Settings::default()));
        let mut stream = Stream::new(&mut *simulator, text.bytes(), FAST).with_statements_at_rest();
        assert_eq!(stream.run(&mut Silent), StreamEnd::Complete);
        drop(stream);
        simulator.physical_steps().0.to_vec()
    }

    #[test]
    fn wherever_a_job_is_continued_it_ends_at_the_same_steps() {
        let job = "G21 G90 G64 P0.05\nT1 M6\nM3 S500\nG0 Z3\nG1 X1.001 Y2.003 F300\nG20\nG1 X0.1 Y0.05 F20\n\
                   G91\nX0.011\nY-0.007 Z-0.01\nG2 X0.02 Y0.02 I0.02 J0\nG21\nX0.3 Y0.3 I0 J0.3\nG90 G55\nG93\n\
                   G1 X1 F30\nX2 F20\nG94 F250\nG52 X0.5 Y0.25\nX1 Y1 Z0\nG18 G3 X2 Z1 I0.5 K0.5\nG17 G99\n\
                   G81 X3 Y1 Z-1 R1\nX4\nG80\nG0 Z4\nG61 M8\nG1 X0.337 Y0.771 Z0.1\nM9\nM5\nG0 Z2\n";
        let undisturbed = ends_at(job);
        let lines: Vec<_> = job.lines().collect();
        let mut begun = std::collections::BTreeSet::new();
        for line in 1..=lines.len() {
            let entry = entry_of(job, line).unwrap_or_else(|error| panic!("{line}: {error}"));
            assert!(entry.line < line);
            if begun.insert(entry.line) {
                // From a reset at another place.
                let text = [
                    entry.approach.join("\n"),
                    lines[entry.line..].join("\n"),
                    String::new(),
                ]
                .join("\n");
                assert_eq!(
                    ends_at(&text),
                    undisturbed,
                    "{} {:?}",
                    entry.line + 1,
                    entry.approach
                );
            }
        }
        assert!(begun.len() > 20, "{begun:?}");
    }
}
