//! A segment of motion: the data from `prepare` for the step times, and the data kept for later.

use crate::{
    axis::{AXES, Axes},
    model::Power,
    units::FineSteps,
};

/// The motion of one axis over a segment.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct AxisMotion {
    /// Exact position at the end.
    pub to: FineSteps,
    /// Acceleration, steps per tick².
    pub acceleration: f32,
}

/// A motion with constant acceleration of every axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Duration, at least 1 tick.
    pub ticks: u32,
    /// Motion of each axis.
    pub axes: Axes<AxisMotion>,
    /// Speed along the path at the end, mm/min.
    pub feed_mm_min: f32,
    /// `N` word of the block, 0 without.
    pub line: u32,
    /// Power of the spindle or laser.
    pub power: Power,
}

impl Segment {
    /// A standstill at zero.
    pub const NONE: Self = Self {
        ticks: 1,
        axes: Axes(
            [AxisMotion {
                to: FineSteps(0),
                acceleration: 0.0,
            }; AXES],
        ),
        feed_mm_min: 0.0,
        line: 0,
        power: Power::OFF,
    };
}

impl Segment {
    /// Returns a standstill, without power.
    #[must_use]
    pub fn standstill(ticks: u32, position: &Axes<FineSteps>) -> Self {
        Self {
            ticks,
            axes: position.map(|to| AxisMotion {
                to,
                acceleration: 0.0,
            }),
            ..Self::NONE
        }
    }
}

/// What holds for a whole segment while it is played.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SegmentInfo {
    /// Start, ticks on the generator's clock, wrapping.
    pub start_ticks: u32,
    /// Step count of each axis at the start.
    pub steps: Axes<i32>,
    /// Number of the segment's first event, or of one before that begins no pulse.
    pub first_event: u32,
    /// Axes that move in the negative direction, bit 0 = X.
    pub directions: u8,
    /// Nothing moves: only then may the event ring run empty.
    pub is_standstill: bool,
    /// Speed along the path at the end, mm/min.
    pub feed_mm_min: f32,
    /// `N` word of the block, 0 without.
    pub line: u32,
    /// Spindle PWM, 0 to [`crate::model::Outputs::FULL`].
    pub duty: u16,
    /// Spindle speed or laser power, rpm.
    pub spindle_rpm: f32,
}
