//! The arc that touches two curves of a plane beside the corner where they meet.
//!
//! Coordinates are relative to the corner. A curve is a line or a circle through it, with a unit tangent t along the
//! path, a unit normal n to its left and a curvature κ, positive to the left. Points p at a distance d to its left are a
//! line or a circle around the same centre:
//!
//! ```text
//! n·p - κ|p|²/2 = d - κd²/2
//! ```
//!
//! The centre of an arc of radius r has the distance d = r or -r from both curves. With q = (|p|² - d²)/2, half of the
//! corner's power with respect to the arc, both equations are n·p = d + κq, so that p = d·A + q·B; and |p|² = d² + 2q is
//! left for q:
//!
//! ```text
//! |B|²q² - 2(1 - d A·B)q + d²(|A|² - 1) = 0
//! ```
//!
//! The smaller root is the one that grows from the corner with r. The arc touches a curve at (p - d·n)/(1 - κd).
//!
//! # Deviation
//!
//! From the touching point to the corner, the distance of a curve from p grows from r to |p|, and its direction from p turns
//! towards the corner as long as n·(p - c) = d + κq has the sign of d at the corner. So there is a point of the path in each
//! direction from the arc's centre, between the arc and the circle through the corner: |p| - r is the greatest distance
//! between the two, in either direction, on whichever side the curves are bent.

/// Least cos² of half the angle at the corner, and of half the angle of the arc: 176°, as between lines.
const MIN_COSINE_SQR: f64 = 1.0e-3;
/// Least sine of the angle at the corner: curves at a smaller one pass into each other without a corner.
const MIN_SINE: f64 = 1.0e-4;
/// Halvings of the interval of the radius: to a millionth of the greatest one.
const HALVINGS: u32 = 20;

type Point = [f64; 2];

/// A line or a circle through the corner, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaneCurve {
    /// Unit tangent at the corner, along the path.
    pub(super) tangent: Point,
    /// Curvature, 1/mm, positive to the left.
    pub(super) curvature: f64,
    /// Most that may be trimmed, mm: less than half a turn.
    pub(super) most_mm: f64,
}

impl PlaneCurve {
    fn normal(&self) -> Point {
        [-self.tangent[1], self.tangent[0]]
    }

    /// Returns the square of the chord of what may be trimmed, mm².
    fn most_chord_sqr(&self) -> f64 {
        let curvature = libm::fabs(self.curvature);
        let chord_mm = if curvature > 0.0 {
            2.0 / curvature * libm::sin(0.5 * curvature * self.most_mm)
        } else {
            self.most_mm
        };
        chord_mm * chord_mm
    }

    /// Returns the distance of a point of the curve from the corner along the curve, mm.
    fn distance_mm(&self, point: &Point) -> f64 {
        let along = dot(point, &self.tangent);
        let across = dot(point, &self.normal());
        let curvature = self.curvature;
        if libm::fabs(curvature) > 0.0 {
            libm::fabs(libm::atan2(curvature * along, 1.0 - curvature * across) / curvature)
        } else {
            libm::fabs(along)
        }
    }
}

/// An arc that touches two curves, in coordinates relative to their corner, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fillet {
    pub(super) radius_mm: f64,
    pub(super) centre: Point,
    /// Where it touches the curve before the corner and the curve after it.
    pub(super) ends: [Point; 2],
    /// Greatest distance from the path through the corner, mm, in either direction.
    pub(super) deviation_mm: f64,
    /// True for an arc to the left.
    pub(super) is_left: bool,
}

impl Fillet {
    /// Returns the unit vector from the centre to an end.
    pub(super) fn radial(&self, end: usize) -> Point {
        let [x, y] = difference(&self.ends[end], &self.centre);
        [x / self.radius_mm, y / self.radius_mm]
    }

    /// Returns the direction of the path at an end.
    pub(super) fn tangent(&self, end: usize) -> Point {
        let [x, y] = self.radial(end);
        if self.is_left { [-y, x] } else { [y, -x] }
    }

    /// Returns the angle travelled, rad.
    pub(super) fn sweep_rad(&self) -> f64 {
        let radials = [self.radial(0), self.radial(1)];
        libm::fabs(libm::atan2(
            cross(&radials[0], &radials[1]),
            dot(&radials[0], &radials[1]),
        ))
    }
}

