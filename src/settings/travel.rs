//! Where homing ends, and the travel from there, in machine coordinates.
//!
//! ```text
//!            far end of $130..                            switch
//!   $22=1    -travel                          -$27        0          an axis that homes upwards
//!            0                     -travel + $27    -travel          one of `$23`
//!   $22=9    -travel + $27                     0                     both with $21=1; without, the
//!            travel - $27                      0                     far end is $27 farther away
//! ```
//!
//! Read with Grbl 1.1 `limits.c`, and grblHAL `machine_limits.c` for `$22=9` (`force_set_origin`) and for what keeps
//! the pull-off from the switches (`limits_set_work_envelope`).

use super::Settings;
use crate::{
    axis::{LINEAR, Z},
    math,
    units::Nm,
};

impl Settings {
    /// `$22`, bit 0: the homing cycle is on.
    pub(super) const HOMING_ON: u8 = 1;
    /// `$22`, bit 3: the place where an axis is homed is its zero, as grblHAL's.
    pub(super) const ZERO_AT_HOME: u8 = 8;

    /// Returns whether the homing cycle is on.
    #[must_use]
    pub const fn is_homing_on(&self) -> bool {
        self.homing & Self::HOMING_ON != 0
    }

    /// Returns whether an axis homes towards its negative end.
    #[must_use]
    pub const fn homes_downwards(&self, axis: usize) -> bool {
        self.homing_direction >> axis & 1 != 0
    }

    const fn is_zero_at_home(&self) -> bool {
        self.homing & Self::ZERO_AT_HOME != 0
    }

    /// Returns the distance that an axis keeps from its switch, mm: none where it homes by marks.
    const fn pull_off_mm(&self, axis: usize) -> f32 {
        if self.homing_marks >> axis & 1 == 0 {
            self.homing_pull_off_mm
        } else {
            0.0
        }
    }

    /// Returns the coordinate of an axis where it is homed, mm, in Grbl's arithmetic.
    #[must_use]
    pub const fn home_mm(&self, axis: usize) -> f32 {
        let pull_off_mm = self.pull_off_mm(axis);
        if self.is_zero_at_home() {
            0.0
        } else if self.homes_downwards(axis) {
            pull_off_mm - self.max_travel_mm.0[axis]
        } else {
            -pull_off_mm
        }
    }

    /// Returns the lowest and the highest coordinate of an axis that soft limits allow; `None` without limits: of an
    /// axis that `E` drives, and where 0 is set.
    #[must_use]
    pub fn travel(&self, axis: usize) -> Option<[Nm; 2]> {
        let is_driven = axis >= LINEAR && axis + 1 == usize::from(self.extruder_axis);
        let mut travel_mm = self.max_travel_mm[axis];
        if is_driven || travel_mm == 0.0 {
            return None;
        }
        if self.is_zero_at_home() && self.hard_limits {
            travel_mm = math::max(travel_mm - self.pull_off_mm(axis), 0.0);
        }
        let travel = Nm::from_mm_f64(f64::from(travel_mm));
        Some(if self.is_zero_at_home() && self.homes_downwards(axis) {
            [Nm(0), travel]
        } else {
            [Nm(-travel.0), Nm(0)]
        })
    }

    /// Returns the highest coordinate of Z that keeps the pull-off from the end of the travel.
    #[must_use]
    pub fn top(&self) -> Nm {
        let [_, highest] = self.travel(Z).unwrap_or_default();
        if self.is_zero_at_home() {
            highest
        } else {
            highest - Nm::from_mm(self.homing_pull_off_mm)
        }
    }

    /// Returns the travel of an axis without what lies within the pull-off of a hard limit at either end.
    #[must_use]
    pub fn travel_off_switches(&self, axis: usize) -> Option<[Nm; 2]> {
        let [lowest, highest] = self.travel(axis)?;
        if !self.hard_limits || self.is_zero_at_home() {
            return Some([lowest, highest]);
        }
        let pull_off = Nm::from_mm(self.pull_off_mm(axis));
        let middle = Nm(i64::midpoint(lowest.0, highest.0));
        Some([
            (lowest + pull_off).min(middle),
            (highest - pull_off).max(middle),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::assign;

    fn settings(assignments: &[&str]) -> Settings {
        let mut settings = Settings::default();
        for assignment in assignments {
            assign(&mut settings, assignment.as_bytes()).expect(assignment);
        }
        settings
    }

    fn mm(range: Option<[Nm; 2]>) -> Option<[f64; 2]> {
        range.map(|ends| ends.map(Nm::to_mm_f64))
    }

    #[test]
    fn home_and_travel_are_grbls_or_begin_at_zero_as_grblhals() {
        let downwards = &["22=1", "27=2", "23=1"][..];
        for (assignments, home, travel, off_switches) in [
            (&["22=1", "27=2"][..], -2.0, [-200.0, 0.0], [-200.0, 0.0]),
            (downwards, -198.0, [-200.0, 0.0], [-200.0, 0.0]),
            (
                &["22=1", "27=2", "21=1"],
                -2.0,
                [-200.0, 0.0],
                [-198.0, -2.0],
            ),
            (&["22=9", "27=2"], 0.0, [-200.0, 0.0], [-200.0, 0.0]),
            (&["22=9", "27=2", "23=1"], 0.0, [0.0, 200.0], [0.0, 200.0]),
            (&["22=9", "27=2", "21=1"], 0.0, [-198.0, 0.0], [-198.0, 0.0]),
            (
                &["22=9", "27=2", "21=1", "23=1"],
                0.0,
                [0.0, 198.0],
                [0.0, 198.0],
            ),
            // By marks: there is no switch.
            (
                &["22=1", "27=2", "21=1", "788=1"],
                0.0,
                [-200.0, 0.0],
                [-200.0, 0.0],
            ),
            (
                &["22=9", "27=2", "21=1", "788=1", "23=1"],
                0.0,
                [0.0, 200.0],
                [0.0, 200.0],
            ),
            (
                &["22=1", "27=150", "21=1"],
                -150.0,
                [-200.0, 0.0],
                [-100.0, -100.0],
            ),
        ] {
            let settings = settings(assignments);
            assert_eq!(settings.home_mm(0), home, "{assignments:?}");
            assert_eq!(mm(settings.travel(0)), Some(travel), "{assignments:?}");
            let between = mm(settings.travel_off_switches(0));
            assert_eq!(between, Some(off_switches), "{assignments:?}");
        }
        assert_eq!(settings(&["22=9", "130=0"]).travel(0), None);
    }
}
