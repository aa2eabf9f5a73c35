//! The source lines of a row's worst path.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    Cache, Line,
    system::{Row, System},
};

/// Most lines that are listed.
const MOST_LINES: usize = 40;

/// The lines of a row's worst path with such a cache, the costliest first; none where it has no deadline.
pub(crate) fn of(
    system: &System<'_>,
    row: &Row,
    named: &BTreeMap<String, u64>,
    cache: Cache,
) -> Vec<Line> {
    if row.times.is_none() {
        return Vec::new();
    }
    let wcets = system.wcets(row, named);
    let mut lines: BTreeMap<(String, u32, String), (u64, u64)> = BTreeMap::new();
    for ((address, block), count) in wcets.block_counts(row.root, cache) {
        let Some(function) = system.program.function(address) else {
            continue;
        };
        let mut seen = BTreeSet::new();
        for (at, cycles) in wcets.costs(function, block, cache) {
            let frames = system.image.frames(at);
            let Some(frame) = frames.iter().find(|frame| frame.file.starts_with("src/")) else {
                continue;
            };
            let key = (
                frame.file.to_string(),
                frame.line,
                frame.function.to_string(),
            );
            let line = lines.entry(key.clone()).or_default();
            line.0 += count * cycles;
            if seen.insert(key) {
                line.1 = line.1.max(count);
            }
        }
    }
    let lines = lines
        .into_iter()
        .map(|((file, line, function), (cycles, count))| Line {
            file,
            line,
            function,
            cycles,
            count,
        });
    let mut lines: Vec<Line> = lines.collect();
    lines.sort_by_key(|line| std::cmp::Reverse(line.cycles));
    lines.truncate(MOST_LINES);
    lines
}
