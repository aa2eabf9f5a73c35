//! What the step interrupt is given to do.

use crate::axis::Axes;

/// One interrupt's worth of pin changes, and how long to wait for it after the one before.
///
/// Bits 0-5: pins to raise, 6-11: pins to drop, 12: first event of a segment, 13-31: ticks. "Raise"
/// begins a pulse, whatever level the driver calls active.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct StepEvent(u32);

impl StepEvent {
    /// Longest wait, ticks (6.2 ms).
    pub const MAX_TICKS: u32 = (1 << 19) - 1;

    /// An event. Masks have six bits, bit 0 = X; `ticks` is at most [`Self::MAX_TICKS`].
    #[inline]
    #[must_use]
    pub const fn new(ticks: u32, raise: u32, drop: u32) -> Self {
        Self(ticks << 13 | (drop & 0x3f) << 6 | raise & 0x3f)
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
        Self(self.0 | 1 << 12)
    }

    /// Ticks after the event before.
    #[inline]
    #[must_use]
    pub const fn ticks(self) -> u32 {
        self.0 >> 13
    }

    /// Pulses that begin, bit 0 = X.
    #[inline]
    #[must_use]
    pub const fn raise(self) -> u32 {
        self.0 & 0x3f
    }

    /// Pulses that end, bit 0 = X.
    #[inline]
    #[must_use]
    pub const fn drop(self) -> u32 {
        self.0 >> 6 & 0x3f
    }

    /// Whether a new segment begins with it.
    #[inline]
    #[must_use]
    pub const fn is_boundary(self) -> bool {
        self.0 & 1 << 12 != 0
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
    pub is_rest: bool,
    /// Speed along the path at its end, mm/min.
    pub feed_mm_min: f32,
    /// `N` word of its block, 0 without.
    pub line: u32,
    /// Spindle PWM in it, 0 to [`crate::machine::Outputs::FULL`].
    pub duty: u16,
    /// Spindle speed or laser power in it, rpm.
    pub spindle_rpm: f32,
}
