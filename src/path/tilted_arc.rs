//! Arcs in a plane that is neither that of X and Y nor parallel to two axes of motors: `G18` and `G19` under a
//! rotated work coordinate system, or on a `CoreXY` machine.
//!
//! Such an arc or helix becomes chords that stay within `$12` of it. No other arc does. Double
//! precision; a point is computed when the machine has room for its chord.

use core::f64::consts::{FRAC_PI_2, TAU};

use super::arc::Arc;
use crate::{
    axis::{Axes, X, Y, Z},
    model::{Circle, Command, FeedRate, Plane, Target, XyRotation},
    settings::Settings,
    units::{MicroDegrees, Nm},
};

/// Longest chord as an angle, rad: however coarse `$12` is, an arc stays recognisable.
const MAX_STEP_RAD: f64 = FRAC_PI_2;
/// Most angles at which a coordinate can be extreme: two each in the first and the last turn.
const EXTREMES: usize = 4;

/// An arc of which the machine gets chords.
#[derive(Debug, Clone, Copy)]
pub struct TiltedArc {
    from: Axes<Nm>,
    target: Target,
    /// Displacement of the end, before the rotation.
    displacement: Axes<Nm>,
    rotation: XyRotation,
    circle: Circle,
    feed_rate: FeedRate,
    line: u32,
    chords: u32,
    /// Chords that have been taken.
    taken: u32,
}

impl TiltedArc {
    /// Returns the arc of a command from a position; `None` for every other command.
    #[must_use]
    pub fn of(command: &Command, from: &Axes<Nm>, settings: &Settings) -> Option<Self> {
        let Command::Arc {
            target,
            circle,
            feed_rate,
            line,
        } = command
        else {
            return None;
        };
        let is_flat = circle.tilt == MicroDegrees::ZERO;
        if is_flat && (circle.plane == Plane::Xy || !settings.core_xy) {
            return None;
        }
        let rotation = XyRotation::by(circle.tilt);
        let mut displacement = target.position.zip(*from, |to, from| to - from);
        let unrotated = rotation.unrotate([displacement[X], displacement[Y]]);
        [displacement[X], displacement[Y]] = unrotated;
        let mut tilted = Self {
            from: *from,
            target: *target,
            displacement,
            rotation,
            circle: *circle,
            feed_rate: *feed_rate,
            line: *line,
            chords: 1,
            taken: 0,
        };
        let arc = tilted.arc();
        let radius = arc.radius[0].max(arc.radius[1]);
        let tolerance = f64::from(settings.arc_tolerance_mm);
        let step = (2.0 * libm::acos((1.0 - tolerance / radius).max(0.0))).min(MAX_STEP_RAD);
        let chords = libm::ceil(libm::fabs(arc.sweep) / step);
        tilted.chords = (chords as u32).max(1);
        if let FeedRate::InverseTime(feed) = feed_rate {
            tilted.feed_rate = FeedRate::InverseTime(feed * tilted.chords as f32);
        }
        Some(tilted)
    }

    /// Returns the move along the next chord; `None` at the end of the arc.
    pub fn next_chord(&mut self) -> Option<Command> {
        if self.taken == self.chords {
            return None;
        }
        self.taken += 1;
        let target = if self.taken == self.chords {
            self.target
        } else {
            let arc = self.arc();
            let part = f64::from(self.taken) / f64::from(self.chords);
            self.point(&arc, arc.sweep * part).into()
        };
        Some(Command::Line {
            target,
            feed_rate: self.feed_rate,
            line: self.line,
        })
    }

    /// Returns whether the end of the arc has not been reached.
    #[must_use]
    pub const fn has_more(&self) -> bool {
        self.taken < self.chords
    }

    /// Returns the geometry in the plane before the rotation.
    fn arc(&self) -> Arc {
        let (first, second, _) = self.circle.plane.axes();
        let displacement = [self.displacement[first], self.displacement[second]];
        Arc::new(&self.circle, displacement)
    }

    /// Returns the machine position after an angle of the arc, rad.
    fn point(&self, arc: &Arc, angle: f64) -> Axes<Nm> {
        let (first, second, _) = self.circle.plane.axes();
        let part = angle / arc.sweep;
        let mut moved = self
            .displacement
            .map(|along| Nm::from_mm_f64(along.to_mm_f64() * part));
        let radius = arc.radius[0] + arc.growth() * angle;
        let (sin, cos) = libm::sincos(arc.start + angle);
        moved[first] = self.circle.centre[0] + Nm::from_mm_f64(radius * cos);
        moved[second] = self.circle.centre[1] + Nm::from_mm_f64(radius * sin);
        [moved[X], moved[Y]] = self.rotation.rotate([moved[X], moved[Y]]);
        self.from.zip(moved, |from, moved| from + moved)
    }

