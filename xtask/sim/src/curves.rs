//! Curves for pictures: from samples of the motion to points worth drawing.

use leadscrew::axis::AXES;

use crate::trace::Motion;

/// Speeds and accelerations over time.
pub(crate) struct Curves {
    /// Along the path, mm/s.
    pub(crate) speed: Vec<f64>,
    /// Of each axis that moves, mm/s².
    pub(crate) accelerations: Vec<(usize, Vec<f64>)>,
}

impl Curves {
    /// Fits over about the time that one pixel stands for, and never less than 2 ms for speeds
    /// and 16 ms for accelerations.
    pub(crate) fn of(motion: &Motion) -> Self {
        let pixel = (motion.len() / 1000).max(1);
        let mut speed = vec![0.0; motion.len()];
        let mut accelerations = Vec::new();
        for axis in (0..AXES).filter(|axis| moves(&motion.mm[*axis])) {
            let (speeds, _) = motion.derivatives(axis, pixel);
            let (_, seconds) = motion.derivatives(axis, pixel.max(8));
            for (sum, speed) in speed.iter_mut().zip(speeds) {
                *sum += speed * speed;
            }
            accelerations.push((axis, seconds));
        }
        for square in &mut speed {
            *square = square.sqrt();
        }
        Self {
            speed,
            accelerations,
        }
    }

    /// The highest speed, mm/s.
    pub(crate) fn fastest(&self) -> f64 {
        self.speed.iter().copied().fold(1e-6, f64::max)
    }
}

/// Whether an axis moves at all.
pub(crate) fn moves(mm: &[f64]) -> bool {
    mm.iter().any(|at| (at - mm[0]).abs() > 1e-6)
}

/// A curve with no more points than can be seen: of many samples, the lowest and the highest.
pub(crate) fn thinned(values: &[f64], spacing_s: f64, scale: f64) -> Vec<(f64, f64)> {
    let bucket = (values.len() / 1200).max(1);
    let mut points = Vec::new();
    for (number, group) in values.chunks(bucket).enumerate() {
        let at = |index: usize| (number * bucket + index) as f64 * spacing_s;
        let by_value = |a: &(usize, &f64), b: &(usize, &f64)| a.1.total_cmp(b.1);
        let lowest = group.iter().enumerate().min_by(by_value);
        let highest = group.iter().enumerate().max_by(by_value);
        let mut pair: Vec<_> = lowest.into_iter().chain(highest).collect();
        pair.sort_by_key(|(index, _)| *index);
        pair.dedup_by_key(|(index, _)| *index);
        points.extend(
            pair.iter()
                .map(|(index, value)| (at(*index), **value * scale)),
        );
    }
    points
}

/// A line with fewer points, none farther than `tolerance` from the original (Douglas and Peucker
/// 1973).
pub(crate) fn simplified(points: &[(f64, f64)], tolerance: f64) -> Vec<(f64, f64)> {
    let mut keep = vec![false; points.len()];
    let mut open = vec![(0, points.len().saturating_sub(1))];
    while let Some((first, last)) = open.pop() {
        keep[first] = true;
        keep[last] = true;
        let far = (first + 1..last)
            .map(|index| (index, distance(points[index], points[first], points[last])))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((index, far)) = far
            && far > tolerance
        {
            open.extend([(first, index), (index, last)]);
        }
    }
    let kept = points.iter().zip(keep).filter(|(_, keep)| *keep);
    kept.map(|(point, _)| *point).collect()
}

/// Distance of a point from a stretch.
fn distance(point: (f64, f64), from: (f64, f64), to: (f64, f64)) -> f64 {
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    let (px, py) = (point.0 - from.0, point.1 - from.1);
    let square = dx * dx + dy * dy;
    let share = if square > 0.0 {
        ((px * dx + py * dy) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (px - share * dx).hypot(py - share * dy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_needs_two_points() {
        let points: Vec<_> = (0..100)
            .map(|k| (f64::from(k), 2.0 * f64::from(k)))
            .collect();
        assert_eq!(simplified(&points, 0.01), [points[0], points[99]]);
        let corner = [(0.0, 0.0), (5.0, 0.0), (5.0, 5.0)];
        assert_eq!(simplified(&corner, 0.01), corner);
    }

    #[test]
    fn thinning_keeps_the_extremes() {
        let mut values = vec![0.0; 100_000];
        values[54_321] = 9.0;
        values[54_322] = -9.0;
        let points = thinned(&values, 0.001, 2.0);
        assert!(points.len() < 3000);
        assert!(points.iter().any(|point| point.1 == 18.0));
        assert!(points.iter().any(|point| point.1 == -18.0));
    }
}
