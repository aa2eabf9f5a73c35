//! Circular interpolation in whole steps, by the sign of a deviation: algebraic interpolation.
//!
//! Coordinates are whole steps relative to the centre, R² = x² + y² of the start. In each quadrant the
//! direction of travel leaves two steps, both along the arc: one of them reduces the radius, the other
//! increases it. The deviation D = x² + y² - R² decides, and a step changes it by 1 - 2·|u| or 1 + 2·|w| for
//! the coordinates u and w that the two steps change: additions only, no product and no root.
//!
//! Counter-clockwise, with inwards and outwards:
//!
//! ```text
//!   second quadrant  Y- X-  │  X- Y+  first quadrant
//!   ────────────────────────┼───────────────────────
//!   third quadrant   X+ Y-  │  Y+ X+  fourth quadrant
//! ```
//!
//! Clockwise is the same in the mirror. A point on an axis belongs to the quadrant that is entered.
//!
//! The steps of a motor come at even speed along the arc if each step takes the time c/(r·v), where c is
//! twice the area between the step and the centre: [`UnitStep::area`].

use crate::model::Rotation;

/// Which of the two steps is taken at a deviation D.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StepRule {
    /// Inwards for D ≥ 0. The radius is off by at most 1 step. Not for a radius of 1, on which it never
    /// leaves the first axis.
    Sign,
    /// That which leaves the smaller deviation, outwards if they are equal. The radius is off by at most
    /// √2/2 steps.
    LeastDeviation,
}

/// One step of one axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnitStep {
    /// 0 for the first axis of the plane, 1 for the second.
    pub axis: usize,
    /// 1 or -1.
    pub sign: i32,
    /// Twice the area between the step and the centre, steps².
    pub area: i64,
}

/// The steps of an arc, which ends exactly where it shall.
///
/// The arc is turned so that it lies in the first quadrant, counter-clockwise: u falls and w grows.
#[derive(Debug, Clone)]
pub struct IntegerArc {
    u: i64,
    w: i64,
    deviation: i64,
    rule: StepRule,
    /// Quarters of a turn by which it is turned, 0 to 3.
    quadrant: u8,
    is_mirrored: bool,
    /// Changes of quadrant up to the end.
    quadrants_left: u64,
    /// The end in its quadrant.
    end: [i64; 2],
}

impl IntegerArc {
    /// Returns the steps from a place to another one, relative to the centre; `turns` as in
    /// [`Circle`](crate::model::Circle), 1 for an arc of at most a full circle.
    ///
    /// `None` for a start in the centre, and where the rule does not end: [`StepRule::Sign`] at a radius of
    /// 1. Coordinates are at most 2³⁰ steps.
    #[must_use]
    pub fn new(
        start: [i32; 2],
        end: [i32; 2],
        rotation: Rotation,
        turns: u16,
        rule: StepRule,
    ) -> Option<Self> {
        let is_mirrored = rotation == Rotation::Clockwise;
        let upright = |[x, y]: [i32; 2]| {
            let (x, y) = (i64::from(x), i64::from(y));
            [x, if is_mirrored { -y } else { y }]
        };
        let (from, to) = (upright(start), upright(end));
        let radius_sqr = from[0] * from[0] + from[1] * from[1];
        if radius_sqr == 0 || rule == StepRule::Sign && radius_sqr == 1 {
            return None;
        }
        let (first, last) = (quadrant_entered(from), quadrant_left(to));
        let mut quadrants = (last + 4 - first) % 4;
        let is_behind = from[0] * to[1] - from[1] * to[0] <= 0;
        if quadrants == 0 && is_behind {
            quadrants = 4;
        }
        let [u, w] = turned_back(from, first);
        Some(Self {
            u,
            w,
            deviation: 0,
            rule,
            quadrant: first,
            is_mirrored,
            quadrants_left: u64::from(quadrants) + 4 * u64::from(turns.saturating_sub(1)),
            end: turned_back(to, last),
        })
    }