/// Two curves that meet at a corner.
pub(super) struct PlaneCorner {
    curves: [PlaneCurve; 2],
    most_chords_sqr: [f64; 2],
    /// 1 for a corner to the left, -1 for one to the right.
    side: f64,
    /// A and B: the centre is at d·A + q·B.
    per_distance: Point,
    per_half_power: Point,
    /// |A|² - 1: the square of the tangent of half the angle.
    half_tangent_sqr: f64,
}

impl PlaneCorner {
    /// The corner of a curve before and a curve after it; `None` for no corner, and for a reversal.
    pub(super) fn new(curves: [PlaneCurve; 2]) -> Option<Self> {
        let [before, after] = curves.map(|curve| curve.tangent);
        let sine = cross(&before, &after);
        let versed = 1.0 + dot(&before, &after);
        if versed < 2.0 * MIN_COSINE_SQR || libm::fabs(sine) < MIN_SINE {
            return None;
        }
        let normals = curves.map(|curve| curve.normal());
        let [of_before, of_after] = curves.map(|curve| curve.curvature);
        let half_tangent = sine / versed;
        Some(Self {
            curves,
            most_chords_sqr: curves.map(|curve| curve.most_chord_sqr()),
            side: if sine > 0.0 { 1.0 } else { -1.0 },
            per_distance: [0, 1].map(|n| (normals[0][n] + normals[1][n]) / versed),
            per_half_power: [0, 1].map(|n| (of_before * after[n] - of_after * before[n]) / sine),
            half_tangent_sqr: half_tangent * half_tangent,
        })
    }

    /// Returns the widest arc found that is within a distance of the path and has no greater radius than `most_mm`.
    pub(super) fn widest(&self, allowed_mm: f64, most_mm: f64) -> Option<Fillet> {
        let fitting = |radius_mm: f64| {
            let fillet = self.touching(radius_mm)?;
            (fillet.deviation_mm <= allowed_mm).then_some(fillet)
        };
        let mut found = fitting(most_mm);
        if found.is_some() {
            return found;
        }
        let (mut least_mm, mut most_mm) = (0.0, most_mm);
        for _ in 0..HALVINGS {
            let radius_mm = 0.5 * (least_mm + most_mm);
            let fillet = fitting(radius_mm);
            if fillet.is_some() {
                found = fillet;
                least_mm = radius_mm;
            } else {
                most_mm = radius_mm;
            }
        }
        found
    }

    /// Returns the arc of a radius; `None` where no such arc touches both curves on what may be trimmed of them, or where
    /// its deviation is not that from the corner.
    fn touching(&self, radius_mm: f64) -> Option<Fillet> {
        let distance_mm = self.side * radius_mm;
        let (per_distance, per_half_power) = (&self.per_distance, &self.per_half_power);
        let linear = 1.0 - distance_mm * dot(per_distance, per_half_power);
        let constant = distance_mm * distance_mm * self.half_tangent_sqr;
        let discriminant = linear * linear - constant * dot(per_half_power, per_half_power);
        if linear <= 0.0 || discriminant < 0.0 {
            return None;
        }
        let half_power = constant / (linear + libm::sqrt(discriminant));
        let centre = [0, 1].map(|n| distance_mm * per_distance[n] + half_power * per_half_power[n]);
        let ends = [
            self.touched(0, &centre, radius_mm, half_power)?,
            self.touched(1, &centre, radius_mm, half_power)?,
        ];
        let fillet = Fillet {
            radius_mm,
            centre,
            ends,
            deviation_mm: 2.0 * half_power
                / (libm::sqrt(radius_mm * radius_mm + 2.0 * half_power) + radius_mm),
            is_left: self.side > 0.0,
        };
        let radials = [fillet.radial(0), fillet.radial(1)];
        let is_forward = self.side * cross(&radials[0], &radials[1]) > 0.0
            && dot(&radials[0], &radials[1]) > 2.0 * MIN_COSINE_SQR - 1.0;
        is_forward.then_some(fillet)
    }

