//! How far the bounds of loops are known: counted by the analysis, or stated and believed.
//!
//! A bound that nothing counts needs a reason in its comment. A name has a value where a proof is made: there it is
//! compared with what is counted, and what is smaller bounds the loop.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    BelievedLoop, Bound, Count, Flaw, Function, Loop, LoopCounts, Rule, bounds, busy_waits,
    system::System,
};

impl Loop {
    /// Its bound as a number, with these values of names; `None`: there is none. Names in `varied` are the number of
    /// units of work, and costs have to grow ever faster with these: so they are not capped.
    pub(crate) fn most(
        &self,
        named: &BTreeMap<String, u64>,
        varied: &BTreeSet<String>,
    ) -> Option<u64> {
        let count = &self.bound.as_ref()?.count;
        let value = count.value(named)?;
        let Some(runs) = self.counted else {
            return Some(value);
        };
        let is_varied = matches!(count, Count::Named(name) if varied.contains(name));
        let is_capped = !runs.is_open && !is_varied;
        let most = if is_capped { runs.returns } else { u64::MAX };
        Some(value.min(most).max(runs.least))
    }

    /// Whether only comments say how often it runs.
    fn is_believed(&self, named: &BTreeMap<String, u64>) -> bool {
        let closed = self.counted.filter(|runs| !runs.is_open);
        let bound = self.bound.as_ref().filter(|bound| bound.is_stated());
        let is_less =
            |bound: &Bound| closed.is_none_or(|runs| bound.count.value(named) < Some(runs.returns));
        self.total.is_some() || bound.is_some_and(is_less)
    }

    /// What comments say of it.
    pub(crate) fn comments(&self) -> impl Iterator<Item = &Bound> {
        let totals = self.total.iter().map(|total| &total.bound);
        self.stated.iter().chain(totals)
    }
}

/// Counts the loops of some functions by how far their bounds are known.
pub(crate) fn count<'a>(
    functions: impl Iterator<Item = &'a Function>,
    named: &BTreeMap<String, u64>,
) -> LoopCounts {
    let mut counts = LoopCounts::default();
    for looped in functions.flat_map(|function| &function.loops) {
        if looped.is_believed(named) {
            counts.believed += 1;
        } else if looped.stated.is_some() {
            counts.counted_and_stated += 1;
        } else if looped.bound.is_some() {
            counts.counted += 1;
        }
    }
    counts
}

/// The comments of some functions that are believed.
pub(crate) fn comments<'a>(
    functions: impl Iterator<Item = &'a Function>,
    named: &BTreeMap<String, u64>,
) -> BTreeSet<BelievedLoop> {
    let loops = functions.flat_map(|function| &function.loops);
    let believed = loops.filter(|looped| looped.is_believed(named));
    let comments = believed
        .flat_map(Loop::comments)
        .map(|stated| BelievedLoop {
            place: stated.origin.clone(),
            count: match &stated.count {
                Count::Number(number) => number.to_string(),
                Count::Named(name) => name.clone(),
            },
            reason: stated.reason.clone().unwrap_or_default(),
        });
    comments.collect()
}

/// Reports names that are smaller than what is counted or have no value, and comments that give no reason for what
/// they alone say.
pub(crate) fn flaws(system: &System<'_>, named: &BTreeMap<String, u64>) -> Vec<Flaw> {
    let (image, all) = (system.image, system.program.functions());
    let loops = all
        .values()
        .flat_map(|it| it.loops.iter().map(move |looped| (it, looped)));
    let mut flaws = Vec::new();
    for (function, looped) in loops {
        let place = || image.place(function.blocks[looped.head].start());
        for stated in looped.comments() {
            let origin = &stated.origin;
            if looped.is_believed(named) && stated.reason.is_none() {
                let what =
                    format!("nothing counts a loop, and {origin} does not say why its bound holds");
                let remedy = "Let a constant bound it; or give the reason behind the number, `// wcet-bound: N: reason`.";
                flaws.push(Flaw::new(Rule::BelievedBound, what, place(), remedy));
            }
            let Count::Named(name) = &stated.count else {
                if looped.is_believed(named) {
                    let what = format!(
                        "nothing counts a loop, and {origin} bounds it by a number of its own"
                    );
                    let remedy = "Let a constant bound it; or name a constant of the program (src/board/proof_constants.rs), or one \
                         of [bounds] in `schedule.toml`.";
                    flaws.push(Flaw::new(Rule::BelievedBound, what, place(), remedy));
                }
                continue;
            };
            let Some(value) = named.get(name) else {
                let what = format!("the bound `{name}` at {origin} is not known");
                let remedy = "Define it in `schedule.toml`, at [bounds].";
                flaws.push(Flaw::new(Rule::Configuration, what, place(), remedy));
                continue;
            };
            let waits = busy_waits::is_busy_wait(all, function, looped);
            flaws.extend(bounds::wrong(
                image,
                function,
                looped,
                (stated, *value),
                waits,
            ));
        }
    }
    flaws
}
