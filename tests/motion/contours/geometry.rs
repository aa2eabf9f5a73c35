//! Lines and arcs of the plane in double precision, and the way of a round tool beside them.
//!
//! Nothing of the firmware is used: what it does is compared with this.

use std::f64::consts::{PI, TAU};

pub(super) type Point = [f64; 2];

pub(super) fn plus(a: Point, b: Point, factor: f64) -> Point {
    [a[0] + b[0] * factor, a[1] + b[1] * factor]
}

pub(super) fn minus(a: Point, b: Point) -> Point {
    plus(a, b, -1.0)
}

pub(super) fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub(super) fn length(a: Point) -> f64 {
    dot(a, a).sqrt()
}

pub(super) fn unit(angle: f64) -> Point {
    [angle.cos(), angle.sin()]
}

/// Turned to the left by a right angle.
pub(super) fn left(a: Point) -> Point {
    [-a[1], a[0]]
}

fn angle_of(a: Point) -> f64 {
    a[1].atan2(a[0])
}

/// The angle from one direction to another, to the left, -π to π.
pub(super) fn turn(from: Point, to: Point) -> f64 {
    dot(left(from), to).atan2(dot(from, to))
}

/// A line, or an arc of less than a turn.
#[derive(Debug, Clone, Copy)]
pub(super) enum Piece {
    Line {
        start: Point,
        end: Point,
    },
    Arc {
        centre: Point,
        radius: f64,
        /// Direction from the centre to the start, rad.
        from: f64,
        /// To the left if positive, rad.
        sweep: f64,
    },
}

impl Piece {
    /// The arc from a start about a centre.
    pub(super) fn arc(start: Point, centre: Point, sweep: f64) -> Self {
        let radius = minus(start, centre);
        Self::Arc {
            centre,
            radius: length(radius),
            from: angle_of(radius),
            sweep,
        }
    }

    /// A place on it, 0 at the start and 1 at the end.
    pub(super) fn at(&self, part: f64) -> Point {
        match *self {
            Self::Line { start, end } => plus(start, minus(end, start), part),
            Self::Arc {
                centre,
                radius,
                from,
                sweep,
            } => plus(centre, unit(from + sweep * part), radius),
        }
    }

    pub(super) fn start(&self) -> Point {
        self.at(0.0)
    }

    pub(super) fn end(&self) -> Point {
        self.at(1.0)
    }

    /// The direction of travel at a place.
    pub(super) fn direction(&self, part: f64) -> Point {
        match *self {
            Self::Line { start, end } => {
                let chord = minus(end, start);
                plus([0.0; 2], chord, 1.0 / length(chord))
            }
            Self::Arc { from, sweep, .. } => {
                plus([0.0; 2], left(unit(from + sweep * part)), sweep.signum())
            }
        }
    }

    pub(super) fn length(&self) -> f64 {
        match *self {
            Self::Line { start, end } => length(minus(end, start)),
            Self::Arc { radius, sweep, .. } => radius * sweep.abs(),
        }
    }

    /// The distance of a point.
    pub(super) fn distance(&self, point: Point) -> f64 {
        let part = self.part(point).clamp(0.0, 1.0);
        length(minus(point, self.at(part)))
    }

    /// The place whose distance from a point is the least, or beyond the ends by how far along.
    pub(super) fn part(&self, point: Point) -> f64 {
        match *self {
            Self::Line { start, end } => {
                let chord = minus(end, start);
                dot(minus(point, start), chord) / dot(chord, chord)
            }
            Self::Arc {
                centre,
                from,
                sweep,
                ..
            } => {
                let along = (angle_of(minus(point, centre)) - from) * sweep.signum();
                let mut along = along.rem_euclid(TAU);
                // Half of what is left out of a turn lies beyond each end.
                if along > sweep.abs() + (TAU - sweep.abs()) / 2.0 {
                    along -= TAU;
                }
                along / sweep.abs()
            }
        }
    }

    /// The part of it between two places.
    pub(super) fn between(&self, first: f64, last: f64) -> Self {
        match *self {
            Self::Line { .. } => Self::Line {
                start: self.at(first),
                end: self.at(last),
            },
            Self::Arc {
                centre,
                radius,
                from,
                sweep,
            } => Self::Arc {
                centre,
                radius,
                from: from + sweep * first,
                sweep: sweep * (last - first),
            },
        }
    }

