//! The outputs beside those of the axes.

use super::{Coolant, Spindle};

/// The outputs as `prepare` sets them; its platform switches those that have changed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Outputs {
    /// Spindle enable and direction; in laser mode off whenever the beam is.
    pub spindle: Spindle,
    /// Spindle PWM at rest, 0 to [`Self::FULL`]; in motion it goes with the segments.
    pub duty: u16,
    /// Flood and mist.
    pub coolant: Coolant,
    /// Whether the stepper drivers are switched on.
    pub drivers: bool,
}

impl Outputs {
    /// Duty of a PWM that is always high: 255 steps of Grbl, each divided by four.
    pub const FULL: u16 = 1020;
    /// Periods of the PWM in a second with the prescaler of the board's file, about.
    pub const USUAL_PWM_HZ: f32 = 5147.0;

    /// Returns the prescaler with which the PWM has about so many periods in a second; `usual` is that of
    /// [`Self::USUAL_PWM_HZ`].
    #[must_use]
    pub fn prescaler(usual: u32, pwm_hz: f32) -> u32 {
        let prescaler = usual as f32 * Self::USUAL_PWM_HZ / pwm_hz + 0.5;
        (prescaler as u32).clamp(1, 0x1_0000)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pwm_has_about_the_frequency_of_the_setting() {
        // Timers at 84 and at 168 MHz.
        for (usual, timer_hz) in [(16, 84.0e6), (32, 168.0e6)] {
            assert_eq!(Outputs::prescaler(usual, Outputs::USUAL_PWM_HZ), usual);
            for pwm_hz in [100.0, 1000.0, 5000.0, 10_000.0, 20_000.0] {
                let prescaler = Outputs::prescaler(usual, pwm_hz);
                let found = timer_hz / (prescaler * u32::from(Outputs::FULL)) as f32;
                assert!((found / pwm_hz - 1.0).abs() < 0.04, "{pwm_hz}: {found}");
            }
        }
        assert_eq!(Outputs::prescaler(16, 1.0), 0x1_0000);
        assert_eq!(Outputs::prescaler(16, f32::INFINITY), 1);
    }
}
