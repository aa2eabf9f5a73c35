//! `cargo xtask test`: everything that can be tested without hardware.

use std::{
    ffi::OsString,
    fs, iter,
    process::{self, ExitCode},
};

use anyhow::{Context, Result, bail};
use clap::{Arg, ArgAction, Command};
use common::{
    cargo::{self, cargo, wait},
    check::{self, Check, Verdict},
    tools::{self, Tool},
    ui,
};

/// Test everything that needs no hardware
///
/// And what else its help says.
fn command() -> Command {
    let only = Arg::new("only")
        .value_name("NAME")
        .help("Only the checks whose name contains this");
    let list = Arg::new("list")
        .long("list")
        .action(ArgAction::SetTrue)
        .help("List the checks and do nothing");
    let clients = Arg::new("clients").long("clients").action(ArgAction::SetTrue).help(
        "Instead, drive sender programs at the simulator and at the firmware: gets them with pip \
         and npm, and skips what cannot be had",
    );
    Command::new("test")
        .bin_name("cargo xtask test")
        .about("Test everything that needs no hardware")
        .long_about(
            "Test everything that needs no hardware\n\n\
             Formatting, lints, host tests with three, four and six axes, the firmware of every board \
             and the proof of its timing, tests on the emulated processor, and the firmware over its \
             serial line. Goes on after a failure and lists what failed. Asks rustup for what rustup \
             can give.",
        )
        .after_help(ui::AXES)
        .styles(ui::STYLES)
        .max_term_width(100)
        .version(env!("CARGO_PKG_VERSION"))
        .no_binary_name(true)
        .args([only, list, clients])
}

/// Tests what is asked for.
pub(crate) fn start(arguments: Vec<OsString>) -> Result<ExitCode> {
    if arguments.iter().any(|argument| argument == "--clients") {
        // What else is asked for is its matter.
        return tools::become_tool(tools::CLIENTS, arguments);
    }
    let matches = command().get_matches_from(arguments);
    let only = matches.get_one::<String>("only");
    let is_list = matches.get_flag("list");
    if !is_list {
        // Checks without it go on, and those that need it say the same.
        match cargo::need_qemu() {
            Ok(version) => ui::status("Emulator", &format!("QEMU {version}")),
            Err(error) => ui::warning(&error.to_string()),
        }
    }
    check::run(checks()?, only.map(String::as_str), is_list, 1)
}

/// A check that needs no words when it passes.
fn plain(name: impl Into<String>, run: impl Fn() -> Result<()> + Send + 'static) -> Check {
    Check::new(name, move || run().map(|()| Verdict::Passed))
}

/// A check that a tool makes.
fn by(tool: Tool, name: impl Into<String>, arguments: &'static [&'static str]) -> Check {
    Check::new(name, move || check::by(tool, arguments, cargo::axes()))
}

/// A board.
#[derive(Clone)]
struct Board {
    name: String,
    /// The feature of its chip.
    chip: String,
    is_emulated: bool,
}

impl Board {
    /// Makes a Cargo command compile for the board.
    fn compile<'a>(&self, command: &'a mut process::Command) -> &'a mut process::Command {
        let features = if self.is_emulated {
            format!("{},emulated", self.chip)
        } else {
            self.chip.clone()
        };
        cargo::compile_for(command, &self.name, &features, &cargo::target_dir());
        command
    }
}

/// The boards whose images are all built.
fn boards() -> Result<Vec<Board>> {
    let text = tools::output(tools::FIRMWARE, ["boards"])?;
    let boards = text.lines().map(|line| Board {
        name: line.split(' ').next().unwrap_or_default().into(),
        chip: line.split(' ').nth(1).unwrap_or_default().into(),
        is_emulated: line.ends_with(" emulated"),
    });
    let boards = boards.filter(|board| WHOLE.contains(&board.name.as_str()));
    Ok(boards.collect())
}

/// Every check, the quick ones first.
fn checks() -> Result<Vec<Check>> {
    let boards = boards()?;
    let mut checks = vec![
        plain("formatting", || {
            cargo::need_component("fmt", "rustfmt")?;
            wait(&mut cargo(&["fmt", "--all", "--check"]))
        }),
        by(tools::DOCS, "documents", &["--check"]),
        plain("lints, host", || {
            cargo::need_component("clippy", "clippy")?;
            wait(cargo(&["clippy", "--workspace", "--all-targets"]).args(["--", "-Dwarnings"]))
        }),
        plain("documentation of the library", || {
            wait(&mut rustdoc("--lib"))
        }),
        plain("host tests", || {
            wait(&mut cargo(&["test", "--workspace", "--no-fail-fast"]))
        }),
    ];
    checks.push(by(tools::SOAK, "a day in virtual time", &["--day"]));
    checks.extend(with_features());
    checks.extend(boards.iter().cloned().map(|board| {
        let name = format!("lints, {}", board.name);
        plain(name, move || lint(&board))
    }));
    for board in boards {
        checks.push(Check::new(format!("firmware, {}", board.name), move || {
            check::by(tools::FIRMWARE, ["all", &board.name], cargo::axes())
        }));
    }
    checks.extend(proofs());
    checks.push(plain("tests on the target", on_target));
    let by_target = [
        ("calibration without a counter", &["check", "calibration"]),
        ("bring-up as far as QEMU goes", &["check", "bring-up"]),
        ("records of activations", &["check", "records"]),
        ("the same on the chip", &["check", "chip"]),
        ("the same in the firmware", &["check", "firmware"]),
    ];
    checks.extend(by_target.map(|(name, arguments)| by(tools::TARGET, name, arguments)));
    checks.push(by(
        tools::FIRMWARE,
        "firmware over its serial line",
        &["serial"],
    ));
    Ok(checks)
}

