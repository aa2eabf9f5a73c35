//! The tools that other tools start: each is compiled when it is needed, and stands alone.
//!
//! Under Cargo, which is so when `CARGO` names it, a tool is brought up to date before it is
//! started. Otherwise the one is started that lies beside the program.

use std::{
    env,
    ffi::OsStr,
    io::{BufReader, IsTerminal as _, Write as _},
    path::{Path, PathBuf},
    process::{Command, ExitCode, Stdio},
    sync::{Mutex, PoisonError},
};

use anstream::stderr;
use anyhow::{Context, Result, bail, ensure};

use crate::{cargo, ui};

/// The profile of the tools, which tests have, too.
pub const PROFILE: &str = "dev";

/// A program of the workspace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tool {
    /// The program.
    pub program: &'static str,
    /// Its package.
    package: &'static str,
    /// What it is to the user.
    pub name: &'static str,
    /// How long it takes to compile with everything that it needs.
    pub takes: &'static str,
    /// Features that it is compiled with; `default` where other tools are compiled with those of its library, so that
    /// it is compiled once for all.
    pub features: &'static [&'static str],
    /// Whether it has the firmware's number of axes compiled in.
    has_axes: bool,
    /// Whether it has the clock of the virtual machine compiled in.
    has_clock: bool,
    /// The profile that it is compiled with.
    profile: &'static str,
    /// What it is compiled for, if that is not this computer.
    target: Option<&'static str>,
    /// The tool is a library that another program loads.
    is_library: bool,
    /// The tool has several commands: the caller names one.
    has_commands: bool,
    /// Its manifest, from the project's root, if it is in a workspace of its own.
    manifest: Option<&'static str>,
}

impl Tool {
    const fn new(program: &'static str, name: &'static str, takes: &'static str) -> Self {
        Self {
            program,
            package: program,
            name,
            takes,
            features: &[],
            has_axes: true,
            has_clock: true,
            profile: PROFILE,
            target: None,
            is_library: false,
            has_commands: false,
            manifest: None,
        }
    }

    /// It is in a package of several programs.
    const fn of(self, package: &'static str) -> Self {
        Self { package, ..self }
    }

    const fn of_pages(self) -> Self {
        Self {
            package: "pages",
            features: &["default"],
            ..self
        }
    }

    const fn for_any_axes(self) -> Self {
        Self {
            has_axes: false,
            has_clock: false,
            ..self
        }
    }

    const fn of_several_commands(self) -> Self {
        Self {
            has_commands: true,
            ..self
        }
    }

    /// It is for chips and their emulator, each of which has its own clock.
    const fn for_any_clock(self) -> Self {
        Self {
            has_clock: false,
            ..self
        }
    }

    /// Where, below a target folder, Cargo builds it for a number of axes and a clock.
    fn folder(self, top: PathBuf, axes: u8, clock_mhz: u32) -> PathBuf {
        let folder = cargo::with_clock(top, self.clock_mhz(clock_mhz));
        cargo::with_axes(folder, self.axes(axes))
    }

    /// The clock that it is compiled for when one is asked for, MHz.
    fn clock_mhz(self, asked: u32) -> u32 {
        if self.has_clock {
            asked
        } else {
            cargo::USUAL_CLOCK_MHZ
        }
    }

    /// The number of axes that it is compiled for when a number is asked for.
    fn axes(self, asked: u8) -> u8 {
        if self.has_axes { asked } else { 3 }
    }

    /// Where, in a folder of Cargo's, what is compiled for its target lies.
    fn of_target(self, folder: PathBuf) -> PathBuf {
        match self.target {
            Some(target) => folder.join(target),
            None => folder,
        }
    }

    fn file_name(self) -> String {
        format!("{}{}", self.program, env::consts::EXE_SUFFIX)
    }
}

