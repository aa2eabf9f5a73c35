//! Lines of pictures: fewer points for the same look, and ranges with the same middle.

use std::ops::Range;

/// A range of a given length with the same middle.
pub fn widened(range: &Range<f64>, length: f64) -> Range<f64> {
    let middle = f64::midpoint(range.start, range.end);
    middle - length / 2.0..middle + length / 2.0
}

/// A line with fewer points, none farther than some pixels from the original; a pixel may have different
/// sizes across and up.
pub fn simplified(points: &[(f64, f64)], pixel: [f64; 2], pixels: f64) -> Vec<(f64, f64)> {
    let place = |point: &(f64, f64)| [point.0 / pixel[0], point.1 / pixel[1]];
    thinned(points, place, pixels)
}

/// The points of a line that are needed so that none is farther than `most` from the line through them
/// (Douglas and Peucker 1973), where `place` has them.
pub fn thinned<P: Copy, const N: usize>(
    points: &[P],
    place: impl Fn(&P) -> [f64; N],
    most: f64,
) -> Vec<P> {
    let mut keep = vec![false; points.len()];
    let mut open = vec![(0, points.len().saturating_sub(1))];
    while let Some((first, last)) = open.pop() {
        for end in [first, last] {
            keep.get_mut(end).into_iter().for_each(|keep| *keep = true);
        }
        if last < first + 2 {
            continue;
        }
        let (from, to) = (place(&points[first]), place(&points[last]));
        let (mut farthest, mut index) = (most, None);
        let between = points.iter().enumerate().take(last).skip(first + 1);
        for (number, point) in between {
            let (_, off) = nearest(place(point), from, to);
            if off > farthest {
                (farthest, index) = (off, Some(number));
            }
        }
        open.extend(
            index
                .into_iter()
                .flat_map(|index| [(first, index), (index, last)]),
        );
    }
    let kept = points.iter().zip(keep).filter(|(_, keep)| *keep);
    kept.map(|(point, _)| *point).collect()
}

/// Which part of a stretch is nearest to a point, and how far that is.
pub fn nearest<const N: usize>(point: [f64; N], from: [f64; N], to: [f64; N]) -> (f64, f64) {
    let (mut square, mut product) = (0.0, 0.0);
    for axis in 0..N {
        let along = to[axis] - from[axis];
        square += along * along;
        product += along * (point[axis] - from[axis]);
    }
    let share = if square > 0.0 {
        (product / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let mut square = 0.0;
    for axis in 0..N {
        let off = point[axis] - from[axis] - share * (to[axis] - from[axis]);
        square += off * off;
    }
    (share, f64::sqrt(square))
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
    #[test]
    fn what_is_in_a_plane_from_above_may_be_a_corner_in_space() {
        let corner = [[0.0, 0.0, 0.0], [5.0, 0.0, 1.0], [10.0, 0.0, 0.0]];
        assert_eq!(thinned(&corner, |point| *point, 0.5), corner);
        assert_eq!(thinned(&corner, |[x, y, _]| [*x, *y], 0.5).len(), 2);
        assert_eq!(nearest([4.0, 3.0], [0.0, 0.0], [8.0, 0.0]), (0.5, 3.0));
    }
}
