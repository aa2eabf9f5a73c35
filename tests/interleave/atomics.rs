//! The atomics of the library for a test that executes its tasks in every order.
//!
//! Each access is a point where more urgent tasks may run, as on a single core: an interrupt runs to its end before the
//! interrupted task goes on. Besides, the compiler may move what no fence holds. A store may take effect as late as the
//! next fence of its task, and a load may have been made as early as the last one. So each access has several possible
//! results, and [`explore`] tries them all.
//!
//! What is left out: a store that moves up over a load of another place, and accesses to memory other than atomics.

extern crate std;

use core::{cell::RefCell, panic::Location, ptr};
use std::{
    boxed::Box, collections::BTreeMap, collections::BTreeSet, rc::Rc, string::String, thread_local,
    vec, vec::Vec,
};

pub use core::sync::atomic::Ordering;

/// Whether a task is pending.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Pending {
    /// Not now.
    Never,
    /// Now or later, as for what comes from outside.
    Possible,
    /// Now, before what it interrupts goes on.
    Certain,
}

/// A task that may interrupt others.
pub struct Task {
    /// Tasks of a lower priority are interrupted by it; what [`explore`] runs has priority 0.
    pub priority: u8,
    /// Whether it runs; without an access to an atomic.
    pub pending: Box<dyn Fn() -> Pending>,
    /// A run of it.
    pub run: Box<dyn Fn()>,
}