/// `cargo xtask sim`.
pub const SIM: Tool = Tool {
    features: &["default"],
    ..Tool::new("sim", "the simulator", "about a minute").of("simulation")
};
/// The manifest of what runs the image of a board on models of its chip, from the project's root: a workspace of its own.
pub const VIRTUAL_BOARDS: &str = "tests/virtual_board/Cargo.toml";
/// What browsers run.
const WASM: &str = "wasm32-unknown-unknown";
/// What runs the image of a board on models of its chip.
pub const VIRTUAL_BOARD: Tool = Tool {
    manifest: Some(VIRTUAL_BOARDS),
    // Its arguments are no command line of a user.
    has_commands: true,
    ..Tool::new("virtual-board", "the models of chips", "some minutes").for_any_axes()
};
/// Everything that has to do with a board, emulated or not.
pub const TARGET: Tool = Tool::new("target", "the tools for boards", "about two minutes")
    .for_any_clock()
    .of_several_commands();
/// The same with probe-rs.
pub const PROBE: Tool = Tool {
    name: "the tools for boards, with probe-rs",
    takes: "some minutes",
    features: &["probe"],
    ..TARGET
};
/// `cargo xtask conformance`.
pub const CONFORMANCE: Tool =
    Tool::new("conformance", "the comparison with Grbl", "about a minute");
/// `cargo xtask docs`.
pub const DOCS: Tool = Tool {
    features: &["docs"],
    ..Tool::new("docs", "the writer of documents", "about a minute").of("firmware")
};
/// `cargo xtask schedule`.
pub const SCHEDULE: Tool =
    Tool::new("schedule", "the timing analysis", "about two minutes").for_any_axes();
/// `cargo xtask build` and `size`.
pub const FIRMWARE: Tool = Tool::new("firmware", "the builder of firmware", "half a minute")
    .for_any_axes()
    .of_several_commands();
/// `cargo xtask flash --dfu`.
pub const DFU: Tool = Tool::new("dfu", "the writer by DFU", "half a minute")
    .for_any_axes()
    .of_several_commands();
/// `cargo xtask board import`.
pub const IMPORT: Tool = Tool {
    features: &["import"],
    ..FIRMWARE
};
/// `cargo xtask send`.
pub const SEND: Tool = Tool::new("send", "the sender", "about a minute");
/// `cargo xtask settings`.
pub const SETTINGS: Tool =
    Tool::new("settings", "the tool for settings", "about a minute").of("send");
/// `cargo xtask monitor`.
pub const MONITOR: Tool = Tool::new("monitor", "the monitor", "about a minute").of_pages();
/// `cargo xtask view`.
pub const VIEW: Tool = Tool::new("view", "the view of jobs", "about a minute").of_pages();
/// `cargo xtask web`.
pub const WEB: Tool = Tool::new(
    "web",
    "the maker of the page for browsers",
    "about a minute",
)
.of_pages();
/// `cargo xtask soak`, `fuzz` and `test --faults`.
pub const SOAK: Tool = Tool::new(
    "soak",
    "the makers of random histories and inputs",
    "two minutes",
)
.of_several_commands();
/// The senders of `cargo xtask test --clients`.
pub const CLIENTS: Tool =
    Tool::new("clients", "the test of senders", "about a minute").of_several_commands();

/// A command that starts a tool, which is compiled before where that is necessary. Arguments follow; the first one is
/// a command where the tool has several.
pub fn command(tool: Tool) -> Result<Command> {
    command_for(tool, cargo::axes())
}

/// The same for a number of axes.
pub fn command_for(tool: Tool, axes: u8) -> Result<Command> {
    let mut command = program(tool, axes)?;
    if !tool.has_commands {
        command.arg(tool.program);
    }
    Ok(command)
}

/// The program of a tool.
fn program(tool: Tool, axes: u8) -> Result<Command> {
    let path = match env::var_os("CARGO") {
        Some(_) => build(tool, axes)?,
        None => built(tool, axes)?,
    };
    let mut command = Command::new(path);
    command
        .env(cargo::AXES, axes.to_string())
        .env(cargo::CLOCK, cargo::clock_mhz().to_string());
    Ok(command)
}

