//! What comes before a command on a machine with backlash: taking it up, and the parts of an arc up to its last reversal.

use super::Router;
use crate::{
    axis::{AXES, Axes, LINEAR},
    model::{Command, FeedRate, Target},
    path::{BlendOutput, TakeUp, Work, arc::Arc},
    settings::Settings,
    units::Nm,
};

/// Most parts of an arc up to a part that makes a step: an arc has four reversals in a turn, so after five parts
/// without a step the whole arc goes at once.
const MAX_PARTS_WITHOUT_STEPS: usize = 6;

/// The directions in which the axes with backlash have moved last, bit 0 = X.
#[derive(Debug)]
pub(super) struct LastDirections {
    axes: u8,
    positive: u8,
    negative: u8,
}

impl LastDirections {
    /// Nothing is known: then [`TakeUp`] may find nothing to do.
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            axes: settings.backlash_axes(),
            positive: 0,
            negative: 0,
        }
    }

    /// Forgets them: motions may have ended early.
    pub(super) const fn forget(&mut self) {
        (self.positive, self.negative) = (0, 0);
    }

    /// Returns whether an axis has backlash.
    pub(super) const fn has(&self, axis: usize) -> bool {
        self.axes >> axis & 1 != 0
    }

    /// Notes a move. Returns the axes with backlash that have not moved in its direction last, if there are any.
    fn move_by(&mut self, steps: &Axes<i32>) -> Option<TakeUp> {
        let mut moving = TakeUp::default();
        for axis in 0..AXES {
            let bit = self.axes & 1 << axis;
            match steps[axis] {
                0 => {}
                1.. => moving.positive |= bit,
                ..0 => moving.negative |= bit,
            }
        }
        let reversing = TakeUp {
            positive: moving.positive & !self.positive,
            negative: moving.negative & !self.negative,
            is_jog: false,
        };
        self.positive = self.positive & !moving.negative | moving.positive;
        self.negative = self.negative & !moving.positive | moving.negative;
        (reversing != TakeUp::default()).then_some(reversing)
    }
}

impl Router {
    /// Returns whether an axis has backlash, so that [`Self::work_before`] may have something.
    #[inline]
    #[must_use]
    pub const fn has_backlash(&self) -> bool {
        self.last_directions.axes != 0
    }

    /// Returns the next work that comes before the work of a command; `None` when no more comes before. Then
    /// [`Self::take_remainder`] has the rest of the command.
    #[inline]
    pub fn work_before(&mut self, command: &Command) -> Option<Work> {
        if self.has_backlash() {
            self.next_before(command)
        } else {
            None
        }
    }

    /// As [`Self::work_before`], for an output of the blender.
    pub fn work_before_blended(&mut self, output: &BlendOutput) -> Option<Work> {
        match output {
            BlendOutput::Command(command) => self.work_before(command),
            BlendOutput::CornerArc(arc) => self.take_up_before(&arc.target.into(), arc.feed_rate),
        }
    }

    /// Returns whether something has been made of a command, and what is left of it has not.
    #[inline]
    #[must_use]
    pub const fn is_within_command(&self) -> bool {
        self.remainder.is_some()
    }

    /// Takes what is left of a command of which something has been made.
    #[inline]
    pub const fn take_remainder(&mut self) -> Option<Command> {
        self.remainder.take()
    }

    #[inline(never)]
    fn next_before(&mut self, command: &Command) -> Option<Work> {
        let mut command = self.remainder.take().unwrap_or(*command);
        let mut work = None;
        for _ in 0..MAX_PARTS_WITHOUT_STEPS {
            let parts = self.at_reversal(&command);
            let next = parts.map_or(command, |[part, _]| part);
            let (Command::Line {
                target, feed_rate, ..
            }
            | Command::Arc {
                target, feed_rate, ..
            }
            | Command::Probe {
                target, feed_rate, ..
            }) = next
            else {
                return None;
            };
            work = self.take_up_before(&target, feed_rate);
            let (None, Some([part, remainder])) = (work, parts) else {
                break;
            };
            work = self.route_to(&part, |work| work);
            command = remainder;
            if work.is_some() {
                break;
            }
        }
        self.remainder = Some(command);
        work
    }

    /// Returns what takes up backlash before a move to a target, where that may be due.
    fn take_up_before(&mut self, target: &Target, feed_rate: FeedRate) -> Option<Work> {
        let end = self.block_end(target);
        let steps = end
            .steps
            .zip(self.at.steps, |to, from| to.0.wrapping_sub(from.0));
        let reversing = self.last_directions.move_by(&steps)?;
        let is_jog = matches!(feed_rate, FeedRate::Jog(_));
        Some(Work::TakeUp(TakeUp {
            is_jog,
            ..reversing
        }))
    }

    /// Returns the part of an arc up to where an axis with backlash reverses first, and the remainder; `None` for other
    /// commands, and where no such axis does.
    fn at_reversal(&self, command: &Command) -> Option<[Command; 2]> {
        let Command::Arc {
            target,
            circle,
            feed_rate,
            line,
        } = *command
        else {
            return None;
        };
        let (first, second, _) = circle.plane.axes();
        let axes = [first, second];
        let displacement = target.position.zip(self.at.position, |to, from| to - from);
        let arc = Arc::new(&circle, axes.map(|axis| displacement[axis]));
        let angle = arc.first_reversal(axes.map(|axis| self.last_directions.has(axis)))?;
        let part = angle / arc.sweep;
        let mut moved = displacement.map(|along| Nm::from_mm_f64(along.to_mm_f64() * part));
        let radius = arc.radius[0] + arc.growth() * angle;
        let (sine, cosine) = libm::sincos(arc.start + angle);
        moved[first] = circle.centre[0] + Nm::from_mm_f64(radius * cosine);
        moved[second] = circle.centre[1] + Nm::from_mm_f64(radius * sine);
        let mut of_remainder = circle;
        of_remainder.centre = [0, 1].map(|axis| circle.centre[axis] - moved[axes[axis]]);
        of_remainder.turns = 1;
        let to_target = axes.map(|axis| displacement[axis] - moved[axis]);
        let one_turn = Arc::new(&of_remainder, to_target).sweep;
        // The end may be a nm before the beginning or behind it.
        let turns = (arc.sweep - angle - one_turn) / core::f64::consts::TAU;
        of_remainder.turns += libm::round(libm::fabs(turns)) as u16;
        let mut of_part = circle;
        of_part.turns = 1;
        let feed_rate = match feed_rate {
            FeedRate::InverseTime(per_min) => {
                let others = (0..LINEAR).filter(|axis| !axes.contains(axis));
                let others_sqr = others.map(|axis| {
                    let mm = displacement[axis].to_mm_f64();
                    mm * mm
                });
                let plane_mm = arc.length_mm();
                let length_mm = libm::sqrt(plane_mm * plane_mm + others_sqr.sum::<f64>());
                FeedRate::Feed(length_mm as f32 * per_min)
            }
            FeedRate::Rapid | FeedRate::Feed(_) | FeedRate::Jog(_) => feed_rate,
        };
        let arc_to = |target, circle| Command::Arc {
            target,
            circle,
            feed_rate,
            line,
        };
        let middle = self.at.position.zip(moved, |from, moved| from + moved);
        Some([arc_to(middle.into(), of_part), arc_to(target, of_remainder)])
    }
}
