//! The table of settings: numbers, groups, ranges and rules.
//!
//! `$$`, `$+`, `$ES`, the checks of `$n=value`, the stored record and `docs/settings.md` are made from
//! it. Numbers, formats and refusals are Grbl 1.1's, with one deliberate difference: a value that the
//! machine cannot work with (a resolution of 0, a byte above 255) is refused instead of changed.

use DefinedBy::{Extension, Grbl};
use Kind::{AnyBit, AxisMask, AxisResolution, Bits, Flag};
use SettingGroup::{General, Homing, Host, Limits, Parking, Spindle, Tools};

use super::{
    SettingError, Settings,
    kind::{
        Kind, axis_backlash, axis_divisor, axis_number, byte, byte_from, coordinate, milliseconds,
        number, pwm_frequency, rate, rpm, seconds,
    },
    rules,
};
use crate::axis::LETTERS;

/// One row: a setting, or one for each axis.
#[derive(Debug)]
pub struct Row {
    /// The number; that of the X axis where there is one for each axis.
    pub number: u16,
    /// The group.
    pub group: SettingGroup,
    /// The meaning of the value.
    pub name: &'static str,
    /// The unit of the value, empty without.
    pub unit: &'static str,
    /// Type and range of the value.
    pub kind: Kind,
    /// Who defines the setting.
    pub(super) defined_by: DefinedBy,
    /// Refuses a new value that does not go with other settings.
    pub(super) check: fn(&Settings, usize) -> Result<(), SettingError>,
    /// Changes the settings that depend on a new value, of an axis where there is one for each.
    pub(super) adjust: fn(&mut Settings, usize),
}

/// A group of settings, with the number that `$EG` shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum SettingGroup {
    /// Outputs, inputs and reports.
    General = 1,
    /// Homing.
    Homing = 2,
    /// The spindle, or the laser.
    Spindle = 3,
    /// Limits of the travel.
    Limits = 4,
    /// Parking.
    Parking = 5,
    /// The axes.
    Axes = 6,
    /// Changes of the tool.
    Tools = 7,
    /// Hosts of 3D printers.
    Host = 8,
}

/// Who defines a setting: `$$` lists Grbl's, `$+` all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DefinedBy {
    /// Grbl 1.1.
    Grbl,
    /// grblHAL (`$41`, `$56`…), or this firmware.
    Extension,
}

const fn row(
    number: u16,
    group: SettingGroup,
    defined_by: DefinedBy,
    name: &'static str,
    unit: &'static str,
    kind: Kind,
) -> Row {
    Row {
        number,
        group,
        name,
        unit,
        kind,
        defined_by,
        check: |_, _| Ok(()),
        adjust: |_, _| {},
    }
}

const MM: &str = "mm";
const MM_MIN: &str = "mm/min";