/// Hands on to a tool with all arguments, of which the first is the command: on success this program is that one now.
pub fn become_tool<A: AsRef<OsStr>>(
    tool: Tool,
    arguments: impl IntoIterator<Item = A>,
) -> Result<ExitCode> {
    let mut command = program(tool, cargo::axes())?;
    command.args(arguments);
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt as _;
        Err(command.exec()).with_context(|| format!("cannot start {}", tool.name))
    }
    #[cfg(not(unix))]
    {
        let status = command.status();
        let status = status.with_context(|| format!("cannot start {}", tool.name))?;
        Ok(ExitCode::from(status.code().unwrap_or(1) as u8))
    }
}

/// Runs a tool to its end and returns what it prints on standard output.
pub fn output<A: AsRef<OsStr>>(
    tool: Tool,
    arguments: impl IntoIterator<Item = A>,
) -> Result<String> {
    let mut command = command(tool)?;
    let output = command
        .args(arguments)
        .stderr(Stdio::inherit())
        .output()
        .with_context(|| format!("cannot start {}", tool.name))?;
    let text = String::from_utf8_lossy(&output.stdout)
        .trim_end()
        .to_owned();
    if !output.status.success() {
        ensure!(text.is_empty(), "{text}");
        bail!("{} has failed ({})", tool.name, output.status);
    }
    Ok(text)
}

/// The tool that was built when this program was.
fn built(tool: Tool, axes: u8) -> Result<PathBuf> {
    let here = env::current_exe().context("this program cannot be found")?;
    let path = tool_path(&here, tool, axes, cargo::clock_mhz());
    ensure!(
        path.exists(),
        "{} is not built: there is no {} (`cargo xtask` builds what it needs)",
        tool.name,
        path.display()
    );
    Ok(path)
}

/// Where Cargo has built a tool, if it has built the program `here`.
fn tool_path(here: &Path, tool: Tool, axes: u8, clock_mhz: u32) -> PathBuf {
    let profile = here.parent().unwrap_or(here);
    let mut folder = profile.parent().unwrap_or(profile);
    for variant in ["axes-", "clock-"] {
        let name = folder.file_name().unwrap_or_default();
        if name.to_string_lossy().starts_with(variant) {
            folder = folder.parent().unwrap_or(folder);
        }
    }
    let folder = tool.folder(folder.to_owned(), axes, clock_mhz);
    let profile = match tool.profile {
        PROFILE => profile.file_name().unwrap_or_default(),
        own => own.as_ref(),
    };
    tool.of_target(folder).join(profile).join(tool.file_name())
}

/// What this program has had Cargo bring up to date, with the folders: that is done once, for Cargo waits for every
/// other build.
static BUILT: Mutex<Vec<(Tool, PathBuf)>> = Mutex::new(Vec::new());

/// Has Cargo bring a tool up to date, and shows what Cargo does if that is more than nothing.
fn build(tool: Tool, axes: u8) -> Result<PathBuf> {
    let clock_mhz = cargo::clock_mhz();
    let folder = tool.folder(cargo::top_target_dir(), axes, clock_mhz);
    let (axes, clock_mhz) = (tool.axes(axes), tool.clock_mhz(clock_mhz));
    let profile = match tool.profile {
        PROFILE => "debug",
        own => own,
    };
    let path = { tool.of_target(folder.clone()).join(profile) }.join(tool.file_name());
    let mut built = BUILT.lock().unwrap_or_else(PoisonError::into_inner);
    if built.contains(&(tool, folder.clone())) {
        return Ok(path);
    }
    let mut command = cargo::cargo(&[
        "build",
        "--profile",
        tool.profile,
        "--package",
        tool.package,
    ]);
    command.arg("--no-default-features");
    command.arg("--target-dir").arg(&folder);
    if let Some(manifest) = tool.manifest {
        // What it uses asks for a newer compiler, and compiles with this one.
        command.args(["--manifest-path", manifest, "--ignore-rust-version"]);
    }
    match tool.target {
        Some(target) => command.args(["--lib", "--target", target]),
        None if tool.is_library => command.arg("--lib"),
        None => command.args(["--bin", tool.program]),
    };
    let mut features: Vec<_> = tool
        .features
        .iter()
        .map(|name| (*name).to_owned())
        .collect();
    if axes != 3 {
        features.push(format!("leadscrew/axes-{axes}"));
    }
    if clock_mhz != cargo::USUAL_CLOCK_MHZ {
        features.push(format!("leadscrew/clock-{clock_mhz}"));
    }
    if !features.is_empty() {
        command.arg("--features").arg(features.join(","));
    }
    let what = if path.exists() {
        tool.name.to_owned()
    } else {
        format!("{} (first use: {})", tool.name, tool.takes)
    };
    let is_built = show(&mut command, &what)?;
    ensure!(is_built, "{} cannot be compiled", tool.name);
    built.push((tool, folder));
    Ok(path)
}

