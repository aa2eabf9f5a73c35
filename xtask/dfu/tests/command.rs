//! What is wrong with a release or a board is told before a device is waited for.

use std::process::Command;

#[test]
fn a_folder_that_is_no_release_and_a_board_without_dfu_are_told_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let from = folder.path().to_string_lossy();
    for (arguments, words) in [
        (
            &["--from", &from][..],
            "is no release: it has no SHA256SUMS",
        ),
        (
            &["--board", "nucleo-f446re"],
            "is not flashed by DFU: docs/boards/nucleo-f446re.md has how it is",
        ),
        (&["--board", "mill"], "there is no board \"mill\""),
    ] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_dfu"));
        command.args(["flash", "--dfu"]).args(arguments);
        let output = command.env("CARGO", "false").output().unwrap();
        let printed = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            !output.status.success() && printed.contains(words),
            "{printed}"
        );
        assert!(!printed.contains("Waiting"), "{printed}");
    }
}
