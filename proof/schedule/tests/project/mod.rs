//! The fixture, changed and built: a small RTIC application with one thing wrong.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use schedule::{Flaw, Input, Report, Rule, analyse, certify};

const TARGET: &str = "thumbv7em-none-eabihf";
/// The application that a test compiles; the rest of the folder is copied.
const FILES: [&str; 6] = [
    "Cargo.toml",
    "device.x",
    "memory.x",
    "schedule.toml",
    "src/main.rs",
    "src/device.rs",
];

/// A copy of the fixture that is a project of its own.
pub(crate) struct Project {
    name: String,
    folder: PathBuf,
    app: String,
}

impl Project {
    /// The fixture as it is, or `None` and a word why, when the target is not installed.
    pub(crate) fn new(name: &str) -> Option<Self> {
        if !target_is_installed() {
            println!("skipped: the target {TARGET} is not installed");
            return None;
        }
        let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixture");
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
            .join("rules")
            .join(name);
        fs::create_dir_all(folder.join("src")).expect("the target folder is writable");
        for file in FILES {
            let text = fs::read_to_string(fixture.join(file)).expect("it is a part of the fixture");
            // Programs of different names do not overwrite each other.
            write(
                &folder.join(file),
                &text.replace("\"fixture\"", &format!("\"{name}\"")),
            );
        }
        let lock = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../Cargo.lock");
        if !folder.join("Cargo.lock").exists() {
            fs::copy(lock, folder.join("Cargo.lock")).expect("the project has a lock file");
        }
        let app =
            fs::read_to_string(fixture.join("src/app.rs")).expect("it is a part of the fixture");
        Some(Self {
            name: name.into(),
            folder,
            app,
        })
    }

    /// Puts code where the application says `// {mark}: here`.
    pub(crate) fn with(mut self, mark: &str, code: &str) -> Self {
        let mark = format!("// {mark}: here");
        assert!(self.app.contains(&mark), "the fixture has no {mark}");
        self.app = self.app.replace(&mark, code);
        self
    }

    /// Replaces a part of the application.
    pub(crate) fn replacing(mut self, old: &str, new: &str) -> Self {
        assert!(self.app.contains(old), "the fixture has no {old}");
        self.app = self.app.replace(old, new);
        self
    }

    /// Replaces a part of `schedule.toml`.
    pub(crate) fn configured(self, old: &str, new: &str) -> Self {
        let path = self.folder.join("schedule.toml");
        let text = fs::read_to_string(&path).expect("it was written");
        assert!(text.contains(old), "schedule.toml has no {old}");
        write(&path, &text.replace(old, new));
        self
    }

    /// The number of the first line of the application that contains `code`.
    pub(crate) fn line(&self, code: &str) -> usize {
        let index = self.app.lines().position(|line| line.contains(code));
        index.unwrap_or_else(|| panic!("no line has {code}")) + 1
    }

    /// Compiles the application.
    pub(crate) fn build(&self) -> PathBuf {
        write(&self.folder.join("src/app.rs"), &self.app);
        let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("rules/target");
        let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let output = Command::new(cargo)
            .args(["build", "--release", "--target", TARGET])
            .current_dir(&self.folder)
            .env("CARGO_TARGET_DIR", &target)
            .env("RUSTFLAGS", "-C link-arg=-Tlink.x -C link-arg=--nmagic")
            .env_remove("CARGO_ENCODED_RUSTFLAGS")
            .output()
            .expect("cargo runs");
        let messages = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{messages}");
        target.join(TARGET).join("release").join(&self.name)
    }

    /// The report of the analysis of a program, with the sources as they are now.
    pub(crate) fn analyse(&self, elf: &Path) -> Report {
        write(&self.folder.join("src/app.rs"), &self.app);
        analyse(&self.input(elf)).expect("all files are there")
    }

    /// The certificate of the proof of a program.
    pub(crate) fn certify(&self, elf: &Path) -> String {
        let (report, certificate) = certify(&self.input(elf)).expect("all files are there");
        certificate.unwrap_or_else(|| panic!("{:?}", report.flaws))
    }

    fn input<'a>(&'a self, elf: &'a Path) -> Input<'a> {
        Input {
            elf,
            root: &self.folder,
            board: "fixture",
            features: &[],
            clock: "168/5/4/2".parse().expect("these are clocks"),
            axes: 3,
            step_rate_hz: None,
            baud: None,
            measured: None,
        }
    }

    /// Builds it and says what is wrong.
    pub(crate) fn flaws(&self) -> Vec<Flaw> {
        self.analyse(&self.build()).flaws
    }
}

/// The flaws of this rule at some lines of the application.
pub(crate) fn flaws_at(
    flaws: &[Flaw],
    rule: Rule,
    lines: std::ops::RangeInclusive<usize>,
) -> impl Iterator<Item = &Flaw> {
    let is_there = move |flaw: &&Flaw| {
        let mut frames = flaw.place.frames.iter();
        frames.any(|frame| {
            let line = frame.split_once("(src/app.rs:").and_then(|(_, rest)| {
                let digits = rest.split([':', ')']).next()?;
                digits.parse().ok()
            });
            line.is_some_and(|line: usize| lines.contains(&line))
        })
    };
    flaws
        .iter()
        .filter(move |flaw| flaw.rule == rule)
        .filter(is_there)
}

/// The flaw of this rule at one of these lines of the application, with something to do about it.
pub(crate) fn assert_caught(
    flaws: &[Flaw],
    rule: Rule,
    lines: std::ops::RangeInclusive<usize>,
) -> &Flaw {
    let found = flaws_at(flaws, rule, lines.clone()).next();
    let flaw = found.unwrap_or_else(|| panic!("no {rule:?} at lines {lines:?} in {flaws:#?}"));
    assert!(!flaw.what.is_empty() && !flaw.remedy.is_empty(), "{flaw:?}");
    flaw
}

/// Writes a file, when it is not like that already: Cargo looks at the time of a change.
fn write(path: &Path, text: &str) {
    if fs::read_to_string(path).is_ok_and(|found| found == text) {
        return;
    }
    fs::write(path, text).expect("the target folder is writable");
}

fn target_is_installed() -> bool {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc)
        .args(["--print", "target-libdir", "--target", TARGET])
        .output();
    output.is_ok_and(|output| {
        let folder = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        output.status.success() && Path::new(&folder).is_dir()
    })
}