/// Builds the plugin of QEMU that counts and follows instructions.
pub fn plugin() -> Result<PathBuf> {
    const PLUGIN: Tool = Tool {
        is_library: true,
        ..Tool::new("cost", "the plugin that counts", "about a minute").for_any_axes()
    };
    let program = build(PLUGIN, 3)?;
    Ok(program.with_file_name("libcost.so"))
}

/// Builds what a browser runs: WebAssembly.
pub fn wasm() -> Result<PathBuf> {
    let tool = for_browsers("pages", "the simulator for browsers", "about a minute");
    cargo::need_target_named(WASM)?;
    Ok(build(tool, cargo::axes())?.with_file_name("pages.wasm"))
}

/// What the control page runs.
const CONTROL: Tool = Tool {
    profile: "control",
    ..for_browsers("control", "the control page", "two minutes")
};

/// Builds the control page's code: WebAssembly, and the script that loads it.
pub fn control() -> Result<[PathBuf; 2]> {
    const GLUE: Tool = Tool {
        has_commands: true,
        ..Tool::new("glue", "what binds scripts to WebAssembly", "half a minute").for_any_axes()
    };
    let files = |folder: &Path| ["control_bg.wasm", "control.js"].map(|file| folder.join(file));
    if env::var_os("CARGO").is_none() {
        return Ok(files(&built(CONTROL, cargo::axes())?));
    }
    cargo::need_target_named(WASM)?;
    let folder = build(CONTROL, cargo::axes())?;
    let wasm = folder.with_file_name("control.wasm");
    let mut glue = command(GLUE)?;
    let status = glue.arg(&wasm).arg(&folder).status();
    let status = status.with_context(|| format!("cannot start {}", GLUE.name))?;
    ensure!(status.success(), "{} has failed ({status})", GLUE.name);
    Ok(files(&folder))
}

const fn for_browsers(package: &'static str, name: &'static str, takes: &'static str) -> Tool {
    Tool {
        profile: "web",
        target: Some(WASM),
        ..Tool::new(package, name, takes)
    }
}

