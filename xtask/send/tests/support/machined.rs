//! The material that a tool path removes.

use std::collections::{HashMap, HashSet};

/// The material removed below a surface, in steps.
///
/// Places of vertical moves do not count as removed at their depth. A continued job lifts the tool wherever the
/// machine was held, and plunges at the start of a line.
pub(crate) struct MachinedPath {
    /// Places at which it moved sideways.
    horizontal: HashSet<[i32; 3]>,
    /// The lowest Z at each place, X and Y.
    lowest: HashMap<[i32; 2], i32>,
}

impl MachinedPath {
    /// Takes all places of a way, X Y Z, one step from each other.
    pub(crate) fn of(tool_path: &[[i32; 3]], surface: i32) -> Self {
        let mut lowest = HashMap::new();
        for [x, y, z] in tool_path.iter().filter(|[_, _, z]| *z < surface) {
            let known = lowest.entry([*x, *y]).or_insert(*z);
            *known = (*known).min(*z);
        }
        let is_horizontal = |pair: &&[[i32; 3]]| pair[0][..2] != pair[1][..2];
        let horizontal = tool_path
            .windows(2)
            .filter(is_horizontal)
            .flatten()
            .filter(|[_, _, z]| *z < surface)
            .copied()
            .collect();
        Self { horizontal, lowest }
    }

    /// At how many places it has cut.
    pub(crate) fn len(&self) -> usize {
        self.lowest.len()
    }

    /// The places that are farther than a step from where `other` moved sideways at their depth, or below all that
    /// it has reached within a step.
    pub(crate) fn beyond(&self, other: &Self) -> Vec<[i32; 3]> {
        let around =
            |x: i32, y: i32| (-1..=1).flat_map(move |dx| (-1..=1).map(move |dy| [x + dx, y + dy]));
        let is_elsewhere = |[x, y, z]: &&[i32; 3]| {
            !around(*x, *y).any(|[x, y]| other.horizontal.contains(&[x, y, *z]))
        };
        let is_deeper = |[x, y, z]: &[i32; 3]| {
            !around(*x, *y).any(|place| other.lowest.get(&place).is_some_and(|lowest| lowest <= z))
        };
        let lowest = self.lowest.iter().map(|([x, y], z)| [*x, *y, *z]);
        let elsewhere = self.horizontal.iter().filter(is_elsewhere).copied();
        let mut beyond: Vec<_> = elsewhere.chain(lowest.filter(is_deeper)).collect();
        beyond.sort_unstable();
        beyond.dedup();
        beyond
    }
}

#[test]
fn a_place_that_is_only_passed_while_lifting_is_not_removed_and_a_deeper_or_offset_one_is() {
    let tool_path = |places: &[[i32; 3]]| MachinedPath::of(places, 0);
    let down = [[0, 0, 1], [0, 0, 0], [0, 0, -1], [0, 0, -2]];
    let along: Vec<_> = (0..9).map(|x| [x, 0, -2]).collect();
    let job = tool_path(&[&down[..], &along].concat());
    let held = [[4, 0, -2], [4, 0, -1], [4, 0, 0], [4, 0, 1]];
    let again = |more: &[[i32; 3]]| tool_path(&[&down[..], &along[..5], &held, more].concat());
    let others: Vec<_> = (0..9).map(|x| [x, 1, -2]).collect();
    assert!(again(&others).beyond(&job).is_empty());
    assert!(job.beyond(&again(&others)).is_empty());
    // The end is missing, a line is farther off than a step, it is at another depth, a hole is too deep.
    assert_eq!(job.beyond(&again(&others[..7])), [[8, 0, -2]]);
    for (more, place) in [
        ([[6, 2, -2], [7, 2, -2]], [6, 2, -2]),
        ([[6, 0, -1], [7, 0, -1]], [6, 0, -1]),
        ([[8, 0, -2], [8, 0, -3]], [8, 0, -3]),
    ] {
        let more = [
            &others[..],
            &[[8, 1, 1], [more[0][0], more[0][1], 1]],
            &more,
        ]
        .concat();
        assert!(again(&more).beyond(&job).contains(&place), "{more:?}");
    }
}
