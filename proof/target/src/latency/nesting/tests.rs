//! Activations as a chip would record them, put together again.

use super::*;

const STEP: usize = 0;
const SERIAL: usize = 1;
const PREPARE: usize = 2;
const ENTRY_AND_EXIT: u64 = 24;

/// A record that was written.
const fn record(number: u32, start: u32, end: u32) -> Record {
    Record {
        start,
        duration: end.wrapping_sub(start),
        latency: None,
        number,
    }
}

/// What is read of three tasks, with no records left in the chip.
fn batch(now: u32, tasks: [&[Record]; 3], activations: [u32; 3]) -> Batch {
    let tasks = tasks.map(<[Record]>::to_vec);
    Batch {
        now,
        tasks: tasks.into_iter().zip(activations).collect(),
    }
}

/// Start, execution and preemptions of each settled activation of a task.
fn of(task: usize, settled: &[Activation]) -> Vec<(u64, Option<u64>, u32)> {
    let one = settled.iter().filter(|one| one.task == task);
    one.map(|one| (one.start - (1 << 32), one.execution, one.preemptions))
        .collect()
}

/// Pushes batches and returns everything that is settled.
fn settle(batches: &[Batch]) -> Vec<Activation> {
    let mut nesting = Nesting::new(3, ENTRY_AND_EXIT);
    let mut settled = Vec::new();
    for batch in batches {
        settled.extend(nesting.push(batch));
    }
    settled.extend(nesting.settle_all());
    settled
}

#[test]
fn what_preempted_is_not_counted() {
    let steps = [
        record(0, 150, 200),
        record(1, 400, 440),
        record(2, 1100, 1140),
    ];
    let settled = settle(&[batch(
        2000,
        [&steps, &[], &[record(0, 100, 1000)]],
        [3, 0, 1],
    )]);
    let own = 900 - (50 + 24) - (40 + 24);
    assert_eq!(of(PREPARE, &settled), [(100, Some(own), 2)]);
    let expected = [(150, Some(50), 0), (400, Some(40), 0), (1100, Some(40), 0)];
    assert_eq!(of(STEP, &settled), expected);
}

#[test]
fn only_the_outermost_is_taken_out() {
    let settled = settle(&[batch(
        2000,
        [
            &[record(0, 300, 350)],
            &[record(0, 200, 500)],
            &[record(0, 100, 1000)],
        ],
        [1, 1, 1],
    )]);
    assert_eq!(of(SERIAL, &settled), [(200, Some(300 - 50 - 24), 1)]);
    assert_eq!(of(PREPARE, &settled), [(100, Some(900 - 300 - 24), 1)]);
}

#[test]
fn the_counter_may_wrap_inside_of_an_activation_and_between_batches() {
    let end = u32::MAX;
    let settled = settle(&[
        batch(
            end - 500,
            [&[record(0, end - 900, end - 850)], &[], &[]],
            [1, 0, 0],
        ),
        batch(
            400,
            [&[record(1, end - 9, 40)], &[], &[record(0, end - 99, 200)]],
            [2, 0, 1],
        ),
        batch(900, [&[record(2, 600, 650)], &[], &[]], [3, 0, 1]),
    ]);
    let executions: Vec<_> = of(STEP, &settled).iter().map(|one| one.1).collect();
    assert_eq!(executions, [Some(50), Some(50), Some(50)]);
    let starts: Vec<_> = of(STEP, &settled).iter().map(|one| one.0).collect();
    assert_eq!(starts[1] - starts[0], 891);
    assert_eq!(starts[2] - starts[1], 610);
    assert_eq!(of(PREPARE, &settled)[0].1, Some(300 - 50 - 24));
}

#[test]
fn a_record_that_was_dropped_makes_those_around_it_uncertain() {
    // The steps 1 and 2 were dropped between 250 and 900.
    let steps = [record(0, 150, 250), record(3, 900, 950)];
    let prepares = [
        record(0, 100, 400),
        record(1, 450, 800),
        record(2, 1000, 1100),
    ];
    let settled = settle(&[batch(2000, [&steps, &[], &prepares], [4, 0, 3])]);
    let expected = [(100, None, 1), (450, None, 0), (1000, Some(100), 0)];
    assert_eq!(of(PREPARE, &settled), expected);
    assert_eq!(of(STEP, &settled)[0].1, Some(100));
}

#[test]
fn records_dropped_at_the_end_are_known_by_the_count() {
    let steps = [record(0, 150, 250)];
    let settled = settle(&[batch(
        2000,
        [&steps, &[], &[record(0, 900, 950)]],
        [2, 0, 1],
    )]);
    assert_eq!(of(PREPARE, &settled), [(900, None, 0)]);
}

#[test]
fn dropped_records_of_lower_priorities_do_not_matter() {
    let settled = settle(&[batch(
        2000,
        [&[record(0, 500, 550)], &[], &[record(7, 900, 950)]],
        [1, 0, 8],
    )]);
    assert_eq!(of(STEP, &settled), [(500, Some(50), 0)]);
}

#[test]
fn what_was_read_a_batch_later_is_still_taken_out() {
    // The debugger read the ring of `step` first, and that of `prepare` a little later.
    let settled = settle(&[
        batch(1010, [&[], &[], &[record(0, 100, 1000)]], [0, 0, 1]),
        batch(2000, [&[record(0, 300, 350)], &[], &[]], [1, 0, 1]),
    ]);
    assert_eq!(of(PREPARE, &settled), [(100, Some(900 - 50 - 24), 1)]);
}

#[test]
fn an_activation_older_than_what_is_remembered_is_uncertain() {
    let step = |number: u32| record(number, 200 + 1000 * number, 250 + 1000 * number);
    let one = |number: u32| {
        let now = 1000 * (number + 1);
        batch(now, [&[step(number)], &[], &[]], [number + 1, 0, 0])
    };
    let mut batches: Vec<_> = (0..5).map(one).collect();
    batches.push(batch(6000, [&[], &[], &[record(0, 100, 5900)]], [5, 0, 1]));
    assert_eq!(of(PREPARE, &settle(&batches)), [(100, None, 1)]);
}
