//! Rules about the sources: layers, words, sentences, costs, types, variants, glue, boards, and paths and
//! links in documents.

#![cfg(not(target_os = "none"))]

mod boards;
mod costs;
mod glue;
mod layers;
mod links;
mod options;
mod paths;
mod random;
mod sentences;
mod size;
mod types;
mod variants;
mod walk;
mod words;

use std::{
    fs,
    path::{Path, PathBuf},
};

/// The files of Rust at or below some places of the project, as paths from its root, with what is in
/// them.
fn sources(places: &[&str]) -> Vec<(String, String)> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let mut files = Vec::new();
    for place in places {
        collect(&root.join(place), &mut files);
    }
    files.sort();
    files
        .into_iter()
        .map(|path| {
            let source = fs::read_to_string(&path).expect("the sources can be read");
            let below = path.strip_prefix(root).expect("it is in the project");
            (below.to_string_lossy().replace('\\', "/"), source)
        })
        .collect()
}

fn collect(place: &Path, found: &mut Vec<PathBuf>) {
    if place.is_file() {
        found.push(place.to_owned());
        return;
    }
    for entry in fs::read_dir(place).expect("the sources can be read") {
        let path = entry.expect("the sources can be read").path();
        if path.is_dir() || path.extension().is_some_and(|ending| ending == "rs") {
            collect(&path, found);
        }
    }
}
