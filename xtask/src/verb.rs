//! The commands: what each is, and which tool it is a part of.

use std::{
    ffi::{OsStr, OsString},
    fs::{self, Metadata},
    os::unix::fs::MetadataExt as _,
    path::Path,
    process::ExitCode,
};

use anyhow::{Context, Result, ensure};
use common::{
    cargo, probe,
    tools::{self, Tool},
};

use crate::test;

/// A command.
pub(crate) struct Verb {
    /// As it is typed.
    pub(crate) name: &'static str,
    /// What it does: the first line of its own help.
    pub(crate) about: &'static str,
    /// The tool that does it; none: this program.
    tool: Option<Tool>,
}

/// Every command.
pub(crate) const VERBS: [Verb; 22] = [
    verb(
        "bench",
        tools::TARGET,
        "Count what the firmware costs on the emulated chip, in instructions and modelled cycles",
    ),
    verb("board", tools::FIRMWARE, "Check the file of a board"),
    verb(
        "bring-up",
        tools::TARGET,
        "Look whether a board is what the firmware counts on",
    ),
    verb("build", tools::FIRMWARE, "Build the firmware"),
    verb(
        "calibrate",
        tools::TARGET,
        "Measure on a board what the timing analysis takes for granted",
    ),
    verb(
        "conformance",
        tools::CONFORMANCE,
        "Replay what Grbl was recorded to do, and compare",
    ),
    verb(
        "docs",
        tools::DOCS,
        "Write the documents that are made from the code: settings, errors and alarms",
    ),
    verb(
        "flash",
        tools::PROBE,
        "Build the firmware and write it to the board with a debug probe",
    ),
    verb(
        "fuzz",
        tools::SOAK,
        "Give the library inputs that nobody sends, and look whether any makes it panic",
    ),
    verb(
        "latency",
        tools::TARGET,
        "Measure how long tasks wait and take, beside the bounds that are proven",
    ),
    verb(
        "monitor",
        tools::MONITOR,
        "Show in a browser what a machine does",
    ),
    verb(
        "qemu",
        tools::TARGET,
        "Run a G-code program on the firmware itself, on the emulated board",
    ),
    verb(
        "run",
        tools::TARGET,
        "Run an ELF file on the emulated board and print its log",
    ),
    verb(
        "schedule",
        tools::SCHEDULE,
        "Prove from the machine code that every task meets its deadline",
    ),
    verb("send", tools::SEND, "Send a G-code program to a machine"),
    verb(
        "settings",
        tools::SETTINGS,
        "Save the settings of a machine, compare them with a file, or load them",
    ),
    verb(
        "sim",
        tools::SIM,
        "Run a G-code program on the virtual machine",
    ),
    verb(
        "size",
        tools::FIRMWARE,
        "Build the firmware and show how much flash and RAM it takes",
    ),
    verb(
        "soak",
        tools::SOAK,
        "Let anything happen to the virtual machine, and look whether it does what it must",
    ),
    Verb {
        name: "test",
        about: "Test everything that needs no hardware",
        tool: None,
    },
    verb(
        "view",
        tools::VIEW,
        "Show a G-code program as a page: its path, its speeds and its time",
    ),
    verb(
        "web",
        tools::WEB,
        "Make a page that runs G-code programs on the virtual machine in the browser",
    ),
];

const fn verb(name: &'static str, tool: Tool, about: &'static str) -> Verb {
    Verb {
        name,
        about,
        tool: Some(tool),
    }
}