    /// The same at a distance to the left; `None` where an arc is too small for that.
    pub(super) fn offset(&self, distance: f64) -> Option<Self> {
        match *self {
            Self::Line { start, end } => {
                let aside = left(self.direction(0.0));
                Some(Self::Line {
                    start: plus(start, aside, distance),
                    end: plus(end, aside, distance),
                })
            }
            Self::Arc {
                centre,
                radius,
                from,
                sweep,
            } => {
                let radius = radius - distance * sweep.signum();
                (radius > 0.0).then_some(Self::Arc {
                    centre,
                    radius,
                    from,
                    sweep,
                })
            }
        }
    }

    /// Points that lie on both, or on what continues them.
    pub(super) fn crossings(&self, other: &Self) -> Vec<Point> {
        match (*self, *other) {
            (Self::Line { start, .. }, Self::Line { start: to, .. }) => {
                let (u, v) = (self.direction(0.0), other.direction(0.0));
                let across = dot(left(v), u);
                if across.abs() < 1e-9 {
                    return Vec::new();
                }
                let along = dot(left(v), minus(to, start)) / across;
                vec![plus(start, u, along)]
            }
            (Self::Line { start, .. }, Self::Arc { centre, radius, .. })
            | (Self::Arc { centre, radius, .. }, Self::Line { start, .. }) => {
                let line = if matches!(self, Self::Line { .. }) {
                    self
                } else {
                    other
                };
                let u = line.direction(0.0);
                let foot = plus(start, u, dot(minus(centre, start), u));
                let square = radius * radius - dot(minus(foot, centre), minus(foot, centre));
                if square < 0.0 {
                    return Vec::new();
                }
                [1.0, -1.0]
                    .map(|sign| plus(foot, u, sign * square.sqrt()))
                    .to_vec()
            }
            (
                Self::Arc { centre, radius, .. },
                Self::Arc {
                    centre: to,
                    radius: radius_to,
                    ..
                },
            ) => {
                let between = minus(to, centre);
                let distance = length(between);
                let along = (distance * distance + radius * radius - radius_to * radius_to)
                    / 2.0
                    / distance;
                let square = radius * radius - along * along;
                if distance < 1e-9 || square < 0.0 {
                    return Vec::new();
                }
                let u = plus([0.0; 2], between, 1.0 / distance);
                let foot = plus(centre, u, along);
                [1.0, -1.0]
                    .map(|sign| plus(foot, left(u), sign * square.sqrt()))
                    .to_vec()
            }
        }
    }
}

/// Directions that differ by less continue each other, rad.
pub(super) const TANGENT: f64 = 0.05;

/// How far beside the contour an entry by an arc begins at least, as a part of its chord.
const LEAST_AHEAD: f64 = 0.1;

/// Minimum length of the offset path of a piece, mm. A program rounds the end of an arc by up to 0.71 µm, which would
/// decide whether the tool fits on a shorter path.
const LEAST_LEFT: f64 = 1e-3;

/// What the tool does at a corner.
#[derive(Debug, Clone, Copy)]
pub(super) enum Corner {
    /// It goes on.
    Tangent,
    /// It goes around.
    Convex(Piece),
    /// It goes to where both offset curves meet.
    Concave(Point),
}

/// Returns the corner between two pieces, of which the offset curves are known, for a tool on the
/// left (`side` 1) or on the right (-1); `None` where the tool does not fit.
pub(super) fn corner(
    pieces: [&Piece; 2],
    offsets: [&Piece; 2],
    side: f64,
    radius: f64,
) -> Option<Corner> {
    let [before, after] = pieces;
    let (u, v) = (before.direction(1.0), after.direction(0.0));
    let angle = turn(u, v) * side;
    if angle.abs() <= TANGENT {
        return Some(Corner::Tangent);
    }
    let at = before.end();
    if angle < 0.0 {
        let start = plus(at, left(u), side * radius);
        return Some(Corner::Convex(Piece::arc(start, at, angle * side)));
    }
    let crossings = offsets[0].crossings(offsets[1]).into_iter();
    let mut crossings: Vec<_> = crossings
        .filter(|point| offsets[0].part(*point) < 1.0 && offsets[1].part(*point) > 0.0)
        .collect();
    crossings.sort_by(|a, b| length(minus(*a, at)).total_cmp(&length(minus(*b, at))));
    crossings.first().copied().map(Corner::Concave)
}

/// The path of the tool: its moves, each with the pieces of the contour that it may touch.
pub(super) type ToolPath = Vec<(Piece, [usize; 2])>;

