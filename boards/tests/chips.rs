//! Chips: what the firmware must be compiled with for each, and which it cannot be compiled for.

use std::{
    fs,
    path::{Path, PathBuf},
};

use board_data::Board;

fn root() -> &'static Path {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    folder.parent().expect("it is in the project")
}

/// Writes a project with one board and one chip, whose files are those of the project with one thing replaced in the
/// chip's, and reads the board.
fn with_chip(name: &str, old: &str, new: &str) -> Result<Board, String> {
    let project: PathBuf = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let chips = project.join("boards/chips");
    fs::create_dir_all(&chips).expect("the target folder is writable");
    let text = |path: &str| fs::read_to_string(root().join(path)).expect("the file is there");
    let chip = text("boards/chips/f411.toml");
    assert!(chip.contains(old), "{old}");
    fs::write(chips.join("f411.toml"), chip.replacen(old, new, 1)).expect("it is writable");
    let board = project.join("boards/blackpill-f411.toml");
    fs::write(&board, text("boards/blackpill-f411.toml")).expect("it is writable");
    Board::read(&board, &project).map_err(|fault| fault.to_string())
}

#[test]
fn a_chip_at_96_mhz_needs_the_feature_of_its_clock() {
    let board = with_chip("at-96", "core_mhz = 96", "core_mhz = 96").expect("nothing is wrong");
    assert_eq!(board.features(3), ["chip-f411", "clock-96", "usb"]);
    let clocks = board.chip.clocks;
    assert_eq!(
        (clocks.apb1_timers_mhz(), clocks.apb2_timers_mhz()),
        (96, 96)
    );
    let usual = Board::all(root()).expect("nothing is wrong");
    let usual = usual
        .iter()
        .filter(|board| board.chip.clocks.core_mhz == 168);
    let mut features = usual.flat_map(|board| board.features(3));
    assert!(features.all(|feature| !feature.starts_with("clock-")));
}

#[test]
fn a_chip_with_a_clock_that_the_firmware_has_no_unit_of_time_for_is_refused() {
    let error = with_chip("at-100", "core_mhz = 96", "core_mhz = 100").expect_err("100 MHz");
    assert!(error.contains("f411.toml:1: "), "{error}");
    assert!(
        error.contains("no unit of time for 100 MHz; it has 168, 96"),
        "{error}"
    );
}

#[test]
fn the_firmware_and_the_chips_have_the_same_clocks() {
    let units = fs::read_to_string(root().join("src/units.rs")).expect("it is there");
    for board in Board::all(root()).expect("nothing is wrong") {
        let mhz = board.chip.clocks.core_mhz;
        let own = match board.chip.clocks.feature() {
            Some(feature) => format!("cfg!(feature = \"{feature}\") {{ {mhz} }}"),
            None => format!("else {{ {mhz} }}"),
        };
        let line = units
            .lines()
            .find(|line| line.starts_with("pub const CORE_MHZ"));
        assert!(line.is_some_and(|line| line.contains(&own)), "{own}");
    }
}

#[test]
fn a_chip_that_promises_more_than_its_manual_allows_is_refused() {
    let refused = |name: &str, old: &str, new: &str| with_chip(name, old, new).expect_err(new);
    let error = refused("fast-flash", "wait_states = 3", "wait_states = 2");
    let expected = "RM0383 requires 3 wait states of the flash at 96 MHz, not 2";
    assert!(error.contains(expected), "{error}");
    let error = refused("fast-bus", "apb1_divider = 2", "apb1_divider = 1");
    let expected = "RM0383 allows 50 MHz on apb1: a core at 96 MHz divided by 1 is faster";
    assert!(error.contains(expected), "{error}");
    let error = refused("odd-divider", "apb1_divider = 2", "apb1_divider = 3");
    assert!(error.contains("`apb1_divider` is 1, 2, 4"), "{error}");
    let error = refused("overclocked", "core_mhz = 96", "core_mhz = 168");
    let expected = "RM0383 does not allow a core at 168 MHz";
    assert!(error.contains(expected), "{error}");
    let error = refused("unknown", "hal = \"f411\"", "hal = \"f412\"");
    assert!(error.contains("`f412` are not known"), "{error}");
}

#[test]
fn a_chip_with_more_wait_states_than_its_manual_requires_is_read() {
    let slow = with_chip("slow-flash", "wait_states = 3", "wait_states = 4");
    assert_eq!(
        slow.expect("it is allowed").chip.clocks.flash_wait_states,
        4
    );
}
