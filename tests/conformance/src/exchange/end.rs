//! The end of an exchange against the recorded one.

use leadscrew::axis::AXES;

use super::{Exchange, stops::Stops};
use crate::{
    compare::{Difference, follows_from_answers},
    deviation::Deviation,
};
use simulation::session::state::End;

/// How far apart two positions may be that were both computed exactly and in single precision, mm.
fn is_close(ours: f64, theirs: f64) -> bool {
    (ours - theirs).abs() <= 0.002_f64.max(theirs.abs() * 1e-6)
}

/// Compares the ends, and knows the excuses.
struct Ends<'a> {
    exchange: &'a Exchange,
    ours: &'a End,
    theirs: &'a End,
    /// What excuses the consequences of answers that differ.
    follows: Option<Deviation>,
    /// Whether the axes stand elsewhere because of a stop.
    is_stopped: bool,
    /// Whether homing has failed: Grbl counts from where the last of its moves began.
    is_lost: bool,
    /// Whether they still moved in the recording.
    moves: bool,
}

pub(super) fn compare(
    exchange: &Exchange,
    (ours, theirs): (&End, &End),
    stops: &Stops,
    found: &mut Vec<Difference>,
) {
    let scale = exchange.scale();
    let by: Vec<f64> = (ours.mpos_steps.iter().zip(&theirs.mpos_steps))
        .zip(scale)
        .map(|((our, their), scale)| (our - their) as f64 / scale)
        .collect();
    let ends = Ends {
        exchange,
        ours,
        theirs,
        follows: follows_from_answers(found),
        is_stopped: stops.explain(f64::MAX, &by, exchange.step_mm()),
        is_lost: exchange.has_failed_homing(usize::MAX - 1),
        moves: theirs.idle == Some(false) || [RUN, JOG].contains(&theirs.state),
    };
    let differences = [ends.state(), ends.steps()].into_iter().flatten();
    let differences = differences.chain(ends.parser());
    found.extend(differences.map(|(text, by_design)| Difference {
        what: "end",
        text,
        by_design,
    }));
}

/// Grbl's numbers of states.
const HOME: u8 = 4;
const RUN: u8 = 8;
const JOG: u8 = 32;

type Found = (String, Option<Deviation>);

impl Ends<'_> {
    fn state(&self) -> Option<Found> {
        let (ours, theirs) = (self.ours.state, self.theirs.state);
        // Grbl stays in its homing state when it refuses `$H` with more behind it.
        let was_refused = self.exchange.session.steps().any(|step| {
            step.line
                .as_deref()
                .is_some_and(|line| line.starts_with("$H"))
                && step.recv.iter().any(|text| text == "error:3")
        });
        let by_design = if theirs == HOME && was_refused {
            Some(Deviation::RefusedChangesNothing)
        } else {
            self.follows
        };
        (ours != theirs).then(|| (format!("state {ours}, Grbl {theirs}"), by_design))
    }

    fn steps(&self) -> Option<Found> {
        let (ours, theirs) = (&self.ours.mpos_steps, &self.theirs.mpos_steps);
        if ours.len() != theirs.len() {
            return Some((format!("{} axes, Grbl {}", ours.len(), theirs.len()), None));
        }
        if self.moves || ours == theirs {
            return None;
        }
        let scale = self.exchange.scale();
        let is_tie = (0..AXES).all(|axis| {
            let off = ours[axis] - theirs[axis];
            let exact = self.ours.parser_pos_mm[axis] * scale[axis];
            let from_half = (exact.abs().fract() - 0.5).abs();
            off == 0 || (off.abs() == 1 && from_half <= exact.abs().max(1.0) * 1e-6)
        });
        let by_design = if is_tie || self.exchange.has_long_number() {
            Some(Deviation::ExactPositions)
        } else if self.is_stopped {
            Some(Deviation::ShortStops)
        } else if self.is_lost {
            Some(Deviation::HomingMotion)
        } else {
            self.follows
        };
        Some((format!("steps {ours:?}, Grbl {theirs:?}"), by_design))
    }

    fn parser(&self) -> Vec<Found> {
        let (ours, theirs) = (self.ours, self.theirs);
        let mut found = Vec::new();
        let axes = ours.parser_pos_mm.iter().zip(&theirs.parser_pos_mm);
        for (axis, (our, their)) in axes.enumerate() {
            if !is_close(*our, *their) {
                let is_stopped = self.is_stopped && !self.moves;
                let by_design = is_stopped.then_some(Deviation::ShortStops);
                let is_exact = self.exchange.has_long_number();
                let by_design = by_design.or(is_exact.then_some(Deviation::ExactPositions));
                let is_lost = self.is_lost.then_some(Deviation::HomingMotion);
                let by_design = by_design.or(is_lost);
                let text = format!("programmed position {axis}: {our}, Grbl {their}");
                found.push((text, by_design.or(self.follows)));
            }
        }
        if ours.modal != theirs.modal {
            let text = format!("modes {:?}, Grbl {:?}", ours.modal, theirs.modal);
            found.push((text, self.follows));
        }
        for (letter, our, their) in [
            ('F', ours.feed, theirs.feed),
            ('S', ours.speed, theirs.speed),
        ] {
            if !is_close(our, their) {
                let text = format!("{letter}{our}, Grbl {letter}{their}");
                found.push((text, self.follows));
            }
        }
        if theirs.tool.is_some() && ours.tool != theirs.tool {
            let text = format!("T {:?}, Grbl {:?}", ours.tool, theirs.tool);
            let is_kept = theirs.tool == Some(0);
            let by_design = is_kept.then_some(Deviation::ToolIsModal);
            found.push((text, by_design.or(self.follows)));
        }
        found
    }
}
