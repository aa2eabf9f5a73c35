//! The decoder against LLVM's disassembler, on every instruction of real programs.

mod expected;
mod support;

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use expected::Line;
use schedule::{Decoder, Image};

#[test]
fn decoder_agrees_with_llvm_objdump() {
    let Some(objdump) = objdump() else {
        println!("skipped: llvm-objdump is not installed (rustup component add llvm-tools)");
        return;
    };
    let mut checked = 0;
    let mut differences = Vec::new();
    let copy = support::scratch().join("copy.elf");
    let programs = programs();
    if programs.is_empty() {
        return; // The target is not installed, as `compile` says.
    }
    for elf in programs {
        // A build beside this test may replace the program, or take it away.
        if fs::copy(&elf, &copy).is_err() {
            continue;
        }
        let Ok(image) = Image::load(&copy) else {
            continue;
        };
        let disassembly = Command::new(&objdump)
            .args(["-d", "--no-print-imm-hex", "--no-symbolic-operands"])
            .arg(&copy)
            .output()
            .expect("llvm-objdump runs");
        let text = String::from_utf8_lossy(&disassembly.stdout);
        let lines: Vec<Line> = text.lines().filter_map(Line::parse).collect();
        let code: u32 = image.functions().map(|function| function.size).sum();
        assert!(
            lines.len() > code as usize / 8,
            "llvm-objdump showed little of {}",
            elf.display()
        );
        differences.extend(compare(&lines));
        checked += lines.len();
    }
    let count = differences.len();
    differences.truncate(20);
    assert!(
        differences.is_empty(),
        "{count} differences\n{}",
        differences.join("\n")
    );
    assert!(checked > 0, "no program was compared");
    println!("{checked} instructions agree");
}

/// The differences of the decoder.
fn compare(lines: &[Line]) -> Vec<String> {
    let mut decoder = Decoder::new();
    let mut end = 0;
    let mut differences = Vec::new();
    for line in lines {
        if line.address != end {
            decoder = Decoder::new();
        }
        end = line.address + u32::from(line.size);
        let decoded = decoder.decode(line.address, line.code).ok();
        if let Err(difference) = line.check(decoded) {
            differences.push(format!("{line}: {difference}"));
        }
    }
    differences
}

/// The disassembler of Rust's tools, or the system's.
fn objdump() -> Option<PathBuf> {
    let host = env::consts::ARCH;
    let folder = support::sysroot()?.join("lib/rustlib");
    let hosts = fs::read_dir(folder).ok()?.filter_map(Result::ok);
    let own = hosts
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(host))
        .map(|entry| entry.path().join("bin/llvm-objdump"))
        .find(|path| path.exists());
    let has_system = || {
        let version = Command::new("llvm-objdump").arg("--version").output();
        version.is_ok_and(|output| output.status.success())
    };
    own.or_else(|| has_system().then(|| PathBuf::from("llvm-objdump")))
}

/// A program compiled here, and whatever was built for the chip in this target folder.
fn programs() -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = support::compile(&support::scratch(), INSTRUCTIONS)
        .into_iter()
        .collect();
    let target = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let target = target.parent().expect("it is in the target folder");
    let chip = target.join(support::TARGET);
    let folders = ["debug", "release", "debug/deps", "release/deps"].map(|one| chip.join(one));
    for folder in folders.into_iter().chain([target.join("firmware")]) {
        let entries = fs::read_dir(folder).into_iter().flatten();
        found.extend(entries.filter_map(Result::ok).map(|entry| entry.path()));
    }
    let is_program = |path: &PathBuf| {
        let is_object = path.extension().is_some_and(|end| end == "o" || end == "d");
        path.is_file() && !is_object
    };
    found.retain(is_program);
    found
}

/// Every kind of instruction that the decoder knows and compilers seldom use.
const INSTRUCTIONS: &str = include_str!("instructions/program.rs");
