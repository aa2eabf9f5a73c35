//! The settings that the user changes with `$n=value`, and everything that outlives power.
//!
//! A setting is in two places: its field with its default here, and its row in
//! `TABLE` of `settings/table.rs` with everything else.

mod assign;
mod kind;
mod rules;
mod setting;
mod step_rate;
mod storage;
mod stored;
mod table;
mod tool_table;
mod travel;

pub use assign::{SettingError, assign, numbered};
pub use kind::{DataType, Kind, Value, ValueRange};
pub use rules::TOOL_CHANGE_IGNORED;
pub use setting::Setting;
pub use step_rate::StepRate;
pub use storage::{
    EEPROM_KIB, Eeprom, EepromError, EepromStore, Journal, Loaded, PAGE_BYTES, SMALL_EEPROM_KIB,
    TwoWireEeprom, Wires,
};
pub use stored::{
    Change, Changes, Erasing, Origins, STARTUP_LINES, STORED_LINE, StoreError, Stored, StoredLine,
};
pub use table::{Row, SettingGroup};
pub use tool_table::{TOOLS, ToolEntry, ToolTable};

use crate::{
    axis::{AXES, Axes, X, Y},
    model::{
        HAS_PHASES, Outputs, core_xy,
        timing::{EVENT_SPACING_TICKS, min_period_ticks},
    },
    units::{Nm, Steps, StepsPerMm, TICKS_PER_SECOND, TICKS_PER_US},
};

/// Largest number of steps per second that a segment can count on one axis.
const MAX_STEP_RATE_HZ: f32 = 500_000.0;

/// Grbl's 250 steps/mm; of motors driven by phases, 2048 full steps for the 40 mm of a turn of 20 teeth of a GT2 belt.
const RESOLUTION: StepsPerMm =
    match StepsPerMm::from_millionths(if HAS_PHASES { 51_200_000 } else { 250_000_000 }) {
        Some(resolution) => resolution,
        None => unreachable!(),
    };

