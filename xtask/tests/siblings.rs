//! A dispatcher that has been built starts what lies beside it, without Cargo.
#![cfg(unix)]

use std::{
    fs,
    os::unix::fs::PermissionsExt as _,
    path::Path,
    process::{Command, Output},
};

/// Puts a tool that says what it is asked into a folder.
fn put(folder: &Path, name: &str) {
    fs::create_dir_all(folder).unwrap();
    let path = folder.join(name);
    let script = format!("#!/bin/sh\necho \"{name}\" for $LEADSCREW_AXES axes: \"$@\"\n");
    fs::write(&path, script).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn a_dispatcher_that_has_been_built_starts_built_siblings_without_cargo() {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("siblings");
    let tools = target.join("debug");
    put(&tools, "sim");
    put(&target.join("axes-4/debug"), "sim");
    let xtask = tools.join("xtask");
    fs::copy(env!("CARGO_BIN_EXE_xtask"), &xtask).unwrap();
    let run = |arguments: &[&str]| -> Output {
        let mut command = Command::new(&xtask);
        command.args(arguments).env_clear().env("PATH", "/nowhere");
        command.output().unwrap()
    };
    // Help needs no tool at all.
    let help = run(&["settings", "--help"]);
    let help = String::from_utf8_lossy(&help.stdout).into_owned();
    assert!(help.contains("Usage: cargo xtask settings"), "{help}");
    for (arguments, expected) in [
        (
            &["sim", "-", "--quality"][..],
            "sim for 3 axes: sim - --quality\n",
        ),
        (
            &["sim", "--axes", "4", "-"],
            "sim for 4 axes: sim --axes 4 -\n",
        ),
    ] {
        let output = run(arguments);
        assert_eq!(
            String::from_utf8_lossy(&output.stdout),
            expected,
            "{output:?}"
        );
    }
    for arguments in [&["sim", "--axes", "5", "-"][..], &["docs"]] {
        let output = run(arguments);
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(
            !output.status.success() && error.contains("is not built"),
            "{error}"
        );
    }
}