impl Verb {
    /// The command of a name.
    pub(crate) fn named(name: &str) -> Result<&'static Self> {
        let found = VERBS.iter().find(|verb| verb.name == name);
        found.with_context(|| format!("there is no command {name}"))
    }

    /// Does it, which a tool does in place of this program.
    pub(crate) fn start(&self, arguments: Vec<OsString>) -> Result<ExitCode> {
        let Some(tool) = self.tool else {
            return test::start(arguments);
        };
        self.check(&arguments)?;
        // A tool of several commands is told which.
        let name = (self.name != tool.program).then(|| self.name.into());
        tools::become_tool(tool, name.into_iter().chain(arguments))
    }

    /// Makes sure that what the command uses is there: that is told before anything is compiled.
    fn check(&self, arguments: &[OsString]) -> Result<()> {
        let given = Given::new(arguments);
        if ["--help", "-h", "--version", "-V"]
            .map(|option| given.has(option))
            .contains(&true)
        {
            return Ok(());
        }
        for path in given.files(self.name) {
            // The same sentence for whatever cannot be opened: a program, settings, a port.
            let read =
                fs::metadata(path).with_context(|| format!("cannot open {}", path.display()))?;
            ensure!(
                !read.is_file() || !given.writes(&read),
                "{} would be written over: it is what is read",
                path.display()
            );
        }
        if self.needs_qemu(&given) {
            ensure!(
                cargo::clock_mhz() == cargo::USUAL_CLOCK_MHZ,
                "the emulated board runs at {} MHz: `--clock` is for the virtual machine",
                cargo::USUAL_CLOCK_MHZ
            );
            cargo::need_qemu()?;
        }
        if self.needs_probe(&given) {
            let needed = probe::need(given.value("--probe").and_then(OsStr::to_str));
            if self.name == "bring-up" {
                needed.context(probe::BRING_UP)?;
            } else {
                needed?;
            }
        }
        Ok(())
    }

    fn needs_qemu(&self, given: &Given) -> bool {
        match self.name {
            "bench" | "qemu" | "run" => true,
            "latency" => given.value("--board").is_none(),
            "bring-up" | "calibrate" => given.has("--qemu"),
            "schedule" => given.has("--replay"),
            "sim" => given.has("--on-target"),
            _ => false,
        }
    }

    fn needs_probe(&self, given: &Given) -> bool {
        match self.name {
            "flash" => true,
            "latency" => given.value("--board").is_some(),
            "calibrate" => !given.has("--qemu"),
            "bring-up" => !given.has("--qemu") && !given.has("--verify"),
            _ => false,
        }
    }
}

/// Options that name something to be read, of any command.
const READ: [&str; 9] = [
    "--settings",
    "--load",
    "--measure",
    "--diff",
    "--elf",
    "--port",
    "--session",
    "--tool-table",
    "--verify",
];
/// Options that name a file to be written, of any command.
const WRITTEN: [&str; 11] = [
    "--coils",
    "--html",
    "--json",
    "--out",
    "--output",
    "--picture",
    "--plot",
    "--save",
    "--svg",
    "--trace",
    "-o",
];
/// Commands whose argument is something to be read.
const READERS: [&str; 8] = [
    "conformance",
    "latency",
    "monitor",
    "qemu",
    "run",
    "send",
    "sim",
    "view",
];
/// Their options without a value.
const FLAGS: [&str; 13] = [
    "--confirmed",
    "--despite-refusals",
    "--home",
    "--locked",
    "--no-open",
    "--on-target",
    "--qemu",
    "--quality",
    "--resume",
    "--sim",
    "--switches",
    "--wait",
    "--all",
];

/// What was typed behind a command.
struct Given<'a>(Vec<&'a OsStr>);

impl<'a> Given<'a> {
    /// Options and their values apart: `--settings=FILE` are two.
    fn new(arguments: &'a [OsString]) -> Self {
        let both = arguments.iter().flat_map(|argument| {
            let halves = argument.to_str().filter(|text| text.starts_with("--"));
            match halves.and_then(|text| text.split_once('=')) {
                Some((option, value)) => vec![OsStr::new(option), OsStr::new(value)],
                None => vec![argument.as_os_str()],
            }
        });
        Self(both.collect())
    }

    fn has(&self, option: &str) -> bool {
        self.0.iter().any(|argument| *argument == option)
    }

