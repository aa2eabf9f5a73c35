//! The machines of the histories.

use leadscrew::{
    axis::{AXES, Axes, X, Y, Z},
    model::Levels,
    settings::{Settings, StepRate, assign},
    sim::{Closes, Simulator, Switch},
};
use proptest::prelude::*;

/// Length of each axis, mm.
pub(crate) const TRAVEL_MM: i32 = 100;
/// Place of the machine on each axis when it is built, mm from the upper switch.
const START_MM: i32 = -30;
/// Plates that close the probe from below: the axis, and the place, mm from where the machine was built.
const PLATES: [(usize, i32); 2] = [(Z, -30), (X, -40)];
/// Resolutions, steps/mm, and how often they are drawn. At the highest of them several steps lie in one segment, and
/// a history takes a hundred times as many edges as at the lowest.
const RESOLUTIONS: [(u32, i32); 6] = [(6, 5), (3, 25), (3, 80), (3, 160), (1, 400), (1, 1000)];

/// How a machine is built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Setup {
    pub(crate) kind: Kind,
    /// Its motors of X and Y turn for X + Y and X - Y.
    pub(crate) is_core_xy: bool,
    /// Steps/mm of X and Y, and of the other axes.
    pub(crate) steps_per_mm: [i32; 2],
    /// The axes with two motors, bit 0 = X.
    pub(crate) ganged: u8,
    /// Whether plates close the probe.
    pub(crate) has_plates: bool,
    /// The sender fills the whole queue of the machine, and not 128 bytes as of Grbl.
    pub(crate) fills_queue: bool,
    /// It speaks to hosts of 3D printers: `$780=1`.
    pub(crate) is_reprap: bool,
    pub(crate) options: Options,
}

/// What is set on a machine beside what its kind needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Options {
    /// Jerk is limited: `$800` and so on.
    pub(crate) jerk: bool,
    /// Z leaves the work when the door opens: `$41`.
    pub(crate) parking: bool,
    /// Drivers wait before the first step: `$786`.
    pub(crate) enable_delay: bool,
    /// Motion waits for the spindle: `$394`, and another time behind the door and a stop, `$392`.
    pub(crate) spindle_delay: bool,
    /// `M6` goes to the position of `G30`: `$789`.
    pub(crate) tool_travel: bool,
    /// Arcs are made in whole steps: `$790`.
    pub(crate) whole_arcs: bool,
    /// The position is sent unasked: `$792`, `$793`.
    pub(crate) stream: bool,
    /// Lines with a checksum are checked: `$780`.
    pub(crate) checked_lines: bool,
    /// An alarm of a probing move switches spindle and coolant off: `$777`.
    pub(crate) probing_switches_off: bool,
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

fn options() -> impl Strategy<Value = Options> {
    let rare = || prop::bool::weighted(0.25);
    prop::array::uniform9(rare()).prop_map(
        |[
            jerk,
            parking,
            enable_delay,
            spindle_delay,
            tool_travel,
            whole_arcs,
            stream,
            checked_lines,
            probing_switches_off,
        ]| Options {
            jerk,
            parking,
            enable_delay,
            spindle_delay,
            tool_travel,
            whole_arcs,
            stream,
            checked_lines,
            probing_switches_off,
        },
    )
}

fn resolution() -> impl Strategy<Value = i32> {
    prop::strategy::Union::new_weighted(
        RESOLUTIONS
            .map(|(weight, steps)| (weight, Just(steps)))
            .to_vec(),
    )
}

/// Each setup.
pub(crate) fn setup() -> impl Strategy<Value = Setup> {
    let kind = prop::sample::select(vec![Kind::Marks, Kind::Switches, Kind::Laser]);
    // Belts that cross have no second motor.
    let ganged = prop_oneof![3 => Just(0), 1 => Just(1_u8 << Y), 1 => Just(1 << X | 1 << Z)];
    let steps_per_mm = [resolution(), resolution()];
    let is_core_xy = prop::bool::weighted(1.0 / 3.0);
    let flags = (any::<bool>(), any::<bool>(), prop::bool::weighted(0.15));
    (kind, is_core_xy, steps_per_mm, ganged, flags, options()).prop_map(
        |(
            kind,
            is_core_xy,
            steps_per_mm,
            ganged,
            (has_plates, fills_queue, is_reprap),
            options,
        )| Setup {
            kind,
            is_core_xy,
            steps_per_mm,
            ganged: if is_core_xy { ganged & 1 << Z } else { ganged },
            has_plates,
            // A host may not.
            fills_queue: fills_queue && !is_reprap,
            is_reprap,
            options,
        },
    )
}

impl Setup {
    /// A plain machine.
    pub(crate) const fn plain(kind: Kind) -> Self {
        Self {
            kind,
            is_core_xy: false,
            steps_per_mm: [5; 2],
            ganged: 0,
            has_plates: false,
            fills_queue: false,
            is_reprap: false,
            options: Options {
                jerk: false,
                parking: false,
                enable_delay: false,
                spindle_delay: false,
                tool_travel: false,
                whole_arcs: false,
                stream: false,
                checked_lines: false,
                probing_switches_off: false,
            },
        }
    }

