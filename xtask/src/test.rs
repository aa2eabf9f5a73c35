//! `cargo xtask test`: what can be tested without hardware, in two parts.
//!
//! What is quick finds most of what a change breaks; the rest takes long, or finds what is seldom broken.

use std::{
    env, fs, iter,
    process::{self, ExitCode},
    time::Instant,
};

use anyhow::{Context, Result};
use common::{
    cargo::{self, cargo, wait},
    check::{self, Check, Verdict},
    options::Test,
    tools::{self, Tool},
    ui,
};

/// Tests what is asked for.
pub(crate) fn start(options: &Test) -> Result<ExitCode> {
    if !options.list
        && let Ok(version) = cargo::need_qemu()
    {
        ui::status("Emulator", &format!("QEMU {version}"));
    }
    let checks = match options {
        Test { all: true, .. } => [quick(), rest()].into_iter().flatten().collect(),
        Test { rest: true, .. } => rest(),
        // A check that is named is one of all.
        Test { only: Some(_), .. } => [quick(), rest()].into_iter().flatten().collect(),
        _ => quick(),
    };
    let start = Instant::now();
    let only = options.only.as_deref();
    let is_long = options.rest || options.all;
    let at_once = if is_long {
        PARALLEL_LONG_CHECKS
    } else {
        PARALLEL_QUICK_CHECKS
    };
    let code = check::run(checks, only, options.list, at_once)?;
    if !options.list && !options.all && !options.rest && only.is_none() {
        let minutes = start.elapsed().as_secs_f32() / 60.0;
        ui::status(
            "Tested",
            &format!("what is quick, in {minutes:.1} minutes; left out: {REST_SUMMARY}"),
        );
    }
    Ok(code)
}

/// How many checks `--rest` and `--all` make at the same time: each works on one processor for part of its time.
const PARALLEL_LONG_CHECKS: usize = 3;
/// How many of the others: while one runs its tests, the next one is compiled.
const PARALLEL_QUICK_CHECKS: usize = 2;
/// What is not quick, and how to test it.
const REST_SUMMARY: &str = "lints, every case of the random tests, the tools, other numbers of axes, the other boards and \
    their proofs, boards on models of their chips, what the proof must find, tests on the emulated processor, random \
    histories and inputs, sender programs (`cargo xtask test --rest`)";

/// A check that needs no words when it passes.
fn plain(name: impl Into<String>, run: impl Fn() -> Result<()> + Send + 'static) -> Check {
    Check::new(name, move || run().map(|()| Verdict::Passed))
}

/// A check that runs a command to its end.
fn runs<const N: usize>(name: impl Into<String>, arguments: [&'static str; N]) -> Check {
    plain(name, move || wait(&mut cargo(&arguments)))
}

/// A check that a tool makes which shows what it finds.
fn shown_by(tool: Tool, name: &str, arguments: &'static [&'static str]) -> Check {
    plain(name, move || wait(tools::command(tool)?.args(arguments)))
}

/// A check that a tool makes.
fn by(tool: Tool, name: impl Into<String>, arguments: &'static [&'static str]) -> Check {
    Check::new(name, move || check::by(tool, arguments, cargo::axes()))
}

/// The same check where there is QEMU; without it, it is skipped.
fn emulated(check: Check) -> Check {
    Check::new(check.name, move || match cargo::need_qemu() {
        Ok(_) => (check.run)(),
        Err(error) => Ok(Verdict::Skipped(error.to_string())),
    })
}

/// Of the unit tests of the library, those of USB with them, which are as quick without optimisation.
const UNIT_TESTS: [&str; 8] = [
    "test",
    "--no-fail-fast",
    "--package=leadscrew",
    "--lib",
    "--no-default-features",
    "--features=usb",
    "--config",
    "profile.dev.package.leadscrew.opt-level=0",
];

/// What is quick.
fn quick() -> Vec<Check> {
    vec![
        plain("formatting", || {
            cargo::need_component("fmt", "rustfmt")?;
            wait(&mut cargo(&["fmt", "--all", "--check"]))?;
            let of_models = ["--manifest-path", tools::VIRTUAL_BOARDS];
            wait(cargo(&["fmt", "--check"]).args(of_models))
        }),
        runs("unit tests", UNIT_TESTS),
        runs("host tests", ["test", "--no-fail-fast", "--package=tests"]),
        by(tools::DOCS, "documents", &["--check"]),
        runs("answers of Grbl", ["test", "--package=conformance"]),
        Check::new("the proof that the documents show", || {
            check::by(tools::SCHEDULE, ["--check"], 3)
        }),
        // The proof has just compiled it.
        Check::new("room in the flash", || {
            check::by(tools::FIRMWARE, ["room", SHOWN], 3)
        }),
        emulated(by(
            tools::FIRMWARE,
            "firmware over its serial line",
            &["serial"],
        )),
    ]
}