    /// Returns whether every point at which a coordinate is extreme satisfies a condition.
    ///
    /// Along X, Y and Z the arc is a cos φ + b sin φ + cφ: extreme where the derivative is 0, which is
    /// in the first or in the last turn, as the part in proportion to φ is monotonic.
    #[must_use]
    pub fn extremes_satisfy(&self, condition: impl Fn(&Axes<Nm>) -> bool) -> bool {
        let arc = self.arc();
        let (first, second, depth) = self.circle.plane.axes();
        let radius = arc.radius[0].max(arc.radius[1]);
        let rise = self.displacement[depth].to_mm_f64() / arc.sweep;
        [X, Y, Z].into_iter().all(|axis| {
            let part = |of: usize| self.rotation.part(axis, of);
            let (a, b) = (radius * part(first), radius * part(second));
            extreme_angles(&arc, a, b, rise * part(depth))
                .into_iter()
                .flatten()
                .all(|angle| condition(&self.point(&arc, angle)))
        })
    }
}

/// Returns the angles from the start of an arc at which a cos φ + b sin φ + cφ is extreme.
fn extreme_angles(arc: &Arc, a: f64, b: f64, c: f64) -> [Option<f64>; EXTREMES] {
    let amplitude = libm::hypot(a, b);
    if amplitude <= libm::fabs(c) {
        return [None; EXTREMES];
    }
    // The derivative is amplitude · cos(φ + phase) + c.
    let phase = libm::atan2(a, b);
    let half = libm::acos(-c / amplitude);
    let turn = if arc.sweep > 0.0 { TAU } else { -TAU };
    let mut angles = [None; EXTREMES];
    for (index, root) in [half, -half].into_iter().enumerate() {
        let ahead = libm::fmod(root - phase - arc.start, TAU);
        let first = if ahead * turn < 0.0 {
            ahead + turn
        } else {
            ahead
        };
        let turns = libm::floor((arc.sweep - first) / turn);
        if turns >= 0.0 {
            angles[2 * index] = Some(first);
            angles[2 * index + 1] = Some(first + turns * turn);
        }
    }
    angles
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;
    use crate::{
        model::{Plane, Rotation},
        path::leaves_travel,
    };

    /// An arc with its centre at 0 in its plane, a rise along the other axis, and a turn about Z.
    #[derive(Debug, Clone, Copy)]
    struct Given {
        is_zx: bool,
        is_clockwise: bool,
        radius_mm: f64,
        angles: [f64; 2],
        turns: u16,
        rise_mm: f64,
        tilt: MicroDegrees,
    }

    impl Given {
        /// The start of the arc and its command.
        fn command(&self) -> (Axes<Nm>, Command) {
            let plane = if self.is_zx { Plane::Zx } else { Plane::Yz };
            let (first, second, depth) = plane.axes();
            let point = |angle: f64, depth_mm: f64| {
                let mut point = Axes::all(Nm(0));
                point[first] = Nm::from_mm_f64(self.radius_mm * angle.cos());
                point[second] = Nm::from_mm_f64(self.radius_mm * angle.sin());
                point[depth] = Nm::from_mm_f64(depth_mm);
                point
            };
            let (start, end) = (
                point(self.angles[0], 0.0),
                point(self.angles[1], self.rise_mm),
            );
            let turned = |mut point: Axes<Nm>| {
                [point[X], point[Y]] = XyRotation::by(self.tilt).rotate([point[X], point[Y]]);
                point
            };
            let circle = Circle {
                plane,
                centre: [Nm(-start[first].0), Nm(-start[second].0)],
                rotation: if self.is_clockwise {
                    Rotation::Clockwise
                } else {
                    Rotation::CounterClockwise
                },
                turns: self.turns,
                tilt: self.tilt,
            };
            let target = turned(end).into();
            let feed_rate = FeedRate::InverseTime(2.0);
            (
                turned(start),
                Command::Arc {
                    target,
                    circle,
                    feed_rate,
                    line: 7,
                },
            )
        }
    }

    fn given() -> impl Strategy<Value = Given> {
        (
            any::<[bool; 2]>(),
            (
                0.1..60.0_f64,
                prop::array::uniform2(0.0..TAU),
                -30.0..30.0_f64,
            ),
            1_u16..4,
            1_000_000_i64..359_000_000,
        )
            .prop_map(
                |([is_zx, is_clockwise], (radius_mm, angles, rise_mm), turns, tilt)| Given {
                    is_zx,
                    is_clockwise,
                    radius_mm,
                    angles,
                    turns,
                    rise_mm,
                    tilt: MicroDegrees::new(tilt),
                },
            )
    }

    /// The ends of all chords.
    fn points(mut arc: TiltedArc) -> Vec<Axes<Nm>> {
        let mut points = Vec::new();
        while let Some(Command::Line {
            target,
            feed_rate,
            line,
        }) = arc.next_chord()
        {
            assert_eq!(
                (feed_rate, line),
                (FeedRate::InverseTime(2.0 * arc.chords as f32), 7)
            );
            points.push(target.position);
        }
        assert!(!arc.has_more());
        points
    }

    proptest! {
        #![proptest_config(crate::cases(64))]

        #[test]
        fn chords_stay_within_the_tolerance_and_end_at_the_target(given in given()) {
            let (start, command) = given.command();
            let settings = Settings { arc_tolerance_mm: 0.01, ..Settings::default() };
            let arc = TiltedArc::of(&command, &start, &settings).unwrap();
            let points = points(arc);
            let Command::Arc { target, .. } = command else { unreachable!() };
            prop_assert_eq!(points.last(), Some(&target.position));
            // Back in its plane, every chord's end is on the circle and its middle near it.
            let (first, second, _) = arc.circle.plane.axes();
            let in_plane = |point: &Axes<Nm>| {
                let mut back = *point;
                [back[X], back[Y]] = arc.rotation.unrotate([point[X], point[Y]]);
                [back[first].to_mm_f64(), back[second].to_mm_f64()]
            };
            let mut before = in_plane(&start);
            for point in &points {
                let end = in_plane(point);
                prop_assert!((end[0].hypot(end[1]) - given.radius_mm).abs() < 1.0e-5);
                let middle = [0.5 * (before[0] + end[0]), 0.5 * (before[1] + end[1])];
                let height = given.radius_mm - middle[0].hypot(middle[1]);
                prop_assert!(height < 0.010_01, "{height} mm");
                before = end;
            }
        }

        #[test]
        fn the_extremes_are_those_of_many_points(given in given()) {
            let (start, command) = given.command();
            let arc = TiltedArc::of(&command, &start, &Settings::default()).unwrap();
            let plane = arc.arc();
            for axis in [X, Y, Z] {
                let (mut most, mut least) = (i64::MIN, i64::MAX);
                for part in 0..=2_000 {
                    let point = arc.point(&plane, plane.sweep * f64::from(part) / 2_000.0);
                    (most, least) = (most.max(point[axis].0), least.min(point[axis].0));
                }
                let ends = [start[axis].0, arc.target.position[axis].0];
                let (highest, lowest) = (ends[0].max(ends[1]), ends[0].min(ends[1]));
                // A point beside an extreme by half a part in 2 000 of four turns of 60 mm is 1.2 µm short
                // of it: between the two conditions the extreme may be on either side.
                let is_within = arc.extremes_satisfy(|point| point[axis].0 <= highest + 1200);
                prop_assert!(!is_within || most <= highest + 1200);
                prop_assert!(is_within || most > highest);
                prop_assert!(arc.extremes_satisfy(|point| point[axis].0 <= highest.max(most) + 1200));
                prop_assert!(arc.extremes_satisfy(|point| point[axis].0 >= lowest.min(least) - 1200));
            }
        }
    }

    #[test]
    fn an_arc_that_leaves_the_travel_between_its_ends_is_found() {
        // Half a circle of 10 mm in a plane turned by 90 degrees: along Y it reaches as far as along Z.
        let mut given = Given {
            is_zx: true,
            is_clockwise: false,
            radius_mm: 10.0,
            angles: [0.0, core::f64::consts::PI],
            turns: 1,
            rise_mm: 0.0,
            tilt: MicroDegrees::new(90_000_000),
        };
        let settings = Settings::default();
        let shifted = |given: &Given, y_mm: f64| {
            let (mut start, mut command) = given.command();
            let Command::Arc { target, .. } = &mut command else {
                unreachable!()
            };
            for point in [&mut start, &mut target.position] {
                point[X] = point[X] - Nm::from_mm_f64(50.0);
                point[Y] = point[Y] + Nm::from_mm_f64(y_mm);
                point[Z] = point[Z] - Nm::from_mm_f64(50.0);
            }
            leaves_travel(&settings, &start, &command)
        };
        assert!(!shifted(&given, -10.0));
        assert!(shifted(&given, -9.99));
        given.is_clockwise = true;
        assert!(!shifted(&given, -1.0));
    }
}
