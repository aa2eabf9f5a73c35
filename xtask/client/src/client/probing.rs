//! Probing cycles: a plate, corners, holes, bosses, the length of a tool.
//!
//! Each surface is touched twice, the second time slowly, and the place of the contact that the machine has reported
//! counts, and not that where it came to rest. Every move sideways or down is a probing move as well: a contact on
//! it ends the cycle.

use std::{collections::VecDeque, fmt::Write as _};

use leadscrew::axis::{LETTERS, X, Y, Z};
use serde::{Deserialize, Serialize};

use super::{cycle::LINEAR_AXES, jog};

/// How fast the second touch is, of the first one's feed.
const SLOWLY: f64 = 0.1;
/// How far from where it should be the machine may come to rest, mm.
const ARRIVED_MM: f64 = 0.1;
/// How much farther than back to the first contact the second touch goes, mm.
const BEYOND_MM: f64 = 1.0;

/// What is probed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "what", rename_all = "kebab-case")]
pub enum Target {
    /// The workpiece's top or a plate on it, below the tool: Z.
    Top,
    /// The length of the tool, at a surface below: against that of the reference tool.
    ToolLength {
        /// Where the reference tool touches, as machine position; without it, this tool becomes the reference.
        reference_mm: Option<f64>,
    },
    /// A corner of a workpiece, from above it: X, Y and, where it is wanted, Z.
    CornerOutside {
        /// Where the workpiece is, seen from the corner: 1 for the side of larger values, and -1.
        side: [i8; 2],
        /// The top first.
        with_top: bool,
    },
    /// A corner of a pocket, from within: X and Y.
    CornerInside {
        /// Where the walls are, seen from the tool.
        side: [i8; 2],
    },
    /// The centre of a hole, from within: X and Y.
    Hole,
    /// The centre of a boss, from above it: X and Y.
    Boss,
}

/// Tool, plate and distances, all mm, and the feed of the first touch, mm/min.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Probing {
    /// What is probed.
    pub target: Target,
    /// The diameter of the tool, or of the probe's ball.
    pub diameter: f64,
    /// The thickness of the plate on the workpiece, 0 without.
    pub plate: f64,
    /// How far a contact is looked for.
    pub search: f64,
    /// How far back after each contact.
    pub retract: f64,
    /// From where the tool is to beside the workpiece.
    pub beside: f64,
    /// How far below where the tool is a side is touched.
    pub depth: f64,
    /// The feed of the first touch.
    pub feed: f64,
}

/// A part of a cycle. Places are from where the cycle began.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Part {
    /// To a place along an axis.
    Go(usize, f64),
    /// To the middle of the last two contacts of an axis.
    Centre(usize),
    /// A surface, in a direction.
    Touch(usize, f64),
}

/// What the machine is asked for next.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Next {
    /// A line.
    Line(String),
    /// The cycle has ended: a line that sets what was found, and what the operator is to read.
    Done(String, String),
    /// The same of the reference tool, with where it has made contact.
    Reference(String, String, f64),
    /// It has ended for a reason.
    Failed(String),
}

/// A line that was sent.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Sent {
    /// A move on which nothing may be touched.
    Guarded,
    /// The first touch and the second, along an axis in a direction.
    First(usize, f64),
    Second(usize, f64),
    /// A jog along an axis to a machine position.
    Back(usize, f64),
}

/// A cycle under way.
#[derive(Debug)]
pub(super) struct Cycle {
    probing: Probing,
    start: Vec<f64>,
    parts: VecDeque<Part>,
    /// Lines of the part that is under way.
    lines: VecDeque<(Sent, String)>,
    sent: Option<Sent>,
    /// Where the touch has begun, along its axis.
    touch_start: f64,
    /// Contacts of each axis, machine positions.
    contacts: [Vec<f64>; 3],
}

impl Probing {
    /// Why it cannot begin.
    #[must_use]
    pub fn fault(&self) -> Option<String> {
        let lengths = [
            ("the diameter of the tool", self.diameter, 0.0),
            ("the thickness of the plate", self.plate, 0.0),
            ("the search", self.search, 0.1),
            ("the retract", self.retract, 0.1),
            ("the way beside the workpiece", self.beside, 0.0),
            ("the depth", self.depth, 0.0),
            ("the feed", self.feed, 1.0),
        ];
        let mut wrong = lengths
            .into_iter()
            .filter(|(_, value, least)| !(*least..1e4).contains(value));
        wrong.next().map(|(name, value, least)| {
            format!("{name} is {value}, and at least {least} is needed")
        })
    }

