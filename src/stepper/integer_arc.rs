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

/// Which of the steps is taken at a deviation D.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StepRule {
    /// Inwards for D ≥ 0. The radius is off by at most 1 step. Not for a radius of 1, on which it never
    /// leaves the first axis.
    Sign,
    /// That which leaves the smaller deviation, outwards if they are equal. The radius is off by at most
    /// √2/2 steps.
    LeastDeviation,
    /// The same, with the step of both axes at once as a third choice. The radius is off by at most half a
    /// step.
    EightDirections,
}

/// One step of one axis, or of both at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnitStep {
    /// 1, -1 or 0 for the first and the second axis of the plane.
    pub signs: [i32; 2],
    /// Twice the area between the step and the centre, steps².
    pub area: i64,
    /// One of the last steps, which lead straight to the end.
    pub is_straight: bool,
}

/// What a step does to the radius.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Choice {
    Inwards,
    Outwards,
    Both,
}

/// The steps of an arc, which ends exactly where it shall.
///
/// The arc is turned so that it lies in the first quadrant, counter-clockwise: u falls and w grows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IntegerArc {
    u: i32,
    w: i32,
    deviation: i32,
    /// The end in its quadrant.
    end: [i32; 2],
    /// Changes of quadrant up to the end.
    quadrants_left: u32,
    rule: StepRule,
    /// Quarters of a turn by which it is turned, 0 to 3.
    quadrant: u8,
    is_mirrored: bool,
}

impl IntegerArc {
    /// Returns the steps from a place to another one, relative to the centre; `turns` as in
    /// [`Circle`](crate::model::Circle), 1 for an arc of at most a full circle.
    ///
    /// `None` for a start in the centre, and where the rule does not end: [`StepRule::Sign`] at a radius of
    /// 1. Coordinates are at most 2²⁸ steps: no deviation is more than twice that then.
    #[must_use]
    pub fn new(
        start: [i32; 2],
        end: [i32; 2],
        rotation: Rotation,
        turns: u16,
        rule: StepRule,
    ) -> Option<Self> {
        let is_mirrored = rotation == Rotation::Clockwise;
        let upright = |[x, y]: [i32; 2]| [x, if is_mirrored { -y } else { y }];
        let (from, to) = (upright(start), upright(end));
        let product = |a: i32, b: i32| i64::from(a) * i64::from(b);
        let radius_sqr = product(from[0], from[0]) + product(from[1], from[1]);
        if radius_sqr == 0 || rule == StepRule::Sign && radius_sqr == 1 {
            return None;
        }
        let (first, last) = (quadrant_entered(from), quadrant_left(to));
        let mut quadrants = (last + 4 - first) % 4;
        let is_past_end = product(from[0], to[1]) <= product(from[1], to[0]);
        if quadrants == 0 && is_past_end {
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
            quadrants_left: u32::from(quadrants) + 4 * u32::from(turns.saturating_sub(1)),
            end: turned_back(to, last),
        })
    }

    /// Returns the next step of the rule.
    fn choice(&self) -> Choice {
        let (u, w) = (self.u, self.w);
        let is_inwards = match self.rule {
            StepRule::Sign => self.deviation >= 0,
            // |D + 1 - 2u| < |D + 1 + 2w|, as D lies between them.
            StepRule::LeastDeviation | StepRule::EightDirections => self.deviation + w - u + 1 > 0,
        };
        let single = if is_inwards {
            self.deviation + 1 - 2 * u
        } else {
            self.deviation + 1 + 2 * w
        };
        let both = self.deviation + 2 * (w - u + 1);
        if self.rule == StepRule::EightDirections && both.abs() < single.abs() {
            Choice::Both
        } else if is_inwards {
            Choice::Inwards
        } else {
            Choice::Outwards
        }
    }

    /// Steps along the arc, perhaps into the next quadrant.
    fn step(&mut self, choice: Choice) -> UnitStep {
        let (inwards, outwards) = match choice {
            Choice::Inwards => (-1, 0),
            Choice::Outwards => (0, 1),
            Choice::Both => (-1, 1),
        };
        let step = self.unit_step([inwards, outwards], false);
        if inwards != 0 {
            self.deviation += 1 - 2 * self.u;
        }
        if outwards != 0 {
            self.deviation += 1 + 2 * self.w;
        }
        self.u += inwards;
        self.w += outwards;
        if self.u == 0 && self.quadrants_left > 0 {
            self.quadrants_left -= 1;
            self.quadrant = (self.quadrant + 1) % 4;
            (self.u, self.w) = (self.w, 0);
        }
        step
    }

    /// Steps along one coordinate towards the end, off the arc.
    fn step_straight(&mut self, is_along_u: bool) -> UnitStep {
        let [end_u, end_w] = self.end;
        let signs = if is_along_u {
            [(end_u - self.u).signum(), 0]
        } else {
            [0, (end_w - self.w).signum()]
        };
        let step = self.unit_step(signs, true);
        self.u += signs[0];
        self.w += signs[1];
        step
    }

    /// Returns a step of the coordinates of the turned arc as that of the axes.
    fn unit_step(&self, [u, w]: [i32; 2], is_straight: bool) -> UnitStep {
        let area = self.u * w - self.w * u;
        let [x, y] = match self.quadrant {
            0 => [u, w],
            1 => [-w, u],
            2 => [-u, -w],
            _ => [w, -u],
        };
        UnitStep {
            signs: [x, if self.is_mirrored { -y } else { y }],
            area: i64::from(area.abs()),
            is_straight,
        }
    }

    /// Takes the next step, if there is one.
    pub fn take_step(&mut self) -> Option<UnitStep> {
        let choice = self.choice();
        if self.quadrants_left == 0 {
            let [end_u, end_w] = self.end;
            if self.u == end_u {
                return (self.w != end_w).then(|| self.step_straight(false));
            }
            // The next step would leave the last quadrant.
            let is_end = choice == Choice::Both && end_u == 0 && self.w + 1 == end_w;
            let leaves = choice != Choice::Outwards && self.u == 1 && !is_end;
            if self.w == end_w || leaves {
                return Some(self.step_straight(self.w == end_w));
            }
        }
        Some(self.step(choice))
    }
}

#[expect(
    clippy::copy_iterator,
    reason = "a block has the arc, and the executor a copy of it"
)]
impl Iterator for IntegerArc {
    type Item = UnitStep;

    fn next(&mut self) -> Option<UnitStep> {
        self.take_step()
    }
}

/// Returns the quadrant that is entered at a place, counter-clockwise, 0 to 3.
const fn quadrant_entered([x, y]: [i32; 2]) -> u8 {
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
const fn quadrant_left([x, y]: [i32; 2]) -> u8 {
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
const fn turned_back([x, y]: [i32; 2], quarters: u8) -> [i32; 2] {
    match quarters {
        0 => [x, y],
        1 => [y, -x],
        2 => [-x, -y],
        _ => [-y, x],
    }
}
