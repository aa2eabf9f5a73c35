//! Axes with a second motor, and where both of their motors stand.

use anyhow::{Result, ensure};
use common::options::SecondMotor;
use common::text::row;
use leadscrew::{
    axis::{LETTERS, Y},
    model::Levels,
    settings::Settings,
    sim::{Closes, Simulator, Switch},
};
use serde::Serialize;
use simulation::machine::SwitchPositions;

use crate::steps_per_mm;

/// Gives a machine that is just switched on its second motors, and each the switch to which its axis homes.
pub(crate) fn mount(motors: &[SecondMotor], simulator: &mut Simulator) -> Result<()> {
    let settings = *simulator.session().settings();
    for (index, motor) in motors.iter().enumerate() {
        let letter = char::from(LETTERS[motor.axis]);
        let others = &motors[..index];
        ensure!(
            others.iter().all(|other| other.axis != motor.axis),
            "--second gives {letter} more than one second motor"
        );
        ensure!(
            !settings.core_xy || motor.axis > Y,
            "--second: the motors of CoreXY ($795=1) turn for X and Y together"
        );
        let travel_mm = f64::from(settings.max_travel_mm[motor.axis]);
        ensure!(
            motor.ahead_mm.abs() < travel_mm / 2.0,
            "--second: {letter} stands {} mm from the ends of its travel",
            travel_mm / 2.0
        );
    }
    let axes = motors.iter().fold(0, |axes, motor| axes | 1 << motor.axis);
    simulator.gang(axes);
    let positions = SwitchPositions::of(&settings);
    positions.mount_on(simulator);
    for &SecondMotor { axis, ahead_mm } in motors {
        let homes_down = settings.homing_direction >> axis & 1 != 0;
        let switch = Switch {
            axis,
            closes: if homes_down {
                Closes::DownFrom(positions.low[axis])
            } else {
                Closes::From(positions.high[axis])
            },
            input: Levels::second_limits(1 << axis),
        };
        ensure!(simulator.mount_second(switch), "there is no room for it");
        simulator.skew(axis, in_steps(&settings, axis, ahead_mm));
    }
    Ok(())
}

fn in_steps(settings: &Settings, axis: usize, mm: f64) -> i32 {
    (mm * steps_per_mm(settings)[axis]).round() as i32
}

/// Where both sides of a gantry stand at the end.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Sides {
    /// Its letter.
    axis: char,
    /// The first motor, where the machine believes the axis to be, mm.
    first_mm: f64,
    /// The second motor, mm.
    second_mm: f64,
    /// How far the second one is ahead at power-up and in the end, steps.
    ahead_steps: [i32; 2],
}

impl Sides {
    /// Of a machine after its run.
    pub(crate) fn of(motors: &[SecondMotor], simulator: &Simulator) -> Vec<Self> {
        let settings = simulator.session().settings();
        let counted = simulator.snapshot().steps;
        let [first, second] = [simulator.physical_steps(), simulator.second_steps()];
        let sides = motors.iter().map(|&SecondMotor { axis, ahead_mm }| {
            let scale = steps_per_mm(settings)[axis];
            let ahead = second[axis] - first[axis];
            let first_mm = f64::from(counted[axis]) / scale;
            Self {
                axis: char::from(LETTERS[axis]),
                first_mm,
                second_mm: first_mm + f64::from(ahead) / scale,
                ahead_steps: [in_steps(settings, axis, ahead_mm), ahead],
            }
        });
        sides.collect()
    }

    /// Prints a row of the summary.
    pub(crate) fn print(&self) {
        let Self {
            axis,
            first_mm,
            second_mm,
            ahead_steps: [before, now],
        } = self;
        row(
            &format!("motors of {axis}"),
            &format!(
                "first {first_mm:.3} mm, second {second_mm:.3} mm: {now} steps ahead, {before} at power-up"
            ),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_motor_is_read_with_how_far_it_is_ahead() {
        for (text, axis, ahead_mm) in [("Y=3", 1, 3.0), ("z=-0.5", 2, -0.5), ("X", 0, 0.0)] {
            let motor: SecondMotor = text.parse().unwrap();
            assert_eq!(motor, SecondMotor { axis, ahead_mm });
        }
        for (text, error) in [
            ("A=3", "X, Y or Z"),
            ("", "X, Y or Z"),
            ("XY=3", "X, Y or Z"),
            ("Y=", "no number"),
            ("Y=3mm", "no number"),
            ("Y=inf", "no number"),
        ] {
            let message = text.parse::<SecondMotor>().unwrap_err();
            assert!(message.contains(error), "{text}: {message}");
        }
    }
}
