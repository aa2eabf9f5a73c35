//! Position lookup: where the axes were at any instant, from the events that had been output by then.
//!
//! The step interrupt counts no steps. But the ring keeps the events played last, and each segment has
//! the position at its start; between the two are the pulses of these events. An interrupt that needs the position
//! reads a single number, [`EventTap::output_count`](super::EventTap::output_count), and `prepare` counts the pulses before it
//! overwrites the events.
//!
//! # Cost
//! The pulses of three axes are counted in one word, and events in groups of four. The loop over groups is
//! kept from being unrolled, as its bound is that of single groups.

use core::hint::black_box;

use super::{EventWriter, SegmentRing};
use crate::{
    axis::{AXES, Axes},
    model::{
        HAS_ARC_MACHINE,
        queues::EVENT_RING,
        timing::{MAX_SEGMENT_EVENTS, pulse_slots},
    },
    units::TICKS_PER_US,
};

/// Axes in a word of [`PulseCounts`], and bits of each count.
const AXES_IN_WORD: usize = 3;
const COUNT_BITS: usize = 10;
// A pulse begins with an event of its own, and an end of the segment may be moved by a slot.
const _: () = assert!(MAX_SEGMENT_EVENTS + 2 < 1 << COUNT_BITS);

/// Events that are counted at a time.
const EVENTS_IN_GROUP: u32 = 4;

/// Pulses of each axis.
#[derive(Debug, Clone, Copy)]
struct PulseCounts([u32; AXES.div_ceil(AXES_IN_WORD)]);

impl PulseCounts {
    const NONE: Self = Self([0; AXES.div_ceil(AXES_IN_WORD)]);

    /// Counts a pulse of each axis in `mask`.
    fn add(&mut self, mask: u32) {
        /// Moves bits 1 and 2 to those of the second and the third axis, among others.
        const SPREAD: u32 = 1 << (2 * (COUNT_BITS - 1)) | 1 << (COUNT_BITS - 1) | 1;
        /// One pulse of each.
        const ONE_EACH: u32 = 1 << (2 * COUNT_BITS) | 1 << COUNT_BITS | 1;
        for (word, pulses) in self.0.iter_mut().enumerate() {
            *pulses += ((mask >> (AXES_IN_WORD * word)) * SPREAD) & ONE_EACH;
        }
    }

    /// Returns the pulses of an axis.
    fn of(self, axis: usize) -> i32 {
        let word = self.0.get(axis / AXES_IN_WORD).copied().unwrap_or(0);
        let pulses = word >> (axis % AXES_IN_WORD * COUNT_BITS) & ((1 << COUNT_BITS) - 1);
        pulses.cast_signed()
    }
}

/// Returns the step count of each axis when `output` events had been output; `None` when that is too
/// long ago.
///
/// The event and its segment must be among the last [`EVENT_RING`] and
/// [`SEGMENT_RING`](crate::model::queues::SEGMENT_RING): one run of `prepare` does not overwrite more.
#[inline(never)]
#[must_use]
pub fn steps_after(
    output: u32,
    segments: &SegmentRing,
    events: &EventWriter<'_>,
) -> Option<Axes<i32>> {
    let (mut steps, directions, first) = segments.segment_at(output)?;
    let length = output.wrapping_sub(first);
    // A segment has fewer events.
    if length > EVENT_RING as u32 {
        return None;
    }
    if HAS_ARC_MACHINE {
        return Some(steps_by_direction(steps, directions, first, length, events));
    }
    let mut pulses = PulseCounts::NONE;
    let mut number = first;
    let last_group_end = first.wrapping_add(length - length % EVENTS_IN_GROUP);
    // wcet-bound: segment_event_groups: these are the events of one segment
    while number != last_group_end {
        for place in 0..EVENTS_IN_GROUP {
            pulses.add(events.event(number.wrapping_add(place)).raise());
        }
        number = black_box(number.wrapping_add(EVENTS_IN_GROUP));
    }
    for _ in 1..EVENTS_IN_GROUP {
        if number == output {
            break;
        }
        pulses.add(events.event(number).raise());
        number = black_box(number.wrapping_add(1));
    }
    for (axis, steps) in steps.iter_mut().enumerate() {
        let pulses = pulses.of(axis);
        let is_negative = directions >> axis & 1 != 0;
        *steps = steps.wrapping_add(if is_negative { -pulses } else { pulses });
    }
    Some(steps)
}

