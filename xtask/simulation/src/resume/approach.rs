//! The lines that bring a machine to the place and the modes of a line in the middle of a job.

use leadscrew::{
    axis::{AXES, Axes, LETTERS, LINEAR, Z},
    gcode::{
        ArcDistance, FeedMode, Modal, RetractMode,
        interpreter::{Interpreter, Offsets},
    },
    model::{Coolant, PathControl, Plane, Spindle},
    settings::Settings,
    units::Nm,
};

use crate::replay::Replay;

/// How the tool goes down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plunge {
    /// Highest feed, mm/min.
    pub feed_mm_min: f32,
    /// How long the spindle gets before, s.
    pub spin_up_s: f32,
    /// Whether the machine is told in any case which tool is in it, so that it waits for a change again.
    pub reports_tool: bool,
}

impl Default for Plunge {
    /// As `send` has it without options.
    fn default() -> Self {
        Self {
            feed_mm_min: 200.0,
            spin_up_s: 5.0,
            reports_tool: false,
        }
    }
}

/// The lines that lead a machine in its power-up modes to a state. They move Z to the top and the other axes at rapid
/// speed, start the spindle, dwell, plunge Z at feed, and set the modes.
pub(super) fn approach(
    state: &Replay,
    now: &Interpreter,
    top: Nm,
    settings: &Settings,
    plunge: Plunge,
) -> Vec<String> {
    let interpreter = &state.interpreter;
    let modal = interpreter.modal();
    let target = work_position(interpreter);
    let mut lines = vec![format!(
        "G21 G90 G94 G17 G40 G49 G80 {}",
        modal.coordinates.word()
    )];
    lines.extend(offsets(interpreter.offsets(), now.offsets()));
    if plunge.reports_tool || interpreter.loaded_tool() != now.loaded_tool() {
        lines.push(format!("M61 Q{}", interpreter.loaded_tool()));
    }
    lines.push(format!("G53 G0 Z{}", decimal(top)));
    let others = (0..AXES).filter(|axis| *axis != Z);
    lines.push(format!("G0 {}", words(&target, others).join(" ")));
    let accessories = accessories(modal, settings, plunge);
    let feed = if modal.feed > 0.0 && modal.feed_mode == FeedMode::PerMinute {
        modal.feed.min(plunge.feed_mm_min)
    } else {
        plunge.feed_mm_min
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
pub(super) fn top(highest: Nm, settings: &Settings) -> Nm {
    let homes_upwards = settings.is_homing_on() && !settings.homes_downwards(Z);
    if homes_upwards {
        highest.max(settings.top())
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
fn accessories(modal: &Modal, settings: &Settings, plunge: Plunge) -> Vec<String> {
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
        lines.push(format!("G4 P{}", plunge.spin_up_s));
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

/// The programmed position in work coordinates.
pub(super) fn work_position(interpreter: &Interpreter) -> Axes<Nm> {
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

pub(super) fn words(values: &Axes<Nm>, axes: impl IntoIterator<Item = usize>) -> Vec<String> {
    let word = |axis: usize| format!("{}{}", char::from(LETTERS[axis]), decimal(values[axis]));
    axes.into_iter().map(word).collect()
}
