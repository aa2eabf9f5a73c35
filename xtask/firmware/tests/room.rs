//! The room that a firmware leaves, and the check of a board, which fails where it is too little.
#![cfg(unix)]

mod fake;

use std::{path::Path, process::Output};

use fake::{elf, folder, tool};

/// A board with up to five axes, its program's start and the end of its RAM; the program may have 736 KiB.
const BOARD: &str = "btt-skr-2";
const START: u32 = 0x0800_8000;
const RAM_END: u32 = 0x2002_0000;
const ROOM_KIB: u32 = 736;

/// Runs the tool with a firmware that leaves some KiB.
fn run(folder: &Path, free_kib: u32, arguments: &[&str]) -> Output {
    let bytes = (ROOM_KIB - free_kib) * 1024;
    tool(folder, &elf(folder, START, RAM_END, bytes), arguments)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

const REFUSAL: &str = "only 31.0 KiB of flash are free: 32 KiB have to be";

#[test]
fn a_firmware_that_leaves_too_little_is_refused() {
    let folder = folder("room");
    let output = run(&folder, 32, &["room", BOARD]);
    assert_eq!(text(&output.stdout).trim(), "32.0 KiB of flash are free");
    let output = run(&folder, 31, &["room", BOARD]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains(REFUSAL), "{output:?}");
}

#[test]
fn the_check_of_a_board_measures_the_room_with_each_number_of_axes() {
    let folder = folder("checked");
    for (free_kib, status, message) in [(700, 0, "700.0 KiB of flash are free"), (31, 1, REFUSAL)] {
        let output = run(&folder, free_kib, &["board", "check", BOARD, "--prove"]);
        assert_eq!(output.status.code(), Some(status), "{output:?}");
        let shown = text(&output.stdout);
        for axes in 3..=5 {
            let begins = format!("{BOARD} with {axes} axes: ");
            let line = shown.lines().find(|line| line.starts_with(&begins));
            let line = line.unwrap_or_else(|| panic!("{shown}"));
            assert!(line.contains(message), "{line}");
        }
    }
}
