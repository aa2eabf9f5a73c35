//! Where the axes were at any instant: from the events that had been output by then.
//!
//! The step interrupt counts nothing. But the ring keeps the events it has played, and each segment
//! the position at which it began; what was output in between are the pulses of these events. The
//! interrupt that has to know takes one number, [`EventTap::output`](super::EventTap::output), and
//! `prepare` counts, before it has overwritten so much.

use super::{EVENT_RING, EventWriter, StepCounts};
use crate::axis::Axes;

/// Step count of each axis when so many events had been output; `None` when that is too long ago.
///
/// The event and its segment must be among the last [`EVENT_RING`] and
/// [`SEGMENT_RING`](super::SEGMENT_RING): one run of `prepare` does not overwrite more.
#[must_use]
pub fn steps_after(
    output: u32,
    counts: &StepCounts,
    events: &EventWriter<'_>,
) -> Option<Axes<i32>> {
    let (mut steps, directions, first) = counts.segment_at(output)?;
    let length = output.wrapping_sub(first);
    if length > EVENT_RING as u32 {
        return None;
    }
    // wcet-bound: 2048
    for number in (0..length).map(|after| first.wrapping_add(after)) {
        let raise = events.event(number).raise();
        // wcet-bound: 6
        for (axis, steps) in steps.iter_mut().enumerate() {
            let pulse = (raise >> axis & 1).cast_signed();
            let is_negative = directions >> axis & 1 != 0;
            *steps = steps.wrapping_add(if is_negative { -pulse } else { pulse });
        }
    }
    Some(steps)
}