    /// The machine when it is switched on for the first time.
    pub(crate) fn build(self, step_rate: StepRate) -> Box<Simulator> {
        let mut simulator = Box::new(Simulator::new(&self.settings(step_rate)));
        self.mount(&mut simulator, &Axes::all(0));
        simulator
    }

    /// Mounts the second motors and the switches of a machine that is switched on with its motors at `moved` steps
    /// from where they were when it was built.
    pub(crate) fn mount(self, simulator: &mut Simulator, moved: &Axes<i32>) {
        if self.ganged != 0 {
            simulator.gang(self.ganged);
        }
        for switch in self.plates(moved) {
            assert!(simulator.mount(switch), "no room for a plate");
        }
        if self.kind != Kind::Switches {
            return;
        }
        for (axis, half_steps) in self.half_steps_of(moved).into_iter().enumerate() {
            let mut input = Levels::limits(1 << axis);
            let upper = -START_MM * self.resolution(axis) - half_steps.div_euclid(2);
            let ends = [
                Closes::From(upper),
                Closes::DownFrom(upper - TRAVEL_MM * self.resolution(axis)),
            ];
            let mut is_mounted = ends.map(|closes| {
                simulator.mount(Switch {
                    axis,
                    closes,
                    input,
                })
            }) == [true; 2];
            if self.ganged >> axis & 1 != 0 {
                input = Levels::second_limits(1 << axis);
                let closes = ends[0];
                is_mounted &= simulator.mount_second(Switch {
                    axis,
                    closes,
                    input,
                });
            }
            assert!(is_mounted, "no room for a switch");
        }
    }

    /// The plates that close the probe of such a machine.
    pub(crate) fn plates(self, moved: &Axes<i32>) -> impl Iterator<Item = Switch> {
        let moved = self.half_steps_of(moved);
        let plates = PLATES.into_iter().filter(move |_| self.has_plates);
        plates.map(move |(axis, mm)| Switch {
            axis,
            closes: Closes::DownFrom(mm * self.resolution(axis) - moved[axis].div_euclid(2)),
            input: Levels::PROBE,
        })
    }

    /// Whether no program leaves the travel, from the homing at the start on.
    pub(crate) fn has_travel(self) -> bool {
        self.kind == Kind::Marks
    }

    /// Steps/mm of an axis.
    pub(crate) fn resolution(self, axis: usize) -> i32 {
        self.steps_per_mm[usize::from(axis > Y)]
    }

    /// Where the axes are for the steps of the motors, in half steps.
    pub(crate) fn half_steps_of(self, motors: &Axes<i32>) -> [i32; AXES] {
        let mut axes = motors.0.map(|steps| 2 * steps);
        if self.is_core_xy {
            [axes[X], axes[Y]] = [motors[X] + motors[Y], motors[X] - motors[Y]];
        }
        axes
    }

    /// The same in mm.
    pub(crate) fn mm_of(self, motors: &Axes<i32>) -> Axes<f64> {
        let half_steps = self.half_steps_of(motors);
        Axes::from_fn(|axis| f64::from(half_steps[axis]) / f64::from(2 * self.resolution(axis)))
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
            let most = 60.0 * settings.greatest_step_rate_hz() / self.resolution(axis) as f32;
            for assignment in [
                format!("10{axis}={}", self.resolution(axis)),
                format!("11{axis}={}", most.min(6000.0).floor()),
                format!("12{axis}=500"),
                format!("13{axis}={TRAVEL_MM}"),
            ] {
                set(&mut settings, &assignment);
            }
            if self.options.jerk {
                set(&mut settings, &format!("80{axis}=20000"));
            }
        }
        if self.is_core_xy {
            set(&mut settings, "795=1");
        }
        let own: &[&str] = match self.kind {
            Kind::Marks => &["22=9", "20=1", "40=1"],
            Kind::Switches => &["22=1", "20=1", "21=1", "24=600", "25=3000", "27=2"],
            Kind::Laser => &["32=1", "1=255"],
        };
        for assignment in own {
            set(&mut settings, assignment);
        }
        if self.kind == Kind::Marks {
            set(&mut settings, &format!("788={}", (1 << AXES) - 1));
        }
        for (is_set, assignments) in self.options.assignments() {
            for assignment in assignments.iter().filter(|_| is_set) {
                set(&mut settings, assignment);
            }
        }
        if self.is_reprap {
            set(&mut settings, "780=1");
        }
        settings
    }
}

impl Options {
    /// The settings of each option but jerk, which each axis has.
    fn assignments(self) -> [(bool, &'static [&'static str]); 8] {
        [
            (self.parking, &["41=1", "57=1200", "59=3000"]),
            (self.enable_delay, &["786=120"]),
            (self.spindle_delay, &["394=0.5", "392=0.8"]),
            (self.tool_travel, &["789=1", "796=1"]),
            (self.whole_arcs, &["790=1"]),
            (self.stream, &["792=40", "793=1"]),
            (self.checked_lines, &["780=2"]),
            (self.probing_switches_off, &["777=1"]),
        ]
    }
}

fn set(settings: &mut Settings, assignment: &str) {
    assign(settings, assignment.as_bytes())
        .unwrap_or_else(|error| panic!("{assignment}: {error:?}"));
}
