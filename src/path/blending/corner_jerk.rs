//! Whether an arc in the place of a corner is faster within limits of jerk.
//!
//! An acceleration is there after the ramp time T then, and the time of a corner depends on all moves from which the machine
//! brakes. So an arc is in the place of a corner only if the machine is ahead on it in each motion:
//!
//! ```text
//!  speed of a motion ──╮                    ╭──      Wherever the motion on the exact path begins to brake, the other
//!                   ╲   ╲── arc ─────────╱ ╱         one brakes later: for each speed that a move may come to,
//!                    ╲                    ╱          distance to the arc's speed + trimmed ≤ distance to that of
//!                     ╰──── corner ─────╯            the corner.
//! ```
//!
//! The arc has a part of the acceleration left along the path, with which the moves before it may have to brake, too. So on
//! both sides there is space to come to the arc's speed from a standstill with that part, whatever the other ends of the moves
//! are: no motion has to change its speed on the arc.

use super::corner_time::CornerSide;
use crate::math;

/// Speeds of a move that are tried, above that of the arc.
const SPEEDS: u32 = 4;

/// An arc of a corner, within limits of jerk.
pub(super) struct JerkLimitedArc {
    pub(super) speed_mm_s: f32,
    /// Acceleration along the arc, mm/s².
    pub(super) acceleration_mm_s2: f32,
    /// What the arc trims of each move, mm.
    pub(super) trimmed_mm: [f32; 2],
    pub(super) ramp_s: f32,
}

impl JerkLimitedArc {
    /// Returns the distance to a standstill, or from one, that has to be left of each move, mm.
    pub(super) fn stopping_mm(&self) -> f32 {
        distance_mm(self.speed_mm_s, 0.0, self.acceleration_mm_s2, self.ramp_s)
    }

    /// Returns whether no motion over the corner at a speed is faster.
    pub(super) fn is_ahead(&self, sides: &[CornerSide; 2], corner_mm_s: f32) -> bool {
        let arc_mm_s = self.speed_mm_s;
        let [of_arc, ramp_s] = [self.acceleration_mm_s2, self.ramp_s];
        { sides.iter() }.enumerate().all(|(number, side)| {
            let part_mm_s =
                math::max(side.speed_mm_s - arc_mm_s, 0.0) * (1.0 / (SPEEDS - 1) as f32);
            let is_later = |speed: u32| {
                let from_mm_s = arc_mm_s + speed as f32 * part_mm_s;
                let to_arc_mm = distance_mm(from_mm_s, arc_mm_s, of_arc, ramp_s);
                let of_move = side.acceleration_mm_s2;
                let to_corner_mm = distance_mm(from_mm_s, corner_mm_s, of_move, ramp_s);
                to_arc_mm + self.trimmed_mm[number] <= to_corner_mm
            };
            (0..SPEEDS).all(is_later)
        })
    }
}

/// Returns the distance between two speeds without an acceleration at both, the first one the higher, mm.
fn distance_mm(from_mm_s: f32, to_mm_s: f32, acceleration_mm_s2: f32, ramp_s: f32) -> f32 {
    let change_s = (from_mm_s - to_mm_s) / acceleration_mm_s2;
    let half_s = if change_s <= ramp_s {
        math::sqrt(change_s * ramp_s)
    } else {
        0.5 * (change_s + ramp_s)
    };
    (from_mm_s + to_mm_s) * half_s
}
