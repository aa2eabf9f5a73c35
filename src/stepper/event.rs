//! The event: what one step interrupt does.

use crate::{axis::AXES, model::timing::SLOT_TICKS};

/// Bits of all axes.
const AXIS_BITS: u32 = (1 << AXES) - 1;

/// The pin changes of one interrupt, and the time since the interrupt before.
///
/// From bit 0: pins to raise, pins to drop, one bit each for every axis. Bit 12: first event of a
/// segment, 13-31: ticks. "Raise" begins a pulse, whatever level the driver calls active. An event
/// that raises and drops X, which no pulse does, sets the direction outputs instead: the bits of the
/// other axes are their levels. So one table has the outputs of every event, by one number.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct StepEvent(u32);

impl StepEvent {
    /// No event: every event has ticks.
    pub const NONE: Self = Self(0);
    /// Longest wait, ticks (6.2 ms).
    pub const MAX_TICKS: u32 = (1 << 19) - 1;
    /// Number of different things that the step and direction pins do at an event: see [`StepEvent::output_index`].
    pub const OUTPUTS: usize = 1 << (2 * AXES);
    /// Raises and drops X.
    const SET_DIRECTIONS: u32 = 1 << AXES | 1;
    const BOUNDARY: u32 = 1 << 12;

    /// Returns an event. Masks have a bit for each axis, bit 0 = X; `ticks` is at most
    /// [`Self::MAX_TICKS`].
    #[must_use]
    pub const fn new(ticks: u32, raise: u32, drop: u32) -> Self {
        Self(ticks << 13 | (drop & AXIS_BITS) << AXES | raise & AXIS_BITS)
    }

    /// Returns an event that sets the direction outputs, bit 0 = X, 1 = negative.
    #[must_use]
    pub const fn set_directions(ticks: u32, directions: u8) -> Self {
        let directions = directions as u32;
        let x = (directions & 1) << 1;
        Self(Self::new(ticks, directions & !1, x).0 | Self::SET_DIRECTIONS)
    }

    /// Returns the same event, `ticks` after the one before.
    #[must_use]
    pub const fn with_ticks(self, ticks: u32) -> Self {
        Self(ticks << 13 | self.0 & (2 * Self::BOUNDARY - 1))
    }

    /// Returns the same event at other ticks from the start of a slot.
    #[must_use]
    pub(super) const fn with_slot_ticks(self, ticks: u32) -> Self {
        let all = SLOT_TICKS - 1;
        Self((ticks & all) << 13 | self.0 & !(all << 13))
    }

    /// Returns an event with the pin changes of both; one of the two has no ticks.
    #[must_use]
    pub const fn merged_with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Returns the event as a word.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Returns the event of a word.
    #[must_use]
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// Returns the same event as the first of a segment.
    #[must_use]
    pub const fn at_boundary(self) -> Self {
        Self(self.0 | Self::BOUNDARY)
    }

    /// Returns the ticks since the event before.
    #[must_use]
    pub const fn ticks(self) -> u32 {
        self.0 >> 13
    }

    /// Returns the half ticks since the event before, less one: where a timer that counts half ticks
    /// begins. Of [`Self::NONE`], the most that an event can have.
    #[must_use]
    pub const fn half_ticks_less_one(self) -> u32 {
        // The boundary's bit is that of half ticks: 2 ticks and 1, less 2.
        (self.0 | Self::BOUNDARY).wrapping_sub(2 * Self::BOUNDARY) >> 12
    }

    /// Returns the number of what the step and direction pins do, below [`Self::OUTPUTS`].
    #[must_use]
    pub const fn output_index(self) -> usize {
        self.0 as usize % Self::OUTPUTS
    }

    /// Returns the axes whose pulses begin, bit 0 = X.
    #[must_use]
    pub const fn raise(self) -> u32 {
        if self.sets_directions() {
            0
        } else {
            self.0 & AXIS_BITS
        }
    }

    /// Returns the axes whose pulses end, bit 0 = X.
    #[must_use]
    pub const fn drop(self) -> u32 {
        if self.sets_directions() {
            0
        } else {
            self.0 >> AXES & AXIS_BITS
        }
    }

    /// Returns the levels of the direction outputs, if the event sets them: bit 0 = X, 1 = negative.
    #[must_use]
    pub const fn directions(self) -> Option<u8> {
        if !self.sets_directions() {
            return None;
        }
        let x = self.0 >> (AXES + 1) & 1;
        Some((self.0 & AXIS_BITS & !1 | x) as u8)
    }

    /// Returns whether the event sets the direction outputs.
    #[must_use]
    pub const fn sets_directions(self) -> bool {
        self.0 & Self::SET_DIRECTIONS == Self::SET_DIRECTIONS
    }

    /// Returns whether the event is the first of a segment.
    #[must_use]
    pub const fn is_boundary(self) -> bool {
        self.0 & Self::BOUNDARY != 0
    }
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
                assert!(event.output_index() < StepEvent::OUTPUTS && !event.is_boundary());
            }
        }
    }
}
