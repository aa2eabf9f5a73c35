//! The machines of the histories.

use leadscrew::{
    axis::{AXES, Axes, X, Y},
    model::Levels,
    settings::{Settings, StepRate, assign},
    sim::{Closes, Simulator, Switch},
};
use proptest::prelude::*;

/// Length of each axis, mm, and steps/mm.
pub(crate) const TRAVEL_MM: i32 = 100;
pub(crate) const STEPS_PER_MM: i32 = 5;
/// Place of the machine on each axis when it is built, mm from the upper switch.
const START_MM: i32 = -30;

/// How a machine is built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Setup {
    pub(crate) kind: Kind,
    /// Its motors of X and Y turn for X + Y and X - Y.
    pub(crate) is_core_xy: bool,
}

/// What a machine has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// It homes by marks, and has soft limits.
    Marks,
    /// It homes by switches at the upper ends, and has hard limits by switches at both.
    Switches,
    /// A laser without homing.
    Laser,
}

/// Each setup.
pub(crate) fn setup() -> impl Strategy<Value = Setup> {
    let kind = prop::sample::select(vec![Kind::Marks, Kind::Switches, Kind::Laser]);
    (kind, prop::bool::weighted(1.0 / 3.0))
        .prop_map(|(kind, is_core_xy)| Setup { kind, is_core_xy })
}

impl Setup {
    /// The machine when it is switched on for the first time.
    pub(crate) fn build(self, step_rate: StepRate) -> Box<Simulator> {
        let mut simulator = Box::new(Simulator::new(&self.settings(step_rate)));
        self.mount(&mut simulator, &Axes::all(0));
        simulator
    }

    /// Mounts the switches of a machine that is switched on with its motors at `moved` steps from where they
    /// were when it was built.
    pub(crate) fn mount(self, simulator: &mut Simulator, moved: &Axes<i32>) {
        if self.kind != Kind::Switches {
            return;
        }
        for (axis, half_steps) in self.half_steps_of(moved).into_iter().enumerate() {
            let input = Levels::limits(1 << axis);
            let upper = -START_MM * STEPS_PER_MM - half_steps.div_euclid(2);
            let ends = [
                Closes::From(upper),
                Closes::DownFrom(upper - TRAVEL_MM * STEPS_PER_MM),
            ];
            for closes in ends {
                assert!(
                    simulator.mount(Switch {
                        axis,
                        closes,
                        input
                    }),
                    "no room for a switch"
                );
            }
        }
    }

    /// Whether no program leaves the travel, from the homing at the start on.
    pub(crate) fn has_travel(self) -> bool {
        self.kind == Kind::Marks
    }

    /// Where the axes are for the steps of the motors, in half steps.
    pub(crate) fn half_steps_of(self, motors: &Axes<i32>) -> [i32; AXES] {
        let mut axes = motors.0.map(|steps| 2 * steps);
        if self.is_core_xy {
            [axes[X], axes[Y]] = [motors[X] + motors[Y], motors[X] - motors[Y]];
        }
        axes
    }

    /// The steps of the motors for those of the axes.
    pub(crate) fn motors_of(self, axes: [f64; AXES]) -> [f64; AXES] {
        let mut motors = axes;
        if self.is_core_xy {
            [motors[X], motors[Y]] = [axes[X] + axes[Y], axes[X] - axes[Y]];
        }
        motors
    }

    fn settings(self, step_rate: StepRate) -> Settings {
        let mut settings = Settings::new(step_rate);
        for axis in 0..AXES {
            for assignment in [
                format!("10{axis}={STEPS_PER_MM}"),
                format!("11{axis}=6000"),
                format!("12{axis}=500"),
                format!("13{axis}={TRAVEL_MM}"),
            ] {
                set(&mut settings, &assignment);
            }
        }
        if self.is_core_xy {
            set(&mut settings, "795=1");
        }
        let own: &[&str] = match self.kind {
            Kind::Marks => &["22=1", "20=1"],
            Kind::Switches => &["22=1", "20=1", "21=1", "24=600", "25=3000", "27=2"],
            Kind::Laser => &["32=1", "1=255"],
        };
        for assignment in own {
            set(&mut settings, assignment);
        }
        if self.kind == Kind::Marks {
            set(&mut settings, &format!("788={}", (1 << AXES) - 1));
        }
        settings
    }
}

fn set(settings: &mut Settings, assignment: &str) {
    assign(settings, assignment.as_bytes())
        .unwrap_or_else(|error| panic!("{assignment}: {error:?}"));
}
