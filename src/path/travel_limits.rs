//! Soft limits, `$20`: moves that leave the travel of the machine.
//!
//! The travel of an axis is what [`Settings::travel`] returns; with `$130`.. = 0 it has no limits, as a rotary axis that
//! turns freely, in grblHAL too. The farthest points of an arc are computed from
//! its exact geometry, not from chords. Runs once per line, in `interpret`.

use core::{cell::Cell, f64::consts::FRAC_PI_2};

use super::{TiltedArc, arc::Arc};
use crate::{
    axis::{AXES, Axes},
    model::{Circle, Command},
    settings::Settings,
    units::Nm,
};

/// Greatest error of a computed extreme, nm: a centre is rounded to 1 nm. Bounded by the test
/// `an_arc_is_refused_exactly_where_a_point_of_it_is_outside`.
const EXTREME_ERROR_NM: i64 = 5;

/// Returns true if some part of a command's path from a position is outside the travel.
#[must_use]
pub fn leaves_travel(settings: &Settings, from: &Axes<Nm>, command: &Command) -> bool {
    let Some(target) = command.moved_to() else {
        return false;
    };
    let to = &target.position;
    let Command::Arc { circle, .. } = command else {
        return is_outside(settings, to);
    };
    is_outside(settings, from)
        || is_outside(settings, to)
        || match TiltedArc::of(command, from, settings) {
            Some(arc) => !arc.extremes_satisfy(|point| is_nearly_inside(settings, point)),
            None => arc_leaves(settings, from, to, circle),
        }
}

/// A coordinate outside the travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutsideTravel {
    /// The axis.
    pub axis: usize,
    /// Its coordinate.
    pub position: Nm,
}

impl OutsideTravel {
    fn of(settings: &Settings, axis: usize, position: Nm) -> Option<Self> {
        is_axis_outside(settings, axis, position).then_some(Self { axis, position })
    }

    /// Returns the first coordinate of a position that is outside the travel.
    #[must_use]
    pub fn at(settings: &Settings, position: &Axes<Nm>) -> Option<Self> {
        (0..AXES).find_map(|axis| Self::of(settings, axis, position[axis]))
    }

    /// Returns a coordinate for which [`leaves_travel`] is true: of an end, or where an arc is farthest out. For
    /// tools that show the reason; the firmware itself needs none.
    #[must_use]
    pub fn on_path(settings: &Settings, from: &Axes<Nm>, command: &Command) -> Option<Self> {
        if !leaves_travel(settings, from, command) {
            return None;
        }
        let to = command.moved_to()?.position;
        let Command::Arc { circle, .. } = command else {
            return Self::at(settings, &to);
        };
        let ends = [*from, to];
        let of_end = ends.iter().find_map(|end| Self::at(settings, end));
        of_end.or_else(|| {
            Self::between_ends(
                settings,
                ends,
                circle,
                TiltedArc::of(command, from, settings),
            )
        })
    }

    /// Returns the coordinate of an arc where it is farthest out.
    fn between_ends(
        settings: &Settings,
        [from, to]: [Axes<Nm>; 2],
        circle: &Circle,
        tilted: Option<TiltedArc>,
    ) -> Option<Self> {
        if let Some(arc) = tilted {
            let found = Cell::new(None);
            let _ = arc.extremes_satisfy(|point| {
                found.set(Self::at(settings, point));
                found.get().is_none()
            });
            return found.get();
        }
        let arc = arc_between(&from, &to, circle);
        (0..4).find_map(|quadrant| {
            let (axis, position) = extreme(&arc, &from, circle, quadrant)?;
            Self::of(settings, axis, position)
        })
    }
}

/// Returns true if a position is outside the travel.
#[must_use]
pub fn is_outside(settings: &Settings, position: &Axes<Nm>) -> bool {
    (0..AXES).any(|axis| is_axis_outside(settings, axis, position[axis]))
}

/// Returns true if a position of an axis is outside the travel.
#[must_use]
pub fn is_axis_outside(settings: &Settings, axis: usize, position: Nm) -> bool {
    let travel = settings.travel(axis);
    travel.is_some_and(|[lowest, highest]| position < lowest || position > highest)
}

