//! Persistent loops, whose code stays in the instruction cache although not all of the task's code
//! does, and the cache-related preemption delay (CRPD) of the rest of its code.
//!
//! While a loop runs, only the lines of the loop and of the tasks that preempt it are used. If all of
//! these lines fit the cache together, none is evicted before the loop is left, in whatever order they
//! are used: each line is missed once at most.
//!
//! The rest of the code proceeds from line to line, and so evicts lines of the preempting tasks now
//! and then. Divide such code into *stretches*, each of which uses as many different lines as the cache
//! holds besides the lines of the preempting tasks: in a stretch, too, each of the preempting tasks'
//! lines is missed once at most. Every stretch but the last before a visit of a loop, or before the
//! end, fetches as many lines. So a visit pays for the stretch that it ends, and each fetched line
//! pays its share of another stretch.

use std::collections::{BTreeMap, BTreeSet};

use crate::{Block, Count, Function, Loop, Operation, model::CACHE_LINES, wcet::Wcets};

/// Assumed iterations of a loop whose bound varies with the step rate.
const VARIED_ITERATIONS: u64 = 100;

/// Lines that are in use where a stretch begins: an interrupted instruction goes on in them.
const IN_USE: usize = 2;

/// The share by which code pays for the preempting tasks' lines, fetched once in each stretch.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub(crate) struct Share {
    /// Cycles for each line that is fetched outside of visits.
    pub(crate) of_line: u64,
    /// Cycles for each visit: of the stretch that it ends.
    pub(crate) of_visit: u64,
}

impl Share {
    /// The share for `warm` lines of warm tasks among `resident` lines of all tasks that stay cached;
    /// `None` where these leave no room in the cache.
    pub(crate) fn new(warm: usize, resident: usize, miss: u64) -> Option<Self> {
        let of_visit = warm as u64 * miss;
        let room = CACHE_LINES.checked_sub(resident + IN_USE)?;
        (room > 0).then(|| Self {
            of_line: of_visit.div_ceil(room as u64),
            of_visit,
        })
    }

    /// For code of which only the cycles without a cache are known: each of its fetches counts as a
    /// miss.
    pub(crate) fn of_uncached(self, cycles: u64, miss: u64) -> u64 {
        cycles.div_ceil(miss.max(1)) * self.of_line
    }
}

/// The persistent loops of a function, the outermost of those within each other.
#[derive(Debug, Clone, Default)]
pub(crate) struct PersistentLoops {
    /// For each block the head of its loop.
    pub(crate) of_block: Vec<Option<usize>>,
    /// For each head, how many lines are missed in one visit.
    pub(crate) lines: BTreeMap<usize, u64>,
}

impl PersistentLoops {
    pub(crate) fn new(wcets: &Wcets<'_>, function: &Function) -> Self {
        let mut new = Self {
            of_block: vec![None; function.blocks.len()],
            lines: BTreeMap::new(),
        };
        if wcets.model.prefetch || function.loops.is_empty() {
            return new;
        }
        let touched = wcets.touched_by_blocks(function);
        let mut loops: Vec<&Loop> = function.loops.iter().collect();
        loops.sort_by_key(|looped| std::cmp::Reverse(looped.blocks.len()));
        for looped in loops {
            if new.of_block[looped.head].is_some() {
                continue;
            }
            let own = looped.blocks.iter().flat_map(|block| &touched[*block]);
            let own: BTreeSet<u32> = own.copied().collect();
            let all = own.union(&wcets.resident_lines).count();
            if all > CACHE_LINES || !pays(wcets, looped, own.len(), all) {
                continue;
            }
            new.lines.insert(looped.head, all as u64);
            for block in &looped.blocks {
                new.of_block[*block] = Some(looped.head);
            }
        }
        new
    }
}

/// Whether there is an exclusive store in any of these functions.
pub(crate) fn has_exclusive_store(wcets: &Wcets<'_>, functions: &BTreeSet<u32>) -> bool {
    let functions = functions
        .iter()
        .filter_map(|address| wcets.functions.get(address));
    let mut blocks = functions.flat_map(|function| &function.blocks);
    blocks.any(stores_exclusively)
}

/// Whether there is an exclusive store in a block.
pub(crate) fn stores_exclusively(block: &Block) -> bool {
    let mut instructions = block.instructions.iter();
    instructions.any(|it| matches!(it.operation, Operation::StoreExclusive { .. }))
}

