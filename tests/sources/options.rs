//! The command line is read in one place.

use std::fs;

/// The text of a manifest, by its folder.
fn manifest(folder: &str) -> String {
    let path = format!("{}/../{folder}/Cargo.toml", env!("CARGO_MANIFEST_DIR"));
    fs::read_to_string(path).expect("a manifest")
}

/// Whether a package that is no test of it depends on clap.
fn reads_arguments(manifest: &str) -> bool {
    let mut table = "";
    manifest.lines().any(|line| {
        if line.starts_with('[') {
            table = line;
        }
        table.ends_with("dependencies]")
            && !table.contains("dev-dependencies")
            && line
                .strip_prefix("clap")
                .is_some_and(|rest| rest.starts_with(['.', ' ', '=']))
    })
}

/// A tool whose arguments are read otherwise than by `cargo xtask` refuses them.
#[test]
fn only_the_library_of_the_tools_reads_arguments() {
    let workspace = manifest(".");
    let (_, members) = workspace.split_once("members = [").expect("a workspace");
    let (members, _) = members.split_once(']').expect("an end of the members");
    let folders = members.split('"').skip(1).step_by(2);
    let readers: Vec<_> = folders
        .filter(|folder| reads_arguments(&manifest(folder)))
        .collect();
    assert_eq!(readers, ["xtask"]);
}

#[test]
fn a_dependency_on_clap_is_found_however_it_is_written() {
    for line in [
        "clap = \"4\"",
        "clap.workspace = true",
        "clap={ version = \"4\" }",
    ] {
        for (table, is_found) in [
            ("[dependencies]", true),
            ("[dev-dependencies]\n[dependencies]", true),
            ("[target.'cfg(unix)'.dependencies]", true),
            ("[dependencies]\n[dev-dependencies]", false),
            ("[features]", false),
        ] {
            let found = reads_arguments(&format!("{table}\n{line}\n"));
            assert_eq!(found, is_found, "{table} {line}");
        }
    }
    assert!(!reads_arguments("[dependencies]\nclap_lex = \"1\"\n"));
}
