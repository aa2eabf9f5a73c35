//! Each board and chip of `boards/` is everywhere where it has to be: read from the sources.

use std::{fs, path::Path};

fn text(path: &str) -> String {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    fs::read_to_string(root.join(path)).unwrap_or_default()
}

/// Returns the names of the files of a folder that end in `.toml`, but for Cargo's.
fn names(folder: &str) -> Vec<String> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let listing = fs::read_dir(root.join(folder)).expect("the folder is there");
    let names = listing.flatten().map(|entry| entry.file_name());
    let names = names.filter_map(|name| Some(name.to_str()?.strip_suffix(".toml")?.to_owned()));
    names.filter(|name| name != "Cargo").collect()
}

#[test]
fn a_board_is_in_the_list_that_users_choose_from() {
    let boards = names("boards");
    assert!(!boards.is_empty());
    let lists = ["README.md", "docs/boards.md"].map(text);
    for board in boards {
        let name = format!("`{board}`");
        assert!(
            lists.iter().all(|list| list.contains(&name)),
            "README.md or docs/boards.md has no {name}: run `cargo xtask docs`"
        );
    }
}

#[test]
fn a_board_has_its_rates() {
    let rates = text("docs/rates.toml");
    for board in names("boards") {
        assert!(
            rates.contains(&format!("\n\"{board}\" = [")),
            "docs/rates.toml has no `{board}`: run `cargo xtask release --board {board} --out DIR --write`"
        );
    }
}

#[test]
fn a_chip_has_a_feature_with_that_of_the_hal() {
    let manifest = text("Cargo.toml");
    let chips = names("boards/chips");
    assert!(!chips.is_empty());
    for chip in chips {
        let feature = format!("chip-{chip} = [\"board\", \"stm32f4xx-hal/stm32{chip}\"]");
        assert!(manifest.contains(&feature), "Cargo.toml has no {feature}");
        let hal = format!("hal = \"{chip}\"");
        let file = format!("boards/chips/{chip}.toml");
        assert!(text(&file).contains(&hal), "{file} has no {hal}");
    }
}