/// Whether loading all lines for a visit costs less than fetching the loop in each iteration.
fn pays(wcets: &Wcets<'_>, looped: &Loop, own: usize, all: usize) -> bool {
    let total = looped.total.as_ref().map(|total| &total.bound.count);
    let count = total.or(looped.bound.as_ref().map(|bound| &bound.count));
    // One decision for all values: so that costs grow evenly with them.
    let iterations = count.map_or(0, |count| match count {
        Count::Number(number) => *number,
        Count::Named(name) if wcets.varied.contains(name) => VARIED_ITERATIONS,
        Count::Named(_) => wcets.number(count).unwrap_or(0),
    });
    let (miss, share) = (wcets.model.miss(), wcets.share);
    let each_iteration = iterations.saturating_mul(own as u64 * (miss + share.of_line));
    each_iteration > all as u64 * miss + share.of_visit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Cache, Model, testing, wcet::Functions};
    use proptest::prelude::*;

    const SHARE: Share = Share {
        of_line: 3,
        of_visit: 50,
    };

    /// One loop of 20 iterations of 4 + 6 instructions, with code before and after.
    fn bounds(resident: usize) -> [u64; 2] {
        let shape: &[(u32, &[usize])] = &[(3, &[1]), (4, &[2, 3]), (6, &[1]), (2, &[])];
        let mut function = testing::function(shape);
        function.loops = vec![testing::counted(1, &[1, 2], &[2], 20)];
        let functions = Functions::from([(function.address, function)]);
        let model = Model::new(&testing::CLOCK);
        let named = BTreeMap::new();
        let mut wcets = Wcets::new(&functions, &model, &named, BTreeSet::new());
        wcets.resident_lines = (0..resident as u32).collect();
        wcets.share = SHARE;
        [Cache::Loops, Cache::Shared].map(|cache| wcets.bound(0x0800_0000, cache).unwrap().cycles())
    }

    #[test]
    fn a_loop_that_fits_is_loaded_once() {
        // Blocks of one or two lines: 2, 2, 2 and 1; the refill of the return.
        let outside = 3 + 5 * 2 + 2 + 5 + 3;
        let alone = outside + 21 * 4 + 20 * 6 + 5 * (4 + 10);
        assert_eq!(bounds(10), [alone, alone + 50 + 3 * (2 + 1)]);
    }

    #[test]
    fn a_loop_that_does_not_fit_with_the_resident_lines_is_fetched_each_iteration() {
        let alone = 3 + 10 + 21 * (4 + 10) + 20 * (6 + 10) + 2 + 5 + 3;
        assert_eq!(bounds(61), [alone, alone + 3 * (2 + 21 * 2 + 20 * 2 + 1)]);
    }

    /// A cache of that many lines: the line used last comes last.
    #[derive(Default)]
    struct Lru(Vec<u32>);

    impl Lru {
        /// Uses a line; 1 if it was not there.
        fn touch(&mut self, line: u32) -> u64 {
            let place = self.0.iter().position(|it| *it == line);
            place.map(|place| self.0.remove(place));
            self.0.push(line);
            if self.0.len() > CACHE_LINES {
                self.0.remove(0);
            }
            u64::from(place.is_none())
        }
    }

    /// What happens: code goes to a line, or through a loop of so many lines; a warm task runs, or a
    /// cold one.
    #[derive(Debug, Clone)]
    enum Act {
        Line(u32),
        Visit(u32, Vec<(u32, bool)>),
        Warm(Vec<u32>),
        Cold(Vec<u32>),
    }

    const MISS: u64 = 100;
    const WARM_LINES: u32 = 12;
    const COLD_LINES: u32 = 20;

    fn act() -> impl Strategy<Value = Act> {
        let warm = || proptest::collection::vec(0..WARM_LINES, 1..20);
        let in_visit = proptest::collection::vec((0..32_u32, any::<bool>()), 1..60);
        prop_oneof![
            20 => (0..2000_u32).prop_map(Act::Line),
            20 => (0..40_u32).prop_map(Act::Line),
            1 => (1..=64 - WARM_LINES - COLD_LINES, in_visit).prop_map(|(lines, iterations)| Act::Visit(lines, iterations)),
            3 => warm().prop_map(Act::Warm),
            1 => Just(Act::Warm((0..WARM_LINES).collect())),
            2 => proptest::collection::vec(0..COLD_LINES, 1..30).prop_map(Act::Cold),
        ]
    }

    /// Code that evicts a warm task again and again, with as few lines as it can.
    fn evicting() -> impl Strategy<Value = Vec<Act>> {
        (25..40_u32, 1..40_u32).prop_map(|(lines, times)| {
            let iteration = |time| {
                let code = (0..lines).map(move |line| Act::Line(time * lines + line));
                code.chain([
                    Act::Cold((0..COLD_LINES).collect()),
                    Act::Warm((0..WARM_LINES).collect()),
                ])
            };
            (0..times).flat_map(iteration).collect()
        })
    }

    proptest! {
        #![proptest_config(crate::cases(64))]

        #[test]
        fn warm_tasks_miss_no_more_lines_than_are_charged(
            acts in prop_oneof![proptest::collection::vec(act(), 1..1500), evicting()],
        ) {
            let share = Share::new(WARM_LINES as usize, (WARM_LINES + COLD_LINES) as usize, MISS).unwrap();
            let mut cache = Lru::default();
            let (mut missed, mut again, mut charged) = (0, 0, share.of_visit);
            let mut in_use = Vec::new();
            for act in &acts {
                match act {
                    Act::Line(line) => {
                        cache.touch(1000 + line);
                        charged += share.of_line;
                        in_use.push(1000 + line);
                    }
                    Act::Visit(lines, iterations) => {
                        // Its own lines, and once the resident lines.
                        charged += share.of_visit + u64::from(WARM_LINES) * MISS;
                        for (line, preempts) in iterations {
                            cache.touch(5000 + line % lines);
                            if *preempts {
                                missed += (0..WARM_LINES).map(|line| cache.touch(line)).sum::<u64>();
                            }
                        }
                        in_use.clear();
                    }
                    Act::Warm(lines) => {
                        missed += lines.iter().map(|line| cache.touch(*line)).sum::<u64>();
                    }
                    Act::Cold(lines) => {
                        for line in lines {
                            cache.touch(100 + line);
                        }
                    }
                }
                // The preempted code resumes.
                let begin = in_use.len().saturating_sub(IN_USE);
                again += in_use[begin..].iter().map(|line| cache.touch(*line)).sum::<u64>();
            }
            prop_assert!(missed * MISS <= charged, "{} misses, {} charged", missed, charged);
            prop_assert_eq!(again, 0);
        }
    }
}
