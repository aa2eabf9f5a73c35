//! What a newcomer compiles for his first picture.

use std::{collections::BTreeSet, process::Command};

#[test]
fn the_simulator_needs_at_most_sixty_crates_of_others() {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--package", "xtask", "--package", "simulation"])
        .args(["--edges", "normal,build", "--prefix", "none", "--offline"])
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{output:?}");
    let tree = String::from_utf8(output.stdout).expect("names are text");
    // The project's own stand with their folder.
    let crates: BTreeSet<_> = tree
        .lines()
        .map(|line| line.trim_end_matches(" (*)"))
        .filter(|line| !line.is_empty() && !line.contains('/'))
        .collect();
    assert!(
        (30..=60).contains(&crates.len()),
        "{}: {crates:#?}",
        crates.len()
    );
}
