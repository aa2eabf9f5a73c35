//! Stores that only a test lets happen: the flash is erased only while no step is due.
//!
//! Read from the machine code: every way to such a store reads the register that is tested first, and some way behind
//! that read ends without the store.

use std::collections::BTreeSet;

use crate::{Config, Flaw, Function, Program, Rule, config::GuardedStore};

/// The stores that no test guards.
pub(crate) fn flaws(program: &Program<'_>, config: &Config) -> Vec<Flaw> {
    let functions = program.functions().values();
    let flaws = functions.flat_map(|function| {
        let guarded = config.guarded.iter();
        guarded.filter_map(|guarded| unguarded(program, function, guarded))
    });
    flaws.collect()
}

fn unguarded(program: &Program<'_>, function: &Function, guarded: &GuardedStore) -> Option<Flaw> {
    let stores = function.stores.iter();
    let stores: BTreeSet<u32> = stores
        .filter(|store| store.to == Some(guarded.register))
        .map(|store| store.at)
        .collect();
    let first = *stores.first()?;
    let reads = function.addresses.iter();
    let reads: BTreeSet<u32> = reads
        .filter(|(_, to)| **to == guarded.test)
        .map(|(at, _)| *at)
        .collect();
    let is_tested = !reaches(function, Some(&stores), &reads);
    let is_avoidable = reaches(function, None, &stores);
    (!is_tested || !is_avoidable).then(|| {
        let what = format!(
            "a store to {:#010x} does not depend on {:#010x}: {}",
            guarded.register, guarded.test, guarded.reason
        );
        let remedy = "Read the register, and store only if it says so.";
        program.image.flaw(Rule::Register, first, what, remedy)
    })
}

/// Whether a way through a function leads to one of some instructions, or to its end, and executes none of others
/// before.
fn reaches(function: &Function, targets: Option<&BTreeSet<u32>>, avoided: &BTreeSet<u32>) -> bool {
    let is_target = |at: u32| targets.is_some_and(|targets| targets.contains(&at));
    let judge = |block: usize| {
        let block = &function.blocks[block];
        let mut own = block.instructions.iter();
        let decisive = own.find(|it| {
            is_target(it.address) || avoided.contains(&it.address) && !it.is_conditional()
        });
        let is_end = block.ends && targets.is_none();
        decisive.map_or(is_end.then_some(true), |it| Some(is_target(it.address)))
    };
    function.leads(0, judge)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn a_store_after_a_test_may_be_left_out_and_comes_after_a_read() {
        // 0: the read, then 1 with the store or 2, the end.
        let function = testing::function(&[(2, &[1, 2]), (2, &[2]), (2, &[])]);
        let at = |block: usize| BTreeSet::from([function.blocks[block].instructions[0].address]);
        assert!(!reaches(&function, Some(&at(1)), &at(0)));
        assert!(reaches(&function, None, &at(1)));
        // Without the read, or in each way.
        assert!(reaches(&function, Some(&at(1)), &BTreeSet::new()));
        assert!(!reaches(&function, None, &at(0)));
    }
}