/// What takes long.
fn rest() -> Vec<Check> {
    // First what takes longest: one works on one processor, the other waits for senders most of the time.
    let mut checks = vec![
        shown_by(
            tools::SCHEDULE,
            "a fault of each kind that the proof finds",
            &["--mutants=3"],
        ),
        by(
            tools::CLIENTS,
            "sender programs",
            &["test", "--clients", "--short"],
        ),
    ];
    checks.extend(lints_and_all_cases());
    checks.extend(with_features());
    for board in LINTED {
        checks.push(plain(format!("lints, {board}"), move || lint(board)));
        checks.push(Check::new(format!("firmware, {board}"), move || {
            check::by(tools::FIRMWARE, ["all", board], cargo::axes())
        }));
    }
    checks.extend(proofs());
    checks.extend(virtual_boards());
    checks.extend(long_in_emulator());
    checks.extend([
        by(tools::SOAK, "a day in virtual time", &["soak", "--day"]),
        by(tools::SOAK, "random histories", &["soak"]),
        by(tools::SOAK, "random inputs", &["fuzz"]),
    ]);
    checks
}

/// Lints, and the tests with all their cases.
fn lints_and_all_cases() -> Vec<Check> {
    vec![
        plain("lints, host", || {
            cargo::need_component("clippy", "clippy")?;
            wait(cargo(&["clippy", "--workspace", "--all-targets"]).args(["--", "-Dwarnings"]))
        }),
        plain("documentation of the library", || {
            wait(&mut rustdoc("--lib"))?;
            wait(&mut cargo(&["test", "--package=leadscrew", "--doc"]))
        }),
        plain("host tests, every case", || {
            let mut command = cargo(&["test", "--no-fail-fast", "--package=tests"]);
            // The sources have no cases, and those over the serial line are of another check.
            command.args(OF_AXES.map(|name| format!("--test={name}")));
            // Most of their time is their own.
            command.args(["--config", "profile.dev.package.tests.opt-level=1"]);
            wait(command.env(CASES, all_cases()))
        }),
        plain("unit tests, every case", || {
            wait(cargo(&UNIT_TESTS).env(CASES, all_cases()))
        }),
        plain("tests of the tools", of_tools),
    ]
}

/// The packages of the tools. Those that need the timing analysis have the features here that they have as tools, so
/// that it is compiled already.
const TOOLS: [&[&str]; 3] = [
    &["--package=schedule"],
    &["--package=target", "--package=cost", "--package=clients"],
    &[
        "--workspace",
        "--exclude=leadscrew",
        "--exclude=tests",
        "--exclude=schedule",
        "--exclude=target",
        "--exclude=cost",
        "--exclude=clients",
    ],
];

/// The tests of the tools, with all their cases.
fn of_tools() -> Result<()> {
    let run = |packages: &&[&str]| {
        let mut command = cargo(&["test", "--no-fail-fast"]);
        wait(command.args(*packages).env(CASES, all_cases()))
    };
    // All of them, whichever fails.
    let results: Vec<_> = TOOLS.iter().map(run).collect();
    results.into_iter().collect()
}

/// What takes long in the emulator.
fn long_in_emulator() -> Vec<Check> {
    let over_serial = || check::with_variable(tools::FIRMWARE, ["serial"], (CASES, &all_cases()));
    let by_target: [(_, &[_]); 5] = [
        ("calibration without a counter", &["check", "calibration"]),
        ("bring-up as far as QEMU goes", &["check", "bring-up"]),
        ("records of activations", &["check", "records"]),
        ("the same on the chip", &["check", "chip"]),
        ("the same in the firmware", &["check", "firmware"]),
    ];
    let others = [
        plain("tests on the target", on_target),
        Check::new("every case over the serial line", over_serial),
        shown_by(
            tools::SCHEDULE,
            "an execution beside the proof",
            &["--replay"],
        ),
    ];
    let by_target = by_target.map(|(name, arguments)| by(tools::TARGET, name, arguments));
    let all = others.into_iter().chain(by_target);
    all.map(emulated).collect()
}

