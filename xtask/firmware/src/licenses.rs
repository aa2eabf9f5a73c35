//! The licences of everything that is in an image.

use std::{collections::BTreeMap, fmt::Write as _, fs, path::PathBuf};

use anyhow::{Context, Result, ensure};
use common::cargo;
use serde::Deserialize;

/// Names of files with the texts of licences begin so.
const LICENSE_FILES: [&str; 4] = ["LICENSE", "LICENCE", "COPYING", "NOTICE"];

/// What Cargo tells of packages.
#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
    resolve: Resolve,
}

#[derive(Deserialize)]
struct Package {
    id: String,
    name: String,
    version: String,
    license: Option<String>,
    manifest_path: PathBuf,
    targets: Vec<Target>,
}

#[derive(Deserialize)]
struct Target {
    kind: Vec<String>,
}

#[derive(Deserialize)]
struct Resolve {
    root: String,
    nodes: Vec<Node>,
}

#[derive(Deserialize)]
struct Node {
    id: String,
    deps: Vec<Dependency>,
}

#[derive(Deserialize)]
struct Dependency {
    pkg: String,
    dep_kinds: Vec<DependencyKind>,
}

#[derive(Deserialize)]
struct DependencyKind {
    kind: Option<String>,
}

impl Metadata {
    fn read() -> Result<Self> {
        let features = "chip-f405,usb";
        let output = cargo::cargo(&["metadata", "--format-version=1", "--no-default-features"])
            .args(["--features", features, "--filter-platform", cargo::TARGET])
            .output()?;
        ensure!(
            output.status.success(),
            "Cargo knows no packages: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        Ok(serde_json::from_slice(&output.stdout)?)
    }

    /// The packages that are in an image: what the firmware depends on, but for what runs in the compiler.
    fn linked(&self) -> Vec<&Package> {
        let of_compiler = |id: &str| {
            let package = self.packages.iter().find(|package| package.id == id);
            let mut targets = package.iter().flat_map(|it| &it.targets);
            targets.any(|target| target.kind.iter().any(|kind| kind == "proc-macro"))
        };
        let mut known = vec![self.resolve.root.as_str()];
        let mut next = 0;
        while let Some(id) = known.get(next).copied() {
            next += 1;
            let node = self.resolve.nodes.iter().find(|node| node.id == id);
            for dependency in node.iter().flat_map(|node| &node.deps) {
                let is_linked = dependency.dep_kinds.iter().any(|it| it.kind.is_none());
                let id = dependency.pkg.as_str();
                if is_linked && !known.contains(&id) && !of_compiler(id) {
                    known.push(id);
                }
            }
        }
        let packages = self.packages.iter();
        packages
            .filter(|it| known.contains(&it.id.as_str()))
            .collect()
    }
}

/// The notice of licences: each text that lies in a package, with the packages in which it lies.
pub(crate) fn notice() -> Result<String> {
    let metadata = Metadata::read()?;
    let mut packages = metadata.linked();
    packages.sort_by_key(|package| (&package.name, &package.version));
    let mut notice = String::from(
        "Licences of everything that is in an image of Leadscrew, and the texts that come with it.\n\n\
         core, Rust's library: MIT OR Apache-2.0 (https://github.com/rust-lang/rust)\n",
    );
    let mut texts: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for package in packages {
        let name = format!("{} {}", package.name, package.version);
        let license = package.license.as_deref();
        let _ = writeln!(notice, "{name}: {}", license.unwrap_or("as its files say"));
        let folder = package.manifest_path.parent();
        for entry in fs::read_dir(folder.context("a file is in a folder")?)? {
            let file = entry?;
            let upper = file.file_name().to_string_lossy().to_uppercase();
            if LICENSE_FILES.iter().any(|it| upper.starts_with(it)) && file.file_type()?.is_file() {
                let text = fs::read(file.path())?;
                let text = String::from_utf8_lossy(&text).replace('\r', "");
                texts
                    .entry(text.trim().into())
                    .or_default()
                    .push(name.clone());
            }
        }
    }
    let rule = "=".repeat(72);
    for (text, of) in texts {
        let _ = writeln!(notice, "\n{rule}\n{}\n{rule}\n\n{text}", of.join(", "));
    }
    Ok(notice)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_notice_has_what_is_linked_and_nothing_of_the_compiler() {
        let notice = notice().unwrap();
        for (name, is_there) in [
            ("\nstm32f4xx-hal 0", true),
            ("\nusb-device 0", true),
            ("\nrtic 2", true),
            ("\nsyn ", false),
            ("\nrtic-macros ", false),
            ("\ntoml ", false),
        ] {
            assert_eq!(notice.contains(name), is_there, "{name}");
        }
        assert!(notice.contains("Permission is hereby granted, free of charge"));
    }
}