/// Returns true if a computed position is inside the travel, as far as it is exact.
fn is_nearly_inside(settings: &Settings, position: &Axes<Nm>) -> bool {
    (0..AXES).all(|axis| {
        let Some([lowest, highest]) = settings.travel(axis) else {
            return true;
        };
        let position = position[axis].0;
        position <= highest.0 + EXTREME_ERROR_NM && position >= lowest.0 - EXTREME_ERROR_NM
    })
}

/// Returns true if an arc whose ends are inside the travel has a part that is outside.
fn arc_leaves(settings: &Settings, from: &Axes<Nm>, to: &Axes<Nm>, circle: &Circle) -> bool {
    let arc = arc_between(from, to, circle);
    (0_u8..4).any(|quadrant| {
        let Some((axis, position)) = extreme(&arc, from, circle, quadrant) else {
            return false;
        };
        let Some([lowest, highest]) = settings.travel(axis) else {
            return false;
        };
        if quadrant < 2 {
            position.0 > highest.0 + EXTREME_ERROR_NM
        } else {
            position.0 < lowest.0 - EXTREME_ERROR_NM
        }
    })
}

fn arc_between(from: &Axes<Nm>, to: &Axes<Nm>, circle: &Circle) -> Arc {
    let (first, second, _) = circle.plane.axes();
    Arc::new(circle, [to[first] - from[first], to[second] - from[second]])
}

/// Returns the axis along which an arc is farthest out in a direction, counted in quarters of a turn, and its
/// coordinate there; `None` where an end is the farthest point.
fn extreme(arc: &Arc, from: &Axes<Nm>, circle: &Circle, quadrant: u8) -> Option<(usize, Nm)> {
    let (first, second, _) = circle.plane.axes();
    let (axis, centre) = if quadrant & 1 == 0 {
        (first, from[first] + circle.centre[0])
    } else {
        (second, from[second] + circle.centre[1])
    };
    let radius = Nm::from_mm_f64(arc.extreme_mm(f64::from(quadrant) * FRAC_PI_2)?).0;
    let position = if quadrant < 2 {
        centre.0.saturating_add(radius)
    } else {
        centre.0.saturating_sub(radius)
    };
    Some((axis, Nm(position)))
}

#[cfg(test)]
mod tests {
    use core::f64::consts::TAU;

    use proptest::prelude::*;

    use super::*;
    use crate::model::{FeedRate, Plane, Rotation};

    fn machine() -> Settings {
        Settings::default()
    }

    fn at(x: f64, y: f64) -> Axes<Nm> {
        Axes::from_fn(|axis| match axis {
            0 => Nm::from_mm_f64(x),
            1 => Nm::from_mm_f64(y),
            _ => Nm(0),
        })
    }

    fn arc(rotation: Rotation, centre: [f64; 2], to: Axes<Nm>, turns: u16) -> Command {
        Command::Arc {
            target: to.into(),
            circle: Circle {
                plane: Plane::Xy,
                centre: centre.map(Nm::from_mm_f64),
                rotation,
                turns,
                tilt: crate::units::MicroDegrees::ZERO,
            },
            feed_rate: FeedRate::Feed(100.0),
            line: 0,
        }
    }

    #[test]
    fn an_end_outside_the_travel_is_found() {
        let line = |target: Axes<Nm>| Command::Line {
            target: target.into(),
            feed_rate: FeedRate::Rapid,
            line: 0,
        };
        let from = at(0.0, 0.0);
        for (x, y, is_outside) in [
            (0.0, 0.0, false),
            (-200.0, -200.0, false),
            (0.000_001, 0.0, true),
            (0.0, -200.000_001, true),
        ] {
            let line = line(at(x, y));
            assert_eq!(leaves_travel(&machine(), &from, &line), is_outside);
            let axis = usize::from(y < -200.0);
            let position = at(x, y)[axis];
            let outside = is_outside.then_some(OutsideTravel { axis, position });
            assert_eq!(OutsideTravel::on_path(&machine(), &from, &line), outside);
        }
    }

