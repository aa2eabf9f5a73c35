//! Runs Cargo and the other tools of the project, from its top folder.

use std::{
    env,
    ffi::OsString,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::OnceLock,
};

use anyhow::{Context, Result, bail, ensure};

use crate::ui;

/// The only target.
pub const TARGET: &str = "thumbv7em-none-eabihf";
/// Names the number of axes for tools that are started, see [`axes`].
pub const AXES: &str = "LEADSCREW_AXES";

/// The project's top folder.
pub fn root() -> &'static Path {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.parent().unwrap_or(manifest)
}

/// The environment variable with more features of the firmware, as `reprap`.
pub const FEATURES: &str = "LEADSCREW_FEATURES";

/// The environment variable with the board of a build.
const BOARD: &str = "LEADSCREW_BOARD";

/// Names the clock of the core, MHz, for tools that are started, see [`clock_mhz`].
pub const CLOCK: &str = "LEADSCREW_CLOCK";
/// The clock of the core without a feature for it, MHz.
pub const USUAL_CLOCK_MHZ: u32 = 168;
/// The others, each with a feature as `clock-96`.
pub const OTHER_CLOCKS_MHZ: [u32; 1] = [96];

/// What was asked for in this program.
static ASKED: OnceLock<u8> = OnceLock::new();
static ASKED_CLOCK_MHZ: OnceLock<u32> = OnceLock::new();

/// The number of axes that was asked for, here or in a program that has started this one.
pub fn axes() -> u8 {
    let axes = || env::var(AXES).ok()?.parse().ok();
    *ASKED.get_or_init(|| axes().unwrap_or(3))
}

/// Asks for a number of axes, once, before anybody wants to know it.
pub fn ask_for_axes(axes: u8) {
    let _ = ASKED.set(axes);
}

/// The clock of the core of the virtual machine, MHz, that was asked for, here or in a program that has started this
/// one.
pub fn clock_mhz() -> u32 {
    let clock = || env::var(CLOCK).ok()?.parse().ok();
    *ASKED_CLOCK_MHZ.get_or_init(|| clock().unwrap_or(USUAL_CLOCK_MHZ))
}

/// Asks for a clock, once, before anybody wants to know it.
pub fn ask_for_clock(mhz: u32) {
    let _ = ASKED_CLOCK_MHZ.set(mhz);
}

/// Where Cargo puts what it builds for as many axes as were asked for.
pub fn target_dir() -> PathBuf {
    target_dir_for(axes())
}

/// Where Cargo puts what it builds for a number of axes: what is built for others stays.
pub fn target_dir_for(axes: u8) -> PathBuf {
    with_axes(top_target_dir(), axes)
}

/// Where Cargo puts everything that it builds.
pub(crate) fn top_target_dir() -> PathBuf {
    env::var_os("CARGO_TARGET_DIR").map_or_else(
        || root().join("target"),
        |folder| root().join(PathBuf::from(folder)),
    )
}

/// Where, below a target folder, what is built for a number of axes lies.
pub(crate) fn with_axes(folder: PathBuf, axes: u8) -> PathBuf {
    match axes {
        3 => folder,
        axes => folder.join(format!("axes-{axes}")),
    }
}

/// Where, below a target folder, what is built for a clock lies.
pub(crate) fn with_clock(folder: PathBuf, mhz: u32) -> PathBuf {
    match mhz {
        USUAL_CLOCK_MHZ => folder,
        mhz => folder.join(format!("clock-{mhz}")),
    }
}

