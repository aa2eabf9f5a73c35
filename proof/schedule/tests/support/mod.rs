//! Shared by the tests: programs for the target, compiled here.
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
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("schedule")
        .join(name);
    fs::create_dir_all(&directory).expect("the target folder is writable");
    directory
}

/// Where Rust's own files are.
pub(crate) fn sysroot() -> Option<PathBuf> {
    let output = Command::new("rustc").args(["--print", "sysroot"]).output();
    let path = String::from_utf8(output.ok()?.stdout).ok()?;
    Some(PathBuf::from(path.trim_end()))
}

/// Compiles a program of one file as the firmware is compiled, with `folder` as project; `None`,
/// and a word why, when the target is not installed.
pub(crate) fn compile(folder: &Path, source: &str) -> Option<PathBuf> {
    const SCRIPT: &str = "ENTRY(start)
        SECTIONS {
          .vector_table 0x08000000 : { KEEP(*(.vector_table)) }
          .text : { *(.text .text.*) *(.rodata .rodata.*) }
          .data 0x20000000 : AT(0x08010000) { *(.data .data.*) }
          .bss : { *(.bss .bss.*) }
          /DISCARD/ : { *(.ARM.exidx*) }
        }";
    let libraries = sysroot()?.join("lib/rustlib").join(TARGET);
    if !libraries.exists() {
        println!("skipped: the target {TARGET} is not installed");
        return None;
    }
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        let parent = path.parent().expect("it is in a folder");
        fs::create_dir_all(parent).expect("the target folder is writable");
        fs::write(&path, text).expect("the target folder is writable");
    };
    write("link.x", SCRIPT);
    write("src/main.rs", source);
    let status = Command::new("rustc")
        .current_dir(folder)
        .args(["--edition", "2024", "--target", TARGET])
        .args(["-C", "panic=abort", "-C", "opt-level=3", "-C", "lto=fat"])
        .args(["-C", "debuginfo=2", "-C", "codegen-units=1"])
        .args(["-C", "overflow-checks=off", "-C", "link-arg=-Tlink.x"])
        .args(["-C", "link-arg=--nmagic"])
        .args(["-o", "program.elf", "src/main.rs"])
        .status();
    assert!(status.expect("rustc runs").success());
    Some(folder.join("program.elf"))
}
