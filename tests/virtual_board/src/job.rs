//! A program's step edges at the pins, compared with the step events of the simulator.

use std::{fs, path::Path};

use anyhow::{Context as _, Result};

use crate::plant::{Step, name_of_axis};

/// Compares steps with a file of step events: the time in ns, and the position of each axis behind it. Returns what
/// differs first.
pub(crate) fn difference(steps: &[Step], file: &Path) -> Result<Option<String>> {
    let text =
        fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    let mut rows = text.lines().skip(1);
    let mut steps = steps.iter();
    let mut before: Vec<i64> = Vec::new();
    let mut count = 0;
    for row in &mut rows {
        let mut cells = row.split(',').map(|cell| cell.trim().parse::<i64>());
        let _time = cells.next().context("a row is empty")?;
        let after: Vec<i64> = cells.collect::<Result<_, _>>()?;
        before.resize(after.len(), 0);
        // The axes of one event, in whatever order their ports are written.
        let mut wanted: Vec<(usize, bool)> = { before.iter().zip(&after).enumerate() }
            .filter(|(_, (before, after))| before != after)
            .map(|(axis, (before, after))| (axis, after > before))
            .collect();
        while !wanted.is_empty() {
            let step = steps.next();
            let found = step.and_then(|step| {
                let is_wanted = |it: &(usize, bool)| *it == (step.axis, step.is_forward);
                wanted.iter().position(is_wanted)
            });
            let Some(found) = found else {
                return Ok(Some(describe(count, step, &wanted)));
            };
            wanted.remove(found);
            count += 1;
        }
        before = after;
    }
    Ok(steps.next().map(|step| describe(count, Some(step), &[])))
}

fn describe(count: usize, step: Option<&Step>, wanted: &[(usize, bool)]) -> String {
    let named = |axis: usize, is_forward: bool| {
        format!(
            "{}{}",
            name_of_axis(axis),
            if is_forward { '+' } else { '-' }
        )
    };
    let is = step.map_or("nothing".into(), |step| named(step.axis, step.is_forward));
    let wanted: Vec<_> = wanted.iter().map(|&(axis, is)| named(axis, is)).collect();
    let wanted = if wanted.is_empty() {
        "the end".into()
    } else {
        wanted.join(" ")
    };
    let at = step.map_or(String::new(), |step| {
        format!(" at {:.3} ms", step.at.0 as f64 / 1e6)
    });
    format!("step {count} at the pins is {is}{at}, the simulator's is {wanted}")
}

#[cfg(test)]
mod tests {
    use rigless::time::VirtualNanos;

    use super::*;

    /// X forward, Y back, at the same time.
    fn steps(all: &[(usize, bool)]) -> Vec<Step> {
        let steps = all.iter().map(|&(axis, is_forward)| Step {
            at: VirtualNanos(0),
            axis,
            is_forward,
        });
        steps.collect()
    }

    #[test]
    fn steps_are_compared_in_order_and_those_of_one_event_in_any() {
        let folder = std::env::temp_dir().join(format!("leadscrew-job-{}", std::process::id()));
        fs::write(&folder, "time_ns,x,y\n0,1,0\n5,2,-1\n").unwrap();
        let compared = |all: &[(usize, bool)]| difference(&steps(all), &folder).unwrap();
        assert_eq!(compared(&[(0, true), (0, true), (1, false)]), None);
        assert_eq!(compared(&[(0, true), (1, false), (0, true)]), None);
        for wrong in [
            &[(0, true), (0, true)][..],
            &[(1, false), (0, true), (0, true)],
            &[(0, true), (0, true), (1, true)],
            &[(0, true), (0, true), (1, false), (1, false)],
        ] {
            assert!(compared(wrong).is_some(), "{wrong:?}");
        }
        fs::remove_file(&folder).unwrap();
    }
}
