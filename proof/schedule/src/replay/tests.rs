//! The checker on small graphs made by hand.

use std::collections::BTreeSet;

use super::*;
use crate::{
    Address, Block, Bound, Count, Edge, Function, Loop, Model, Operation, Total, testing::CLOCK,
};

const HANDLER: u32 = 0x0800_0100;
const CALLEE: u32 = 0x0800_0200;
const OTHER: u32 = 0x0800_0300;
const IDLE: u32 = 0x0800_0400;

const PLAIN: Operation = Operation::Plain { writes: 1 };
const RETURN: Operation = Operation::JumpRegister(14);
const LOAD: Operation = Operation::Load {
    writes: 1,
    first: None,
    words: 1,
    bytes: 4,
    address: Address::Offset { base: 1, offset: 0 },
    writeback: None,
};

fn block(address: u32, operations: &[Operation], successors: &[usize]) -> Block {
    let instructions = operations
        .iter()
        .zip(0..)
        .map(|(operation, index)| Instruction {
            address: address + 2 * index,
            bytes: 2,
            operation: *operation,
            condition: 14,
            in_if_then: false,
            sets_flags: false,
        });
    let edge = |to: &usize| Edge {
        to: *to,
        is_taken: false,
    };
    Block {
        instructions: instructions.collect(),
        successors: successors.iter().map(edge).collect(),
        call: None,
        ends: operations.last() == Some(&RETURN),
        traps: false,
    }
}

fn function(address: u32, blocks: Vec<Block>) -> Function {
    Function {
        address,
        name: format!("{address:x}"),
        blocks,
        returns: true,
        ..Function::default()
    }
}

/// A handler with a loop of one block that runs again twice at most, then a call, then a load.
fn looping() -> Function {
    let mut call = block(HANDLER + 8, &[Operation::Call(CALLEE)], &[3]);
    call.call = Some(CALLEE);
    let mut handler = function(
        HANDLER,
        vec![
            block(HANDLER, &[PLAIN], &[1]),
            block(
                HANDLER + 2,
                &[PLAIN, PLAIN, Operation::Jump(HANDLER + 2)],
                &[1, 2],
            ),
            call,
            block(HANDLER + 10, &[LOAD, RETURN], &[]),
        ],
    );
    handler.regions.insert(HANDLER + 10, Region::Sram);
    handler.loops.push(Loop {
        head: 1,
        blocks: [1].into(),
        back: [1].into(),
        bound: Some(Bound::new(Count::Named("turns".into()), "a.rs:7")),
        total: Some(Total {
            bound: Bound::new(Count::Number(3), "a.rs:8"),
            per: None,
            in_runs: BTreeSet::from([1]),
        }),
        ..Loop::default()
    });
    handler
}

/// A handler that pushes two words, pops one under a condition, and reads from the stack.
fn popping() -> Function {
    let load = |writeback| Operation::Load {
        writes: 1,
        first: None,
        words: 1,
        bytes: 4,
        address: Address::Offset {
            base: 13,
            offset: 0,
        },
        writeback,
    };
    let push = Operation::Store {
        words: 2,
        address: Address::Offset {
            base: 13,
            offset: -8,
        },
        writeback: Some((13, -8)),
        source: None,
        reads: 0,
        bytes: 4,
    };
    let operations = [push, load(Some((13, 4))), load(None), RETURN];
    let mut block = block(OTHER, &operations, &[]);
    block.instructions[1].condition = 0;
    function(OTHER, vec![block])
}

fn checker(turns: u64) -> Checker {
    let plain = function(OTHER, vec![block(OTHER, &[PLAIN, RETURN], &[])]);
    checker_with(turns, plain)
}

fn checker_with(turns: u64, other: Function) -> Checker {
    let functions = [
        looping(),
        function(CALLEE, vec![block(CALLEE, &[PLAIN, RETURN], &[])]),
        other,
    ];
    let root = |name: &str, handler, reach: &[u32]| Root {
        name: name.into(),
        handler,
        callers: Vec::new(),
        reach: reach.iter().copied().collect(),
        kinds: vec![Kind {
            name: name.into(),
            excluded: BTreeSet::new(),
        }],
    };
    let plan = Plan {
        functions: functions.map(|one| (one.address, one)).into(),
        roots: vec![
            root("first", HANDLER, &[HANDLER, CALLEE]),
            root("second", OTHER, &[OTHER]),
        ],
        named: [("turns".into(), turns)].into(),
        limited: BTreeMap::new(),
        model: Model::new(&CLOCK),
    };
    Checker::new(plan).unwrap()
}