    fn value(&self, option: &str) -> Option<&'a OsStr> {
        let place = self.0.iter().position(|argument| *argument == option)?;
        self.0.get(place + 1).copied()
    }

    /// Whether a file is to be written, under whatever name.
    fn writes(&self, file: &Metadata) -> bool {
        let named = WRITTEN.iter().filter_map(|option| self.value(option));
        let mut written = named.filter_map(|path| fs::metadata(path).ok());
        written.any(|known| (known.dev(), known.ino()) == (file.dev(), file.ino()))
    }

    /// What is to be read.
    fn files(&self, command: &str) -> Vec<&'a Path> {
        let named = READ.iter().filter_map(|option| self.value(option));
        let is_option = |text: &OsStr| text.to_str().is_some_and(|text| text.starts_with('-'));
        let is_flag = |text: &OsStr| FLAGS.iter().any(|flag| text == *flag);
        let first = self.0.iter().enumerate().find(|(index, argument)| {
            let before = index.checked_sub(1).map(|before| self.0[before]);
            // Otherwise it is the value of that option.
            !is_option(argument)
                && before.is_none_or(|before| !is_option(before) || is_flag(before))
        });
        let first = first.filter(|_| READERS.contains(&command));
        let all = named.chain(first.map(|(_, argument)| *argument));
        all.filter(|path| *path != "-").map(Path::new).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sources below a folder.
    fn sources(folder: &Path) -> String {
        let entries = fs::read_dir(folder).unwrap();
        let paths = entries.map(|entry| entry.unwrap().path());
        let texts = paths.map(|path| match path.extension() {
            _ if path.is_dir() => sources(&path),
            Some(extension) if extension == "rs" => fs::read_to_string(path).unwrap(),
            _ => String::new(),
        });
        texts.collect()
    }

    #[test]
    fn each_line_of_the_help_is_the_first_of_a_commands_own() {
        let folders = ["xtask", "proof", "tests"].map(|name| cargo::root().join(name));
        let sources = folders.map(|folder| sources(&folder)).concat();
        for verb in &VERBS {
            let own = format!("\n/// {}\n///\n", verb.about);
            let short = format!("\n/// {}\n#[derive", verb.about);
            assert!(
                sources.contains(&own) || sources.contains(&short),
                "{}",
                verb.name
            );
        }
    }

    fn typed(line: &str) -> (&'static Verb, Vec<OsString>) {
        let mut words = line.split(' ');
        let verb = Verb::named(words.next().unwrap()).unwrap();
        (verb, words.map(OsString::from).collect())
    }

    #[test]
    fn what_a_command_uses_is_known_before_it_is_compiled() {
        for (line, qemu, probe) in [
            ("qemu a.nc", true, false),
            ("sim a.nc", false, false),
            ("sim a.nc --on-target", true, false),
            ("latency", true, false),
            ("latency --board mill", false, true),
            ("flash --board mill", false, true),
            ("calibrate --qemu", true, false),
            ("bring-up --board mill", false, true),
            ("bring-up --board mill --qemu", true, false),
            ("bring-up --verify a.json", false, false),
            ("test", false, false),
        ] {
            let (verb, arguments) = typed(line);
            let given = Given::new(&arguments);
            assert_eq!(verb.needs_qemu(&given), qemu, "{line}");
            assert_eq!(verb.needs_probe(&given), probe, "{line}");
        }
    }

    #[test]
    fn what_is_read_is_not_written_over() {
        let file = env!("CARGO_MANIFEST_PATH");
        let other = concat!(env!("CARGO_MANIFEST_DIR"), "/../xtask/Cargo.toml");
        for line in [
            format!("view {file} -o {file}"),
            format!("view {file} --picture={other}"),
            format!("sim {file} --plot {other}"),
            format!("sim - --settings {file} --json {file}"),
        ] {
            let (verb, arguments) = typed(&line);
            let error = verb.check(&arguments).unwrap_err().to_string();
            assert_eq!(
                error,
                format!("{file} would be written over: it is what is read")
            );
        }
        for line in [
            format!("view {file} -o {file}.html"),
            "sim /dev/null --json /dev/null".into(),
        ] {
            let (verb, arguments) = typed(&line);
            assert!(verb.check(&arguments).is_ok(), "{line}");
        }
    }

    #[test]
    fn missing_files_and_ports_are_told_at_once() {
        for (line, missing) in [
            ("sim no.nc --plot a.svg", "no.nc"),
            ("sim --quality no.nc", "no.nc"),
            ("sim --set $0=1 no.nc", "no.nc"),
            ("sim - --settings=no.settings", "no.settings"),
            ("settings --port /dev/no --save a.settings", "/dev/no"),
            (
                "settings --tcp localhost:1 --load no.settings",
                "no.settings",
            ),
            ("qemu no.nc", "no.nc"),
            ("monitor --sim no.nc --svg a.svg", "no.nc"),
            ("monitor --port /dev/no", "/dev/no"),
            ("view --no-open no.nc -o a.html", "no.nc"),
            ("send --resume no.nc --tcp localhost:1", "no.nc"),
            ("send --wait no.nc --tcp localhost:1", "no.nc"),
            ("run no.elf", "no.elf"),
            ("bring-up --verify no.json", "no.json"),
        ] {
            let (verb, arguments) = typed(line);
            let error = verb.check(&arguments).unwrap_err().to_string();
            assert_eq!(error, format!("cannot open {missing}"), "{line}");
        }
        for line in [
            "sim --help no.nc",
            "sim - --json a.json",
            "sim --pty a",
            "docs --check",
        ] {
            let (verb, arguments) = typed(line);
            assert!(verb.check(&arguments).is_ok(), "{line}");
        }
    }
}
