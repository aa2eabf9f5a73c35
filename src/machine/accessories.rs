//! Spindle, laser and coolant: the programmed state, and the state of the outputs.
//!
//! The arithmetic is that of Grbl 1.1's `spindle_control.c`: a PWM of 255 steps, each of which is
//! divided by four here.

use crate::{
    math,
    model::{Coolant, Laser, Outputs, Override, OverrideSwitches, Overrides, Power, Spindle},
    settings::Settings,
};

/// The spindle stop override, which stops the spindle in a feed hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SpindleStop {
    None,
    /// Requested before standstill.
    Requested,
    Stopped,
    /// Ended, but a laser stays off up to the next motion.
    UntilMotion,
}

/// The spindle and the coolant.
#[derive(Debug)]
pub struct Accessories {
    /// The programmed state of the spindle.
    spindle: Spindle,
    /// Programmed speed at rest, rpm; in laser mode, the power that stays on at rest.
    rpm: f32,
    /// The speed that the program has come to, where no move may bring it.
    next_rpm: Option<f32>,
    /// The programmed coolant, with realtime toggles since.
    coolant: Coolant,
    /// Number of toggles, wrapping.
    toggles: u8,
    /// Number of changes that the next status report shows, wrapping.
    changes: u8,
    stop: SpindleStop,
    /// Switched off while the door is open, whatever is programmed.
    is_spindle_suspended: bool,
    is_coolant_suspended: bool,
    /// The overrides as the operator has set them.
    asked: Overrides,
    switches: OverrideSwitches,
    /// The overrides in effect.
    overrides: Overrides,
    min_rpm: f32,
    max_rpm: f32,
    is_laser: bool,
    /// `$775`.
    is_relay: bool,
    /// The spindle has been switched on as it was before the door, or its stop, and not by a program.
    is_resumed: bool,
    /// Set by each change, cleared by [`Accessories::take_changed`].
    is_changed: bool,
}