/// Returns the path along pieces, of which the first one is the entry: by a line whose end is beside
/// the contour, or by an arc. `None` where the tool does not fit.
pub(super) fn tool_path(
    entry: &Piece,
    contour: &[Piece],
    side: f64,
    radius: f64,
) -> Option<ToolPath> {
    let offset = |piece: &Piece| piece.offset(side * radius);
    let offsets: Option<Vec<_>> = contour.iter().map(offset).collect();
    let offsets = offsets?;
    let mut moves = Vec::new();
    let first = offsets[0].start();
    // Where the path along the piece begins.
    let mut begin = 0.0;
    match entry {
        Piece::Line { start, .. } => {
            let met = corner(
                [entry, &contour[0]],
                [&offset(entry)?, &offsets[0]],
                side,
                radius,
            )?;
            let Corner::Concave(point) = met else {
                return None;
            };
            begin = offsets[0].part(point);
            let entered = Piece::Line {
                start: *start,
                end: point,
            };
            moves.push((entered, [0, 0]));
        }
        Piece::Arc { .. } => {
            // Tangent to the contour at its start: the circle through the start that touches the path there.
            let chord = minus(entry.start(), first);
            let aside = plus([0.0; 2], left(contour[0].direction(0.0)), side);
            let ahead = dot(chord, aside);
            // An entry from the other side goes almost around a large circle.
            if ahead < LEAST_AHEAD * length(chord) {
                return None;
            }
            let bend = dot(chord, chord) / 2.0 / ahead;
            let centre = plus(first, aside, bend);
            let sweep = turn(minus(entry.start(), centre), minus(first, centre)) * side;
            let sweep = sweep.rem_euclid(TAU) * side;
            moves.push((Piece::arc(entry.start(), centre, sweep), [0, 0]));
        }
    }
    for (index, pair) in contour.windows(2).enumerate() {
        let own = &offsets[index];
        let next = index + 1;
        let met = corner([&pair[0], &pair[1]], [own, &offsets[next]], side, radius)?;
        let (end, around, next_begin) = match met {
            Corner::Tangent => (1.0, None, 0.0),
            Corner::Convex(arc) => (1.0, Some(arc), 0.0),
            Corner::Concave(point) => (own.part(point), None, offsets[next].part(point)),
        };
        if (end - begin) * pair[0].length() < LEAST_LEFT {
            return None;
        }
        moves.push((own.between(begin, end), [index, next]));
        moves.extend(around.map(|arc| (arc, [index, next])));
        begin = next_begin;
    }
    let last = offsets.len() - 1;
    if (1.0 - begin) * contour[last].length() < LEAST_LEFT {
        return None;
    }
    moves.push((offsets[last].between(begin, 1.0), [last, last]));
    Some(moves)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: Point, b: Point) -> bool {
        length(minus(a, b)) < 1e-9
    }

    #[test]
    fn distances_from_lines_and_arcs_are_known() {
        let line = Piece::Line {
            start: [0.0, 0.0],
            end: [10.0, 0.0],
        };
        let arc = Piece::arc([5.0, 0.0], [0.0, 0.0], PI / 2.0);
        for (piece, point, expected) in [
            (line, [4.0, 3.0], 3.0),
            (line, [-3.0, 4.0], 5.0),
            (line, [13.0, 4.0], 5.0),
            (arc, [6.0, 8.0], 5.0),
            (arc, [3.0, 4.0], 0.0),
            (arc, [0.0, 0.0], 5.0),
            (arc, [5.0, -2.0], 2.0),
            (arc, [-3.0, 1.0], 5.0),
        ] {
            assert!(
                (piece.distance(point) - expected).abs() < 1e-12,
                "{point:?}"
            );
        }
    }

    #[test]
    fn offset_paths_of_a_square_meet_in_its_corners_or_go_around_them() {
        let corners = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]];
        let contour: Vec<_> = corners
            .windows(2)
            .map(|pair| Piece::Line {
                start: pair[0],
                end: pair[1],
            })
            .collect();
        let entry = |y| Piece::Line {
            start: [0.0, y],
            end: [0.0, 0.0],
        };
        let inside = tool_path(&entry(5.0), &contour, 1.0, 2.0).unwrap();
        let ends: Vec<_> = inside.iter().map(|(piece, _)| piece.end()).collect();
        let expected = [[2.0, 2.0], [8.0, 2.0], [8.0, 10.0]];
        assert!(ends.iter().zip(expected).all(|(a, b)| near(*a, b)));
        let outside = tool_path(&entry(-5.0), &contour, -1.0, 2.0).unwrap();
        let ends: Vec<_> = outside.iter().map(|(piece, _)| piece.end()).collect();
        let expected = [[2.0, -2.0], [10.0, -2.0], [12.0, 0.0], [12.0, 10.0]];
        assert!(ends.iter().zip(expected).all(|(a, b)| near(*a, b)));
        assert!((outside[2].0.length() - PI).abs() < 1e-9);
        assert!(tool_path(&entry(5.0), &contour, 1.0, 6.0).is_none());
    }
}
