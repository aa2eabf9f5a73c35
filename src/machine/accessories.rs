//! Spindle, laser and coolant: what was asked for, and what is switched.
//!
//! Grbl 1.1's `spindle_control.c` sets the arithmetic: 255 steps of the PWM, of which each has four
//! parts here.

use crate::{
    math,
    model::{Coolant, Laser, Outputs, Override, Overrides, Power, Spindle},
    settings::Settings,
};

/// Stop of the spindle in a feed hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stop {
    None,
    /// Asked for while still slowing down.
    Asked,
    Stopped,
    /// A laser that may be on again, but not at rest.
    Dark,
}

/// The spindle and the coolant.
#[derive(Debug)]
pub struct Accessories {
    /// As programmed.
    spindle: Spindle,
    /// Speed at rest as programmed, rpm; in laser mode, the power left on.
    rpm: f32,
    /// As programmed, or toggled since.
    coolant: Coolant,
    /// Counts toggles, wrapping.
    toggles: u8,
    /// Counts changes that the next status report has to show, wrapping.
    changes: u8,
    stop: Stop,
    /// Off whatever is programmed: the door is open.
    is_spindle_suspended: bool,
    is_coolant_suspended: bool,
    overrides: Overrides,
    min_rpm: f32,
    max_rpm: f32,
    is_laser: bool,
    /// Set by each change, cleared by [`Accessories::take_changed`].
    is_changed: bool,
}

