//! Each board is everywhere where it has to be: read from the sources.

use std::{fs, path::Path};

fn text(path: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    fs::read_to_string(root.join(path)).unwrap_or_default()
}

/// Returns the names of the boards that Cargo.toml has a feature for.
fn boards() -> Vec<String> {
    let manifest = text("Cargo.toml");
    let features = manifest.lines().filter_map(|line| line.split_once(" = "));
    let boards = features.filter_map(|(name, _)| name.strip_prefix("board-"));
    boards.map(str::to_owned).collect()
}

#[test]
fn a_board_is_in_every_place_that_needs_it() {
    let boards = boards();
    assert!(!boards.is_empty());
    let mut missing = Vec::new();
    for board in &boards {
        let module = board.replace('-', "_");
        let feature = format!("feature = \"board-{board}\"");
        for (path, needle, what) in [
            (
                format!("src/board/{module}.rs").as_str(),
                "WIRING",
                "write the module of the board: WIRING, Usart, init, set_pulse",
            ),
            (
                "src/board/mod.rs",
                &feature,
                "declare the module under the feature, `use` it as `chosen`, and its init",
            ),
            (
                "Cargo.toml",
                &format!("[package.metadata.board.{board}]"),
                "add the section, with what probe-rs calls the chip: the tools list boards by it",
            ),
            (
                "schedule.toml",
                &format!("[board.{board}.clock]"),
                "add the section: the proof needs the board's clocks",
            ),
            (
                "tests/target_calibrate.rs",
                &feature,
                "set up the clocks of the board's init",
            ),
            (
                "docs/wiring.md",
                &format!("src/board/{module}.rs"),
                "add the board's pins to the tables, and a link to its module",
            ),
            (
                "README.md",
                &format!("`{board}`"),
                "add the board to the list",
            ),
        ] {
            if !text(path).contains(needle) {
                missing.push(format!("{path} has no {needle}: {what}"));
            }
        }
    }
    assert!(missing.is_empty(), "\n{}", missing.join("\n"));
}

#[test]
fn every_board_of_the_tools_has_a_feature() {
    let boards = boards();
    for line in text("Cargo.toml").lines() {
        let section = line.strip_prefix("[package.metadata.board.");
        if let Some(board) = section.and_then(|rest| rest.strip_suffix(']')) {
            assert!(
                boards.iter().any(|known| known == board),
                "add the feature board-{board} to Cargo.toml, with the HAL's feature of its chip"
            );
        }
    }
}