/// Every setting, in the order of the numbers.
#[rustfmt::skip]
pub(super) static TABLE: &[Row] = &[
    row(0, General, Grbl, "step pulse", "µs", byte_from(|s| &mut s.step_pulse_us, 3, SettingError::ShortPulse)),
    row(1, General, Grbl, "delay before idle steppers are released, 255 never", "ms", byte(|s| &mut s.idle_delay_ms)),
    row(2, General, Grbl, "inverted step outputs", "", AxisMask(|s| &mut s.step_invert)),
    row(3, General, Grbl, "inverted directions", "", AxisMask(|s| &mut s.direction_invert)),
    row(4, General, Grbl, "inverted enable output", "", AnyBit(|s| &mut s.enable_invert)),
    row(5, General, Grbl, "inverted limit inputs", "", AnyBit(|s| &mut s.limit_invert)),
    row(6, General, Grbl, "inverted probe input", "", AnyBit(|s| &mut s.probe_invert)),
    row(10, General, Grbl, "status report: 1 machine position, 2 buffer state", "", Bits(|s| &mut s.report_mask, "Machine position,Buffer state")),
    row(11, General, Grbl, "junction deviation", MM, number(|s| &mut s.junction_deviation_mm)),
    row(12, General, Grbl, "arc tolerance", MM, number(|s| &mut s.arc_tolerance_mm)),
    row(13, General, Grbl, "reports in inches", "", Flag(|s| &mut s.report_inches)),
    row(20, Limits, Grbl, "soft limits", "", Flag(|s| &mut s.soft_limits)).checked(rules::soft_limits_need_homing),
    row(21, Limits, Grbl, "hard limits", "", Flag(|s| &mut s.hard_limits)),
    row(22, Homing, Grbl, "homing cycle: 1 on, 9 on with zero where it ends", "", Bits(|s| &mut s.homing, "Enable,N/A,N/A,Set machine origin to 0")).checked(rules::homing_is_known).adjusting(rules::limits_end_with_homing),
    row(23, Homing, Grbl, "axes that home towards their negative end", "", AxisMask(|s| &mut s.homing_direction)),
    row(24, Homing, Grbl, "homing speed to locate the switch", MM_MIN, rate(|s| &mut s.homing_feed_mm_min)),
    row(25, Homing, Grbl, "homing speed to search the switch", MM_MIN, rate(|s| &mut s.homing_seek_mm_min)),
    row(26, Homing, Grbl, "homing delay for the switch to settle", "ms", byte(|s| &mut s.homing_debounce_ms)),
    row(27, Homing, Grbl, "homing distance from the switch", MM, number(|s| &mut s.homing_pull_off_mm)).checked(rules::lengths_are_counted),
    row(28, General, Extension, "how far pecks of G73 and G83 keep from the last one", MM, number(|s| &mut s.peck_clearance_mm)),
    row(30, Spindle, Grbl, "largest spindle speed", "rpm", rpm(|s| &mut s.spindle_max_rpm)),
    row(31, Spindle, Grbl, "smallest spindle speed", "rpm", rpm(|s| &mut s.spindle_min_rpm)),
    row(32, Spindle, Grbl, "laser mode", "", Flag(|s| &mut s.laser)),
    row(33, Spindle, Extension, "frequency of the spindle's PWM, about", "Hz", pwm_frequency(|s| &mut s.pwm_hz)),
    row(40, Limits, Extension, "jogs are shortened to the travel of homed axes", "", Flag(|s| &mut s.shortens_jogs)).checked(rules::soft_limits_need_homing),
    row(41, Parking, Extension, "parking when the safety door opens", "", Flag(|s| &mut s.parking)),
    row(56, Parking, Extension, "parking: slow pull-out", MM, number(|s| &mut s.parking_pull_out_mm)).checked(rules::lengths_are_counted),
    row(57, Parking, Extension, "parking: speed of the pull-out", MM_MIN, rate(|s| &mut s.parking_pull_out_mm_min)),
    row(58, Parking, Extension, "parking: machine coordinate of Z", MM, coordinate(|s| &mut s.parking_target_mm)).checked(rules::lengths_are_counted),
    row(59, Parking, Extension, "parking: speed to it", MM_MIN, rate(|s| &mut s.parking_mm_min)),
    row(100, SettingGroup::Axes, Grbl, "resolution", "step/mm", AxisResolution(|s| &mut s.steps_per_mm)).checked(rules::resolution_is_possible).adjusting(rules::belts_have_one_resolution),
    row(110, SettingGroup::Axes, Grbl, "largest speed", MM_MIN, axis_divisor(|s| &mut s.max_rate_mm_min)).checked(rules::step_rate_is_possible),
    row(120, SettingGroup::Axes, Grbl, "acceleration", "mm/s²", axis_divisor(|s| &mut s.acceleration_mm_s2)),
    row(130, SettingGroup::Axes, Grbl, "travel; with 0 no soft limits, and no homing", MM, axis_number(|s| &mut s.max_travel_mm)).checked(rules::lengths_are_counted),
    row(160, SettingGroup::Axes, Extension, "backlash, taken up where the axis reverses; 0 for none", MM, axis_backlash(|s| &mut s.backlash_mm)).checked(rules::belts_have_no_backlash),
    row(341, Tools, Extension, "tool change: 0 waits for the operator, 4 ignores M6", "", byte(|s| &mut s.tool_change)).checked(rules::tool_change_is_known),
    row(392, Spindle, Extension, "spindle delay before the machine goes on after the door, or after the spindle was stopped in a hold", "s", seconds(|s| &mut s.door_spindle_delay_s)).checked(rules::delay_is_long_enough),
    row(393, Spindle, Extension, "coolant delay before the machine goes on after the door", "s", seconds(|s| &mut s.door_coolant_delay_s)).checked(rules::delay_is_long_enough),
    row(394, Spindle, Extension, "spindle delay before the machine moves when the spindle has been switched on", "s", seconds(|s| &mut s.spindle_delay_s)).checked(rules::delay_is_long_enough),
    row(775, Spindle, Extension, "the spindle hangs on a relay: it turns without S, too", "", Flag(|s| &mut s.spindle_relay)),
    row(776, Spindle, Extension, "motion stops before the spindle changes its speed", "", Flag(|s| &mut s.stops_for_speed)),
    row(777, Spindle, Extension, "ALARM:4 and ALARM:5, of a probing move, switch spindle and coolant off", "", Flag(|s| &mut s.probing_alarm_switches_off)),
    row(780, Host, Extension, "dialect: 0 Grbl, 1 RepRap, 2 Grbl with checked lines", "", byte(|s| &mut s.dialect)).checked(rules::dialect_is_known),
    row(781, Host, Extension, "RepRap: axis that E drives, 4 for A and so on, 0 counts only", "", byte(|s| &mut s.extruder_axis)).checked(rules::extruder_is_an_axis),
    row(782, Host, Extension, "RepRap: time between two messages that a line is not done yet, 0 for none", "s", byte(|s| &mut s.busy_interval_s)).checked(rules::busy_interval_is_short),
    row(783, Host, Extension, "RepRap: output of M106: 0 none, 1 spindle or laser, 2 flood, 3 mist", "", byte(|s| &mut s.fan_output)).checked(rules::fan_output_is_known),
    row(784, Host, Extension, "RepRap: G6 and G0 S2 may move single motors", "", Flag(|s| &mut s.moves_motors)),
    row(785, General, Extension, "tolerance of G64 without P, 0 for no limit", MM, number(|s| &mut s.path_tolerance_mm)),
    row(786, General, Extension, "time from the enabling of the drivers to the first step", "ms", milliseconds(|s| &mut s.enable_delay_ms)),
    row(787, Host, Extension, "a motion is held when the sender's USB link is lost", "", Flag(|s| &mut s.holds_without_link)),
    row(788, Homing, Extension, "axes that home where they stand, by marks instead of switches", "", AxisMask(|s| &mut s.homing_marks)),
    row(789, Tools, Extension, "M6 raises Z and goes to the position of G30, once homed", "", Flag(|s| &mut s.tool_change_travel)),
    #[cfg(arc_machine)]
    row(790, General, Extension, "arcs: 0 nearest steps, 1 in whole steps, inwards where the deviation is not negative", "", byte(|s| &mut s.arc_rule)).checked(rules::arc_rule_is_known),
    row(791, General, Extension, "motors driven by phases turn in half steps", "", Flag(|s| &mut s.half_steps)).checked(rules::motors_follow),
    row(792, General, Extension, "position stream: least time between two lines, 0 for none", "ms", milliseconds(|s| &mut s.stream_interval_ms)),
    row(793, General, Extension, "position stream: lines have Z", "", Flag(|s| &mut s.stream_z)),
    #[cfg(arc_machine)]
    row(794, General, Extension, "cycle start at Idle runs the stored program again and again", "", Flag(|s| &mut s.runs_stored_program)),
    row(795, SettingGroup::Axes, Extension, "CoreXY: the motors of X and Y turn for X + Y and X - Y", "", Flag(|s| &mut s.core_xy)).checked(rules::belts_turn_at_rate).adjusting(rules::belts_have_one_resolution),
    row(796, General, Extension, "the line behind a refused one waits for cycle start", "", Flag(|s| &mut s.holds_after_refusal)),
    row(797, General, Extension, "motion that may be queued, 0 for no limit", "s", byte(|s| &mut s.queued_motion_s)),
    row(798, General, Extension, "a contact of the probe outside of a probing move stops the machine, once the probe has made contact in one", "", Flag(|s| &mut s.stops_at_contact)),
    row(800, SettingGroup::Axes, Extension, "jerk, 0 for no limit", "mm/s³", axis_number(|s| &mut s.jerk_mm_s3)),
];