/// Pulses that are high after so many events.
pub(super) fn high_after(output: u32, events: &EventWriter<'_>) -> u32 {
    let (mut high, mut known) = (0, 0);
    // The longest pulse, 255 µs, has no more events.
    // wcet-bound: 170
    for back in 1..=170 {
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
        axis::AXES,
        machine::Power,
        stepper::{
            Advance, AxisMotion, EventRing, EventTap, Generator, SEGMENT_TICKS, Segment, Stepper,
        },
        units::FineSteps,
    };

    /// The step interrupt and a count of what it has output.
    struct Player {
        stepper: Stepper,
        /// What is set up, and the directions on the pins.
        next: Option<Advance>,
        directions: u8,
        steps: Axes<i32>,
        high: u32,
    }

    impl Player {
        fn new() -> Self {
            Self {
                stepper: Stepper::new(),
                next: None,
                directions: 0,
                steps: Axes::all(0),
                high: 0,
            }
        }

        /// One interrupt; whether it had anything to do.
        fn play(&mut self, ring: &mut EventRing, counts: &StepCounts) -> bool {
            if !counts.is_running() {
                return false;
            }
            if let Some(next) = self.next.take() {
                assert_eq!((next.raise & self.high, next.drop & !self.high), (0, 0));
                for axis in (0..AXES).filter(|axis| next.raise >> axis & 1 != 0) {
                    self.steps[axis] += 1 - 2 * i32::from(self.directions >> axis & 1);
                }
                self.high = self.high & !next.drop | next.raise;
            }
            let advance = self.stepper.advance(&mut ring.split().1, counts);
            self.directions = advance
                .begun
                .map_or(self.directions, |begun| begun.directions);
            self.next = advance.wait.map(|_| advance);
            true
        }

        fn start(counts: &StepCounts) {
            if !counts.is_running() {
                counts.start();
            }
        }
    }

    fn tap(ring: &mut EventRing) -> EventTap<'_> {
        ring.split().0.tap()
    }

    /// Steps of each axis in a segment, and its length.
    type Move = (Vec<i64>, u32);

    fn segment(generator: &Generator, (way, ticks): &Move) -> Segment {
        let from = generator.position();
        Segment {
            ticks: *ticks,
            axes: Axes::from_fn(|axis| AxisMotion {
                to: FineSteps(from[axis].0 + (way[axis % way.len()] << 32)),
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
        #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

        #[test]
        fn the_position_is_known_at_every_instant_and_later(
            moves in moves(),
            plays in prop::collection::vec(0_usize..400, 1..50),
        ) {
            let mut ring = EventRing::new();
            let counts = StepCounts::new();
            let mut generator = Generator::new();
            let mut player = Player::new();
            let mut moves = moves.iter();
            let mut latches = Vec::new();
            let mut is_ended = false;
            for count in plays.iter().cycle() {
                // A run of `prepare`: latches of the run before are looked at first.
                for (output, steps) in latches.drain(..) {
                    let found = steps_after(output, &counts, &ring.split().0);
                    prop_assert_eq!(found, Some(steps));
                }
                while generator.fill_up(&mut ring, &counts) {
                    let Some(next) = moves.next() else { break };
                    generator.begin(&segment(&generator, next), &counts);
                }
                if moves.len() == 0 && !is_ended && !generator.is_open() && counts.has_room() {
                    generator.rest(Power::OFF, &counts);
                    generator.fill_up(&mut ring, &counts);
                    is_ended = !generator.is_open();
                }
                Player::start(&counts);
                for _ in 0..*count {
                    if !player.play(&mut ring, &counts) {
                        break;
                    }
                    latches.push((tap(&mut ring).output(&counts), player.steps));
                }
                if is_ended && !counts.is_running() {
                    break;
                }
            }
            prop_assert_eq!(player.steps, generator.steps());
        }

        #[test]
        fn a_cut_stops_at_the_next_event_and_its_position_is_what_was_output(
            moves in moves(),
            at in 1_usize..3000,
            late in any::<bool>(),
        ) {
            let mut ring = EventRing::new();
            let counts = StepCounts::new();
            let mut generator = Generator::new();
            let mut player = Player::new();
            let mut moves = moves.iter();
            let mut played = 0;
            while played < at {
                while generator.fill_up(&mut ring, &counts) {
                    let Some(next) = moves.next() else { break };
                    generator.begin(&segment(&generator, next), &counts);
                }
                Player::start(&counts);
                let before = played;
                while played < at && played < before + 100 && player.play(&mut ring, &counts) {
                    played += 1;
                }
                if played == before {
                    break;
                }
            }
            let is_running = counts.is_running();
            tap(&mut ring).cut(&counts);
            if late {
                // `prepare` was interrupted, and puts more.
                generator.fill_up(&mut ring, &counts);
            }
            prop_assert_eq!(player.play(&mut ring, &counts), is_running);
            prop_assert!(!player.play(&mut ring, &counts));
            prop_assert!(!counts.is_running());
            generator.cut_off(&counts, &mut ring.split().0);
            prop_assert!(!counts.is_cut() && !counts.take_starved());
            prop_assert_eq!(generator.steps(), player.steps);
            // A standstill ends the pulses; then it goes on from there.
            generator.rest(Power::OFF, &counts);
            generator.fill_up(&mut ring, &counts);
            counts.start();
            while player.play(&mut ring, &counts) {}
            prop_assert_eq!(player.high, 0);
            prop_assert_eq!(counts.position(), player.steps);
            let on = (vec![7, -5, 3], 20_000);
            generator.begin(&segment(&generator, &on), &counts);
            generator.fill_up(&mut ring, &counts);
            generator.rest(Power::OFF, &counts);
            generator.fill_up(&mut ring, &counts);
            counts.start();
            while player.play(&mut ring, &counts) {}
            prop_assert_eq!(player.steps, generator.steps());
            prop_assert_eq!(counts.position(), player.steps);
        }
    }

    impl Generator {
        /// Fills the ring; whether a segment can begin.
        fn fill_up(&mut self, ring: &mut EventRing, counts: &StepCounts) -> bool {
            (!self.is_open() || self.fill(&mut ring.split().0)) && counts.has_room()
        }
    }
}