/// How many times as many cases random tests try as they name: see `tests/support/cases.rs`.
const CASES: &str = "LEADSCREW_CASES";

/// All that they name, or as many times that as are asked for.
fn all_cases() -> String {
    env::var(CASES).unwrap_or_else(|_| "1".into())
}

/// The programs of host tests in which something has as many parts as there are axes, and their modules in which nothing
/// has.
const OF_AXES: [&str; 7] = [
    "interpreter",
    "journal",
    "machine",
    "motion",
    "protocol",
    "realtime",
    "reprap",
];
const OF_NO_AXES: [&str; 6] = [
    "arithmetic::",
    "contours::",
    "experiment_arcs::",
    "integer_arcs::",
    "step_arcs::",
    "rounding::",
];

/// The host tests with features, as quick as without. The workflow has four axes.
fn with_features() -> impl Iterator<Item = Check> {
    let programs = OF_AXES.map(|name| format!("--test={name}"));
    let skipped = OF_NO_AXES.map(|name| format!("--skip={name}"));
    let separator = ["--".to_owned()].into_iter();
    let of_axes = programs.into_iter().chain(separator).chain(skipped);
    let owned = |words: &[&str]| words.iter().copied().map(String::from).collect();
    let tests: [(_, Vec<_>); 4] = [
        ("axes-6", of_axes.collect()),
        (
            "phases",
            owned(&["--test=machine", "--", "phases", "stored_program"]),
        ),
        ("clock-96", owned(&["--test=motion", "segments"])),
        ("interleave", owned(&["--test=interleave"])),
    ];
    tests.into_iter().map(|(feature, tests)| {
        plain(format!("host tests, {feature}"), move || {
            let mut command = cargo(&[
                "test",
                "--no-fail-fast",
                "--package=tests",
                "--features",
                feature,
            ]);
            wait(command.args(&tests).env_remove(CASES))?;
            if !feature.starts_with("axes") {
                return Ok(());
            }
            wait(
                cargo(&UNIT_TESTS)
                    .args(["--features", feature])
                    .env_remove(CASES),
            )
        })
    })
}

/// The boards that have every lint and all their images built, and those whose firmware is proven: of four chips,
/// one with a bootloader, one with a small EEPROM, one whose motors are driven by phases, one at 96 MHz.
/// `cargo xtask board check --all --prove` looks at all boards.
const LINTED: [&str; 2] = [SHOWN, PHASES];
const PROVEN_BOARDS: [&str; 5] = [SHOWN, "fysetc-s6-2", "btt-skr-2", PHASES, "blackpill-f411"];
/// Whose motors are driven by phases.
const PHASES: &str = "nucleo-f446re-uln2003";
/// Whose proof the documents show, with three axes.
const SHOWN: &str = "netduino-plus-2";

/// The proofs that every deadline is met.
fn proofs() -> Vec<Check> {
    let all = PROVEN_BOARDS.map(|board| {
        let axes = if board == SHOWN { 4 } else { 3 };
        Check::new(format!("the proof, {board}, {axes} axes"), move || {
            let arguments = ["--board", board, "--verdict", "--confirm"];
            check::by(tools::SCHEDULE, arguments, axes)
        })
    });
    let for_hosts = Check::new("the proof with the RepRap dialect", || {
        let arguments = ["--board", SHOWN, "--verdict"];
        check::with_variable(tools::SCHEDULE, arguments, (cargo::FEATURES, "reprap"))
    });
    all.into_iter().chain([for_hosts]).collect()
}

/// The boards that are rehearsed: of three chips, two with a bootloader, one with an EEPROM. The first one's pins make
/// whole jobs as well; `cargo xtask rehearse --all` rehearses all, with all of them.
const REHEARSED: [&str; 3] = ["btt-skr-2", "blackpill-f411", "fysetc-s6-2"];