/// Returns the same where an axis may reverse within a segment, on an arc in whole steps.
fn steps_by_direction(
    mut steps: Axes<i32>,
    directions: u8,
    first: u32,
    length: u32,
    events: &EventWriter<'_>,
) -> Axes<i32> {
    let [mut all, mut negative] = [PulseCounts::NONE; 2];
    let mut directions = u32::from(directions);
    let mut count = |number: u32| {
        let event = events.event(number);
        directions = event.directions().map_or(directions, u32::from);
        all.add(event.raise());
        negative.add(event.raise() & directions);
    };
    let mut number = first;
    let last_group_end = first.wrapping_add(length - length % EVENTS_IN_GROUP);
    // wcet-bound: segment_event_groups: these are the events of one segment
    while number != last_group_end {
        for place in 0..EVENTS_IN_GROUP {
            count(number.wrapping_add(place));
        }
        number = black_box(number.wrapping_add(EVENTS_IN_GROUP));
    }
    for _ in 1..EVENTS_IN_GROUP {
        if number == first.wrapping_add(length) {
            break;
        }
        count(number);
        number = black_box(number.wrapping_add(1));
    }
    for (axis, steps) in steps.iter_mut().enumerate() {
        *steps = steps.wrapping_add(all.of(axis) - 2 * negative.of(axis));
    }
    steps
}

/// Bounds the events from the beginning of a pulse to its end: as many slots, each with one event, and
/// a slot that either of them may be delayed by.
const LONGEST_PULSE_EVENTS: u32 = 256;
const _: () = assert!(pulse_slots(255 * TICKS_PER_US) + 2 <= LONGEST_PULSE_EVENTS);

/// Returns the axes whose pulses are high after `output` events.
pub(super) fn pulses_high_after(output: u32, events: &EventWriter<'_>) -> u32 {
    let (mut high, mut known) = (0, 0);
    for back in 1..=LONGEST_PULSE_EVENTS {
        let event = events.event(output.wrapping_sub(back));
        high |= event.raise() & !known;
        known |= event.raise() | event.drop();
    }
    high
}

#[cfg(test)]
mod tests {
    use std::{vec, vec::Vec};

    use proptest::prelude::*;

    use super::*;
    use crate::{
        model::{Power, timing::SEGMENT_TICKS},
        stepper::{AxisMotion, EventRing, EventTap, Generator, Segment, StepEvent, Upcoming},
        units::FineSteps,
    };

    /// The step timer, its interrupt, and a count of its output.
    struct Player {
        /// The event that is set up.
        next: Option<StepEvent>,
        /// Ticks that the timer counts now.
        counted: u32,
        /// Ticks that it counts from its next interrupt on.
        reload: u32,
        /// The directions on the pins.
        directions: u8,
        steps: Axes<i32>,
        high: u32,
    }

    impl Player {
        fn new() -> Self {
            Self {
                next: None,
                counted: 0,
                reload: 0,
                directions: 0,
                steps: Axes::all(0),
                high: 0,
            }
        }

        /// Runs one interrupt. Returns false when the step timer is stopped.
        fn play(&mut self, ring: &mut EventRing, segments: &SegmentRing) -> bool {
            if !segments.is_running() {
                return false;
            }
            if let Some(next) = self.next.take() {
                assert_eq!(self.counted, next.ticks());
                let (raise, drop) = (next.raise(), next.drop());
                assert_eq!((raise & self.high, drop & !self.high), (0, 0));
                for axis in (0..AXES).filter(|axis| raise >> axis & 1 != 0) {
                    self.steps[axis] += 1 - 2 * i32::from(self.directions >> axis & 1);
                }
                self.high = self.high & !drop | raise;
                self.directions = next.directions().unwrap_or(self.directions);
            }
            self.counted = self.reload;
            let (_, mut events) = ring.split();
            match events.advance() {
                Some(upcoming) => self.set_up(upcoming),
                None => segments.stop(),
            }
            while segments.start_segment(tap(ring)).has_more {}
            true
        }