    fn parts(&self) -> Vec<Part> {
        use Part::{Centre, Go, Touch};
        let (beside, depth) = (self.beside, self.depth);
        match self.target {
            Target::Top | Target::ToolLength { .. } => vec![Touch(Z, -1.0)],
            Target::CornerInside { side } => {
                let axis = |axis: usize| [Touch(axis, f64::from(side[axis])), Go(axis, 0.0)];
                [X, Y].into_iter().flat_map(axis).collect()
            }
            Target::Hole => {
                let axis = |axis| {
                    [
                        Touch(axis, -1.0),
                        Go(axis, 0.0),
                        Touch(axis, 1.0),
                        Centre(axis),
                    ]
                };
                [X, Y].into_iter().flat_map(axis).collect()
            }
            Target::CornerOutside { side, with_top } => {
                let top = if with_top {
                    vec![Touch(Z, -1.0), Go(Z, 0.0)]
                } else {
                    Vec::new()
                };
                let axis = |axis: usize| {
                    let side = f64::from(side[axis]);
                    [
                        Go(axis, -side * beside),
                        Go(Z, -depth),
                        Touch(axis, side),
                        Go(Z, 0.0),
                        Go(axis, 0.0),
                    ]
                };
                top.into_iter()
                    .chain([X, Y].into_iter().flat_map(axis))
                    .collect()
            }
            Target::Boss => {
                let side = |axis, side: f64| {
                    [
                        Go(axis, side * beside),
                        Go(Z, -depth),
                        Touch(axis, -side),
                        Go(Z, 0.0),
                    ]
                };
                let axis = |axis| {
                    let sides = [-1.0, 1.0].into_iter().flat_map(move |it| side(axis, it));
                    sides.chain([Centre(axis)])
                };
                [X, Y].into_iter().flat_map(axis).collect()
            }
        }
    }

    /// The places that the tool may come to, from where it is, mm: the motion as it is shown before it begins.
    #[must_use]
    pub fn places(&self) -> Vec<[f64; 3]> {
        let mut at = [0.0; 3];
        let mut places = vec![at];
        for part in self.parts() {
            match part {
                Part::Go(axis, to) => at[axis] = to,
                Part::Centre(axis) => at[axis] = 0.0,
                Part::Touch(axis, direction) => {
                    let before = at[axis];
                    at[axis] += direction * self.search;
                    places.push(at);
                    at[axis] = before;
                }
            }
            places.push(at);
        }
        places
    }
}

/// A line of a cycle: codes, and a distance along an axis at a feed.
fn line(codes: &str, axis: usize, by: f64, feed: f64) -> String {
    let axis = char::from(LETTERS[axis]);
    format!("{codes}{axis}{by:.3}F{feed:.3}")
}

impl Cycle {
    /// A cycle from a machine position, mm.
    pub(super) fn new(probing: Probing, start: Vec<f64>) -> Self {
        Self {
            parts: probing.parts().into(),
            probing,
            start,
            lines: VecDeque::new(),
            sent: None,
            touch_start: 0.0,
            contacts: Default::default(),
        }
    }

    /// Goes on at rest at a machine position, mm, with what the last line has answered: the contact of a probing move.
    pub(super) fn next(&mut self, at: &[f64], contact: Option<(Vec<f64>, bool)>) -> Next {
        if let Err(fault) = self.take(at, contact) {
            return Next::Failed(fault);
        }
        while self.lines.is_empty() {
            let Some(part) = self.parts.pop_front() else {
                return self.finish(at);
            };
            self.begin(part, at);
        }
        match self.lines.pop_front() {
            Some((sent, line)) => {
                self.sent = Some(sent);
                Next::Line(line)
            }
            None => Next::Failed("the cycle has lost its way".into()),
        }
    }

    /// Takes the answer to the last line, with the machine at rest at a position.
    fn take(&mut self, at: &[f64], contact: Option<(Vec<f64>, bool)>) -> Result<(), String> {
        let Probing { retract, feed, .. } = self.probing;
        let touched = contact.filter(|(_, is_touched)| *is_touched);
        // It comes to rest beyond the contact, the farther the faster it was.
        // No farther back than to where the touch began: behind that something may be.
        let room =
            |axis: usize, contact: &[f64]| retract.min((contact[axis] - self.touch_start).abs());
        let back = |axis: usize, direction: f64, contact: &[f64]| {
            let beyond = (at[axis] - contact[axis]).abs();
            let by = -direction * (room(axis, contact) + beyond);
            Self::back(axis, by, at, feed)
        };
        match (self.sent.take(), touched) {
            (Some(Sent::Back(axis, target)), _) if (at[axis] - target).abs() > ARRIVED_MM => {
                Err("the machine did not move back as far as it should".into())
            }
            (None | Some(Sent::Back(..)), _) | (Some(Sent::Guarded), None) => Ok(()),
            (Some(Sent::Guarded), Some(_)) => {
                Err("the probe has touched something on its way".into())
            }
            (Some(Sent::First(axis, _) | Sent::Second(axis, _)), None) => Err(format!(
                "no contact in {}: the search is too short, or the probe is not connected",
                char::from(LETTERS[axis])
            )),
            (Some(Sent::First(axis, direction)), Some((contact, _))) => {
                let again = direction * (room(axis, &contact) + BEYOND_MM);
                let again = line("G91G21G94G38.3", axis, again, feed * SLOWLY);
                self.lines.extend([
                    back(axis, direction, &contact),
                    (Sent::Second(axis, direction), again),
                ]);
                Ok(())
            }
            (Some(Sent::Second(axis, direction)), Some((contact, _))) => {
                self.lines.push_back(back(axis, direction, &contact));
                self.contacts[axis].push(contact[axis]);
                Ok(())
            }
        }
    }

