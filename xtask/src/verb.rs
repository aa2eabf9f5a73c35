//! The commands: what each is, and which tool it is a part of.

use std::{ffi::OsString, process::ExitCode};

use anyhow::{Context, Result};
use common::{
    cargo,
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
pub(crate) const VERBS: [Verb; 14] = [
    verb(
        "bench",
        tools::TARGET,
        "Count what the firmware costs on the emulated chip, in instructions and modelled cycles",
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
        "latency",
        tools::TARGET,
        "Measure how long tasks wait and take, beside the bounds that are proven",
    ),
    verb(
        "qemu",
        tools::TARGET,
        "Run a G-code program on the firmware itself, on the emulated board",
    ),
    verb(
        "run",
        tools::RUN,
        "Run an ELF file on the emulated board and print its log",
    ),
    verb(
        "schedule",
        tools::SCHEDULE,
        "Prove from the machine code that every task meets its deadline",
    ),
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
    Verb {
        name: "test",
        about: "Test everything that needs no hardware",
        tool: None,
    },
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
        if self.needs_qemu(&arguments) {
            cargo::need_qemu()?;
        }
        // A tool of several commands is told which.
        let name = (self.name != tool.package).then(|| self.name.into());
        tools::become_tool(tool, name.into_iter().chain(arguments))
    }

    /// Whether QEMU has to be there, which is told before anything is compiled.
    fn needs_qemu(&self, arguments: &[OsString]) -> bool {
        let has = |option: &str| arguments.iter().any(|argument| argument == option);
        !has("--help")
            && !has("-h")
            && match self.name {
                "bench" | "qemu" | "run" => true,
                "latency" => !has("--board"),
                "calibrate" => has("--qemu"),
                "schedule" => has("--replay"),
                "sim" => has("--on-target"),
                _ => false,
            }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// The sources of a tool that has a command.
    fn source(verb: &Verb) -> String {
        let package = verb.tool.map_or("src", |tool| tool.package);
        let folder = match package {
            "src" => "xtask/src".to_owned(),
            "schedule" => "xtask/schedule/src/bin/schedule".to_owned(),
            other => format!("xtask/{other}/src"),
        };
        let files = fs::read_dir(cargo::root().join(folder)).unwrap();
        let files = files.map(|file| file.unwrap().path());
        let files = files.filter(|path| path.is_file());
        files
            .map(|path| fs::read_to_string(path).unwrap())
            .collect()
    }

    #[test]
    fn each_line_of_the_help_is_the_first_of_a_commands_own() {
        for verb in &VERBS {
            let own = format!("\n/// {}\n///\n", verb.about);
            let short = format!("\n/// {}\n#[derive", verb.about);
            let source = source(verb);
            assert!(
                source.contains(&own) || source.contains(&short),
                "{}",
                verb.name
            );
        }
    }

    #[test]
    fn qemu_is_needed_where_something_is_emulated() {
        for (line, needs) in [
            ("qemu a.nc", true),
            ("qemu --help", false),
            ("sim a.nc", false),
            ("sim a.nc --on-target", true),
            ("latency", true),
            ("latency --board mill", false),
            ("test", false),
        ] {
            let mut words = line.split(' ');
            let verb = Verb::named(words.next().unwrap()).unwrap();
            let arguments: Vec<_> = words.map(OsString::from).collect();
            assert_eq!(verb.needs_qemu(&arguments), needs, "{line}");
        }
    }
}
