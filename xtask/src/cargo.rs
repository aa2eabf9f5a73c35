//! Runs Cargo and the other tools of the project, from its top folder.

use std::{
    env,
    ffi::OsString,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use anyhow::{Context, Result, bail, ensure};

use leadscrew::axis::AXES;

use crate::{boards::Board, ui};

/// The only target.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// The project's top folder.
pub(crate) fn root() -> &'static Path {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.parent().unwrap_or(manifest)
}

/// Where Cargo puts what it builds.
pub(crate) fn target_dir() -> PathBuf {
    env::var_os("CARGO_TARGET_DIR").map_or_else(
        || root().join("target"),
        |folder| root().join(PathBuf::from(folder)),
    )
}

/// The Cargo that started this program.
pub(crate) fn program() -> OsString {
    env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

/// A Cargo command in the project.
pub(crate) fn cargo<A: AsRef<str>>(arguments: &[A]) -> Command {
    let mut command = Command::new(program());
    command
        .args(arguments.iter().map(AsRef::as_ref))
        .current_dir(root());
    command
}

/// The options that make Cargo compile for `board`, with as many axes as this program has.
pub(crate) fn for_board(board: &Board) -> [String; 5] {
    for_board_with(board, AXES as u8)
}

/// The same for another number of axes.
pub(crate) fn for_board_with(board: &Board, axes: u8) -> [String; 5] {
    [
        "--target".into(),
        TARGET.into(),
        "--no-default-features".into(),
        "--features".into(),
        featured(&format!("board-{}", board.name), axes),
    ]
}

/// A list of features, and the one for as many axes as this program has.
pub(crate) fn with_axes(features: &str) -> String {
    featured(features, AXES as u8)
}

fn featured(features: &str, axes: u8) -> String {
    match axes {
        3 => features.into(),
        axes => format!("{features},axes-{axes}"),
    }
}

/// Runs a command to its end, and fails when it does.
pub(crate) fn wait(command: &mut Command) -> Result<()> {
    let name = describe(command);
    ui::status("Running", &name);
    let status = command
        .status()
        .with_context(|| format!("cannot start `{name}`"))?;
    ensure!(status.success(), "`{name}` failed ({status})");
    Ok(())
}

/// The command as one would type it.
fn describe(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let name = program.file_name().unwrap_or(command.get_program());
    let mut text = name.to_string_lossy().into_owned();
    for argument in command.get_args() {
        text.push(' ');
        text.push_str(&argument.to_string_lossy());
    }
    text
}

/// Whether a program can be started.
pub(crate) fn is_there(program: &str) -> bool {
    let mut command = Command::new(program);
    command
        .arg("--version")
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// Makes sure that rustc can compile for the chip: asks rustup for the target where it is missing.
pub(crate) fn need_target() -> Result<()> {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc)
        .args(["--print", "target-libdir", "--target", TARGET])
        .current_dir(root())
        .output()
        .context("cannot start rustc")?;
    let folder = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    if output.status.success() && Path::new(&folder).is_dir() {
        return Ok(());
    }
    rustup(&["target", "add", TARGET])
}

/// Makes sure that `cargo {tool}` exists: asks rustup for the component where it is missing.
pub(crate) fn need_component(tool: &str, component: &str) -> Result<()> {
    let there = cargo(&[tool, "--version"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success());
    if there {
        return Ok(());
    }
    rustup(&["component", "add", component])
}

fn rustup(arguments: &[&str]) -> Result<()> {
    if !is_there("rustup") {
        bail!(
            "this needs `rustup {}`, and there is no rustup: see https://rustup.rs",
            arguments.join(" ")
        );
    }
    wait(Command::new("rustup").args(arguments).current_dir(root()))
}

/// Makes sure that QEMU is there.
pub(crate) fn need_qemu() -> Result<()> {
    ensure!(
        is_there("qemu-system-arm"),
        "qemu-system-arm is not installed\n(Debian, Ubuntu: `sudo apt-get install qemu-system-arm`, \
         macOS: `brew install qemu`)"
    );
    Ok(())
}
