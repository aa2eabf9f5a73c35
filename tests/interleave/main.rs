//! The queues and requests that tasks share without a lock, in every order in which the tasks can interrupt each other,
//! and with every order of their accesses that the compiler may choose between two fences.
//!
//! Each scenario is wrong in no execution. Without a fence that it needs, or with a second writer, the same scenario is
//! wrong in some: so the test can fail.

mod bytes;
mod requests;
mod steps;

use std::{cell::RefCell, rc::Rc};

use leadscrew::atomic::{Executions, Fences, Pending, Task, explore};

/// Executions of a scenario at most: it has to end before.
const MOST: u64 = 300_000;

/// What tasks of a scenario share.
type Shared<T> = Rc<RefCell<T>>;

fn shared<T>(value: T) -> Shared<T> {
    Rc::new(RefCell::new(value))
}

/// A task that may run now if a condition is met.
fn possible(condition: bool) -> Pending {
    if condition {
        Pending::Possible
    } else {
        Pending::Never
    }
}

/// A task that may interrupt others so many times.
fn task(priority: u8, times: u32, run: impl Fn() + 'static) -> Task {
    let left = shared(times);
    let is_left = left.clone();
    Task {
        priority,
        pending: Box::new(move || possible(*is_left.borrow() != 0)),
        run: Box::new(move || {
            *left.borrow_mut() -= 1;
            run();
        }),
    }
}

/// Requires that a scenario goes wrong in no execution, and without fences in some. Returns how many of the fences it
/// needs each by itself. The fences of tasks that are not interrupted, and fences that keep a load in front of
/// a store, do not count.
fn needs_fences<S: FnOnce() -> Result<(), String>>(begin: impl Fn() -> (Vec<Task>, S)) -> usize {
    let all = is_right(&begin);
    let without = explore(&Fences::None, MOST, &begin);
    assert!(
        without.wrong.is_some(),
        "right without a fence: {without:?}"
    );
    let is_needed = |fence| {
        let without = explore(&Fences::Without(fence), MOST, &begin);
        println!("without {}:{}: {:?}", fence.0, fence.1, without.wrong);
        without.wrong.is_some()
    };
    all.fences
        .into_iter()
        .filter(|fence| is_needed(*fence))
        .count()
}

/// Requires that a scenario goes wrong in no execution.
fn is_right<S: FnOnce() -> Result<(), String>>(begin: impl Fn() -> (Vec<Task>, S)) -> Executions {
    let found = explore(&Fences::All, MOST, begin);
    assert_eq!(found.wrong, None, "{found:?}");
    assert!(found.count >= 10 && found.count < MOST, "{found:?}");
    println!("{} executions", found.count);
    found
}

/// Tells what is not as expected.
fn expect<T: PartialEq + std::fmt::Debug>(found: &T, wanted: &T, what: &str) -> Result<(), String> {
    if found == wanted {
        Ok(())
    } else {
        Err(format!("{what}: {found:?}, not {wanted:?}"))
    }
}