/// The firmware of boards on models of their chips, and the tests and lints of these.
fn virtual_boards() -> Vec<Check> {
    let models = plain("models of chips", || {
        cargo::need_component("clippy", "clippy")?;
        let mut command = cargo(&["test", "--ignore-rust-version"]);
        command.args(["--manifest-path", tools::VIRTUAL_BOARDS]);
        command.arg("--target-dir").arg(cargo::target_dir_for(3));
        // What it uses is compiled for the tool anyway, and not once more for `cargo clippy`.
        command.env("RUSTC_WORKSPACE_WRAPPER", "clippy-driver");
        wait(command.env("CLIPPY_ARGS", "-Dwarnings"))
    });
    let rehearsals = REHEARSED.map(|board| {
        Check::new(format!("the rehearsal, {board}"), move || {
            let whole = ["rehearse", "--board", board, "--short"];
            let length = whole.len() - usize::from(board == REHEARSED[0]);
            check::by(tools::FIRMWARE, whole.into_iter().take(length), 3)
        })
    });
    // By SD card, DFU, and the drive of an ST-LINK.
    let starts = ["btt-skr-2", "blackpill-f411", "nucleo-f446re"].map(|board| {
        Check::new(format!("a release on its board, {board}"), move || {
            started_from_release(board)
        })
    });
    { [models].into_iter().chain(rehearsals) }
        .chain(starts)
        .collect()
}

/// Makes a release of a board, and starts the board from the files in its folder.
fn started_from_release(board: &str) -> Result<Verdict> {
    let folder = cargo::target_dir_for(3).join("releases").join(board);
    if folder.exists() {
        fs::remove_dir_all(&folder).with_context(|| format!("{}", folder.display()))?;
    }
    let folder = folder.to_string_lossy();
    let release = ["release", "--board", board, "--with-axes", "3", "--out"];
    check::by(tools::FIRMWARE, [&release[..], &[&folder]].concat(), 3)?;
    let start = ["rehearse", "--board", board, "--start", "--from", &folder];
    check::by(tools::FIRMWARE, start, 3)
}

/// A board.
struct Board {
    /// Its file, which is how tools name it: with another word for the same board, Cargo would compile everything again.
    file: String,
    /// The features of its chip.
    features: String,
    /// Whether QEMU emulates it.
    has_emulator: bool,
}

impl Board {
    /// The board of a name.
    fn named(name: &str) -> Result<Self> {
        let text = tools::output(tools::FIRMWARE, ["boards"])?;
        let mut boards = text.lines().map(|line| line.split(' '));
        let mut words = boards
            .find(|words| words.clone().next() == Some(name))
            .with_context(|| format!("there is no board {name}"))?
            .skip(1);
        let file = cargo::root().join(format!("boards/{name}.toml"));
        Ok(Self {
            file: file.to_string_lossy().into_owned(),
            features: words.next().unwrap_or_default().into(),
            has_emulator: words.next().is_some(),
        })
    }

    /// Makes a Cargo command compile for the board.
    fn compile<'a>(&self, command: &'a mut process::Command) -> &'a mut process::Command {
        cargo::compile_for(command, &self.file, &self.features, &cargo::target_dir());
        command
    }
}

/// Returns the command that documents a library or a program, in which every link must lead somewhere.
fn rustdoc(of: &str) -> process::Command {
    let mut command = cargo(&[
        "doc",
        "--package=leadscrew",
        of,
        "--no-deps",
        "--document-private-items",
    ]);
    command.env("RUSTDOCFLAGS", "-Dwarnings");
    command
}

/// Clippy over what is compiled for a board, and its documentation.
fn lint(board: &str) -> Result<()> {
    cargo::need_component("clippy", "clippy")?;
    cargo::need_target()?;
    let board = Board::named(board)?;
    let mut command = cargo(&[
        "clippy",
        "--lib",
        "--bins",
        "--examples",
        "--test",
        "target_*",
    ]);
    wait(board.compile(&mut command).args(["--", "-Dwarnings"]))?;
    let for_qemu = board.has_emulator.then_some("qemu,trace");
    for features in iter::once("trace").chain(for_qemu) {
        let mut command = cargo(&["clippy", "--bins", "--examples", "--features", features]);
        wait(board.compile(&mut command).args(["--", "-Dwarnings"]))?;
    }
    wait(board.compile(&mut rustdoc("--bins")))
}

/// The tests that run on the emulated processor by themselves; what other checks run there needs the host.
fn on_target() -> Result<()> {
    cargo::need_target()?;
    let board = Board::named(SHOWN)?;
    let mut command = cargo(&["test", "--release", "--no-fail-fast", "--test", "target_*"]);
    wait(board.compile(&mut command))
}