    /// Whether the next step is the one inwards.
    fn is_inwards(&self) -> bool {
        match self.rule {
            StepRule::Sign => self.deviation >= 0,
            // |D + 1 - 2u| < |D + 1 + 2w|, as D lies between them.
            StepRule::LeastDeviation => self.deviation + self.w - self.u + 1 > 0,
        }
    }

    /// Steps inwards, which may lead into the next quadrant.
    fn step_inwards(&mut self) -> UnitStep {
        let step = self.unit_step(0, -1, self.w);
        self.deviation += 1 - 2 * self.u;
        self.u -= 1;
        if self.u == 0 && self.quadrants_left > 0 {
            self.quadrants_left -= 1;
            self.quadrant = (self.quadrant + 1) % 4;
            (self.u, self.w) = (self.w, 0);
        }
        step
    }

    /// Steps outwards.
    fn step_outwards(&mut self) -> UnitStep {
        let step = self.unit_step(1, 1, self.u);
        self.deviation += 1 + 2 * self.w;
        self.w += 1;
        step
    }

    /// Steps along one coordinate towards the end, off the arc.
    fn step_straight(&mut self, coordinate: usize) -> UnitStep {
        let [end_u, end_w] = self.end;
        let (value, end, other) = if coordinate == 0 {
            (&mut self.u, end_u, self.w)
        } else {
            (&mut self.w, end_w, self.u)
        };
        let sign = if end > *value { 1 } else { -1 };
        *value += i64::from(sign);
        self.unit_step(coordinate, sign, other)
    }

    /// Returns a step of a coordinate of the turned arc as that of an axis.
    fn unit_step(&self, coordinate: usize, sign: i32, area: i64) -> UnitStep {
        let is_swapped = !self.quadrant.is_multiple_of(2);
        let axis = if is_swapped {
            1 - coordinate
        } else {
            coordinate
        };
        // u is x, y, -x, -y in the four quadrants, and w is y, -x, -y, x.
        let is_negative = match coordinate {
            0 => self.quadrant >= 2,
            _ => self.quadrant == 1 || self.quadrant == 2,
        };
        let is_turned_over = is_negative != (self.is_mirrored && axis == 1);
        UnitStep {
            axis,
            sign: if is_turned_over { -sign } else { sign },
            area,
        }
    }
}

impl Iterator for IntegerArc {
    type Item = UnitStep;

    fn next(&mut self) -> Option<UnitStep> {
        let is_inwards = self.is_inwards();
        if self.quadrants_left == 0 {
            let [end_u, end_w] = self.end;
            if self.u == end_u {
                return (self.w != end_w).then(|| self.step_straight(1));
            }
            // The next step would leave the last quadrant.
            let leaves = is_inwards && self.u == 1;
            if self.w == end_w || leaves {
                let coordinate = usize::from(self.w != end_w);
                return Some(self.step_straight(coordinate));
            }
        }
        Some(if is_inwards {
            self.step_inwards()
        } else {
            self.step_outwards()
        })
    }
}

/// Returns the quadrant that is entered at a place, counter-clockwise, 0 to 3.
const fn quadrant_entered([x, y]: [i64; 2]) -> u8 {
    if x > 0 && y >= 0 {
        0
    } else if x <= 0 && y > 0 {
        1
    } else if x < 0 {
        2
    } else {
        3
    }
}

/// Returns the quadrant that is left at a place, counter-clockwise, 0 to 3.
const fn quadrant_left([x, y]: [i64; 2]) -> u8 {
    if x >= 0 && y > 0 {
        0
    } else if x < 0 && y >= 0 {
        1
    } else if x <= 0 && y < 0 {
        2
    } else {
        3
    }
}

/// Returns a place turned back by quarters of a turn.
const fn turned_back([x, y]: [i64; 2], quarters: u8) -> [i64; 2] {
    match quarters {
        0 => [x, y],
        1 => [y, -x],
        2 => [-x, -y],
        _ => [-y, x],
    }
}