/// Declares [`Settings`]: each field with its type and its default.
macro_rules! settings {
    ($(
        $(#[doc = $doc:literal])* $(#[cfg($condition:meta)])?
        $field:ident: $type:ty = $default:expr,
    )*) => {
        /// All settings, with Grbl's numbers.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Settings {
            $($(#[doc = $doc])* $(#[cfg($condition)])? pub $field: $type,)*
            /// The proven step rate of the firmware, which the user cannot set.
            pub step_rate: StepRate,
        }

        impl Settings {
            /// Number of fields that have a row in the table.
            const FIELDS: usize = [$($(#[cfg($condition)])? stringify!($field)),*].len();

            /// Returns Grbl 1.1h's defaults (`defaults.h`, `DEFAULTS_GENERIC`).
            #[must_use]
            pub const fn new(step_rate: StepRate) -> Self {
                Self { $($(#[cfg($condition)])? $field: $default,)* step_rate }
            }
        }
    };
}

settings! {
    /// `$0` Step pulse, µs.
    step_pulse_us: u8 = 10,
    /// `$1` Delay before idle steppers are released, ms; 255 keeps them on.
    idle_delay_ms: u8 = 25,
    /// `$2` Axes whose step pulse is inverted, bit 0 = X.
    step_invert: u8 = 0,
    /// `$3` Axes whose direction is inverted, bit 0 = X.
    direction_invert: u8 = 0,
    /// `$4` Whether the enable output is inverted.
    enable_invert: bool = false,
    /// `$5` Whether the limit inputs are inverted.
    limit_invert: bool = false,
    /// `$6` Whether the probe input is inverted.
    probe_invert: bool = false,
    /// `$10` What a status report shows: bit 0 machine position, bit 1 buffer state.
    report_mask: u8 = 1,
    /// `$11` Junction deviation, mm.
    junction_deviation_mm: f32 = 0.01,
    /// `$12` Arc tolerance, mm: of the arcs that become chords; others are exact.
    arc_tolerance_mm: f32 = 0.002,
    /// `$785` Farthest from the programmed path under `G64` without `P`, mm; 0 for no limit.
    path_tolerance_mm: f32 = 0.05,
    /// `$786` Time from the enabling of the drivers to the first step, ms.
    enable_delay_ms: f32 = 0.0,
    /// `$787` Whether the machine is held when the link to its sender is lost.
    holds_without_link: bool = true,
    /// `$33` Periods of the spindle's PWM in a second, about.
    pwm_hz: f32 = Outputs::USUAL_PWM_HZ,
    /// `$28` How far `G73` lifts the tool after a peck, and how far above it `G83` begins the next, mm.
    peck_clearance_mm: f32 = 0.254,
    /// `$341` What `M6` does: 0 waits for the tool, [`TOOL_CHANGE_IGNORED`] does not.
    tool_change: u8 = 0,
    /// `$789` Whether `M6` goes to the position of `G30` before it waits.
    tool_change_travel: bool = false,
    /// `$777` Whether an alarm of a probing move switches spindle and coolant off.
    probing_alarm_switches_off: bool = false,
    /// `$780` Dialect of the sender: 0 Grbl, 1 RepRap, 2 Grbl with checked lines.
    dialect: u8 = 0,
    /// `$781` Axis that `E` drives, 4 for A and so on; 0 for none.
    extruder_axis: u8 = 0,
    /// `$782` Time between two messages that a line is not done yet, s; 0 for none.
    busy_interval_s: u8 = 2,
    /// `$783` Output of `M106`: 0 none, 1 spindle or laser, 2 flood, 3 mist.
    fan_output: u8 = 0,
    /// `$784` Whether `G6` and `G0 S2` may move single motors.
    moves_motors: bool = false,
    /// `$790` Which steps arcs make: 0 the nearest ones, 1 those of the sign of the deviation.
    #[cfg(arc_machine)]
    arc_rule: u8 = 0,
    /// `$791` Whether motors that are driven by phases turn in half steps.
    half_steps: bool = false,
    /// `$795` Whether X and Y are moved by two motors that turn for both: [`core_xy`].
    core_xy: bool = false,
    /// `$792` Least time between two lines of the position stream, ms; 0 sends none.
    stream_interval_ms: f32 = 0.0,
    /// `$793` Whether these lines have Z.
    stream_z: bool = false,
    /// `$794` Whether cycle start runs the stored program when the machine is idle.
    #[cfg(arc_machine)]
    runs_stored_program: bool = false,
    /// `$788` Axes that home where they stand, by marks, bit 0 = X.
    homing_marks: u8 = 0,
    /// `$13` Whether reports are in inches.
    report_inches: bool = false,
    /// `$20` Soft limits.
    soft_limits: bool = false,
    /// `$40` Whether jogs are shortened to the travel of axes that are homed.
    shortens_jogs: bool = false,
    /// `$796` Whether the line behind a refused one waits for cycle start.
    holds_after_refusal: bool = false,
    /// `$797` Duration of the motion that may wait behind the motion in execution, s; 0 does not limit it.
    queued_motion_s: u8 = 5,
    /// `$798` Whether a contact of the probe outside of a probing move stops the machine, once the probe has worked.
    stops_at_contact: bool = true,
    /// `$21` Hard limits.
    hard_limits: bool = false,
    /// `$22` Homing cycle: bit 0 on, bit 3 zero is where it ends.
    homing: u8 = 0,
    /// `$23` Axes that home towards their negative end, bit 0 = X.
    homing_direction: u8 = 0,
    /// `$24` Speed at which homing locates the switch, mm/min.
    homing_feed_mm_min: f32 = 25.0,
    /// `$25` Speed at which homing searches the switch, mm/min.
    homing_seek_mm_min: f32 = 500.0,
    /// `$26` Delay after a homing switch opens or closes, ms.
    homing_debounce_ms: u8 = 250,
    /// `$27` Distance from the switch after homing, mm.
    homing_pull_off_mm: f32 = 1.0,
    /// `$30` Spindle speed at full output, rpm.
    spindle_max_rpm: f32 = 1000.0,
    /// `$31` Spindle speed at least output, rpm.
    spindle_min_rpm: f32 = 0.0,
    /// `$32` Laser mode.
    laser: bool = false,
    /// `$775` Whether the spindle turns at speed 0, too.
    spindle_relay: bool = false,
    /// `$776` Whether motion stops where a spindle that turns gets another speed.
    stops_for_speed: bool = false,
    /// `$392` Time for the spindle behind the door, and behind its stop in a hold, s; 4 s as in Grbl.
    door_spindle_delay_s: f32 = 4.0,
    /// `$393` Time for the coolant behind the door, s; 1 s as in Grbl.
    door_coolant_delay_s: f32 = 1.0,
    /// `$394` Time for a spindle that has been switched on, before anything moves, s.
    spindle_delay_s: f32 = 0.0,
    /// `$41` Whether Z is parked when the safety door opens.
    parking: bool = false,
    /// `$56` Slow pull-out before parking, mm.
    parking_pull_out_mm: f32 = 5.0,
    /// `$57` Speed of the pull-out and of the return, mm/min.
    parking_pull_out_mm_min: f32 = 100.0,
    /// `$58` Where Z is parked, machine coordinate, mm.
    parking_target_mm: f32 = -5.0,
    /// `$59` Speed of parking, mm/min.
    parking_mm_min: f32 = 500.0,
    /// `$100`… Resolution of each axis.
    steps_per_mm: Axes<StepsPerMm> = Axes::all(RESOLUTION),
    /// `$110`… Largest speed of each axis, mm/min.
    max_rate_mm_min: Axes<f32> = Axes::all(500.0),
    /// `$120`… Acceleration of each axis, mm/s².
    acceleration_mm_s2: Axes<f32> = Axes::all(10.0),
    /// `$130`… Travel of each axis, mm.
    max_travel_mm: Axes<f32> = Axes::all(200.0),
    /// `$160`… Backlash of each axis, mm.
    backlash_mm: Axes<f32> = Axes::all(0.0),
    /// `$800`… Jerk of each axis, mm/s³; 0 does not limit it.
    jerk_mm_s3: Axes<f32> = Axes::all(0.0),
}

impl Settings {
    /// Returns the greatest step rate of a single axis: the least of the rate that step pulses allow when pulses of
    /// other axes delay them, the rate that a segment can count, and the rate proven for all axes together. Motors that
    /// are driven by phases have a limit of their own.
    #[must_use]
    pub fn greatest_step_rate_hz(&self) -> f32 {
        if HAS_PHASES {
            return StepRate::of_phases_hz(self.half_steps);
        }
        let pulse_ticks = (u32::from(self.step_pulse_us) * TICKS_PER_US).max(EVENT_SPACING_TICKS);
        let proven = self.step_rate.hz() as f32;
        (TICKS_PER_SECOND as f32 / min_period_ticks(pulse_ticks) as f32)
            .min(MAX_STEP_RATE_HZ)
            .min(proven)
    }

    /// Returns the farthest coordinate of each axis that its step counter can hold.
    #[must_use]
    pub fn farthest(&self) -> Axes<Nm> {
        let mut farthest = self.steps_per_mm.map(StepsPerMm::farthest);
        if self.core_xy {
            // Each motor makes the steps of both axes.
            for axis in [X, Y] {
                farthest[axis] = Nm(farthest[axis].0 / 2);
            }
        }
        farthest
    }

    /// Returns the backlash of an axis, whole steps.
    #[must_use]
    pub fn backlash_steps(&self, axis: usize) -> i32 {
        (self.backlash_mm[axis] * self.steps_per_mm[axis].to_f32() + 0.5) as i32
    }

    /// Returns the axes that have backlash, bit 0 = X.
    #[must_use]
    pub fn backlash_axes(&self) -> u8 {
        let bit = |axis: usize| u8::from(self.backlash_steps(axis) != 0) << axis;
        (0..AXES).fold(0, |axes, axis| axes | bit(axis))
    }

    /// Returns the position of the axes where step counters stand.
    #[must_use]
    pub fn position_of(&self, steps: Axes<i32>) -> Axes<Nm> {
        let position = self.steps_per_mm.zip(steps, |resolution, steps| {
            resolution.position_of(Steps(steps))
        });
        if self.core_xy {
            core_xy::position_of(position)
        } else {
            position
        }
    }
}

impl Default for Settings {
    /// Returns the settings of firmware without a proven step rate.
    fn default() -> Self {
        Self::new(StepRate::Unproven)
    }
}
