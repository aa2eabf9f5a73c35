//! Each module of `src/` uses the layers below its own, and no other: read from the sources.

use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

/// The layers, from the bottom up.
const LAYERS: [&[&str]; 11] = [
    &["axis", "decimal", "math", "units"],
    &["model"],
    &["settings"],
    &["gcode", "stepper"],
    &["path"],
    &["machine"],
    &["motion"],
    &["protocol"],
    &["tasks"],
    &["board", "sim"],
    &["app"],
];

fn layer(module: &str) -> usize {
    LAYERS
        .iter()
        .position(|layer| layer.contains(&module))
        .unwrap_or_else(|| {
            panic!(
                "src/{module} is in no layer: add it to LAYERS in tests/layers.rs and to src/lib.rs"
            )
        })
}

/// Whether a module may use another: what is below it, itself, and at the bottom its neighbours. The
/// firmware takes nothing from the simulator.
fn may_use(user: &str, used: &str) -> bool {
    if used == "sim" {
        return user == "sim";
    }
    user == used || layer(used) < layer(user) || layer(user) == 0 && layer(used) == 0
}

/// The modules of the crate that a source uses, with the number of the line.
fn uses(module: &[&str], source: &str) -> Vec<(usize, String)> {
    let code: String = source
        .lines()
        .map(|line| line.split("//").next().unwrap_or_default())
        .collect::<Vec<_>>()
        .join("\n");
    let mut found = Vec::new();
    for root in ["crate::", "leadscrew::"] {
        for (at, _) in code.match_indices(root) {
            let is_whole = !code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
            if is_whole {
                let line = code[..at].matches('\n').count();
                for (offset, name) in heads(&code[at + root.len()..]) {
                    found.push((line + offset + 1, name));
                }
            }
        }
    }
    // A `super` too many leads to the crate's root, from where everything could be used.
    for (number, line) in code.lines().enumerate() {
        let depth = module.len() + usize::from(line.starts_with(' '));
        let to_root = "super::".repeat(depth);
        if let Some((_, rest)) = line.split_once(&to_root) {
            found.extend(heads(rest).into_iter().map(|(_, name)| (number + 1, name)));
        }
    }
    found
}

/// The first names of a path or of a tree of paths, with the lines before each.
fn heads(path: &str) -> Vec<(usize, String)> {
    let name = |text: &str| -> String {
        text.chars()
            .take_while(|c| c.is_alphanumeric() || *c == '_')
            .collect()
    };
    let Some(tree) = path.strip_prefix('{') else {
        return vec![(0, name(path))];
    };
    let (mut depth, mut line, mut is_head) = (1, 0, true);
    let mut found = Vec::new();
    for (at, c) in tree.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            '\n' => line += 1,
            ',' => is_head = depth == 1,
            _ if is_head && c.is_alphabetic() => {
                is_head = false;
                found.push((line, name(&tree[at..])));
            }
            _ => {}
        }
        if depth == 0 {
            break;
        }
    }
    found
}

/// What is wrong with the uses of one file, a line for each.
fn upward(path: &str, source: &str, modules: &[String]) -> String {
    let inner = path.trim_end_matches(".rs").trim_end_matches("/mod");
    let module: Vec<&str> = inner.split('/').collect();
    let user = module[0];
    let mut told = String::new();
    for (line, used) in uses(&module, source) {
        if modules.contains(&used) && !may_use(user, &used) {
            let below: Vec<&str> = LAYERS[..layer(user)].concat();
            let _ = writeln!(
                told,
                "src/{path}:{line}: `{user}` uses `{used}`, which is not below it; allowed are {}",
                below.join(", "),
            );
        }
    }
    told
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    let entries = fs::read_dir(folder).expect("the sources can be read");
    for entry in entries {
        let path = entry.expect("the sources can be read").path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn every_module_uses_only_what_is_below_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let within: Vec<String> = files
        .iter()
        .map(|path| path.strip_prefix(&root).expect("it is in src"))
        .map(|path| path.to_string_lossy().replace('\\', "/"))
        .filter(|path| path != "lib.rs" && path != "main.rs")
        .collect();
    let modules: Vec<String> = within
        .iter()
        .map(|path| path.split(['/', '.']).next().expect("it has a name").into())
        .collect();
    let told: String = within
        .iter()
        .map(|path| {
            let source = fs::read_to_string(root.join(path)).expect("the sources can be read");
            upward(path, &source, &modules)
        })
        .collect();
    assert!(files.len() > 50, "the sources are not where they were");
    assert!(told.is_empty(), "\n{told}");
}

#[test]
fn a_use_of_a_layer_above_is_found_however_it_is_written() {
    let modules: Vec<String> = LAYERS.concat().iter().map(ToString::to_string).collect();
    for (path, source, line) in [
        ("gcode/block.rs", "use crate::path::Block;\n", 1),
        (
            "model/state.rs",
            "use crate::{\n    axis::Axes,\n    machine::{A, B},\n};\n",
            3,
        ),
        (
            "settings/mod.rs",
            "\nfn f() { crate::stepper::steps() }\n",
            2,
        ),
        ("stepper/mod.rs", "use super::machine::Inputs;\n", 1),
        (
            "model/alarm.rs",
            "mod tests {\n    use super::super::super::sim::Edge;\n}\n",
            2,
        ),
        (
            "app.rs",
            "use leadscrew::{machine::Inputs, sim::Edge};\n",
            1,
        ),
        ("gcode/word.rs", "use crate::stepper::Segment;\n", 1),
    ] {
        let told = upward(path, source, &modules);
        let place = format!("src/{path}:{line}: ");
        assert!(told.starts_with(&place), "{path}: {told:?}");
    }
    for (path, source) in [
        (
            "path/block.rs",
            "use crate::{gcode::Block, units::Nm};\n// crate::sim::Edge\n",
        ),
        (
            "gcode/block.rs",
            "use super::Word;\nmod tests {\n    use super::*;\n}\n",
        ),
        ("axis.rs", "use crate::units::Nm;\n"),
    ] {
        assert_eq!(upward(path, source, &modules), "", "{path}");
    }
}