impl Accessories {
    /// Everything off, with Grbl's default speeds.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            spindle: Spindle::Off,
            rpm: 0.0,
            coolant: Coolant::OFF,
            toggles: 0,
            changes: 0,
            stop: Stop::None,
            is_spindle_suspended: false,
            is_coolant_suspended: false,
            overrides: Overrides::NONE,
            min_rpm: 0.0,
            max_rpm: 1000.0,
            is_laser: false,
            is_changed: true,
        }
    }

    /// Takes over `$30`, `$31` and `$32`.
    pub fn configure(&mut self, settings: &Settings) {
        self.min_rpm = settings.spindle_min_rpm;
        self.max_rpm = settings.spindle_max_rpm;
        self.is_laser = settings.laser;
        self.is_changed = true;
    }

    /// Returns whether anything has changed since the last call; true at first.
    #[inline]
    pub fn take_changed(&mut self) -> bool {
        core::mem::take(&mut self.is_changed)
    }

    /// The overrides in effect.
    #[must_use]
    pub const fn overrides(&self) -> Overrides {
        self.overrides
    }

    /// Whether the spindle is off, whatever segments that wait have.
    #[must_use]
    pub fn is_spindle_off(&self) -> bool {
        self.spindle == Spindle::Off
    }

    /// Whether the spindle is a laser.
    #[must_use]
    pub const fn is_laser(&self) -> bool {
        self.is_laser
    }

    /// Coolant as programmed, or toggled since, and the count of toggles.
    #[must_use]
    pub const fn coolant_asked(&self) -> (Coolant, u8) {
        (self.coolant, self.toggles)
    }

    /// Counts what the next status report has to show, wrapping: each command to the spindle and the
    /// coolant, whether it changes anything or not, and each change of an override.
    #[must_use]
    pub const fn changes(&self) -> u8 {
        self.changes
    }

    /// The next status report has to show the overrides, the spindle and the coolant.
    fn count_change(&mut self) {
        self.changes = self.changes.wrapping_add(1);
        self.is_changed = true;
    }

    /// Whether the spindle, and the coolant, have to be switched on again after the door was open.
    #[must_use]
    pub fn has_to_restore(&self) -> (bool, bool) {
        (self.spindle != Spindle::Off, self.coolant != Coolant::OFF)
    }

    /// A new state of the spindle and its speed, rpm. A laser in proportion to the speed is off at
    /// rest.
    pub fn set_spindle(&mut self, spindle: Spindle, rpm: f32) {
        self.end_dark();
        self.spindle = spindle;
        let is_proportional = self.is_laser && spindle == Spindle::CounterClockwise;
        self.rpm = if is_proportional { 0.0 } else { rpm };
        self.count_change();
    }

    /// Ends the wait of a laser for a motion or for a new state.
    fn end_dark(&mut self) {
        if self.stop == Stop::Dark {
            self.stop = Stop::None;
            self.is_changed = true;
        }
    }

    /// A new state of the coolant.
    pub fn set_coolant(&mut self, coolant: Coolant) {
        self.coolant = coolant;
        self.count_change();
    }

    /// An override. Those of feed and rapids are for the plan.
    pub fn override_by(&mut self, command: Override) {
        let overrides = self.overrides.after(command);
        if overrides != self.overrides {
            self.overrides = overrides;
            self.count_change();
        }
    }

    /// All overrides back to 100 %, and whether the next status report shows it.
    pub fn end_overrides(&mut self, is_shown: bool) {
        self.overrides = Overrides::NONE;
        self.is_changed = true;
        if is_shown {
            self.count_change();
        }
    }

    /// Flood on, or off.
    pub fn toggle_flood(&mut self) {
        self.coolant.flood = !self.coolant.flood;
        self.toggles = self.toggles.wrapping_add(1);
        self.count_change();
    }

    /// Mist on, or off.
    pub fn toggle_mist(&mut self) {
        self.coolant.mist = !self.coolant.mist;
        self.toggles = self.toggles.wrapping_add(1);
        self.count_change();
    }

    /// Stops the spindle in a hold, or starts it again, by its key. Returns whether it starts.
    pub fn toggle_stop(&mut self) -> bool {
        self.is_changed = true;
        match self.stop {
            Stop::None | Stop::Dark => {
                self.stop = Stop::Asked;
                false
            }
            Stop::Asked => false,
            Stop::Stopped => {
                self.count_change();
                self.stop = if self.is_laser {
                    Stop::Dark
                } else {
                    Stop::None
                };
                true
            }
        }
    }

    /// A hold begins: a laser is switched off in any.
    pub fn begin_hold(&mut self) {
        if self.is_laser && self.stop == Stop::None {
            self.stop = Stop::Asked;
            self.is_changed = true;
        }
    }

    /// Stops the spindle at rest in a hold, if that was asked for.
    pub fn stop_in_hold(&mut self) {
        if self.stop == Stop::Asked {
            self.is_changed = true;
            self.stop = if self.spindle == Spindle::Off {
                Stop::None
            } else {
                self.count_change();
                Stop::Stopped
            };
        }
    }

    /// Lets the spindle run again, and returns whether it was stopped. A laser comes on with a motion
    /// only, now (`moves`) or later.
    pub fn end_stop(&mut self, moves: bool) -> bool {
        let was_stopped = self.stop == Stop::Stopped;
        let stays_dark = self.is_laser && !moves && self.stop != Stop::None;
        self.stop = if stays_dark { Stop::Dark } else { Stop::None };
        self.is_changed = true;
        if was_stopped && !self.is_laser {
            self.count_change();
        }
        was_stopped
    }

    /// Switches everything off; what was on can be restored.
    pub fn suspend(&mut self) {
        self.stop = Stop::None;
        self.is_spindle_suspended = true;
        self.is_coolant_suspended = true;
        self.count_change();
    }

    /// Ends the suspension of the spindle; a laser stays dark up to the end of the stop.
    pub fn restore_spindle(&mut self) {
        self.is_spindle_suspended = false;
        self.is_changed = true;
        if self.is_laser {
            self.stop = Stop::Dark;
        } else if self.spindle != Spindle::Off {
            self.count_change();
        }
    }

    /// Ends the suspension of the coolant.
    pub fn restore_coolant(&mut self) {
        self.is_coolant_suspended = false;
        self.is_changed = true;
        if self.coolant != Coolant::OFF {
            self.count_change();
        }
    }

    /// Everything off and forgotten.
    pub fn switch_off(&mut self) {
        self.spindle = Spindle::Off;
        self.rpm = 0.0;
        self.coolant = Coolant::OFF;
        self.stop = Stop::None;
        self.is_spindle_suspended = false;
        self.is_coolant_suspended = false;
        self.is_changed = true;
    }

    /// Begins a block: its laser sets the power that is left on at rest.
    pub fn begin_block(&mut self, laser: Laser) {
        self.end_dark();
        let rpm = match laser {
            Laser::None => return,
            Laser::Constant(rpm) => rpm,
            Laser::Proportional(_) => 0.0,
        };
        self.is_changed |= rpm != self.rpm;
        self.rpm = rpm;
    }

    /// The power at rest.
    #[must_use]
    pub fn power_at_rest(&self) -> Power {
        self.power(self.rpm)
    }

    /// The power while a block is executed at this part of its programmed speed.
    #[must_use]
    pub fn power_in_motion(&self, laser: Laser, part: f32) -> Power {
        match laser {
            Laser::None => self.power(self.rpm),
            Laser::Constant(rpm) => self.power(rpm),
            Laser::Proportional(rpm) => self.power(rpm * part),
        }
    }

    /// The power of a programmed speed, under the override and within the limits.
    #[inline]
    fn power(&self, rpm: f32) -> Power {
        if self.spindle == Spindle::Off {
            return Power::OFF;
        }
        let rpm = rpm * (0.01 * f32::from(self.overrides.spindle));
        if self.is_stopped() || rpm <= 0.0 {
            return Power::OFF;
        }
        if rpm >= self.max_rpm || self.min_rpm >= self.max_rpm {
            return Power {
                rpm: self.max_rpm,
                duty: Outputs::FULL,
            };
        }
        let rpm = math::max(rpm, self.min_rpm);
        let gradient = DUTY_RANGE / (self.max_rpm - self.min_rpm);
        let duty = ((rpm - self.min_rpm) * gradient) as u16 + MIN_DUTY;
        Power { rpm, duty }
    }

    const fn is_stopped(&self) -> bool {
        self.is_spindle_suspended || matches!(self.stop, Stop::Stopped | Stop::Dark)
    }

    /// The direction as it is switched with a power: off where the power is.
    #[must_use]
    pub const fn direction(&self, power: Power) -> Spindle {
        if power.duty == 0 {
            Spindle::Off
        } else {
            self.spindle
        }
    }

    /// The enable and direction outputs with a power: a spindle turns on even at the speed 0.
    #[must_use]
    pub fn switched(&self, power: Power) -> Spindle {
        if self.is_stopped() || self.is_laser && power.duty == 0 {
            Spindle::Off
        } else {
            self.spindle
        }
    }

    /// The coolant as it is switched.
    #[must_use]
    pub const fn coolant(&self) -> Coolant {
        if self.is_coolant_suspended {
            Coolant::OFF
        } else {
            self.coolant
        }
    }
}