        fn set_up(&mut self, upcoming: Upcoming) {
            self.next = Some(upcoming.event);
            self.reload = upcoming.following.ticks();
        }

        /// Halts the step timer.
        fn halt(&mut self, ring: &mut EventRing, segments: &SegmentRing) {
            self.next = None;
            tap(ring).halt(segments);
        }

        /// The end of a run of `prepare`.
        fn follow(&mut self, ring: &mut EventRing, segments: &SegmentRing) {
            let (mut events, _) = ring.split();
            if let Some(missed) = events.appended_late(segments) {
                self.reload = missed.ticks();
                events.append(missed);
            }
            if !segments.is_running() {
                if let Some(upcoming) = events.set_up() {
                    segments.start();
                    self.counted = upcoming.event.ticks();
                    self.set_up(upcoming);
                }
                while segments.start_segment(tap(ring)).has_more {}
            }
        }
    }

    fn tap(ring: &mut EventRing) -> EventTap<'_> {
        ring.split().0.tap()
    }

    /// Steps of each axis in a segment, and its length.
    type Move = (Vec<i64>, u32);

    fn segment(generator: &Generator, (steps, ticks): &Move) -> Segment {
        let from = *generator.position();
        Segment {
            ticks: *ticks,
            axes: Axes::from_fn(|axis| AxisMotion {
                to: FineSteps(from[axis].0 + (steps[axis % steps.len()] << 32)),
                acceleration: 0.0,
            }),
            feed_mm_min: 0.0,
            line: 0,
            power: Power::OFF,
        }
    }

    fn moves() -> impl Strategy<Value = Vec<Move>> {
        let one_move = (
            prop::collection::vec(-60_i64..60, 3),
            prop_oneof![2000..SEGMENT_TICKS, 1000_u32..3000],
        );
        prop::collection::vec(one_move, 1..200)
    }

    proptest! {
        #![proptest_config(crate::cases(10))]

        #[test]
        fn the_position_is_known_at_every_instant_and_later(
            moves in moves(),
            plays in prop::collection::vec(0_usize..400, 1..50),
        ) {
            let mut ring = EventRing::new();
            let segments = SegmentRing::new();
            let mut generator = Generator::new();
            let mut player = Player::new();
            let mut moves = moves.iter();
            let mut latches = Vec::new();
            let mut is_ended = false;
            for count in plays.iter().cycle() {
                // A run of `prepare`: latches of the run before are looked at first.
                for (output, steps) in latches.drain(..) {
                    let found = steps_after(output, &segments, &ring.split().0);
                    prop_assert_eq!(found, Some(steps));
                }
                while generator.fill_up(&mut ring, &segments) {
                    let Some(next) = moves.next() else { break };
                    generator.begin(&segment(&generator, next), &segments);
                }
                if moves.len() == 0 && !is_ended && !generator.is_open() && segments.has_room() {
                    generator.begin_standstill(Power::OFF, &segments);
                    generator.fill_up(&mut ring, &segments);
                    is_ended = !generator.is_open();
                }
                player.follow(&mut ring, &segments);
                for _ in 0..*count {
                    if !player.play(&mut ring, &segments) {
                        break;
                    }
                    latches.push((tap(&mut ring).output_count(), player.steps));
                }
                if is_ended && !segments.is_running() {
                    break;
                }
            }
            prop_assert_eq!(player.steps, generator.steps());
        }

        #[test]
        fn events_that_come_at_the_last_moment_come_at_their_times(
            steps in prop::collection::vec((0_usize..4, 0_usize..4), 1..400),
        ) {
            let mut ring = EventRing::new();
            let segments = SegmentRing::new();
            let mut player = Player::new();
            let mut put = 0;
            for (puts, plays) in steps {
                for _ in 0..puts {
                    let (mut writer, _) = ring.split();
                    let mut events = writer.begin();
                    // A pulse of X and its end.
                    let (raise, drop) = (put & 1 ^ 1, put & 1);
                    events.push(StepEvent::new(1 + put * 7 % 100, raise, drop));
                    events.publish();
                    put += 1;
                }
                player.follow(&mut ring, &segments);
                for _ in 0..plays {
                    if player.play(&mut ring, &segments) && !segments.is_running() {
                        // All that was there when the last one was set up, or appended since.
                        prop_assert_eq!(tap(&mut ring).output_count(), put);
                    }
                }
            }
            while player.play(&mut ring, &segments) {}
            prop_assert_eq!(tap(&mut ring).output_count(), put);
            prop_assert_eq!(player.steps[0].cast_unsigned(), put.div_ceil(2));
        }

        #[test]
        fn a_halt_stops_at_once_and_its_position_is_what_was_output(
            moves in moves(),
            at in 1_usize..3000,
            late in any::<bool>(),
        ) {
            let mut ring = EventRing::new();
            let segments = SegmentRing::new();
            let mut generator = Generator::new();
            let mut player = Player::new();
            let mut moves = moves.iter();
            let mut played = 0;
            while played < at {
                while generator.fill_up(&mut ring, &segments) {
                    let Some(next) = moves.next() else { break };
                    generator.begin(&segment(&generator, next), &segments);
                }
                player.follow(&mut ring, &segments);
                let before = played;
                while played < at && played < before + 100 && player.play(&mut ring, &segments) {
                    played += 1;
                }
                if played == before {
                    break;
                }
            }
            player.halt(&mut ring, &segments);
            if late {
                // `prepare` was interrupted, and puts more.
                generator.fill_up(&mut ring, &segments);
            }
            prop_assert!(!player.play(&mut ring, &segments));
            prop_assert!(!segments.is_running());
            generator.discard_unplayed(&segments, &mut ring.split().0);
            prop_assert!(!segments.is_halted() && !segments.has_underrun());
            prop_assert_eq!(generator.steps(), player.steps);
            // A standstill ends the pulses; then it goes on from there.
            generator.begin_standstill(Power::OFF, &segments);
            generator.fill_up(&mut ring, &segments);
            player.follow(&mut ring, &segments);
            while player.play(&mut ring, &segments) {}
            prop_assert_eq!(player.high, 0);
            prop_assert_eq!(segments.position(), player.steps);
            let on = (vec![7, -5, 3], 20_000);
            generator.begin(&segment(&generator, &on), &segments);
            generator.fill_up(&mut ring, &segments);
            generator.begin_standstill(Power::OFF, &segments);
            generator.fill_up(&mut ring, &segments);
            player.follow(&mut ring, &segments);
            while player.play(&mut ring, &segments) {}
            prop_assert_eq!(player.steps, generator.steps());
            prop_assert_eq!(segments.position(), player.steps);
        }
    }

    #[test]
    fn steps_that_never_got_events_are_taken_back_after_a_fault() {
        let mut ring = EventRing::new();
        let segments = SegmentRing::new();
        let mut generator = Generator::new();
        let mut player = Player::new();
        let dense = (vec![120, -119, 118], 80_000);
        while generator.fill_up(&mut ring, &segments) {
            generator.begin(&segment(&generator, &dense), &segments);
        }
        assert!(generator.is_open(), "the events have no room");
        player.follow(&mut ring, &segments);
        while player.play(&mut ring, &segments) {}
        assert_ne!(generator.steps(), player.steps);
        generator.discard_open_segment();
        assert_eq!(generator.steps(), player.steps);
    }

    impl Generator {
        /// Fills the ring. Returns whether a segment can begin.
        fn fill_up(&mut self, ring: &mut EventRing, segments: &SegmentRing) -> bool {
            (!self.is_open() || self.push_events(&mut ring.split().0)) && segments.has_room()
        }
    }
}
