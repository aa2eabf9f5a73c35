//! The programmed speed of every move: of lines, of arcs, of corners under `G64`, and under overrides.

use crate::{math, model::FeedRate};

/// Lowest nominal speed of what is not programmed more slowly, mm/s: Grbl's `MINIMUM_FEED_RATE` of 1 mm/min.
const MIN_SPEED_MM_S: f32 = 1.0 / 60.0;
/// Lowest speed of a move that takes a time, mm/s: a nanometre in the longest one.
const LEAST_IN_A_TIME_MM_S: f32 = 1.0e-3 / u32::MAX as f32;

/// Returns the programmed speed of a move of a length, mm/s: the limit for a rapid.
pub(super) fn programmed_mm_s(feed_rate: FeedRate, length_mm: f32, limit_mm_s: f32) -> f32 {
    let programmed = match feed_rate {
        FeedRate::Rapid => return limit_mm_s,
        FeedRate::Feed(mm_min) | FeedRate::Jog(mm_min) => mm_min / 60.0,
        FeedRate::InverseTime(per_min) => {
            return math::max(length_mm * per_min / 60.0, LEAST_IN_A_TIME_MM_S);
        }
    };
    math::max(programmed, MIN_SPEED_MM_S)
}

/// Returns the nominal speed of a move that overrides have brought to a speed, mm/s.
#[inline]
pub(super) fn nominal_mm_s(overridden_mm_s: f32, programmed_mm_s: f32, limit_mm_s: f32) -> f32 {
    let least_mm_s = math::min(MIN_SPEED_MM_S, programmed_mm_s);
    math::min(math::max(overridden_mm_s, least_mm_s), limit_mm_s)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::{
        axis::Axes,
        model::{Circle, Command, Overrides, PathControl, Plane, Rotation},
        path::{Blender, Block, Router, Work},
        settings::{Settings, StepRate},
        units::{MicroDegrees, Nm},
    };

    fn at(x: i64, y: i64) -> Axes<Nm> {
        Axes::from_fn(|axis| Nm([x, y].get(axis).copied().unwrap_or(0) * Nm::PER_MM))
    }

    fn line(x: i64, y: i64, mm_min: f32) -> Command {
        Command::Line {
            target: at(x, y).into(),
            feed_rate: FeedRate::Feed(mm_min),
            line: 0,
        }
    }

    /// The blocks of a line, an arc, and two lines with a corner that `G64` rounds.
    fn blocks(mm_min: f32) -> Vec<Block> {
        // An exact corner is a stop, and one that is rounded has room for the speed.
        let mut router = Router::new(&Settings {
            junction_deviation_mm: 0.0,
            acceleration_mm_s2: Axes::from_fn(|_| 1.0e-3),
            ..Settings::new(StepRate::Proven(150_000))
        });
        let circle = Circle {
            plane: Plane::Xy,
            centre: [Nm(0), Nm(10 * Nm::PER_MM)],
            rotation: Rotation::CounterClockwise,
            turns: 1,
            tilt: MicroDegrees::ZERO,
        };
        let arc = Command::Arc {
            target: at(20, 10).into(),
            circle,
            feed_rate: FeedRate::Feed(mm_min),
            line: 0,
        };
        let mut work: Vec<Work> = [line(10, 0, mm_min), arc]
            .iter()
            .filter_map(|command| router.route(command))
            .collect();
        let mut blender = Blender::new();
        let control = PathControl::Continuous {
            tolerance_nm: 500_000,
            merging_nm: 0,
        };
        for command in [line(20, 30, mm_min), line(50, 30, mm_min)] {
            router.blend(&mut blender, control, &command);
        }
        router.flush(&mut blender);
        while let Some(output) = blender.front() {
            work.extend(router.route_blended(output));
            blender.dequeue();
        }
        let blocks = work.iter().map(|work| match work {
            Work::Move(block) => *block,
            other => panic!("{other:?}"),
        });
        blocks.collect()
    }

    #[test]
    fn lines_arcs_and_corners_share_the_least_speed() {
        let blocks = blocks(0.5);
        let arcs = blocks.iter().filter(|block| block.curve.is_some());
        assert_eq!((blocks.len(), arcs.count()), (5, 2));
        for block in blocks {
            assert_eq!(block.programmed_mm_s, MIN_SPEED_MM_S);
            assert_eq!(block.nominal_mm_s, MIN_SPEED_MM_S);
        }
    }

    #[test]
    fn overrides_end_at_the_least_speed() {
        for block in blocks(90.0 * MIN_SPEED_MM_S) {
            let slowest = Overrides {
                feed: 10,
                ..Overrides::default()
            };
            assert!(block.nominal_mm_s > MIN_SPEED_MM_S);
            assert_eq!(block.nominal_under(slowest), MIN_SPEED_MM_S);
        }
    }
}