const IDLING: [u32; 1] = [IDLE];
const TURN: [u32; 3] = [HANDLER + 2, HANDLER + 4, HANDLER + 6];
const AFTER_LOOP: [u32; 5] = [HANDLER + 8, CALLEE, CALLEE + 2, HANDLER + 10, HANDLER + 12];

/// One activation in which the loop runs `1 + again` times.
fn activation(again: usize) -> Vec<u32> {
    let turns = TURN.repeat(1 + again);
    [&IDLING, &[HANDLER][..], &turns, &AFTER_LOOP, &IDLING].concat()
}

fn run(checker: &mut Checker, addresses: &[u32]) -> Summary {
    for &address in addresses {
        let number = checker.site(address, || None);
        checker.execute(number);
        if address == HANDLER + 10 {
            checker.touch(number, 0x2000_0000);
        }
    }
    checker.summary(|address| vec![format!("at {address:x}")])
}

#[test]
fn an_activation_costs_what_the_table_says() {
    let summary = run(&mut checker(2), &activation(1));
    let runs = &summary.tasks[0];
    assert_eq!(summary.violations, []);
    assert_eq!((runs.activations, runs.preempted), (1, 0));
    assert_eq!(runs.instructions_max, 1 + 6 + 5);
    // The load takes 2. Jumps: the loop, the call and its return, the exception's return.
    assert_eq!(runs.warm_max, 13 + 4 * 3 + 24);
    // Lines: the handler's, the callee's and the vector's.
    assert_eq!(runs.cached_max, runs.warm_max + 3 * 5);
    // Without a cache the handler's is fetched once more after each jump to it.
    assert_eq!(runs.uncached_max, runs.warm_max + 5 * 5);
    assert_eq!((runs.blocks, runs.executed), (5, 5));
    assert_eq!((summary.accesses, summary.unpredicted), (1, 0));
}

#[test]
fn a_loop_that_exceeds_its_bound_is_reported_with_its_place() {
    assert_eq!(run(&mut checker(2), &activation(2)).violations, []);
    let summary = run(&mut checker(1), &activation(2));
    let violation = &summary.violations[0];
    assert_eq!(summary.violations.len(), 1);
    assert_eq!(
        violation.what,
        "a loop runs more than 1 times for one entry (a.rs:7)"
    );
    assert_eq!(violation.place, ["at 8000102"]);
    assert_eq!(violation.count, 1);
}

#[test]
fn a_loop_that_exceeds_its_total_is_reported() {
    let summary = run(&mut checker(9), &activation(5));
    let violation = &summary.violations[0];
    assert_eq!(
        violation.what,
        "a loop runs more than 3 times in one activation (a.rs:8)"
    );
    // Two back edges too many, and three runs of the body.
    assert_eq!(violation.count, 5);
}

#[test]
fn loops_that_name_a_total_share_it() {
    let mut plan = checker(9).plan;
    let total = Total {
        bound: Bound::new(Count::Named("turns".into()), "a.rs:8"),
        per: None,
        in_runs: BTreeSet::new(),
    };
    let names = plan.functions.values_mut().flat_map(|one| &mut one.loops);
    names.for_each(|one| one.total = Some(total.clone()));
    let checker = Checker::new(plan).unwrap();
    let budgets = checker.graph.loops.iter().map(|looped| looped.budget);
    assert_eq!(budgets.collect::<BTreeSet<_>>(), [0].into());
}

#[test]
fn a_bound_without_a_value_is_refused() {
    let mut plan = checker(1).plan;
    plan.named.clear();
    let error = Checker::new(plan).err().unwrap();
    assert!(error.contains("\"turns\""), "{error}");
}

#[test]
fn a_step_that_the_graph_does_not_know_is_reported() {
    let mut addresses = activation(0);
    addresses.remove(3);
    let summary = run(&mut checker(2), &addresses);
    assert_eq!(summary.violations.len(), 1);
    assert!(
        summary.violations[0]
            .what
            .contains("0x08000102 is followed by 0x08000106")
    );
    assert_eq!(summary.violations[0].place, ["at 8000102"]);
}

#[test]
fn code_that_is_not_analysed_is_reported() {
    let summary = run(&mut checker(2), &[IDLE, HANDLER, IDLE, IDLE + 2]);
    assert_eq!(summary.violations.len(), 1);
    assert!(summary.violations[0].what.contains("is not analysed"));
}

