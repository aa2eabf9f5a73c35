//! The segments as they are played, with what the machine itself need not know of them.
//!
//! `prepare` runs with a block in execution: its kind and its programmed speed are noted beside the
//! segment that it makes. A segment that begins is kept with its note until it is taken.

use heapless::Deque;

use crate::{
    axis::{AXES, Axes},
    model::{State, queues::SEGMENT_RING, timing::SPARSE_SEGMENT_TICKS},
    motion::Motion,
    path::MoveKind,
    stepper::SegmentRing,
    units::{FineSteps, TICKS_PER_SECOND},
};

/// Segments that have begun and not been taken, at most.
const KEPT: usize = 4;
/// How far the first event of a segment may be from its start, ticks: the longest segment.
const NEAR_TICKS: u64 = SPARSE_SEGMENT_TICKS as u64;

/// What a segment is a part of.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum SegmentKind {
    /// Nothing moves: a dwell, or the standstill after a motion.
    #[default]
    Standstill,
    /// A rapid.
    Rapid,
    /// A move at the programmed feed rate.
    Feed,
    /// A jog.
    Jog,
    /// A move towards a probe, or away from it.
    Probe,
    /// Homing.
    Homing,
    /// Parking while the door is open.
    Parking,
}

/// A segment that has begun.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlayedSegment {
    /// Its start, ticks since power-up.
    pub start_ticks: u64,
    /// Step count of each axis at its start.
    pub steps: Axes<i32>,
    /// Speed along the path at its end, mm/min.
    pub end_mm_min: f32,
    /// Speed of each axis at its start, steps/s.
    pub begin_steps_s: Axes<f32>,
    /// Speed of each axis at its end, steps/s.
    pub end_steps_s: Axes<f32>,
    /// Programmed speed along the path, mm/min; that which the axes allow in a rapid, 0 at standstill and in
    /// cycles of the machine.
    pub programmed_mm_min: f32,
    /// Number of its line: the `N` word, 0 without one.
    pub line: u32,
    /// What it is a part of.
    pub kind: SegmentKind,
    /// Duty of the spindle PWM, 0 to [`crate::model::Outputs::FULL`].
    pub duty: u16,
}

/// Where a segment is to come from: known before it is made.
#[derive(Debug)]
pub(super) struct Origin {
    kind: SegmentKind,
    programmed_mm_min: f32,
    position: Axes<FineSteps>,
}

impl Origin {
    /// Returns the origin of what a run of `prepare` makes in this state.
    pub(super) fn of(motion: &Motion, state: State) -> Self {
        let block = motion.block();
        let kind = match (state, block.map(|block| block.kind)) {
            (State::Home, _) => SegmentKind::Homing,
            (State::DoorRetracting | State::DoorRestoring, _) | (_, None) => SegmentKind::Parking,
            (_, Some(MoveKind::Rapid)) => SegmentKind::Rapid,
            (_, Some(MoveKind::Feed)) => SegmentKind::Feed,
            (_, Some(MoveKind::Fixed)) => SegmentKind::Probe,
            (_, Some(MoveKind::Jog)) => SegmentKind::Jog,
        };
        let is_cycle = matches!(kind, SegmentKind::Homing | SegmentKind::Parking);
        let programmed = block.filter(|_| !is_cycle);
        Self {
            kind,
            programmed_mm_min: programmed.map_or(0.0, |block| block.programmed_mm_s * 60.0),
            position: *motion.position(),
        }
    }
}

/// What is noted of a segment when it is made.
#[derive(Debug, Clone, Copy)]
struct Note {
    kind: SegmentKind,
    programmed_mm_min: f32,
    begin_steps_s: Axes<f32>,
    end_steps_s: Axes<f32>,
}

impl Note {
    const STANDSTILL: Self = Self {
        kind: SegmentKind::Standstill,
        programmed_mm_min: 0.0,
        begin_steps_s: Axes([0.0; AXES]),
        end_steps_s: Axes([0.0; AXES]),
    };

    /// Returns the note of the segment that was made last.
    fn of(origin: &Origin, motion: &Motion) -> Self {
        if *motion.position() == origin.position {
            return Self::STANDSTILL;
        }
        let segment = motion.segment();
        let ticks = segment.ticks as f32;
        // Half a segment before and after its mean speed.
        let speeds_at = |part: f32| {
            Axes::from_fn(|axis| {
                let moved = segment.axes[axis]
                    .to
                    .0
                    .wrapping_sub(origin.position[axis].0);
                let mean = FineSteps(moved).to_f32() / ticks;
                let speed = mean + part * ticks * segment.axes[axis].acceleration;
                speed * TICKS_PER_SECOND as f32
            })
        };
        Self {
            kind: origin.kind,
            programmed_mm_min: origin.programmed_mm_min,
            begin_steps_s: speeds_at(-0.5),
            end_steps_s: speeds_at(0.5),
        }
    }
}

/// The notes of the segments that are played or wait, and the segments that have begun.
#[derive(Debug)]
pub(super) struct Playback {
    notes: [Note; SEGMENT_RING],
    /// Number of the segment that began last.
    begun: u32,
    /// Its start on the generator's clock and since power-up, ticks.
    start: (u32, u64),
    played: Deque<PlayedSegment, KEPT>,
}

impl Playback {
    pub(super) const fn new() -> Self {
        Self {
            notes: [Note::STANDSTILL; SEGMENT_RING],
            begun: u32::MAX,
            start: (0, 0),
            played: Deque::new(),
        }
    }

    /// Takes a note of a segment, by its number in the ring.
    pub(super) fn note(&mut self, number: u32, origin: &Origin, motion: &Motion) {
        self.notes[number as usize % SEGMENT_RING] = Note::of(origin, motion);
    }

    /// Returns whether the segment of a number is one of a rapid.
    pub(super) const fn is_rapid(&self, number: u32) -> bool {
        matches!(
            self.notes[number as usize % SEGMENT_RING].kind,
            SegmentKind::Rapid
        )
    }

    /// Keeps the segment being played, if it has just begun: its first event is set up.
    pub(super) fn begin(&mut self, segments: &SegmentRing, now: u64) {
        let (_, number) = segments.numbers();
        if number == self.begun {
            return;
        }
        self.begun = number;
        let start_ticks = self.start_ticks(segments.played_start_ticks(), now);
        let (steps, end_mm_min, line) = segments.status();
        let note = &self.notes[number as usize % SEGMENT_RING];
        if self.played.is_full() {
            let _ = self.played.pop_front();
        }
        let _ = self.played.push_back(PlayedSegment {
            start_ticks,
            steps,
            end_mm_min,
            begin_steps_s: note.begin_steps_s,
            end_steps_s: note.end_steps_s,
            programmed_mm_min: note.programmed_mm_min,
            line,
            kind: note.kind,
            duty: segments.duty(),
        });
    }

    /// Returns the start of a segment since power-up: the generator's clock counts no time between
    /// motions.
    fn start_ticks(&mut self, start: u32, now: u64) -> u64 {
        let (before, at) = self.start;
        let counted = at + u64::from(start.wrapping_sub(before));
        let is_near = counted.abs_diff(now) <= NEAR_TICKS;
        let ticks = if is_near { counted } else { now };
        self.start = (start, ticks);
        ticks
    }

    pub(super) fn take(&mut self) -> Option<PlayedSegment> {
        self.played.pop_front()
    }
}