    fn begin(&mut self, part: Part, at: &[f64]) {
        let Probing { search, feed, .. } = self.probing;
        let (axis, place) = match part {
            Part::Touch(axis, direction) => {
                self.touch_start = at[axis];
                let touch = line("G91G21G94G38.3", axis, direction * search, feed);
                self.lines.push_back((Sent::First(axis, direction), touch));
                return;
            }
            Part::Go(axis, to) => (axis, self.start[axis] + to),
            Part::Centre(axis) => {
                let contacts = &self.contacts[axis];
                let last = &contacts[contacts.len().saturating_sub(2)..];
                (axis, last.iter().sum::<f64>() / last.len().max(1) as f64)
            }
        };
        let by = place - at[axis];
        if by.abs() < 0.0005 {
            return;
        }
        // Up and away nothing is in the way, and the probe may still be closed.
        let is_up = axis == Z && by > 0.0;
        self.lines.push_back(if is_up {
            Self::back(axis, by, at, feed)
        } else {
            (Sent::Guarded, line("G91G21G94G38.3", axis, by, feed))
        });
    }

    /// A jog from a place along an axis, which a change of the tool allows as well.
    fn back(axis: usize, by: f64, at: &[f64], feed: f64) -> (Sent, String) {
        let mut distances = [0.0; LINEAR_AXES];
        distances[axis] = by;
        (Sent::Back(axis, at[axis] + by), jog::line(&distances, feed))
    }

    /// The line that sets what was found, with the machine at rest.
    fn finish(&self, at: &[f64]) -> Next {
        let radius = self.probing.diameter / 2.0;
        let mut found: Vec<(usize, f64)> = Vec::new();
        let mut text = String::new();
        match self.probing.target {
            Target::ToolLength { reference_mm } => {
                let contact = self.contacts[Z][0];
                let line = |length: f64| format!("G21G43.1Z{length:.3}");
                let Some(reference) = reference_mm else {
                    let text = format!("reference tool: contact at machine Z {contact:.3} mm");
                    return Next::Reference(line(0.0), text, contact);
                };
                let length = contact - reference;
                let text = format!("tool length {length:.3} mm against the reference tool");
                return Next::Done(line(length), text);
            }
            Target::Top => found.push((Z, self.contacts[Z][0] - self.probing.plate)),
            Target::CornerOutside { side, with_top } => {
                found.extend(with_top.then(|| (Z, self.contacts[Z][0] - self.probing.plate)));
                found.extend([X, Y].map(|axis| {
                    (
                        axis,
                        self.contacts[axis][0] + f64::from(side[axis]) * radius,
                    )
                }));
            }
            Target::CornerInside { side } => {
                found.extend([X, Y].map(|axis| {
                    (
                        axis,
                        self.contacts[axis][0] + f64::from(side[axis]) * radius,
                    )
                }));
            }
            Target::Hole | Target::Boss => {
                let sign = if self.probing.target == Target::Hole {
                    1.0
                } else {
                    -1.0
                };
                for axis in [X, Y] {
                    let [first, second] = [self.contacts[axis][0], self.contacts[axis][1]];
                    let width = (second - first).abs() + sign * self.probing.diameter;
                    let _ = write!(text, "{} {width:.3} mm across, ", char::from(LETTERS[axis]));
                    found.push((axis, f64::midpoint(first, second)));
                }
            }
        }
        let mut line = "G21G10L20P0".to_owned();
        let _ = write!(text, "zero at machine");
        for (axis, zero) in found {
            let letter = char::from(LETTERS[axis]);
            let _ = write!(line, "{letter}{:.3}", at[axis] - zero);
            let _ = write!(text, " {letter}{zero:.3}");
        }
        Next::Done(line, text)
    }
}