impl Default for Accessories {
    fn default() -> Self {
        Self::new()
    }
}

/// Duty at the smallest speed: one of Grbl's steps.
const MIN_DUTY: u16 = 4;
/// From the smallest to the largest speed, in the parts of a duty.
const DUTY_RANGE: f32 = (Outputs::FULL - MIN_DUTY) as f32;

#[cfg(test)]
mod tests {
    use super::*;

    fn spindle(settings: &Settings, rpm: f32) -> Accessories {
        let mut accessories = Accessories::new();
        accessories.configure(settings);
        accessories.set_spindle(Spindle::Clockwise, rpm);
        accessories
    }

    #[test]
    fn duties_are_those_of_grbl() {
        let settings = Settings::default();
        for (rpm, duty) in [(0.0, 0), (0.5, 1), (10.0, 3), (500.0, 128), (550.0, 140)] {
            let power = spindle(&settings, rpm).power_at_rest();
            assert_eq!((power.rpm, power.duty / 4), (rpm, duty));
        }
        for (rpm, duty) in [(450.0, 115), (800.0, 204), (999.9, 254), (1000.0, 255)] {
            assert_eq!(spindle(&settings, rpm).power_at_rest().duty / 4, duty);
        }
        assert_eq!(spindle(&settings, 1234.0).power_at_rest().rpm, 1000.0);
        let narrow = Settings {
            spindle_min_rpm: 200.0,
            ..settings
        };
        let least = spindle(&narrow, 100.0).power_at_rest();
        assert_eq!((least.rpm, least.duty), (200.0, MIN_DUTY));
        assert_eq!(spindle(&narrow, 0.0).power_at_rest(), Power::OFF);
        let switched = Settings {
            spindle_min_rpm: 1000.0,
            ..settings
        };
        assert_eq!(spindle(&switched, 5.0).power_at_rest().duty, Outputs::FULL);
        assert_eq!(spindle(&switched, 0.0).power_at_rest().duty, 0);
    }