/// A fence, by its place in the sources.
pub type Fence = (&'static str, u32);

/// What the compiler leaves.
#[derive(Clone, Default)]
pub enum Fences {
    /// Every fence.
    #[default]
    All,
    /// None.
    None,
    /// Every fence but one.
    Without(Fence),
}

/// The executions of a scenario, up to one that goes wrong.
#[derive(Debug)]
pub struct Executions {
    /// How many there are.
    pub count: u64,
    /// What went wrong in the last one.
    pub wrong: Option<String>,
    /// The fences that were passed while tasks could be interrupted.
    pub fences: BTreeSet<Fence>,
}

/// One task in execution.
struct Level {
    priority: u8,
    /// Stores that have not taken effect, oldest first.
    delayed: Vec<(usize, u64)>,
    /// When its last fence was, and from when on it may find the values of single places.
    fence: u64,
    seen: BTreeMap<usize, u64>,
}

impl Level {
    fn new(priority: u8, fence: u64) -> Self {
        let (delayed, seen) = (Vec::new(), BTreeMap::new());
        Self {
            priority,
            delayed,
            fence,
            seen,
        }
    }
}

#[derive(Default)]
struct Memory {
    /// What the places contain in which something has been stored: before the execution, and in it.
    initial: BTreeMap<usize, u64>,
    stored: BTreeMap<usize, u64>,
    /// Values that have been replaced: when, where, and by which level.
    replaced: Vec<(u64, usize, u64, usize)>,
    now: u64,
    levels: Vec<Level>,
    tasks: Rc<Vec<Task>>,
    fences: Fences,
    passed: BTreeSet<Fence>,
    /// The choices of this execution, each with its number of possibilities, and how many have been made.
    choices: Vec<(usize, usize)>,
    made: usize,
}

thread_local! {
    static MEMORY: RefCell<Memory> = RefCell::default();
}

fn with<T>(action: impl FnOnce(&mut Memory) -> T) -> T {
    MEMORY.with_borrow_mut(action)
}

/// Executes a scenario in every order, up to `most` executions. `begin` makes a scenario anew, from the memory
/// of the beginning, with the tasks that may interrupt it. The function that `begin` returns runs at priority 0, and returns
/// the failure, if there is one. Behind [`end`], nothing interrupts.
pub fn explore<S: FnOnce() -> Result<(), String>>(
    fences: &Fences,
    most: u64,
    mut begin: impl FnMut() -> (Vec<Task>, S),
) -> Executions {
    let mut found = Executions {
        count: 0,
        wrong: None,
        fences: BTreeSet::new(),
    };
    with(|memory| {
        memory.initial.append(&mut memory.stored);
        memory.choices.clear();
        memory.passed.clear();
    });
    loop {
        with(|memory| {
            memory.stored.clear();
            memory.replaced.clear();
            memory.made = 0;
        });
        let (tasks, scenario) = begin();
        with(|memory| {
            memory.tasks = Rc::new(tasks);
            memory.fences = fences.clone();
            memory.levels = vec![Level::new(0, memory.now)];
        });
        let result = scenario();
        end();
        found.count += 1;
        found.wrong = result.err();
        if found.wrong.is_some() || found.count == most || !with(Memory::take_next_path) {
            break;
        }
    }
    with(|memory| {
        found.fences.append(&mut memory.passed);
        memory.stored.clear();
    });
    found
}

/// Ends the part of a scenario in which tasks are interrupted.
pub fn end() {
    with(|memory| {
        memory.commit_all();
        memory.levels.clear();
        memory.tasks = Rc::default();
    });
}

/// Makes all stores take effect, as a volatile access does with a barrier, and lets tasks run.
pub fn barrier() {
    interrupt();
    with(Memory::pass_fence);
    interrupt();
}

/// Keeps the compiler from moving accesses.
#[track_caller]
pub fn compiler_fence(_: Ordering) {
    let place = Location::caller();
    let fence = (place.file(), place.line());
    with(|memory| {
        if memory.levels.is_empty() {
            return;
        }
        memory.passed.insert(fence);
        let is_left = match &memory.fences {
            Fences::All => true,
            Fences::None => false,
            Fences::Without(removed) => *removed != fence,
        };
        if is_left {
            memory.pass_fence();
        }
    });
}

impl Memory {
    /// Chooses one of so many possibilities.
    fn choose(&mut self, possibilities: usize) -> usize {
        if possibilities < 2 {
            return 0;
        }
        if self.made == self.choices.len() {
            self.choices.push((0, possibilities));
        }
        let (choice, before) = self.choices[self.made];
        assert_eq!(before, possibilities, "the scenario is not the same again");
        self.made += 1;
        choice
    }

    /// Goes to the next execution, if there is one.
    fn take_next_path(&mut self) -> bool {
        while let Some((choice, possibilities)) = self.choices.pop() {
            if choice + 1 < possibilities {
                self.choices.push((choice + 1, possibilities));
                return true;
            }
        }
        false
    }

    fn value(&self, place: usize, first: u64) -> u64 {
        let value = self.stored.get(&place).or_else(|| self.initial.get(&place));
        value.copied().unwrap_or(first)
    }

    fn commit(&mut self, place: usize, bits: u64, first: u64) {
        self.now += 1;
        let by = self.levels.len();
        let before = self.value(place, first);
        self.replaced.push((self.now, place, before, by));
        self.stored.insert(place, bits);
    }

    fn commit_all(&mut self) {
        if let Some(level) = self.levels.last_mut() {
            for (place, bits) in core::mem::take(&mut level.delayed) {
                self.commit(place, bits, 0);
            }
        }
    }

    /// Lets some of the delayed stores take effect: each set of few. Of many, none, all, all but the oldest, and the
    /// newest or the oldest alone.
    fn commit_some(&mut self) {
        let Some(level) = self.levels.last() else {
            return;
        };
        let all = (1_u32 << level.delayed.len()) - 1;
        let sets: Vec<u32> = if level.delayed.len() <= 3 {
            (0..=all).collect()
        } else {
            vec![0, all, all & !1, all & !(all >> 1), 1]
        };
        let set = sets[self.choose(sets.len())];
        let Some(level) = self.levels.last_mut() else {
            return;
        };
        let delayed = core::mem::take(&mut level.delayed);
        for (number, (place, bits)) in delayed.into_iter().enumerate() {
            if set >> number & 1 != 0 {
                self.commit(place, bits, 0);
            } else if let Some(level) = self.levels.last_mut() {
                level.delayed.push((place, bits));
            }
        }
    }

    fn pass_fence(&mut self) {
        self.commit_all();
        self.now += 1;
        let now = self.now;
        if let Some(level) = self.levels.last_mut() {
            level.fence = now;
            level.seen.clear();
        }
    }

    fn load(&mut self, place: usize, first: u64) -> u64 {
        let now = self.value(place, first);
        let by = self.levels.len();
        let Some(level) = self.levels.last() else {
            return now;
        };
        if let Some((_, own)) = level.delayed.iter().find(|(at, _)| *at == place) {
            return *own;
        }
        // What others have replaced since the compiler may have made the load, the newest first.
        let from = level.seen.get(&place).copied().unwrap_or(level.fence);
        let replaced = self.replaced.iter().rev();
        let replaced = replaced.filter(|(when, at, _, _)| *when > from && *at == place);
        let others = replaced.take_while(|(_, _, _, writer)| *writer != by);
        let values: Vec<(u64, u64)> = others.map(|(when, _, value, _)| (*value, *when)).collect();
        let choice = self.choose(values.len() + 1);
        let (value, when) = match choice.checked_sub(1) {
            None => (now, self.now),
            Some(back) => (values[back].0, values[back].1 - 1),
        };
        if let Some(level) = self.levels.last_mut() {
            level.seen.insert(place, when);
        }
        value
    }

    fn store(&mut self, place: usize, bits: u64, first: u64) {
        let Some(level) = self.levels.last_mut() else {
            self.stored.insert(place, bits);
            return;
        };
        // Two stores to one place keep their order; the first may be left out.
        level.delayed.retain(|(at, _)| *at != place);
        level.delayed.push((place, bits));
        level.seen.remove(&place);
        // So that a place in which nothing has been stored has its first value, when this one takes effect.
        self.initial.entry(place).or_insert(first);
    }
}

/// Lets more urgent tasks run.
fn interrupt() {
    let Some(priority) = with(|memory| memory.levels.last().map(|level| level.priority)) else {
        return;
    };
    let tasks = with(|memory| memory.tasks.clone());
    loop {
        let urgent = tasks.iter().filter(|task| task.priority > priority);
        let all = urgent.map(|task| (task, (task.pending)()));
        let pending: Vec<_> = all
            .filter(|(_, pending)| *pending != Pending::Never)
            .collect();
        let certain = pending
            .iter()
            .find(|(_, pending)| *pending == Pending::Certain);
        let task = certain.or_else(|| {
            let choice = with(|memory| memory.choose(pending.len() + 1));
            choice.checked_sub(1).and_then(|choice| pending.get(choice))
        });
        let Some((task, _)) = task else {
            return;
        };
        with(|memory| {
            memory.commit_some();
            let level = Level::new(task.priority, memory.now);
            memory.levels.push(level);
        });
        (task.run)();
        with(|memory| {
            memory.commit_all();
            memory.levels.pop();
        });
    }
}

/// What an atomic contains, as 64 bits.
trait Bits: Copy {
    fn bits(self) -> u64;
    fn from(bits: u64) -> Self;
}

macro_rules! atomics {
    ($($name:ident: $value:ty, $bits:expr, $from:expr;)*) => {$(
        impl Bits for $value {
            fn bits(self) -> u64 {
                $bits(self)
            }
            fn from(bits: u64) -> Self {
                $from(bits)
            }
        }

        #[doc = concat!("As `core::sync::atomic::", stringify!($name), "`.")]
        #[derive(Debug, Default)]
        pub struct $name($value);

        impl $name {
            /// As that of `core`.
            #[must_use]
            pub const fn new(first: $value) -> Self {
                Self(first)
            }

            /// As that of `core`.
            #[must_use]
            pub fn load(&self, _: Ordering) -> $value {
                interrupt();
                Bits::from(with(|memory| memory.load(ptr::from_ref(self).addr(), self.0.bits())))
            }

            /// As that of `core`.
            pub fn store(&self, value: $value, _: Ordering) {
                interrupt();
                with(|memory| memory.store(ptr::from_ref(self).addr(), value.bits(), self.0.bits()));
            }
        }
    )*};
}

atomics! {
    AtomicBool: bool, u64::from, |bits| bits != 0;
    AtomicI32: i32, |value: i32| u64::from(value.cast_unsigned()), |bits| (bits as u32).cast_signed();
    AtomicU8: u8, u64::from, |bits| bits as u8;
    AtomicU32: u32, u64::from, |bits| bits as u32;
    AtomicUsize: usize, |value| value as u64, |bits| bits as usize;
}
