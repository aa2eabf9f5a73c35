//! `board check` builds and starts firmware, and fails with it: the rehearsal of a false firmware, by a false Python.
#![cfg(unix)]

mod fake;

use std::{fs, path::Path, process::Output};

use fake::{elf, folder, program, tool};

/// A Python whose environments have itself in them. It notes what it is asked for, and does something else where that
/// is of a pattern.
const PYTHON: &str = "#!/bin/sh
echo \"$*\" >>'FOLDER/asked'
case \"$*\" in
  PATTERN) ELSE ;;
  --version) echo Python 3.11.7 ;;
  '-m venv '*) mkdir -p \"$3/bin\"; cp \"$0\" \"$3/bin/python\" ;;
  *unittest*) echo Ran 16 tests >&2 ;;
esac
";

/// A board with three axes and more, its program's start and the end of its RAM.
const BOARD: &str = "btt-skr-2";
const START: u32 = 0x0800_8000;
const RAM_END: u32 = 0x2002_0000;

/// Runs the tool with a firmware of some bytes, and with a Python that does something else where it is asked for what
/// is of a pattern.
fn run(folder: &Path, bytes: u32, other: [&str; 2], arguments: &[&str]) -> Output {
    let script = PYTHON.replace("FOLDER", &folder.to_string_lossy());
    let script = script
        .replace("PATTERN", other[0])
        .replace("ELSE", other[1]);
    program(folder, "python3", &script);
    tool(folder, &elf(folder, START, RAM_END, bytes), arguments)
}

fn lines(bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    text.lines().map(str::to_owned).collect()
}

/// How often Python was asked for something.
fn asked(folder: &Path, part: &str) -> usize {
    let asked = fs::read_to_string(folder.join("asked")).unwrap_or_default();
    asked.lines().filter(|line| line.contains(part)).count()
}

const NO_OVERRIDE: [&str; 2] = ["nothing", ":"];
const CHECK: [&str; 4] = ["board", "check", BOARD, "--prove"];
/// The program may have 736 KiB.
const BYTES: u32 = 36 * 1024;
const STARTS: &str = "starts from 14 states of the chip; 700.0 KiB of flash are free";

#[test]
fn a_firmware_starts_from_every_state_or_is_refused_with_the_fault_and_the_state() {
    let folder = folder("rehearsed");
    let output = run(&folder, BYTES, NO_OVERRIDE, &["start", BOARD]);
    assert_eq!(lines(&output.stdout), [STARTS]);
    assert!(output.status.success());
    assert_eq!(asked(&folder, "rehearse.py"), 14);
    let faulty = ["*--prigroup' '3*", "echo VTOR is 0x0; exit 1"];
    // The environment has the other Python in it.
    fs::remove_dir_all(folder.join("boot")).expect("it has been made");
    let output = run(&folder, BYTES, faulty, &["start", BOARD]);
    assert_eq!(output.status.code(), Some(1));
    let messages = lines(&output.stderr);
    let expected = "error: btt-skr-2 does not start as it should";
    let at = messages.iter().position(|line| line == expected);
    let fault = at.and_then(|at| messages.get(at + 1));
    assert_eq!(
        fault.map(String::as_str),
        Some("VTOR is 0x0 (PRIGROUP 3)"),
        "{messages:?}"
    );
}

#[test]
fn the_check_of_a_board_fails_with_one_firmware() {
    for (name, other, status, four_axes) in [
        ("starts", NO_OVERRIDE, 0, "starts from 4 states of the chip"),
        (
            "fails",
            ["*axes-4*--lse*", "echo LSEON is set; exit 1"],
            1,
            "error: btt-skr-2 does not start as it should",
        ),
    ] {
        let folder = folder(name);
        let output = run(&folder, BYTES, other, &CHECK);
        assert_eq!(output.status.code(), Some(status), "{output:?}");
        let messages = lines(&output.stdout);
        assert!(
            messages.contains(&format!("{BOARD} with 3 axes: {STARTS}")),
            "{messages:?}"
        );
        for begins in [
            format!("{BOARD} with 4 axes: "),
            format!("{BOARD} with 5 axes: starts from 4 states of the chip; "),
        ] {
            assert!(
                messages.iter().any(|line| line.starts_with(&begins)),
                "{messages:?}"
            );
        }
        assert!(
            messages.iter().any(|line| line.contains(four_axes)),
            "{messages:?}"
        );
        let fault = "LSEON is set (all of these)";
        assert_eq!(
            messages.contains(&fault.into()),
            status == 1,
            "{messages:?}"
        );
        assert_eq!(asked(&folder, "-m pip"), 1);
    }
}

#[test]
fn firmware_that_cannot_be_started_here_is_counted_and_no_fault() {
    for (name, other, reason, pips) in [
        (
            "offline",
            ["'-m pip '*", "echo no route; echo to host; exit 1"],
            "pip cannot install Unicorn: no route to host",
            1,
        ),
        (
            "old",
            ["--version", "echo Python 3.8.19"],
            "Python 3.8.19 is too old: 3.9 or newer is needed",
            0,
        ),
        (
            "none",
            ["--version", "exit 1"],
            "python3 is not installed (Debian, Ubuntu: `sudo apt-get install python3`)",
            0,
        ),
    ] {
        let folder = folder(name);
        let output = run(&folder, BYTES, other, &CHECK);
        assert!(output.status.success(), "{output:?}");
        let messages = lines(&output.stdout);
        let first =
            format!("{BOARD} with 3 axes: not started: {reason}; 700.0 KiB of flash are free");
        assert!(messages.contains(&first), "{messages:?}");
        let last = format!("3 of 3 were not started: {reason}");
        assert_eq!(messages.last(), Some(&last), "{messages:?}");
        assert_eq!(asked(&folder, "-m pip"), pips, "{name}");
        // One alone asks itself.
        let output = run(&folder, BYTES, other, &["start", BOARD]);
        let messages = lines(&output.stdout);
        assert_eq!(
            messages,
            [first.trim_start_matches("btt-skr-2 with 3 axes: ")]
        );
    }
}

#[test]
fn a_firmware_that_leaves_too_little_is_refused() {
    let folder = folder("room");
    for (free_bytes, refusal) in [
        (32 * 1024, None),
        (
            32 * 1024 - 1024,
            Some("only 31.0 KiB of flash are free: 32 KiB have to be"),
        ),
    ] {
        let bytes = 736 * 1024 - free_bytes;
        let output = run(&folder, bytes, NO_OVERRIDE, &["start", BOARD]);
        assert_eq!(output.status.success(), refusal.is_none(), "{output:?}");
        let messages = String::from_utf8_lossy(&output.stderr);
        assert!(
            refusal.is_none_or(|refusal| messages.contains(refusal)),
            "{messages}"
        );
    }
}

#[test]
fn a_model_that_is_wrong_or_untested_and_a_folder_that_cannot_be_made_are_errors() {
    for (name, other, refusal) in [
        (
            "wrong",
            ["*unittest*", "echo FAILED >&2; exit 1"],
            "the model of the chip is wrong\nFAILED",
        ),
        (
            "untested",
            ["*unittest*", "echo Ran 0 tests >&2"],
            "the model of the chip has no tests",
        ),
        ("folder", NO_OVERRIDE, "cannot make "),
    ] {
        let folder = folder(name);
        if name == "folder" {
            fs::write(folder.join("boot"), "no folder").expect("the folder is writable");
        }
        let output = run(&folder, BYTES, other, &["start", BOARD]);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        let messages = String::from_utf8_lossy(&output.stderr);
        assert!(messages.contains(refusal), "{messages}");
    }
}