/// The Cargo that started this program.
pub fn program() -> OsString {
    env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

/// A Cargo command in the project. What it compiles for the chip is the same wherever project and crates lie.
pub fn cargo<A: AsRef<str>>(arguments: &[A]) -> Command {
    let mut command = Command::new(program());
    let crates = cargo_home().join("registry/src/");
    let names = [(crates.as_path(), "/registry/src/"), (root(), "/leadscrew")];
    let flags = names.map(|(folder, name)| {
        let folder = folder.display();
        toml_text(&format!("--remap-path-prefix={folder}={name}"))
    });
    let flags = format!("target.{TARGET}.rustflags=[{}]", flags.join(","));
    command
        .args(["--config", &flags])
        .args(arguments.iter().map(AsRef::as_ref))
        .current_dir(root());
    command
}

/// Where Cargo keeps the crates of others.
fn cargo_home() -> PathBuf {
    let home = || env::home_dir().unwrap_or_default().join(".cargo");
    env::var_os("CARGO_HOME").map_or_else(home, |folder| root().join(folder))
}

/// A text of TOML.
fn toml_text(text: &str) -> String {
    let escaped = text.replace('\\', "\\\\").replace('"', "\\\"");
    format!("\"{escaped}\"")
}

/// Makes a Cargo command compile the firmware for a board: its file's name or path, and the features of its
/// chip, with as many axes as were asked for.
pub fn compile_for(command: &mut Command, board: &str, features: &str, target_dir: &Path) {
    let mut features = features.to_owned();
    if axes() != 3 {
        features = format!("{features},axes-{}", axes());
    }
    if let Ok(more) = env::var(FEATURES) {
        features = format!("{features},{more}");
    }
    command
        .args(["--package", "leadscrew", "--target", TARGET, "--target-dir"])
        .arg(target_dir)
        .args(["--no-default-features", "--features", &features])
        .env(BOARD, board)
        // Crates of others are the same wherever the result lies: each is compiled once.
        .env("CARGO_BUILD_BUILD_DIR", top_target_dir());
}

/// Runs a command to its end, and fails when it does.
pub fn wait(command: &mut Command) -> Result<()> {
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
    let mut arguments = command.get_args();
    while let Some(argument) = arguments.next() {
        if argument == "--config" {
            // Names of folders: long, and of no matter to the user.
            arguments.next();
            continue;
        }
        text.push(' ');
        text.push_str(&argument.to_string_lossy());
    }
    text
}

/// Whether a program can be started.
pub fn is_there(program: &str) -> bool {
    let mut command = Command::new(program);
    command
        .arg("--version")
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// Makes sure that rustc can compile for the chip.
pub fn need_target() -> Result<()> {
    need_target_named(TARGET)
}

/// Makes sure that rustc can compile for a target: asks rustup for it where it is missing.
pub fn need_target_named(target: &str) -> Result<()> {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc)
        .args(["--print", "target-libdir", "--target", target])
        .current_dir(root())
        .output()
        .context("cannot start rustc")?;
    let folder = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    if output.status.success() && Path::new(&folder).is_dir() {
        return Ok(());
    }
    rustup(&["target", "add", target])
}

/// Makes sure that `cargo {tool}` exists: asks rustup for the component where it is missing.
pub fn need_component(tool: &str, component: &str) -> Result<()> {
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

/// The oldest QEMU that will do.
const OLDEST_QEMU: (u32, u32) = (7, 2);

/// Makes sure that QEMU is there and new enough, and returns its version.
pub fn need_qemu() -> Result<String> {
    let asked = Command::new("qemu-system-arm").arg("--version").output();
    let asked = asked.ok().filter(|asked| asked.status.success());
    let asked = asked.context(
        "qemu-system-arm is not installed\n(Debian, Ubuntu: `sudo apt-get install qemu-system-arm`, \
         macOS: `brew install qemu`)",
    )?;
    qemu_version(&String::from_utf8_lossy(&asked.stdout))
}

/// Reads the version from what QEMU says of itself.
///
/// # Errors
///
/// If it is too old.
fn qemu_version(printed: &str) -> Result<String> {
    let version = printed.split_once("version ").map_or("", |(_, rest)| rest);
    let version = version.split_whitespace().next().unwrap_or_default();
    let mut numbers = version.split('.').map_while(|part| part.parse().ok());
    let (Some(major), Some(minor)) = (numbers.next(), numbers.next()) else {
        bail!("qemu-system-arm does not tell its version");
    };
    let (oldest_major, oldest_minor) = OLDEST_QEMU;
    ensure!(
        (major, minor) >= OLDEST_QEMU,
        "QEMU {version} is too old: {oldest_major}.{oldest_minor} or newer is needed"
    );
    Ok(version.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_emulator_that_is_too_old_is_refused() {
        let version = |printed: &str| qemu_version(printed).map_err(|error| error.to_string());
        for (printed, expected) in [
            (
                "QEMU emulator version 7.2.22 (Debian 1:7.2+dfsg-7+deb12u18+b3)\nCopyright",
                "7.2.22",
            ),
            ("QEMU emulator version 10.0.2\nCopyright", "10.0.2"),
            ("QEMU emulator version 8.0.50 (v8.0.0-1-gabc)", "8.0.50"),
        ] {
            assert_eq!(version(printed), Ok(expected.to_owned()));
        }
        for old in ["7.1.0", "6.2.0"] {
            let refusal = format!("QEMU {old} is too old: 7.2 or newer is needed");
            assert_eq!(
                version(&format!("QEMU emulator version {old}\n")),
                Err(refusal)
            );
        }
        for printed in ["", "QEMU emulator version ten"] {
            let refusal = "qemu-system-arm does not tell its version";
            assert_eq!(version(printed), Err(refusal.to_owned()));
        }
    }
}
