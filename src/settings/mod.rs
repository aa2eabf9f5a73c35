//! What the user sets with `$n=value`.

mod decimal;
mod described;
mod step_rate;
mod storage;
mod stored;
mod table;

pub use described::{DataType, Description, GROUPS, Group, described};
pub use step_rate::StepRate;
pub use storage::{Journal, Loaded};
pub use stored::{Change, Origins, STARTUP_LINES, STORED_LINE, StoreError, Stored, StoredLine};
pub use table::{
    Kind, Row, SettingError, TABLE, Value, assign, listed, listed_of_grbl, numbered, set,
};

use crate::{
    axis::Axes,
    model::timing::{EVENT_SPACING_TICKS, min_period_ticks},
    units::{Nm, StepsPerMm, TICKS_PER_SECOND, TICKS_PER_US},
};

/// Most steps per second that a segment of the step interrupt can count on one axis.
const MAX_STEP_RATE_HZ: f32 = 500_000.0;

/// All settings, with Grbl's numbers.
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a setting of its own"
)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// `$0` Step pulse, µs.
    pub step_pulse_us: u8,
    /// `$1` Delay before idle steppers are released, ms; 255 keeps them on.
    pub idle_delay_ms: u8,
    /// `$2` Axes whose step pulse is inverted, bit 0 = X.
    pub step_invert: u8,
    /// `$3` Axes whose direction is inverted, bit 0 = X.
    pub direction_invert: u8,
    /// `$4` Whether the enable output is inverted.
    pub enable_invert: bool,
    /// `$5` Whether the limit inputs are inverted.
    pub limit_invert: bool,
    /// `$6` Whether the probe input is inverted.
    pub probe_invert: bool,
    /// `$10` What a status report shows: bit 0 machine position, bit 1 buffer state.
    pub report_mask: u8,
    /// `$11` Junction deviation, mm.
    pub junction_deviation_mm: f32,
    /// `$12` Arc tolerance, mm: kept for senders; arcs are exact.
    pub arc_tolerance_mm: f32,
    /// `$13` Whether reports are in inches.
    pub report_inches: bool,
    /// `$20` Soft limits.
    pub soft_limits: bool,
    /// `$21` Hard limits.
    pub hard_limits: bool,
    /// `$22` Homing cycle.
    pub homing: bool,
    /// `$23` Axes that home towards their negative end, bit 0 = X.
    pub homing_direction: u8,
    /// `$24` Speed at which homing locates the switch, mm/min.
    pub homing_feed_mm_min: f32,
    /// `$25` Speed at which homing searches the switch, mm/min.
    pub homing_seek_mm_min: f32,
    /// `$26` Delay after a homing switch opens or closes, ms.
    pub homing_debounce_ms: u16,
    /// `$27` Distance from the switch after homing, mm.
    pub homing_pull_off_mm: f32,
    /// `$30` Spindle speed at full output, rpm.
    pub spindle_max_rpm: f32,
    /// `$31` Spindle speed at least output, rpm.
    pub spindle_min_rpm: f32,
    /// `$32` Laser mode.
    pub laser: bool,
    /// `$41` Whether Z is parked when the safety door opens.
    pub parking: bool,
    /// `$56` Slow pull-out before parking, mm.
    pub parking_pull_out_mm: f32,
    /// `$57` Speed of the pull-out, and of the way back, mm/min.
    pub parking_pull_out_mm_min: f32,
    /// `$58` Where Z is parked, machine coordinate, mm.
    pub parking_target_mm: f32,
    /// `$59` Speed of parking, mm/min.
    pub parking_mm_min: f32,
    /// `$100`… Resolution of each axis.
    pub steps_per_mm: Axes<StepsPerMm>,
    /// `$110`… Fastest speed of each axis, mm/min.
    pub max_rate_mm_min: Axes<f32>,
    /// `$120`… Acceleration of each axis, mm/s².
    pub acceleration_mm_s2: Axes<f32>,
    /// `$130`… Travel of each axis, mm.
    pub max_travel_mm: Axes<f32>,
    /// `$800`… Jerk of each axis, mm/s³; 0 does not limit it.
    pub jerk_mm_s3: Axes<f32>,
    /// What the firmware is proven to keep up with: nothing that the user sets.
    pub step_rate: StepRate,
}

impl Settings {
    /// The most steps per second of one axis: what the step pulse leaves room for when those of
    /// other axes delay it, what the step interrupt can count, and what is proven for all axes
    /// together.
    #[must_use]
    pub fn greatest_step_rate_hz(&self) -> f32 {
        let pulse_ticks = (u32::from(self.step_pulse_us) * TICKS_PER_US).max(EVENT_SPACING_TICKS);
        let proven = self.step_rate.hz() as f32;
        (TICKS_PER_SECOND as f32 / min_period_ticks(pulse_ticks) as f32)
            .min(MAX_STEP_RATE_HZ)
            .min(proven)
    }

    /// The farthest coordinate of each axis that its step counter can hold.
    #[must_use]
    pub fn farthest(&self) -> Axes<Nm> {
        self.steps_per_mm.map(StepsPerMm::farthest)
    }
}

impl Default for Settings {
    /// Those of a machine of whose firmware nothing is proven.
    fn default() -> Self {
        Self::new(StepRate::Unproven)
    }
}

impl Settings {
    /// Grbl 1.1h's defaults (`defaults.h`, `DEFAULTS_GENERIC`).
    #[must_use]
    pub const fn new(step_rate: StepRate) -> Self {
        const RESOLUTION: StepsPerMm = match StepsPerMm::from_millionths(250_000_000) {
            Some(resolution) => resolution,
            None => unreachable!(),
        };
        Self {
            step_pulse_us: 10,
            idle_delay_ms: 25,
            step_invert: 0,
            direction_invert: 0,
            enable_invert: false,
            limit_invert: false,
            probe_invert: false,
            report_mask: 1,
            junction_deviation_mm: 0.01,
            arc_tolerance_mm: 0.002,
            report_inches: false,
            soft_limits: false,
            hard_limits: false,
            homing: false,
            homing_direction: 0,
            homing_feed_mm_min: 25.0,
            homing_seek_mm_min: 500.0,
            homing_debounce_ms: 250,
            homing_pull_off_mm: 1.0,
            spindle_max_rpm: 1000.0,
            spindle_min_rpm: 0.0,
            laser: false,
            parking: false,
            parking_pull_out_mm: 5.0,
            parking_pull_out_mm_min: 100.0,
            parking_target_mm: -5.0,
            parking_mm_min: 500.0,
            steps_per_mm: Axes::all(RESOLUTION),
            max_rate_mm_min: Axes::all(500.0),
            acceleration_mm_s2: Axes::all(10.0),
            max_travel_mm: Axes::all(200.0),
            jerk_mm_s3: Axes::all(0.0),
            step_rate,
        }
    }
}
