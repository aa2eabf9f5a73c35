//! Shared by the tests: programs for the target, and reading the report.
#![allow(dead_code, reason = "each test uses a part")]

#[path = "../../../schedule/tests/support/mod.rs"]
pub(crate) mod programs;

use std::{
    env,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

pub(crate) use programs::scratch;
use programs::{TARGET, sysroot};

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

/// Runs a program under QEMU until it ends, with the plugin that these arguments load; `None`, and
/// a word why, when QEMU is missing.
pub(crate) fn emulate(elf: &Path, plugin: &str, patience_s: u32) -> Option<()> {
    let status = Command::new("timeout")
        .args(["--kill-after=1", &patience_s.to_string()])
        .args(["qemu-system-arm", "-M", "netduinoplus2", "-nographic"])
        .args(["-monitor", "none", "-serial", "null"])
        .args(["-semihosting-config", "enable=on,target=native"])
        .args(["-plugin", plugin, "-kernel"])
        .arg(elf)
        .stdin(Stdio::null())
        .status();
    let is_there = status.is_ok_and(|status| status.code() != Some(127));
    if !is_there {
        println!("skipped: qemu-system-arm is not installed");
    }
    is_there.then_some(())
}

/// The plugin that Cargo built beside this test.
pub(crate) fn plugin() -> PathBuf {
    let test = env::current_exe().expect("a test has a path");
    test.with_file_name("libcost.so")
}
