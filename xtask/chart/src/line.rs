//! Lines of pictures: fewer points for the same look, and ranges with the same middle.

use std::ops::Range;

/// A range of a given length with the same middle.
pub fn widened(range: &Range<f64>, length: f64) -> Range<f64> {
    let middle = f64::midpoint(range.start, range.end);
    middle - length / 2.0..middle + length / 2.0
}

/// A line with fewer points, none farther than some pixels from the original (Douglas and Peucker
/// 1973); a pixel may have different sizes across and up.
pub fn simplified(points: &[(f64, f64)], pixel: [f64; 2], pixels: f64) -> Vec<(f64, f64)> {
    let place = |index: usize| (points[index].0 / pixel[0], points[index].1 / pixel[1]);
    let mut keep = vec![false; points.len()];
    let mut open = vec![(0, points.len().saturating_sub(1))];
    while let Some((first, last)) = open.pop() {
        for end in [first, last] {
            keep.get_mut(end).into_iter().for_each(|keep| *keep = true);
        }
        let far = (first + 1..last)
            .map(|index| (index, distance(place(index), place(first), place(last))))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((index, far)) = far
            && far > pixels
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
        assert_eq!(simplified(&points, [1.0; 2], 0.01), [points[0], points[99]]);
        let corner = [(0.0, 0.0), (5.0, 0.0), (5.0, 5.0)];
        assert_eq!(simplified(&corner, [1.0; 2], 0.01), corner);
        assert_eq!(simplified(&corner, [1.0, 1000.0], 0.01).len(), 2);
        assert!(simplified(&[], [1.0; 2], 0.01).is_empty());
    }
}