/// Runs a build, silent while there is nothing to do; returns whether it succeeds.
fn show(command: &mut Command, what: &str) -> Result<bool> {
    let is_terminal = std::io::stderr().is_terminal();
    if is_terminal {
        let size = rustix::termios::tcgetwinsize(std::io::stderr());
        let width = size.map_or(80, |size| size.ws_col.max(20));
        command
            .env("CARGO_TERM_PROGRESS_WHEN", "always")
            .env("CARGO_TERM_PROGRESS_WIDTH", width.to_string())
            .env("CARGO_TERM_COLOR", "always");
    }
    let mut child = command
        .stdin(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .context("cannot start cargo")?;
    let mut messages = BufReader::new(child.stderr.take().context("cargo has no output")?);
    let mut is_busy = false;
    let mut message = Vec::new();
    while next_message(&mut messages, &mut message)? {
        match Message::of(&message) {
            Message::Done => continue,
            Message::Step if !is_busy => {
                is_busy = true;
                ui::status("Compiling", what);
            }
            Message::Step | Message::Other => {}
        }
        if is_terminal || Message::of(&message) == Message::Other {
            stderr().write_all(&message).context("nobody listens")?;
        }
    }
    let status = child.wait().context("cannot wait for cargo")?;
    Ok(status.success())
}

/// A piece of what Cargo says.
#[derive(Debug, PartialEq, Eq)]
enum Message {
    /// Something is compiled, or got to be compiled.
    Step,
    /// Everything is up to date now.
    Done,
    Other,
}

impl Message {
    fn of(piece: &[u8]) -> Self {
        let text = String::from_utf8_lossy(piece);
        let plain = anstream::adapter::strip_str(&text).to_string();
        match plain.split_whitespace().next() {
            Some("Compiling" | "Downloading" | "Downloaded" | "Updating") => Self::Step,
            Some("Finished") => Self::Done,
            _ => Self::Other,
        }
    }
}

/// Reads up to the end of a line, or of a line that will be written over.
fn next_message(from: &mut impl std::io::BufRead, message: &mut Vec<u8>) -> Result<bool> {
    message.clear();
    loop {
        let bytes = from.fill_buf().context("cannot read what cargo says")?;
        if bytes.is_empty() {
            return Ok(!message.is_empty());
        }
        let end = bytes.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
        let length = end.map_or(bytes.len(), |end| end + 1);
        message.extend(&bytes[..length]);
        from.consume(length);
        if end.is_some() {
            return Ok(true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_of_cargo_are_classified() {
        for (text, message) in [
            ("   Compiling anyhow v1.0.0\n", Message::Step),
            (
                "\u{1b}[1m\u{1b}[32m   Compiling\u{1b}[0m sim v0.1.0\n",
                Message::Step,
            ),
            ("    Building [====>   ] 12/60: syn\r", Message::Other),
            (
                "    Finished `dev` profile [optimized] target(s) in 0.1s\n",
                Message::Done,
            ),
            ("error[E0432]: unresolved import\n", Message::Other),
            (
                "    Blocking waiting for file lock on build directory\n",
                Message::Other,
            ),
        ] {
            assert_eq!(Message::of(text.as_bytes()), message, "{text:?}");
        }
    }

    #[test]
    fn a_tool_lies_next_to_another_or_in_the_folder_of_its_axes_and_clock() {
        for (here, tool, axes, clock_mhz, there) in [
            ("target/debug/xtask", SIM, 3, 168, "target/debug/sim"),
            ("target/debug/xtask", SIM, 4, 168, "target/axes-4/debug/sim"),
            (
                "target/debug/xtask",
                SIM,
                4,
                96,
                "target/clock-96/axes-4/debug/sim",
            ),
            (
                "target/clock-96/axes-4/debug/sim",
                TARGET,
                4,
                96,
                "target/axes-4/debug/target",
            ),
            (
                "target/clock-96/debug/sim",
                SCHEDULE,
                4,
                96,
                "target/debug/schedule",
            ),
            ("/home/me/bin/xtask", SIM, 3, 168, "/home/me/bin/sim"),
            (
                "target/debug/monitor",
                CONTROL,
                3,
                168,
                "target/wasm32-unknown-unknown/control/control",
            ),
        ] {
            let there = format!("{there}{}", env::consts::EXE_SUFFIX);
            assert_eq!(
                tool_path(Path::new(here), tool, axes, clock_mhz),
                Path::new(&there),
                "{here}"
            );
        }
    }

    #[test]
    fn messages_end_with_a_line_feed_or_where_a_line_begins_anew() {
        let mut from: &[u8] = b"a\rb\nc";
        let mut messages = Vec::new();
        let mut message = Vec::new();
        while next_message(&mut from, &mut message).unwrap() {
            messages.push(message.clone());
        }
        assert_eq!(messages, [b"a\r".to_vec(), b"b\n".to_vec(), b"c".to_vec()]);
    }
}