/// The host tests with features. Random tests try as few cases as when it must be quick: more of them find what
/// the machine with three axes does wrong, too.
fn with_features() -> impl Iterator<Item = Check> {
    let tests: [(&str, &[&str]); 4] = [
        ("axes-4", &["--lib", "--tests"]),
        ("axes-6", &["--lib", "--tests"]),
        (
            "phases",
            &["--test", "machine", "--", "phases", "stored_program"],
        ),
        ("clock-96", &["--test", "motion", "segments"]),
    ];
    tests.into_iter().map(|(feature, tests)| {
        plain(format!("host tests, {feature}"), move || {
            let mut command = cargo(&["test", "--no-fail-fast", "--features", feature]);
            wait(command.args(tests).env_remove("LEADSCREW_CASES"))
        })
    })
}

/// The boards whose images are all built, with every lint, and those whose firmware is proven: of four chips,
/// one with a bootloader, one with a large and one with a small EEPROM, one whose motors are driven by phases, one at 96 MHz. `cargo xtask board check --all --prove` looks at all boards.
const WHOLE: [&str; 3] = [SHOWN, "nucleo-f446re", PHASES];
const PROVEN: [&str; 7] = [
    SHOWN,
    "nucleo-f446re",
    "flexi-hal",
    "fysetc-s6-2",
    "btt-skr-2",
    PHASES,
    "blackpill-f411",
];
/// Whose motors are driven by phases.
const PHASES: &str = "nucleo-f446re-uln2003";
/// Whose proof the documents show, with three axes.
const SHOWN: &str = "netduino-plus-2";

/// The proofs that every deadline is met, and the starts of what they are about.
fn proofs() -> Vec<Check> {
    let shown = Check::new("the proof that the documents show", || {
        check::by(tools::SCHEDULE, ["--check"], 3)
    });
    let others = PROVEN.into_iter().flat_map(|board| {
        let axes = if board == SHOWN { 4 } else { 3 };
        let proof = Check::new(format!("the proof, {board}, {axes} axes"), move || {
            check::by(tools::SCHEDULE, ["--board", board, "--verdict"], axes)
        });
        // The proof has just compiled it.
        let start = Check::new(format!("what is flashed starts, {board}"), move || {
            check::by(tools::FIRMWARE, ["start", board], axes)
        });
        [proof, start]
    });
    let for_hosts = Check::new("the proof with the RepRap dialect", || {
        let arguments = ["--board", SHOWN, "--verdict"];
        check::with_features(tools::SCHEDULE, arguments, "reprap")
    });
    iter::once(shown).chain(others).chain([for_hosts]).collect()
}

/// Whether the project has tests whose file name starts so.
fn has_tests(prefix: &str) -> bool {
    let files = fs::read_dir(cargo::root().join("tests"));
    files.into_iter().flatten().flatten().any(|file| {
        let name = file.file_name();
        name.to_string_lossy().starts_with(prefix)
    })
}

/// Returns the command that documents a library or a program, in which every link must lead somewhere.
fn rustdoc(of: &str) -> process::Command {
    let mut command = cargo(&["doc", of, "--no-deps", "--document-private-items"]);
    command.env("RUSTDOCFLAGS", "-Dwarnings");
    command
}

/// Clippy over what is compiled for a board, and its documentation.
fn lint(board: &Board) -> Result<()> {
    cargo::need_component("clippy", "clippy")?;
    cargo::need_target()?;
    let mut command = cargo(&["clippy", "--lib", "--bins"]);
    if has_tests("target_") {
        command.args(["--test", "target_*"]);
    }
    wait(board.compile(&mut command).args(["--", "-Dwarnings"]))?;
    let feature = if board.is_emulated {
        "trace-emulated"
    } else {
        "trace"
    };
    let mut traced = cargo(&["clippy", "--bins", "--features", feature]);
    wait(board.compile(&mut traced).args(["--", "-Dwarnings"]))?;
    wait(board.compile(&mut rustdoc("--bins")))
}

/// The tests that run on the emulated processor.
fn on_target() -> Result<()> {
    if !has_tests("target_") {
        bail!("there are no tests/target_*.rs");
    }
    cargo::need_qemu()?;
    cargo::need_target()?;
    let boards = boards()?;
    let board = boards.iter().find(|board| board.is_emulated);
    let board = board.context("no board names a QEMU machine")?;
    // Other tests are the host's, and do not compile for the target.
    let mut command = cargo(&["test", "--release", "--no-fail-fast", "--test", "target_*"]);
    wait(board.compile(&mut command))
}