#[test]
fn an_access_to_another_region_is_reported() {
    let mut checker = checker(2);
    let number = checker.site(HANDLER + 10, || None);
    run(&mut checker, &activation(0)[..8]);
    checker.execute(number);
    checker.touch(number, 0x4000_0000);
    let summary = checker.summary(|_| Vec::new());
    assert_eq!(summary.violations.len(), 1);
    let what = &summary.violations[0].what;
    assert!(
        what.contains("predicted to access Sram and accesses Apb1"),
        "{what}"
    );
}

#[test]
fn a_word_that_is_at_no_multiple_of_four_is_reported() {
    for (address, words) in [(0x2000_0004, 0), (0x2000_0006, 1)] {
        let mut checker = checker(2);
        let number = checker.site(HANDLER + 10, || None);
        run(&mut checker, &activation(0)[..8]);
        checker.execute(number);
        checker.touch(number, address);
        let violations = checker.summary(|_| Vec::new()).violations;
        let mut found = violations.iter();
        assert_eq!(violations.len(), words);
        assert!(found.all(|it| it.what.contains("no multiple of its length")));
    }
}

#[test]
fn a_run_begins_where_another_vector_calls_the_handler() {
    let mut checker = checker(2);
    let number = checker.site(CALLEE, || None);
    checker.graph.sites[number].handler = Some(1);
    let addresses = [&IDLING[..], &[CALLEE, CALLEE + 2], &IDLING].concat();
    let runs = run(&mut checker, &addresses).tasks[1].activations;
    assert_eq!(runs, 1);
}

#[test]
fn who_preempts_pays_for_itself() {
    let addresses = activation(1);
    let (first, last) = addresses.split_at(4);
    let addresses = [first, &[OTHER, OTHER + 2], last].concat();
    let summary = run(&mut checker(2), &addresses);
    assert_eq!(summary.violations, []);
    let [first, second] = &summary.tasks[..] else {
        panic!("two tasks");
    };
    assert_eq!((first.activations, first.preempted), (1, 1));
    assert_eq!(first.warm_max, 13 + 4 * 3 + 24);
    assert_eq!((second.activations, second.preempted), (1, 0));
    assert_eq!(second.warm_max, 2 + 3 + 24);
    assert_eq!((second.blocks, second.executed), (1, 1));
}

#[test]
fn tasks_that_follow_each_other_are_not_nested() {
    let chained = [IDLE, OTHER, OTHER + 2, OTHER, OTHER + 2, HANDLER];
    let summary = run(&mut checker(2), &[&chained, &activation(0)[2..]].concat());
    assert_eq!(summary.violations, []);
    assert_eq!(summary.tasks[1].activations, 2);
    assert_eq!(summary.tasks[0].activations, 1);
    assert_eq!(summary.tasks[0].preempted, 0);
}

#[test]
fn blocks_that_were_never_executed_are_listed() {
    let summary = run(&mut checker(2), &[IDLE, OTHER, OTHER + 2, IDLE]);
    assert_eq!(summary.tasks[0].executed, 0);
    assert_eq!(summary.tasks[0].never[0], "0x08000100 at 8000100");
    assert_eq!(summary.tasks[0].never.len(), 5);
}

/// Executes `popping`; where each instruction goes, if it goes anywhere.
fn pop(touches: [Option<u32>; 3]) -> Summary {
    let mut checker = checker_with(1, popping());
    for (address, touch) in (OTHER..).step_by(2).zip(touches) {
        let number = checker.site(address, || None);
        checker.execute(number);
        if let Some(touch) = touch {
            checker.touch(number, touch);
        }
    }
    run(&mut checker, &[OTHER + 6, IDLE])
}

#[test]
fn the_stack_is_followed_through_conditions() {
    let base = 0x2000_1000;
    let popped = pop([Some(base - 8), Some(base - 8), Some(base - 4)]);
    assert_eq!(popped.violations, []);
    assert_eq!(popped.tasks[1].stack_max, 8);
    let skipped = pop([Some(base - 8), None, Some(base - 8)]);
    assert_eq!(skipped.violations, []);
    let wrong = pop([Some(base - 8), None, Some(base - 4)]);
    assert_eq!(wrong.violations.len(), 1);
    assert!(
        wrong.violations[0]
            .what
            .contains("the stack is not as deep")
    );
}
