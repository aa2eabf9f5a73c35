//! Each module of `src/`, and of `src/board/`, uses the layers below its own, and no other: read from the sources.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Write as _,
};

use super::sources;

/// The layers, from the bottom up.
const LAYERS: [&[&str]; 12] = [
    &["axis", "decimal", "math", "units"],
    &["model"],
    &["settings"],
    &["gcode", "stepper"],
    &["path"],
    &["machine"],
    &["motion"],
    &["protocol"],
    &["tasks"],
    &["usb"],
    &["board", "sim"],
    &["app"],
];

/// The folders whose modules use each other in one direction only.
const WITHOUT_CIRCLES: [&str; 3] = ["board", "gcode/interpreter", "motion/jerk_limited"];

fn layer(module: &str) -> usize {
    LAYERS
        .iter()
        .position(|layer| layer.contains(&module))
        .unwrap_or_else(|| {
            panic!(
                "src/{module} is in no layer: add it to LAYERS in tests/sources/layers.rs and to src/lib.rs"
            )
        })
}

/// Returns true if a module may use another: those below it, itself, and at the bottom its neighbours. The
/// firmware takes nothing from the simulator.
fn may_use(user: &str, used: &str) -> bool {
    if used == "sim" {
        return user == "sim";
    }
    user == used || layer(used) < layer(user) || layer(user) == 0 && layer(used) == 0
}

/// A source without its comments.
fn code(source: &str) -> String {
    let lines = source.lines();
    let lines = lines.map(|line| line.split("//").next().unwrap_or_default());
    lines.collect::<Vec<_>>().join("\n")
}

/// The modules of the crate that a source uses, with the number of the line.
fn uses(module: &[&str], source: &str) -> Vec<(usize, String)> {
    let code = code(source);
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

/// Returns the forbidden uses of one file, a line for each.
fn upward(path: &str, source: &str, modules: &[String]) -> String {
    let inner = path.trim_end_matches(".rs").trim_end_matches("/mod");
    let module: Vec<&str> = inner.split('/').collect();
    let user = module[0];
    let mut found = String::new();
    for (line, used) in uses(&module, source) {
        if modules.contains(&used) && !may_use(user, &used) {
            let below: Vec<&str> = LAYERS[..layer(user)].concat();
            let _ = writeln!(
                found,
                "src/{path}:{line}: `{user}` uses `{used}`, which is not below it; allowed are {}",
                below.join(", "),
            );
        }
    }
    found
}

#[test]
fn every_module_uses_only_what_is_below_it() {
    let files: Vec<(String, String)> = sources(&["src"])
        .into_iter()
        .map(|(path, source)| (path["src/".len()..].to_owned(), source))
        .filter(|(path, _)| path != "lib.rs" && path != "main.rs")
        .collect();
    let modules: Vec<String> = files
        .iter()
        .map(|(path, _)| path.split(['/', '.']).next().expect("it has a name").into())
        .collect();
    let found: String = files
        .iter()
        .map(|(path, source)| upward(path, source, &modules))
        .collect();
    assert!(files.len() > 50, "the sources are not where they were");
    assert!(found.is_empty(), "\n{found}");
}

/// Returns the modules of a folder that use each other in a circle, or use a module in such a circle: the rest when
/// modules without a use of the others are removed in turn.
fn circle(folder: &str, files: &[(String, String)]) -> BTreeSet<String> {
    let inside = format!("{folder}/");
    let modules: Vec<(&str, &str)> = files
        .iter()
        .filter_map(|(path, source)| {
            let name = path.strip_prefix(&inside)?.strip_suffix(".rs")?;
            (!name.contains('/') && name != "mod").then_some((name, source.as_str()))
        })
        .collect();
    let mut uses: BTreeMap<String, BTreeSet<String>> = modules
        .iter()
        .map(|(name, source)| ((*name).to_owned(), siblings(folder, source)))
        .collect();
    loop {
        let names: BTreeSet<String> = uses.keys().cloned().collect();
        uses.retain(|name, used| used.iter().any(|used| used != name && names.contains(used)));
        if uses.len() == names.len() {
            return names;
        }
    }
}

/// The names that a source in a folder takes from the folder's modules.
fn siblings(folder: &str, source: &str) -> BTreeSet<String> {
    let code = source.split("#[cfg(test)]\nmod tests {").next();
    let code = self::code(code.unwrap_or_default());
    let from_root = format!("crate::{}::", folder.replace('/', "::"));
    let names = ["super::", &from_root].into_iter().flat_map(|root| {
        let places = code.match_indices(root);
        places
            .filter(|(at, _)| !code[..*at].ends_with("super::"))
            .flat_map(|(at, _)| heads(&code[at + root.len()..]))
            .map(|(_, name)| name)
            .collect::<Vec<_>>()
    });
    names.collect()
}

#[test]
fn modules_of_a_folder_use_each_other_in_no_circle() {
    let files: Vec<(String, String)> = sources(&["src"])
        .into_iter()
        .map(|(path, source)| (path["src/".len()..].to_owned(), source))
        .collect();
    for folder in WITHOUT_CIRCLES {
        let inside = format!("{folder}/");
        assert!(
            files.iter().any(|(path, _)| path.starts_with(&inside)),
            "src/{folder} is gone"
        );
        let circle = circle(folder, &files);
        assert!(
            circle.is_empty(),
            "src/{folder}: these use each other: {circle:?}"
        );
    }
}

#[test]
fn a_circle_is_found_however_it_is_written() {
    let file = |name: &str, source: &str| (format!("gcode/{name}.rs"), source.to_owned());
    let none = [
        file("arc", "use super::{Move, words::Words};\n"),
        file(
            "words",
            "// use super::arc::Arc;\n#[cfg(test)]\nmod tests {\n    use super::arc;\n}\n",
        ),
        file("mod", "use self::arc::Arc;\n"),
    ];
    assert_eq!(circle("gcode", &none), BTreeSet::new());
    for back in [
        "use super::{\n    Move,\n    arc::{A, B},\n};\n",
        "fn f() { super::arc::f() }\n",
        "use crate::gcode::arc::A;\n",
    ] {
        let files = [none[0].clone(), file("words", back)];
        let both = ["arc", "words"].map(str::to_owned);
        assert_eq!(circle("gcode", &files), BTreeSet::from(both), "{back}");
    }
}

/// The files of `src/board/` outside of `qemu/` are those of a chip, and know nothing else.
#[test]
fn no_file_of_the_chip_knows_the_emulator() {
    for (path, source) in sources(&["src/board"]) {
        let is_chosen_there = path == "src/board/mod.rs" || path.starts_with("src/board/qemu/");
        let text = source.to_lowercase();
        let knows = ["qemu", "emulat"]
            .into_iter()
            .any(|word| text.contains(word));
        assert!(is_chosen_there || !knows, "{path}");
    }
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
        let found = upward(path, source, &modules);
        let place = format!("src/{path}:{line}: ");
        assert!(found.starts_with(&place), "{path}: {found:?}");
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