    /// Returns where an arc of a radius touches one of the curves.
    fn touched(
        &self,
        number: usize,
        centre: &Point,
        radius_mm: f64,
        half_power: f64,
    ) -> Option<Point> {
        let curve = &self.curves[number];
        let inwards = self.side * curve.curvature;
        let ratio = 1.0 - inwards * radius_mm;
        if ratio <= 0.0 || radius_mm + inwards * half_power <= 0.0 {
            return None;
        }
        let normal = curve.normal();
        let point = [0, 1].map(|n| (centre[n] - self.side * radius_mm * normal[n]) / ratio);
        let along = dot(&point, &curve.tangent);
        let is_on_path = if number == 0 {
            along < 0.0
        } else {
            along > 0.0
        };
        (is_on_path && dot(&point, &point) <= self.most_chords_sqr[number]).then_some(point)
    }

    /// Returns what an arc trims of the two curves, mm.
    pub(super) fn trimmed_mm(&self, fillet: &Fillet) -> [f64; 2] {
        [0, 1].map(|end| self.curves[end].distance_mm(&fillet.ends[end]))
    }
}

fn dot(a: &Point, b: &Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn cross(a: &Point, b: &Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn difference(a: &Point, b: &Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A quarter turn to the left, between curves that may be trimmed by 5 mm.
    fn corner(curvatures: [f64; 2]) -> PlaneCorner {
        let tangents = [[1.0, 0.0], [0.0, 1.0]];
        PlaneCorner::new([0, 1].map(|n| PlaneCurve {
            tangent: tangents[n],
            curvature: curvatures[n],
            most_mm: 5.0,
        }))
        .unwrap()
    }

    #[test]
    fn between_lines_it_is_the_arc_of_half_the_angle() {
        let corner = corner([0.0; 2]);
        let fillet = corner.touching(1.0).unwrap();
        assert!((fillet.deviation_mm - (2.0_f64.sqrt() - 1.0)).abs() < 1.0e-12);
        assert!((corner.trimmed_mm(&fillet)[0] - 1.0).abs() < 1.0e-12);
        assert!((fillet.sweep_rad() - core::f64::consts::FRAC_PI_2).abs() < 1.0e-12);
    }

    #[test]
    fn it_touches_both_curves_in_their_directions_however_they_are_bent() {
        for before in [-0.5, -0.02, 0.0, 0.04, 0.3] {
            for after in [-0.4, -0.01, 0.0, 0.05, 0.6] {
                let corner = corner([before, after]);
                for radius_mm in [0.001, 0.03, 0.4] {
                    let fillet = corner.touching(radius_mm).unwrap();
                    let trimmed_mm = corner.trimmed_mm(&fillet);
                    for (end, (curve, sign)) in corner.curves.iter().zip([-1.0, 1.0]).enumerate() {
                        let angle = sign * trimmed_mm[end] * curve.curvature;
                        let [t, n] = [curve.tangent, curve.normal()];
                        let tangent = [0, 1].map(|k| t[k] * angle.cos() + n[k] * angle.sin());
                        let off = difference(&tangent, &fillet.tangent(end));
                        assert!(
                            dot(&off, &off).sqrt() < 1.0e-9,
                            "{before} {after} {radius_mm}"
                        );
                        // n·p - κ|p|²/2 is 0 on the curve.
                        let point = &fillet.ends[end];
                        let off_mm = dot(&n, point) - 0.5 * curve.curvature * dot(point, point);
                        assert!(off_mm.abs() < 1.0e-12, "{before} {after} {radius_mm}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_widest_one_uses_the_distance_or_what_may_be_trimmed() {
        for curvatures in [[0.1, -0.1], [-0.1, 0.0], [0.0, 0.1]] {
            let corner = corner(curvatures);
            let fillet = corner.widest(0.05, 100.0).unwrap();
            assert!((fillet.deviation_mm - 0.05).abs() < 1.0e-4);
            let fillet = corner.widest(10.0, 100.0).unwrap();
            let most_mm = corner.trimmed_mm(&fillet).into_iter().fold(0.0, f64::max);
            assert!((most_mm - 5.0).abs() < 0.01, "{curvatures:?}: {most_mm}");
        }
    }
}