    #[test]
    fn the_override_scales_the_speed() {
        let mut accessories = spindle(&Settings::default(), 500.0);
        accessories.override_by(Override::SpindleMore);
        assert_eq!(accessories.power_at_rest().rpm, 550.0);
        assert_eq!(accessories.power_at_rest().duty / 4, 140);
        accessories.end_overrides(true);
        assert_eq!(accessories.power_at_rest().rpm, 500.0);
    }

    #[test]
    fn a_laser_in_proportion_is_off_at_rest_and_a_constant_one_stays() {
        let settings = Settings {
            laser: true,
            ..Settings::default()
        };
        let mut laser = Accessories::new();
        laser.configure(&settings);
        laser.set_spindle(Spindle::CounterClockwise, 500.0);
        let beam = Laser::Proportional(500.0);
        laser.begin_block(beam);
        assert_eq!(laser.power_at_rest(), Power::OFF);
        assert_eq!(laser.switched(Power::OFF), Spindle::Off);
        assert_eq!(laser.power_in_motion(beam, 0.3).rpm, 150.0);
        laser.set_spindle(Spindle::Clockwise, 0.0);
        laser.begin_block(Laser::Constant(800.0));
        assert_eq!(laser.power_at_rest().rpm, 800.0);
        laser.begin_block(Laser::Constant(0.0));
        assert_eq!(laser.power_at_rest(), Power::OFF);
    }

    #[test]
    fn a_spindle_that_is_off_is_not_stopped() {
        let mut accessories = Accessories::new();
        assert!(!accessories.toggle_stop());
        accessories.stop_in_hold();
        assert!(!accessories.toggle_stop());
        accessories.set_spindle(Spindle::Clockwise, 500.0);
        accessories.stop_in_hold();
        assert_eq!(
            accessories.switched(accessories.power_at_rest()),
            Spindle::Off
        );
        assert!(accessories.toggle_stop());
        assert_eq!(accessories.power_at_rest().rpm, 500.0);
    }

    #[test]
    fn everything_suspended_comes_back_one_after_the_other() {
        let mut accessories = spindle(&Settings::default(), 1000.0);
        accessories.toggle_flood();
        accessories.suspend();
        assert_eq!(accessories.power_at_rest(), Power::OFF);
        assert_eq!(accessories.coolant(), Coolant::OFF);
        assert_eq!(accessories.has_to_restore(), (true, true));
        accessories.restore_spindle();
        assert_eq!(accessories.power_at_rest().duty, Outputs::FULL);
        assert_eq!(accessories.coolant(), Coolant::OFF);
        accessories.restore_coolant();
        assert!(accessories.coolant().flood);
    }
}