    #[test]
    fn an_axis_without_travel_has_no_limits() {
        let mut free = machine();
        free.max_travel_mm[0] = 0.0;
        let from = at(0.0, 0.0);
        for (x, y, is_outside) in [
            (1000.0, 0.0, false),
            (-1000.0, -200.0, false),
            (1000.0, 0.001, true),
            (0.0, -200.001, true),
        ] {
            let line = Command::Line {
                target: at(x, y).into(),
                feed_rate: FeedRate::Rapid,
                line: 0,
            };
            assert_eq!(leaves_travel(&free, &from, &line), is_outside, "{x} {y}");
        }
        // Half of a circle whose extreme on X is outside.
        let right = arc(Rotation::Clockwise, [0.0, -20.0], at(0.0, -40.0), 1);
        assert!(!leaves_travel(&free, &from, &right));
        assert!(leaves_travel(&machine(), &from, &right));
        let above = arc(Rotation::CounterClockwise, [-20.0, 0.0], at(-40.0, 0.0), 1);
        assert!(leaves_travel(&free, &from, &above));
    }

    #[test]
    fn only_the_quadrants_that_an_arc_passes_count() {
        use Rotation::{Clockwise, CounterClockwise};
        let from = at(-10.0, -5.0);
        // Both ends 5 mm from the centre at X-5: over the top, or under the bottom.
        for (rotation, y, is_outside) in [
            (Clockwise, -5.0, false),
            (CounterClockwise, -5.0, false),
            (Clockwise, -4.999, true),
            (CounterClockwise, -4.999, false),
            (CounterClockwise, -195.0, false),
            (CounterClockwise, -195.001, true),
            (Clockwise, -195.001, false),
        ] {
            let from = at(from.0[0].to_mm_f64(), y);
            let half = arc(rotation, [5.0, 0.0], at(0.0, y), 1);
            assert_eq!(leaves_travel(&machine(), &from, &half), is_outside, "{y}");
        }
    }

    proptest! {
        #![proptest_config(crate::cases(64))]

        #[test]
        fn an_arc_is_refused_exactly_where_a_point_of_it_is_outside(
            centre in prop::array::uniform2(-40.0..0.0_f64),
            radius in 1.0..30.0_f64,
            growth in -0.4..0.4_f64,
            angles in prop::array::uniform2(0.0..TAU),
            turns in 1_u16..4,
            clockwise: bool,
        ) {
            let point = |r: f64, angle: f64| at(centre[0] + r * angle.cos(), centre[1] + r * angle.sin());
            let (from, to) = (point(radius, angles[0]), point(radius + growth, angles[1]));
            let rotation = if clockwise { Rotation::Clockwise } else { Rotation::CounterClockwise };
            let offset = [centre[0] - from[0].to_mm_f64(), centre[1] - from[1].to_mm_f64()];
            let command = arc(rotation, offset, to, turns);
            let Command::Arc { circle, .. } = command else { unreachable!() };
            let spiral = Arc::new(&circle, [to[0] - from[0], to[1] - from[1]]);
            // The largest violation among many points, mm.
            let mut worst = f64::MIN;
            for part in 0..=20_000 {
                let angle = spiral.sweep * f64::from(part) / 20_000.0;
                let r = spiral.radius[0] + spiral.growth() * angle;
                let x = centre[0] + r * (spiral.start + angle).cos();
                let y = centre[1] + r * (spiral.start + angle).sin();
                worst = worst.max(x).max(y).max(-200.0 - x).max(-200.0 - y);
            }
            let leaves = leaves_travel(&machine(), &from, &command);
            prop_assert!(leaves || worst < 1.0e-5, "{worst} mm");
            prop_assert!(!leaves || worst > -1.0e-4, "{worst} mm");
            // The coordinate that is shown is on the arc, and as far out as an axis gets.
            let outside = OutsideTravel::on_path(&machine(), &from, &command);
            prop_assert_eq!(outside.is_some(), leaves);
            if let Some(OutsideTravel { axis, position }) = outside {
                let mm = position.to_mm_f64();
                let excess = mm.max(-200.0 - mm);
                prop_assert!(axis < 2 && excess > 0.0 && excess < worst + 1.0e-4, "{axis} {mm}: {worst}");
            }
        }
    }
}
