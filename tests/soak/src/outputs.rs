//! Rules for spindle, laser and coolant.

use leadscrew::{
    gcode::CompensationMode,
    model::{Coolant, Outputs, Spindle, State},
    sim::{Edge, Simulator},
};

/// How far a duty may be from the programmed one: a step of Grbl's 255, and rounding.
const DUTY_TOLERANCE: f32 = 6.0;

/// Panics if the beam is on in a rapid.
pub(crate) fn check_edge(edge: &Edge, simulator: &Simulator) {
    let burns = edge.is_rapid && edge.raise != 0 && edge.duty != 0;
    assert!(
        !burns || !simulator.session().settings().laser,
        "the beam is on in a rapid: {edge:?}"
    );
}

/// What must be off in the state of the machine, and is on.
pub(crate) fn on_in_state(simulator: &Simulator, outputs: Outputs) -> Option<&'static str> {
    let is_off = outputs.duty == 0 && outputs.spindle == Spindle::Off;
    match simulator.snapshot().state {
        State::DoorAjar | State::DoorClosed | State::Sleep => {
            let are_off = is_off && outputs.coolant == Coolant::OFF;
            (!are_off).then_some("spindle or coolant stay on behind the door or asleep")
        }
        State::HoldComplete if simulator.session().settings().laser => {
            (!is_off).then_some("the beam stays on in a hold")
        }
        _ => None,
    }
}

/// Panics if a machine at rest, whose lines are all answered, has not switched what is programmed. In an alarm
/// `stays_on` tells whether this alarm switches nothing off.
pub(crate) fn check_at_rest(simulator: &Simulator, outputs: Outputs, stays_on: bool) {
    let snapshot = simulator.snapshot();
    match snapshot.state {
        State::Idle => check_programmed(simulator, outputs),
        State::Alarm if !stays_on => {
            let is_off = outputs.duty == 0 && outputs.spindle == Spindle::Off;
            assert!(
                is_off && outputs.coolant == Coolant::OFF,
                "{outputs:?} in an alarm"
            );
        }
        _ => {}
    }
}

fn check_programmed(simulator: &Simulator, outputs: Outputs) {
    let session = simulator.session();
    let (settings, modal) = (session.settings(), session.interpreter().modal());
    // What is programmed behind a compensated move waits with it.
    if modal.compensation != CompensationMode::Off || session.interpreter().is_off_path() {
        return;
    }
    assert_eq!(outputs.coolant, modal.coolant, "coolant");
    let override_percent = simulator.snapshot().overrides.spindle;
    let rpm = modal.speed_rpm * 0.01 * f32::from(override_percent);
    let (least, most) = (settings.spindle_min_rpm, settings.spindle_max_rpm);
    let part = (rpm.clamp(least, most) - least) / (most - least);
    let is_on = modal.spindle != Spindle::Off && rpm > 0.0;
    let expected = if is_on {
        part * f32::from(Outputs::FULL)
    } else {
        0.0
    };
    let is_programmed = (f32::from(outputs.duty) - expected).abs() <= DUTY_TOLERANCE;
    if settings.laser {
        // It stays off at rest after a hold, and where its power follows the speed.
        let is_right = match modal.spindle {
            Spindle::Clockwise => is_programmed || outputs.duty == 0,
            Spindle::CounterClockwise | Spindle::Off => outputs.duty == 0,
        };
        assert!(
            is_right,
            "the beam of {:?} S{rpm} is at {outputs:?}",
            modal.spindle
        );
    } else {
        assert_eq!(outputs.spindle, modal.spindle, "the spindle");
        assert!(
            is_programmed,
            "S{rpm} is a duty of {expected} and not {outputs:?}"
        );
    }
}
