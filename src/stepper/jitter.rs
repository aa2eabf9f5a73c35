//! The step jitter: how far steps are from the times at which they are due.

use crate::model::timing::EVENT_SPACING_TICKS;

/// Bounds how far a step comes before or after its time, ticks, besides roundings; tested below.
///
/// A step moves within its slot where it precedes a step of the dominant axis, shares an event or
/// waits for the event before: a spacing at most. Near the end of a segment a step first moves away from the next
/// segment; and where a step at the end of a segment has the slot, the other comes in the next slot: either takes
/// another spacing. A step behind a change of direction comes when the change allows.
pub const STEP_JITTER_TICKS: u32 = 2 * EVENT_SPACING_TICKS;

#[cfg(test)]
mod tests {
    use std::{array::from_fn, vec::Vec};

    use proptest::prelude::*;

    use super::*;
    use crate::{
        axis::{AXES, Axes},
        model::timing::{EVENT_SPACING_TICKS, min_period_ticks},
        stepper::{AxisMotion, EventRing, Generator, Segment, SegmentRing},
        units::{FineSteps, TICKS_PER_US},
    };

    /// One step in binary places of a position.
    const STEP: f64 = 4_294_967_296.0;
    /// Roundings of a step's time, ticks.
    const ROUNDING: f64 = 3.0;

    /// The exact motion of an axis.
    #[derive(Clone, Copy)]
    struct Exact {
        position: f64,
        /// Steps per tick.
        speed: f64,
    }

    /// Returns when an axis with a constant acceleration has moved a distance, ticks.
    fn when(distance: f64, speed: f64, acceleration: f64) -> f64 {
        2.0 * distance
            / (speed
                + (speed * speed + 2.0 * acceleration * distance)
                    .max(0.0)
                    .sqrt())
    }

    struct Played {
        /// Times at which the steps of each axis are due and come.
        steps: [Vec<(f64, f64)>; 3],
        /// From the last event of each segment to the segment's end, ticks.
        ends: Vec<f64>,
    }

    /// Plays segments of given lengths, at whose ends the axes have parts of the highest speed. All
    /// axes move in the positive direction.
    fn play(pulse_us: u8, segments: &[(u32, [f64; 3])]) -> Played {
        let mut generator = Generator::new();
        generator.set_pulse_us(pulse_us);
        let (mut ring, segment_ring) = (EventRing::new(), SegmentRing::new());
        let period = min_period_ticks(u32::from(pulse_us) * TICKS_PER_US);
        let mut exact = [Exact {
            position: 0.0,
            speed: 0.0,
        }; 3];
        let (mut due, mut come): ([Vec<f64>; 3], [Vec<f64>; 3]) = Default::default();
        let (mut now, mut ends) = (0.0, Vec::new());
        for (ticks, parts) in segments {
            let begin = f64::from(generator.clock_ticks());
            let length = f64::from(*ticks);
            let axes: [AxisMotion; 3] = from_fn(|axis| {
                let Exact { position, speed } = exact[axis];
                let to = parts[axis] / f64::from(period);
                let acceleration = (to - speed) / length;
                let end = position + 0.5 * (speed + to) * length;
                let mut step = position.round() + 0.5;
                while step < end {
                    due[axis].push(begin + when(step - position, speed, acceleration));
                    step += 1.0;
                }
                exact[axis] = Exact {
                    position: end,
                    speed: to,
                };
                AxisMotion {
                    to: FineSteps((end * STEP).round() as i64),
                    acceleration: acceleration as f32,
                }
            });
            let segment = Segment {
                ticks: *ticks,
                axes: Axes(from_fn(|axis| axes.get(axis).copied().unwrap_or_default())),
                ..Segment::NONE
            };
            generator.begin(&segment, &segment_ring);
            let (mut writer, _) = ring.split();
            assert!(generator.push_events(&mut writer));
            for number in 0..writer.begin().number() {
                let event = writer.event(number);
                now += f64::from(event.ticks());
                for (axis, come) in come.iter_mut().enumerate() {
                    if event.directions().is_none() && event.raise() >> axis & 1 != 0 {
                        come.push(now);
                    }
                }
            }
            ends.push(f64::from(generator.clock_ticks()) - now);
            writer.discard_pending();
            segment_ring.discard_pending();
        }
        let steps = from_fn(|axis| {
            let times = due[axis].iter().zip(&come[axis]);
            times.map(|(due, come)| (*due, *come)).collect()
        });
        Played { steps, ends }
    }

    fn speeds() -> impl Strategy<Value = [f64; 3]> {
        prop::array::uniform3(prop_oneof![0.005..0.1_f64, 0.1..0.9, 0.9..1.0])
    }

    proptest! {
        #![proptest_config(crate::cases(64))]

        #[test]
        fn steps_come_two_spacings_before_or_after_their_times_at_most(
            pulse_us in 1_u8..20,
            segments in prop::collection::vec((60_000_u32..120_000, speeds()), 2..20),
        ) {
            const _: () = assert!(AXES >= 3);
            // The direction is set in the first segment.
            let first = f64::from(segments[0].0);
            for (axis, steps) in play(pulse_us, &segments).steps.iter().enumerate() {
                for (due, come) in steps.iter().filter(|(due, _)| *due > first) {
                    let late = come - due;
                    prop_assert!(
                        late.abs() <= f64::from(STEP_JITTER_TICKS) + ROUNDING,
                        "axis {axis}: {late} ticks at {due}"
                    );
                }
            }
        }

        #[test]
        fn the_last_event_of_a_segment_comes_shortly_before_its_end(
            pulse_us in 1_u8..20,
            segments in prop::collection::vec((60_000_u32..120_000, speeds()), 2..20),
        ) {
            // `schedule.toml` counts with 16 spacings.
            for left in play(pulse_us, &segments).ends {
                prop_assert!(left < 16.0 * f64::from(EVENT_SPACING_TICKS), "{left} ticks");
            }
        }
    }
}