const _: () = assert!(
    TABLE.len() == Settings::FIELDS,
    "a setting is a field in `settings!` (src/settings/mod.rs) and a row in TABLE (here): one of both is missing"
);
const _: () = assert!(
    is_in_order(),
    "put the rows of TABLE in the order of their numbers; a row with one for each axis takes six"
);

const fn is_in_order() -> bool {
    let (mut index, mut next) = (0, 0);
    while index < TABLE.len() {
        let row = &TABLE[index];
        if row.number < next {
            return false;
        }
        next = row.number + row.settings(LETTERS.len()) as u16;
        index += 1;
    }
    true
}

impl Row {
    const fn checked(mut self, check: fn(&Settings, usize) -> Result<(), SettingError>) -> Self {
        self.check = check;
        self
    }

    const fn adjusting(mut self, adjust: fn(&mut Settings, usize)) -> Self {
        self.adjust = adjust;
        self
    }

    /// Returns the number of settings that the row stands for on a machine with `axes` axes.
    pub(super) const fn settings(&self, axes: usize) -> usize {
        if self.kind.is_per_axis() { axes } else { 1 }
    }
}

impl SettingGroup {
    /// Every group.
    pub const ALL: [Self; 8] = [
        Self::General,
        Self::Homing,
        Self::Spindle,
        Self::Limits,
        Self::Parking,
        Self::Axes,
        Self::Tools,
        Self::Host,
    ];

    /// Returns the name that `$EG` shows.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::General => "General",
            Self::Homing => "Homing",
            Self::Spindle => "Spindle",
            Self::Limits => "Limits",
            Self::Parking => "Parking",
            Self::Axes => "Axes",
            Self::Tools => "Tools",
            Self::Host => "Host",
        }
    }
}
