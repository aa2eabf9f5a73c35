//! The path of a job as points, read from its columns.

use leadscrew::axis::AXES;

use crate::Job;

/// A point of the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// Time since the first motion, s.
    pub time_s: f64,
    /// Machine position, mm or degrees.
    pub place: [f64; AXES],
    /// Speed here, mm/min or degrees/min: between two points it changes evenly.
    pub speed: f64,
    /// The line that leads from here to the next point, counted from 1.
    pub line: u64,
    /// The number of its kind: 1 is a rapid, 2 a feed move.
    pub kind: u64,
}

impl Job {
    /// Returns the points of the path.
    pub fn waypoints(&self) -> Vec<Waypoint> {
        let mut columns = ColumnReader(self.columns.iter().copied());
        let count = self.path.vertices;
        let times = columns.sums(count);
        let steps: [_; AXES] = std::array::from_fn(|_| columns.sums(count));
        let (speeds, lines) = (columns.sums(count), columns.sums(count));
        let kinds: Vec<_> = (0..count).map(|_| columns.varint()).collect();
        let point = |row: usize| Waypoint {
            time_s: times[row] as f64 * 1e-6,
            place: std::array::from_fn(|axis| steps[axis][row] as f64 / self.axes[axis].scale),
            speed: speeds[row] as f64,
            line: lines[row].unsigned_abs(),
            kind: kinds[row],
        };
        (0..count).map(point).collect()
    }
}

/// Reads columns of varints.
struct ColumnReader<I>(I);

impl<I: Iterator<Item = u8>> ColumnReader<I> {
    /// 7 bits in each byte, the lowest first.
    fn varint(&mut self) -> u64 {
        let mut value = 0;
        for (index, byte) in self.0.by_ref().enumerate() {
            value |= u64::from(byte & 0x7f) << (7 * index);
            if byte < 0x80 {
                break;
            }
        }
        value
    }

    /// A column of differences, each with its sign in the lowest bit.
    fn sums(&mut self, count: usize) -> Vec<i64> {
        let mut sum = 0;
        let mut next = || {
            let value = self.varint();
            sum += (value >> 1).cast_signed() ^ -(value & 1).cast_signed();
            sum
        };
        (0..count).map(|_| next()).collect()
    }
}

#[cfg(test)]
mod tests {
    use leadscrew::sim::SegmentKind;

    use super::*;
    use crate::{
        job::{Axis, PathInfo},
        recording::Path,
        vertex::{Span, Vertex},
    };

    #[test]
    fn points_are_those_that_were_recorded() {
        let mut path = Path::default();
        let vertex = |us, steps: i32, speed, line, kind| {
            let span = Span {
                line,
                kind,
                programmed: 7,
            };
            Vertex {
                us,
                steps: [steps; AXES],
                speed,
                power: [1, 2],
                span,
            }
        };
        path.push(&vertex(5_000_000, -70_000, 600, 9, SegmentKind::Feed));
        path.push(&vertex(6_500_000, 80_000, 0, 3, SegmentKind::Rapid));
        let axis = Axis {
            scale: 100.0,
            ..Axis::default()
        };
        let job = Job {
            axes: vec![axis; AXES],
            path: PathInfo {
                vertices: 2,
                segments: 1,
            },
            columns: path.finish(),
            ..Job::default()
        };
        let expected = |time_s, mm, speed, line, kind| Waypoint {
            time_s,
            place: [mm; AXES],
            speed,
            line,
            kind,
        };
        let points = [
            expected(0.0, -700.0, 600.0, 9, 2),
            expected(1.5, 800.0, 0.0, 3, 1),
        ];
        assert_eq!(job.waypoints(), points);
    }
}
