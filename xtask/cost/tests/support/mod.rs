//! What the tests share: programs for the target, and reading the report.
#![allow(dead_code, reason = "each test uses a part")]

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
    thread,
};

pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// A folder for this test alone, in Cargo's target folder.
pub(crate) fn scratch() -> PathBuf {
    let test = thread::current();
    let name = test.name().expect("a test's thread has its name");
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::create_dir_all(&directory).expect("the target folder is writable");
    directory
}

/// Where Rust's own files are.
pub(crate) fn sysroot() -> Option<PathBuf> {
    let output = Command::new("rustc").args(["--print", "sysroot"]).output();
    let path = String::from_utf8(output.ok()?.stdout).ok()?;
    Some(PathBuf::from(path.trim_end()))
}

/// Compiles a program of one file; `None`, and a word why, when the target is not installed.
pub(crate) fn compile(source: &Path, script: &Path, elf: &Path) -> Option<()> {
    let libraries = sysroot()?.join("lib/rustlib").join(TARGET);
    if !libraries.exists() {
        println!("skipped: the target {TARGET} is not installed");
        return None;
    }
    let status = Command::new("rustc")
        .args(["--edition", "2024", "--target", TARGET])
        .args(["-C", "panic=abort"])
        .arg(format!("-Clink-arg=-T{}", script.display()))
        .arg("-o")
        .args([elf, source])
        .status();
    assert!(status.expect("rustc runs").success());
    Some(())
}

/// The plugin that Cargo built beside this test.
pub(crate) fn plugin() -> PathBuf {
    let test = env::current_exe().expect("a test has a path");
    test.with_file_name("libcost.so")
}

/// The line that describes `name`.
pub(crate) fn line<'a>(report: &'a str, name: &str) -> &'a str {
    let start = format!("{{\"name\": \"{name}\",");
    let mut lines = report.lines().rev();
    let line = lines.find(|line| line.starts_with(&start));
    line.unwrap_or_else(|| panic!("{name} is not in the report"))
}

/// The number under `key` in `line`.
pub(crate) fn number(line: &str, key: &str) -> u64 {
    let (_, rest) = line
        .split_once(&format!("\"{key}\": "))
        .unwrap_or_else(|| panic!("no {key} in {line}"));
    let end = rest.find(|letter: char| !letter.is_ascii_digit());
    rest[..end.unwrap_or(rest.len())]
        .parse()
        .expect("it is digits")
}
