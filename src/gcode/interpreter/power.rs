//! What a line does to the spindle, and to the laser where the spindle is one.
//!
//! A spindle is switched at standstill. While it turns, a new `S` changes its speed in the order of the program without
//! a stop, unless `$776` asks for one. In laser mode the power goes along with the moves: a new `S` in a line that
//! moves needs no standstill, and moves that must not burn (`G0`, probing) have no power. Read with Grbl 1.1
//! `laser_mode.md`.

use super::{Action, CheckedLine, Interpreter};
use crate::{
    gcode::MotionMode,
    model::{Laser, Spindle},
    settings::Settings,
};

/// Sets the spindle command and the laser power of a line that is otherwise right; `is_motion`
/// tells whether its axis words belong to its motion mode.
pub(super) fn set(
    state: &Interpreter,
    settings: &Settings,
    is_motion: bool,
    checked: &mut CheckedLine,
) {
    let (before, after) = (&state.modal, &checked.modal);
    let is_laser = settings.laser;
    // What is switched at standstill, and what moves have.
    let rpm = if is_laser && !burns(after.motion) {
        0.0
    } else {
        after.speed_rpm
    };
    let is_switched = before.spindle != after.spindle;
    // Constant power has to be switched where the motion mode alone begins or ends it.
    let is_forced = is_laser
        && !is_motion
        && before.spindle == Spindle::Clockwise
        && burns(before.motion) != burns(after.motion);
    let is_new = before.speed_rpm != after.speed_rpm || is_forced;
    let goes_along = is_laser && is_motion;
    let turns = !is_laser && before.speed_rpm > 0.0 && rpm > 0.0 && !settings.stops_for_speed;
    if turns && !is_switched && is_new && before.spindle != Spindle::Off {
        checked.speed = Some(rpm);
    } else if is_switched || (is_new && before.spindle != Spindle::Off && !goes_along) {
        checked.spindle = Some(match after.spindle {
            Spindle::Off => (Spindle::Off, 0.0),
            spindle => (spindle, rpm),
        });
    }
    if is_laser {
        // The rapids of `G28` and `G30` must not burn, whatever the motion mode is.
        let is_rapid = matches!(checked.action, Action::GoTo(_));
        let rpm = if is_rapid { 0.0 } else { rpm };
        checked.power = match after.spindle {
            Spindle::Off => Laser::Constant(0.0),
            Spindle::Clockwise => Laser::Constant(rpm),
            Spindle::CounterClockwise => Laser::Proportional(rpm),
        };
    }
}

/// Whether the laser is on in a motion mode.
const fn burns(motion: MotionMode) -> bool {
    match motion {
        MotionMode::Linear | MotionMode::Arc(_) => true,
        MotionMode::Rapid | MotionMode::Probe(_) | MotionMode::Cycle(_) | MotionMode::Cancelled => {
            false
        }
    }
}
