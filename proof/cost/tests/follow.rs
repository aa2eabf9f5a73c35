//! The plugin in QEMU follows a program against what the analysis says of it.

mod support;

use std::{fs, path::Path};

use schedule::replay::Summary;

const PROGRAM: &str = include_str!("follow/program.rs");
const BOUND: &str = "wcet-bound: 20";

#[test]
fn a_program_that_keeps_its_bounds_contradicts_nothing() {
    let Some(summary) = run(PROGRAM) else { return };
    assert_eq!(summary.violations, []);
    let runs = &summary.tasks[0];
    assert_eq!((runs.name.as_str(), runs.activations), ("count", 20));
    assert_eq!(runs.blocks, runs.executed, "{:?}", runs.never);
    assert!(runs.warm_max > runs.warm_sum / 20);
    assert_eq!(summary.unpredicted, 0);
}

#[test]
fn a_loop_that_runs_more_often_than_its_comment_says_is_reported_with_its_line() {
    let Some(summary) = run(&PROGRAM.replace(BOUND, "wcet-bound: 1")) else {
        return;
    };
    let line = PROGRAM.lines().position(|line| line.contains(BOUND));
    let comment = format!(
        "(src/main.rs:{})",
        line.expect("the program has a bound") + 1
    );
    assert_eq!(summary.violations.len(), 1);
    let violation = &summary.violations[0];
    assert!(
        violation.what.starts_with("a loop runs more than 1 times"),
        "{violation:?}"
    );
    assert!(violation.what.contains(&comment), "{violation:?}");
    let mut places = violation.place.iter();
    assert!(
        places.any(|place| place.starts_with("PendSV (src/main.rs:")),
        "{violation:?}"
    );
}

/// Follows a program; `None`, and a word why, when a tool is missing.
fn run(source: &str) -> Option<Summary> {
    let folder = support::scratch();
    let elf = support::programs::compile(&folder, source)?;
    let given = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/follow");
    for (name, place) in [("app.rs", "src/app.rs"), ("schedule.toml", "schedule.toml")] {
        fs::copy(given.join(name), folder.join(place)).expect("the target folder is writable");
    }
    let out = folder.join("summary.json");
    let plugin = format!(
        "{},elf={},root={},board=emulated,clock=168/5/4/2,axes=3,out={}",
        support::plugin().display(),
        elf.display(),
        folder.display(),
        out.display()
    );
    support::emulate(&elf, &plugin, 60)?;
    let text = fs::read_to_string(out).expect("the plugin writes its report when QEMU exits");
    Some(serde_json::from_str(&text).expect("the report is JSON"))
}