impl Accessories {
    /// Returns accessories that are off, with Grbl's default speeds.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            spindle: Spindle::Off,
            rpm: 0.0,
            next_rpm: None,
            coolant: Coolant::OFF,
            toggles: 0,
            changes: 0,
            stop: SpindleStop::None,
            is_spindle_suspended: false,
            is_coolant_suspended: false,
            asked: Overrides::NONE,
            switches: OverrideSwitches::ALL,
            overrides: Overrides::NONE,
            min_rpm: 0.0,
            max_rpm: 1000.0,
            is_laser: false,
            is_relay: false,
            is_resumed: false,
            is_changed: true,
        }
    }

    /// Applies `$30`, `$31` and `$32`. Another laser mode switches the spindle off: what is on means something else
    /// in it, and a laser would burn at rest.
    pub fn configure(&mut self, settings: &Settings) {
        if self.is_laser != settings.laser && self.spindle != Spindle::Off {
            self.stop = SpindleStop::None;
            self.set_spindle(Spindle::Off, 0.0);
        }
        self.min_rpm = settings.spindle_min_rpm;
        self.max_rpm = settings.spindle_max_rpm;
        self.is_laser = settings.laser;
        self.is_relay = settings.spindle_relay;
        self.is_changed = true;
    }

    /// Takes the mark of a change: returns whether there has been one since the last call; true at
    /// first.
    #[inline]
    pub fn take_changed(&mut self) -> bool {
        core::mem::take(&mut self.is_changed)
    }

    /// Returns the overrides in effect.
    #[must_use]
    pub const fn overrides(&self) -> Overrides {
        self.overrides
    }

    /// Returns whether the spindle is programmed off; segments that wait may still have it on.
    #[must_use]
    pub fn is_spindle_off(&self) -> bool {
        self.spindle == Spindle::Off
    }

    /// Returns the direction in which a spindle turns: off for a laser, and at speed 0 but for one on a relay.
    #[must_use]
    pub fn rotation(&self) -> Spindle {
        let turns = self.is_relay || self.rpm > 0.0;
        if self.is_laser || self.is_stopped() || !turns {
            Spindle::Off
        } else {
            self.spindle
        }
    }

    /// Returns whether the spindle has been switched on as it was before the door or its stop.
    #[must_use]
    pub const fn is_resumed(&self) -> bool {
        self.is_resumed
    }

    /// Returns whether the spindle is a laser.
    #[must_use]
    pub const fn is_laser(&self) -> bool {
        self.is_laser
    }

    /// Returns the programmed coolant, with realtime toggles since, and the number of toggles.
    #[must_use]
    pub const fn programmed_coolant(&self) -> (Coolant, u8) {
        (self.coolant, self.toggles)
    }

    /// Returns the number of changes that the next status report shows, wrapping: each command to the
    /// spindle and the coolant, also without effect, and each change of an override.
    #[must_use]
    pub const fn changes(&self) -> u8 {
        self.changes
    }

    /// Counts a change: the next status report shows the overrides, the spindle and the coolant.
    fn count_change(&mut self) {
        self.changes = self.changes.wrapping_add(1);
        self.is_changed = true;
    }

    /// Returns whether the spindle, and the coolant, are to be switched on again after the door was
    /// open.
    #[must_use]
    pub fn has_to_restore(&self) -> (bool, bool) {
        (self.spindle != Spindle::Off, self.coolant != Coolant::OFF)
    }

    /// Sets the state of the spindle and its speed, rpm. A laser whose power is proportional to the
    /// feed rate is off at rest.
    pub fn set_spindle(&mut self, spindle: Spindle, rpm: f32) {
        self.end_wait_for_motion();
        self.is_resumed = false;
        self.next_rpm = None;
        self.spindle = spindle;
        let is_proportional = self.is_laser && spindle == Spindle::CounterClockwise;
        self.rpm = if is_proportional { 0.0 } else { rpm };
        self.count_change();
    }

    /// Sets the speed for the next rest; moves bring their own.
    pub const fn queue_speed(&mut self, rpm: f32) {
        self.next_rpm = Some(rpm);
    }

    /// Changes the speed at rest to the one that the program has come to.
    pub fn apply_speed(&mut self) {
        if let Some(rpm) = self.next_rpm.take() {
            self.rpm = rpm;
            self.count_change();
        }
    }

    /// Ends the wait of a laser for a motion or a new state.
    fn end_wait_for_motion(&mut self) {
        if self.stop == SpindleStop::UntilMotion {
            self.stop = SpindleStop::None;
            self.is_changed = true;
        }
    }

    /// Sets the state of the coolant.
    pub fn set_coolant(&mut self, coolant: Coolant) {
        self.coolant = coolant;
        self.count_change();
    }

    /// Takes an override, which has an effect from [`Self::update_overrides`] on.
    pub fn take_override(&mut self, command: Override) {
        self.asked = self.asked.after(command);
    }

    /// Allows some overrides, and no others.
    pub fn switch_overrides(&mut self, switches: OverrideSwitches) {
        self.switches = switches;
        self.update_overrides();
    }

    /// Applies the overrides; the plan follows those of feed and rapids.
    #[inline]
    pub fn update_overrides(&mut self) {
        let overrides = self.asked.allowed_by(self.switches);
        if overrides != self.overrides {
            self.overrides = overrides;
            self.count_change();
        }
    }

    /// Resets all overrides to 100 % and allows them; the next status report shows them if `is_shown`.
    pub fn reset_overrides(&mut self, is_shown: bool) {
        self.asked = Overrides {
            optional_stop: self.asked.optional_stop,
            ..Overrides::NONE
        };
        self.switches = OverrideSwitches::ALL;
        self.overrides = self.asked;
        self.is_changed = true;
        if is_shown {
            self.count_change();
        }
    }

    /// Switches flood on, or off.
    pub fn toggle_flood(&mut self) {
        self.coolant.flood = !self.coolant.flood;
        self.toggles = self.toggles.wrapping_add(1);
        self.count_change();
    }

    /// Switches mist on, or off.
    pub fn toggle_mist(&mut self) {
        self.coolant.mist = !self.coolant.mist;
        self.toggles = self.toggles.wrapping_add(1);
        self.count_change();
    }

    /// Requests the stop of the spindle in a hold, or ends it. Returns whether the spindle starts.
    pub fn toggle_stop(&mut self) -> bool {
        self.is_changed = true;
        match self.stop {
            SpindleStop::None | SpindleStop::UntilMotion => {
                self.stop = SpindleStop::Requested;
                false
            }
            SpindleStop::Requested => false,
            SpindleStop::Stopped => {
                self.count_change();
                self.is_resumed = true;
                self.stop = if self.is_laser {
                    SpindleStop::UntilMotion
                } else {
                    SpindleStop::None
                };
                true
            }
        }
    }

    /// Requests the stop of a laser, which every hold switches off.
    pub fn begin_hold(&mut self) {
        if self.is_laser && self.stop == SpindleStop::None {
            self.stop = SpindleStop::Requested;
            self.is_changed = true;
        }
    }

    /// Switches a laser off at once, until cycle start ends the hold, or up to the next motion where nothing is held.
    pub fn switch_laser_off(&mut self, is_held: bool) {
        if self.is_laser && self.spindle != Spindle::Off {
            self.stop = if is_held {
                SpindleStop::Stopped
            } else {
                SpindleStop::UntilMotion
            };
            self.count_change();
        }
    }

    /// Stops the spindle at rest in a hold, if the stop is requested.
    pub fn stop_in_hold(&mut self) {
        if self.stop == SpindleStop::Requested {
            self.stop = if self.spindle == Spindle::Off {
                SpindleStop::None
            } else {
                self.count_change();
                SpindleStop::Stopped
            };
        }
    }

    /// Ends the stop of the spindle. Returns whether it was stopped. A laser comes on with a motion
    /// only: now, if the machine `moves`, or with the next one.
    pub fn end_stop(&mut self, moves: bool) -> bool {
        let was_stopped = self.stop == SpindleStop::Stopped;
        let stays_off = self.is_laser && !moves && self.stop != SpindleStop::None;
        self.stop = if stays_off {
            SpindleStop::UntilMotion
        } else {
            SpindleStop::None
        };
        self.is_changed = true;
        self.is_resumed |= was_stopped;
        if was_stopped && !self.is_laser {
            self.count_change();
        }
        was_stopped
    }

    /// Switches everything off, to be restored later.
    pub fn suspend(&mut self) {
        self.stop = SpindleStop::None;
        self.is_spindle_suspended = true;
        self.is_coolant_suspended = true;
        self.count_change();
    }

    /// Ends the suspension of the spindle; a laser stays off up to the next motion.
    pub fn restore_spindle(&mut self) {
        self.is_spindle_suspended = false;
        self.is_changed = true;
        if self.is_laser {
            self.stop = SpindleStop::UntilMotion;
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

    /// Switches everything off, not to be restored.
    pub fn switch_off(&mut self) {
        self.next_rpm = None;
        self.spindle = Spindle::Off;
        self.coolant = Coolant::OFF;
        self.stop = SpindleStop::None;
        self.is_spindle_suspended = false;
        self.is_coolant_suspended = false;
        self.is_changed = true;
    }

    /// Begins a block, whose laser or speed sets the power that stays on at rest.
    pub fn begin_block(&mut self, laser: Laser) {
        self.end_wait_for_motion();
        let rpm = match laser {
            Laser::None => return,
            Laser::Constant(rpm) => rpm,
            Laser::Proportional(_) => 0.0,
        };
        self.is_changed |= rpm != self.rpm;
        self.rpm = rpm;
    }

    /// Returns the power at rest.
    #[inline]
    #[must_use]
    pub fn power_at_rest(&self) -> Power {
        self.power(self.rpm)
    }

    /// Returns the power of a block while it is executed at a `part` of its programmed speed.
    #[must_use]
    pub fn power_in_motion(&self, laser: Laser, part: f32) -> Power {
        match laser {
            Laser::None => self.power(self.rpm),
            Laser::Constant(rpm) => self.power(rpm),
            Laser::Proportional(rpm) => self.power(rpm * part),
        }
    }

    /// Returns the power of a programmed speed, with the override and within the limits.
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
        self.is_spindle_suspended
            || matches!(self.stop, SpindleStop::Stopped | SpindleStop::UntilMotion)
    }

    /// Returns the direction of the spindle at a power; off without power.
    #[must_use]
    pub const fn direction(&self, power: Power) -> Spindle {
        if power.duty == 0 {
            Spindle::Off
        } else {
            self.spindle
        }
    }

    /// Returns the state of the enable and direction outputs at a power: a spindle is on also at
    /// speed 0.
    #[must_use]
    pub fn switched(&self, power: Power) -> Spindle {
        if self.is_stopped() || self.is_laser && power.duty == 0 {
            Spindle::Off
        } else {
            self.spindle
        }
    }

    /// Returns the state of the coolant outputs.
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

/// Duty at the smallest speed: one step of Grbl's PWM.
const MIN_DUTY: u16 = 4;
/// Difference of the duties at the largest and the smallest speed.
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
        accessories.take_override(Override::SpindleMore);
        accessories.update_overrides();
        assert_eq!(accessories.power_at_rest().rpm, 550.0);
        assert_eq!(accessories.power_at_rest().duty / 4, 140);
        accessories.reset_overrides(true);
        assert_eq!(accessories.power_at_rest().rpm, 500.0);
    }

    #[test]
    fn a_program_switches_overrides_off_and_on_again() {
        let mut accessories = spindle(&Settings::default(), 500.0);
        accessories.take_override(Override::SpindleMore);
        accessories.update_overrides();
        accessories.take_override(Override::FeedLess);
        accessories.update_overrides();
        accessories.take_override(Override::RapidHalf);
        accessories.update_overrides();
        accessories.switch_overrides(OverrideSwitches::NONE);
        let only_rapid = Overrides {
            rapid: 50,
            ..Overrides::NONE
        };
        assert_eq!(accessories.overrides(), only_rapid);
        assert_eq!(accessories.power_at_rest().rpm, 500.0);
        // What the operator asks for meanwhile counts as soon as it may.
        accessories.take_override(Override::FeedLess);
        accessories.update_overrides();
        assert_eq!(accessories.overrides(), only_rapid);
        accessories.switch_overrides(OverrideSwitches::ALL);
        let asked = Overrides {
            feed: 80,
            rapid: 50,
            spindle: 110,
            optional_stop: false,
        };
        assert_eq!(accessories.overrides(), asked);
        accessories.switch_overrides(OverrideSwitches::NONE);
        accessories.reset_overrides(true);
        accessories.take_override(Override::FeedMore);
        accessories.update_overrides();
        assert_eq!(accessories.overrides().feed, 110);
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
