//! The machine at the end of an exchange, in Grbl's numbers.

use leadscrew::{
    axis::AXES,
    gcode::{
        Distance, FeedMode, MotionMode, ProbeMode, ToolLength, Units, interpreter::Interpreter,
    },
    model::{Plane, Rotation, Spindle, State},
};
use serde::{Deserialize, Serialize};

use crate::machine::Machine;

/// Where the machine ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct End {
    /// Grbl's number of the state.
    pub state: u8,
    /// Machine position, steps.
    pub mpos_steps: Vec<i64>,
    /// Programmed position, machine frame.
    pub parser_pos_mm: Vec<f64>,
    /// Modes as [`modal_numbers`] has them.
    pub modal: Vec<u8>,
    /// Feed.
    #[serde(rename = "F")]
    pub feed: f64,
    /// Spindle speed.
    #[serde(rename = "S")]
    pub speed: f64,
    /// Recordings with times do not have it.
    #[serde(rename = "T", default)]
    pub tool: Option<u8>,
    /// Whether it stood still; recordings with times do not say.
    #[serde(default)]
    pub idle: Option<bool>,
}

impl End {
    /// The machine as it is now.
    pub fn of(machine: &Machine) -> Self {
        let snapshot = machine.snapshot();
        let interpreter = machine.session().interpreter();
        let modal = interpreter.modal();
        let position = interpreter.position();
        Self {
            state: state_number(snapshot.state),
            mpos_steps: snapshot.steps.0.map(i64::from).to_vec(),
            parser_pos_mm: (0..AXES).map(|axis| position[axis].to_mm_f64()).collect(),
            modal: modal_numbers(interpreter).to_vec(),
            feed: f64::from(modal.feed),
            speed: f64::from(modal.speed_rpm),
            tool: Some(modal.tool),
            idle: Some(machine.stands_still()),
        }
    }
}

/// Grbl's number of a state.
pub fn state_number(state: State) -> u8 {
    match state {
        // Grbl has no `Tool`, and no bit left for it.
        State::Idle | State::Tool => 0,
        State::Alarm => 1,
        State::Check => 2,
        State::Home => 4,
        State::Run => 8,
        State::HoldSlowing | State::HoldComplete => 16,
        State::Jog => 32,
        State::DoorClosed | State::DoorAjar | State::DoorRetracting | State::DoorRestoring => 64,
        State::Sleep => 128,
    }
}

/// The modes in Grbl's numbers: motion, feed, units, distance, plane, tool length, work coordinate
/// system, program flow, coolant, spindle.
pub fn modal_numbers(interpreter: &Interpreter) -> [u8; 10] {
    let modal = interpreter.modal();
    let motion = match modal.motion {
        MotionMode::Rapid => 0,
        MotionMode::Linear => 1,
        MotionMode::Arc(Rotation::Clockwise) => 2,
        MotionMode::Arc(Rotation::CounterClockwise) => 3,
        MotionMode::Cancelled => 80,
        MotionMode::Cycle(cycle) => cycle as u8,
        MotionMode::Probe(ProbeMode::Contact) => 140,
        MotionMode::Probe(ProbeMode::TryContact) => 141,
        MotionMode::Probe(ProbeMode::Release) => 142,
        MotionMode::Probe(ProbeMode::TryRelease) => 143,
    };
    let plane = match modal.plane {
        Plane::Xy => 0,
        Plane::Zx => 1,
        Plane::Yz => 2,
    };
    let spindle = match modal.spindle {
        Spindle::Off => 0,
        Spindle::Clockwise => 16,
        Spindle::CounterClockwise => 32,
    };
    [
        motion,
        u8::from(modal.feed_mode == FeedMode::InverseTime),
        u8::from(modal.units == Units::Inches),
        u8::from(modal.distance == Distance::Incremental),
        plane,
        u8::from(modal.tool_length != ToolLength::None),
        modal.coordinates.index() as u8,
        0,
        u8::from(modal.coolant.flood) * 64 + u8::from(modal.coolant.mist) * 128,
        spindle,
    ]
}
