//! Durations of segments and sections, and the numbers that stand for no limit and for nothing.

use crate::{
    model::timing::{MAX_SEGMENT_TICKS, SEGMENT_TICKS, SPARSE_SEGMENT_TICKS},
    units::TICKS_PER_SECOND,
};

/// Timer ticks per second in floating point.
pub(super) const TICKS_PER_S: f32 = TICKS_PER_SECOND as f32;
/// A segment of a long section, s.
pub(super) const NOMINAL_SEGMENT_S: f32 = SEGMENT_TICKS as f32 / TICKS_PER_S;
/// Longest segment, s.
pub(super) const LONGEST_SEGMENT_S: f32 = MAX_SEGMENT_TICKS as f32 / TICKS_PER_S;
/// Shortest segment of a section that has several, s.
pub(super) const SHORTEST_SEGMENT_S: f32 = 0.5 * LONGEST_SEGMENT_S;
/// The first segment from a standstill, s: it makes up for the segment of standstill before it. 3 %
/// less than the longest, because a segment of an arc lasts a little longer than planned
/// (tests/motion/segments.rs).
pub(super) const FIRST_SEGMENT_S: f32 = 0.97 * LONGEST_SEGMENT_S;
/// Shortest monotonic section of an arc, s: what is shorter joins the section beside it.
pub(super) const MIN_SECTION_S: f32 = 1.0e-4;
/// The same with the jerk-limited profile, s.
pub(super) const JERK_LIMITED_MIN_SECTION_S: f32 = 4.0e-4;

/// Share by which a speed, or its measure, may exceed the plan by rounding: single precision keeps
/// seven digits.
pub(super) const SPEED_TOLERANCE: f32 = 1.0001;
/// Stands for no limit of a speed, mm/s: its square is far below the greatest `f32`.
pub(super) const NO_SPEED_LIMIT_MM_S: f32 = 1.0e8;
/// Stands for no limit of an acceleration, mm/s².
pub(super) const NO_ACCELERATION_LIMIT_MM_S2: f32 = 1.0e12;
/// Stands for a speed of 0 in a divisor, mm/s: far below the slowest.
pub(super) const MIN_DIVISOR_MM_S: f32 = 1.0e-20;

/// The longest segment where few steps fall, s.
const SPARSE_SEGMENT_S: f32 = SPARSE_SEGMENT_TICKS as f32 / TICKS_PER_S;
/// The share of the greatest step rate at which few steps fall.
pub(super) const SPARSE_SHARE: f32 = MAX_SEGMENT_TICKS as f32 / SPARSE_SEGMENT_TICKS as f32;
/// Shortest ramp from standstill to the speed of a block on which segments are longer, s.
pub(super) const LEAST_SPARSE_RAMP_S: f32 = 4.0 * SPARSE_SEGMENT_S;

/// The share of a duration that the next segment takes: the remainder is long enough for another.
pub(super) fn segment_share_s(seconds: f32) -> f32 {
    SegmentTimes::REGULAR.share_s(seconds)
}

/// Durations of the segments of a section.
#[derive(Debug, Clone, Copy)]
pub(super) struct SegmentTimes {
    /// A segment of a long section, s.
    pub(super) nominal_s: f32,
    /// The longest segment, s.
    pub(super) longest_s: f32,
}

impl SegmentTimes {
    /// Of most sections.
    pub(super) const REGULAR: Self = Self {
        nominal_s: NOMINAL_SEGMENT_S,
        longest_s: LONGEST_SEGMENT_S,
    };
    /// Where few steps fall.
    pub(super) const SPARSE: Self = Self {
        nominal_s: SPARSE_SEGMENT_S,
        longest_s: SPARSE_SEGMENT_S,
    };

    /// Returns the share of a duration that the next segment takes: the remainder is long enough for another.
    #[inline]
    pub(super) fn share_s(self, seconds: f32) -> f32 {
        if seconds < self.nominal_s + self.longest_s {
            0.5 * seconds
        } else {
            self.nominal_s
        }
    }
}
