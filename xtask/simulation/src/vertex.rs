//! Points of the path, and what is done between them.

use leadscrew::{
    axis::AXES,
    model::Outputs,
    sim::{PlayedSegment, SegmentKind},
    units::TICKS_PER_US,
};

/// Parts of the full power that are told apart.
pub(crate) const FULL_POWER: u32 = 1000;

/// What holds from a vertex to the next one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Span {
    /// Number of the line, from 1; 0 for what no line does.
    pub(crate) line: u32,
    pub(crate) kind: SegmentKind,
    /// Programmed speed, mm/min or degrees/min.
    pub(crate) programmed: u32,
}

/// A point of the path at a time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Vertex {
    /// Time since power-up, µs.
    pub(crate) us: u64,
    pub(crate) steps: [i32; AXES],
    /// Speed along the path here, mm/min or degrees/min.
    pub(crate) speed: u32,
    /// Power before and from here on, in parts of [`FULL_POWER`].
    pub(crate) power: [u32; 2],
    /// What is done from here on.
    pub(crate) span: Span,
}

impl Vertex {
    /// The beginning of a segment, behind another one that ends with a speed and has a power.
    pub(crate) fn begin(segment: &PlayedSegment, speed_mm_min: f32, power: u32, line: u32) -> Self {
        Self {
            us: segment.start_ticks / u64::from(TICKS_PER_US),
            steps: segment.steps.0,
            speed: speed_mm_min.round() as u32,
            power: [power, power_of(segment)],
            span: Span {
                line,
                kind: segment.kind,
                programmed: segment.programmed_mm_min.round() as u32,
            },
        }
    }
}

/// The power of a segment in parts of [`FULL_POWER`].
pub(crate) fn power_of(segment: &PlayedSegment) -> u32 {
    let full = u32::from(Outputs::FULL);
    (u32::from(segment.duty) * FULL_POWER + full / 2) / full
}

/// The number of a kind in the page.
pub(crate) const fn kind_number(kind: SegmentKind) -> u64 {
    match kind {
        SegmentKind::Standstill => 0,
        SegmentKind::Rapid => 1,
        SegmentKind::Feed => 2,
        SegmentKind::Jog => 3,
        SegmentKind::Probe => 4,
        SegmentKind::Homing => 5,
        SegmentKind::Parking => 6,
    }
}
