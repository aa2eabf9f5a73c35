//! What the step interrupt is given to do.

use crate::{
    axis::{AXES, Axes},
    model::timing::EVENT_SPACING_TICKS,
};

/// Bits of all axes.
const AXIS_BITS: u32 = (1 << AXES) - 1;

/// One interrupt's worth of pin changes, and how long to wait for it after the one before.
///
/// From bit 0: pins to raise, pins to drop, one bit each for every axis. Bit 12: first event of a
/// segment, 13-31: ticks. "Raise" begins a pulse, whatever level the driver calls active. An event
/// that raises and drops X, which none ever has to, sets the direction outputs instead: the bits of
/// the other axes tell how. So whatever an event outputs is found in one table, by one number.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct StepEvent(u32);

impl StepEvent {
    /// No event: each has ticks.
    pub const NONE: Self = Self(0);
    /// Longest wait, ticks (6.2 ms).
    pub const MAX_TICKS: u32 = (1 << 19) - 1;
    /// Different outputs that events can have: see [`StepEvent::pins`].
    pub const PINS: usize = 1 << (2 * AXES);
    /// Raises and drops X.
    const SET_DIRECTIONS: u32 = 1 << AXES | 1;
    const BOUNDARY: u32 = 1 << 12;

    /// An event. Masks have a bit for each axis, bit 0 = X; `ticks` is at most
    /// [`Self::MAX_TICKS`].
    #[inline]
    #[must_use]
    pub const fn new(ticks: u32, raise: u32, drop: u32) -> Self {
        Self(ticks << 13 | (drop & AXIS_BITS) << AXES | raise & AXIS_BITS)
    }

    /// An event that sets the direction outputs, bit 0 = X, 1 = negative.
    #[inline]
    #[must_use]
    pub const fn set_directions(ticks: u32, directions: u8) -> Self {
        let directions = directions as u32;
        let x = (directions & 1) << 1;
        Self(Self::new(ticks, directions & !1, x).0 | Self::SET_DIRECTIONS)
    }

    /// The same event, so many ticks after the one before.
    #[inline]
    #[must_use]
    pub const fn with_ticks(self, ticks: u32) -> Self {
        Self(ticks << 13 | self.0 & (2 * Self::BOUNDARY - 1))
    }

    /// The same event, whose ticks count in a slot, at other ticks in a slot.
    #[inline]
    #[must_use]
    pub(super) const fn with_slot_ticks(self, ticks: u32) -> Self {
        let all = EVENT_SPACING_TICKS - 1;
        Self((ticks & all) << 13 | self.0 & !(all << 13))
    }

    /// What both events do, after as many ticks as both together in bits: one has none.
    #[inline]
    #[must_use]
    pub const fn merged_with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The event in one word.
    #[inline]
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// The event of a word.
    #[inline]
    #[must_use]
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// The same event as the first of a segment.
    #[must_use]
    pub const fn at_boundary(self) -> Self {
        Self(self.0 | Self::BOUNDARY)
    }

    /// Ticks after the event before.
    #[inline]
    #[must_use]
    pub const fn ticks(self) -> u32 {
        self.0 >> 13
    }

    /// Half ticks after the event before, less one: what a timer that counts them begins with. Of
    /// none, the most that an event can have.
    #[inline]
    #[must_use]
    pub const fn half_ticks_less_one(self) -> u32 {
        // The boundary's bit is that of half ticks: 2 ticks and 1, less 2.
        (self.0 | Self::BOUNDARY).wrapping_sub(2 * Self::BOUNDARY) >> 12
    }

    /// What the pins do, as a number below [`Self::PINS`].
    #[inline]
    #[must_use]
    pub const fn pins(self) -> usize {
        self.0 as usize % Self::PINS
    }

    /// Pulses that begin, bit 0 = X.
    #[inline]
    #[must_use]
    pub const fn raise(self) -> u32 {
        if self.sets_directions() {
            0
        } else {
            self.0 & AXIS_BITS
        }
    }

    /// Pulses that end, bit 0 = X.
    #[inline]
    #[must_use]
    pub const fn drop(self) -> u32 {
        if self.sets_directions() {
            0
        } else {
            self.0 >> AXES & AXIS_BITS
        }
    }

    /// How the direction outputs are set, if they are: bit 0 = X, 1 = negative.
    #[inline]
    #[must_use]
    pub const fn directions(self) -> Option<u8> {
        if !self.sets_directions() {
            return None;
        }
        let x = self.0 >> (AXES + 1) & 1;
        Some((self.0 & AXIS_BITS & !1 | x) as u8)
    }

    /// Whether it sets the direction outputs.
    #[inline]
    #[must_use]
    pub const fn sets_directions(self) -> bool {
        self.0 & Self::SET_DIRECTIONS == Self::SET_DIRECTIONS
    }

    /// Whether a new segment begins with it.
    #[inline]
    #[must_use]
    pub const fn is_boundary(self) -> bool {
        self.0 & Self::BOUNDARY != 0
    }
}

/// What holds for a whole segment.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct SegmentInfo {
    /// When it begins, ticks on the generator's clock, wrapping.
    pub start_ticks: u32,
    /// Step count of each axis where it begins.
    pub steps: Axes<i32>,
    /// Number of its first event, or of one before it that begins no pulse.
    pub first_event: u32,
    /// Axes that move in the negative direction, bit 0 = X.
    pub directions: u8,
    /// Whether everything is at rest in it: only then may the event queue run empty.
    pub is_standstill: bool,
    /// Speed along the path at its end, mm/min.
    pub feed_mm_min: f32,
    /// `N` word of its block, 0 without.
    pub line: u32,
    /// Spindle PWM in it, 0 to [`crate::model::Outputs::FULL`].
    pub duty: u16,
    /// Spindle speed or laser power in it, rpm.
    pub spindle_rpm: f32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_timer_of_half_ticks_takes_the_time_of_the_event() {
        for ticks in [1, 2, 168, StepEvent::MAX_TICKS] {
            let event = StepEvent::new(ticks, 5, 2);
            assert_eq!(event.half_ticks_less_one() + 1, 2 * ticks);
            assert_eq!(event.at_boundary().half_ticks_less_one() + 1, 2 * ticks);
        }
        let none = StepEvent::NONE.half_ticks_less_one();
        assert!(none > StepEvent::MAX_TICKS && none < 1 << 24);
    }

    #[test]
    fn pulses_and_directions_share_a_word_and_are_never_taken_for_each_other() {
        for directions in 0..=AXIS_BITS as u8 {
            let event = StepEvent::set_directions(StepEvent::MAX_TICKS, directions).at_boundary();
            assert_eq!(event.directions(), Some(directions));
            assert_eq!((event.raise(), event.drop()), (0, 0));
            assert_eq!(event.ticks(), StepEvent::MAX_TICKS);
            assert!(event.is_boundary());
        }
        for raise in 0..=AXIS_BITS {
            for drop in (0..=AXIS_BITS).filter(|drop| drop & raise == 0) {
                let event = StepEvent::new(7, raise, drop);
                assert_eq!((event.raise(), event.drop()), (raise, drop));
                assert_eq!((event.directions(), event.ticks()), (None, 7));
                assert!(event.pins() < StepEvent::PINS && !event.is_boundary());
            }
        }
    }
}
