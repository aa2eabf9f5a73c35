//! What may be typed behind `cargo xtask`: every command with its options.
//!
//! The dispatcher reads it before it compiles anything, so that help and what cannot work are told at once; the tool
//! that does a command reads the same.

mod checks;
mod files;
mod firmware;
mod machine;
mod pages;
mod proof;

use std::{env, ffi::OsString, process::ExitCode};

use anyhow::{Result, bail, ensure};
use clap::{ArgMatches, CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

pub use self::{
    checks::*,
    files::{InputPath, OutputPath},
    firmware::*,
    machine::*,
    pages::*,
    proof::*,
};
use crate::{
    cargo, probe,
    tools::{self, Tool},
    ui,
};

/// Builds, simulates, tests and flashes Leadscrew
///
/// Start with `cargo xtask sim examples/…` to see a program run, and `cargo xtask test` for the quick tests. Each
/// command tells more with --help.
#[derive(Debug, Parser)]
#[command(
    name = "xtask",
    bin_name = "cargo xtask",
    version,
    propagate_version = true
)]
#[command(styles = ui::STYLES, max_term_width = 100, disable_help_subcommand = true)]
pub struct CommandLine {
    /// Number of axes, 3 to 6, of the firmware and of the virtual machine
    #[arg(long, value_name = "N", global = true, value_parser = clap::value_parser!(u8).range(3..=6))]
    pub axes: Option<u8>,
    /// Clock of the chip that the virtual machine is, 168 or 96: a board's file says its own
    #[arg(long, value_name = "MHZ", global = true, value_parser = clock)]
    pub clock: Option<u32>,
    /// The command.
    #[command(subcommand)]
    pub verb: Verb,
}

/// A command.
#[derive(Debug, Subcommand)]
#[allow(missing_docs, reason = "the options of each say what it does")]
pub enum Verb {
    Bench(Bench),
    #[command(subcommand)]
    Board(Board),
    BringUp(BringUp),
    Build(Build),
    Calibrate(Calibrate),
    Conformance(Conformance),
    Docs(Docs),
    Flash(Flash),
    Fuzz(Fuzz),
    Latency(Latency),
    Monitor(Monitor),
    Qemu(Qemu),
    Rehearse(Rehearse),
    Release(Release),
    Run(Run),
    Schedule(Schedule),
    Send(Send),
    Settings(Settings),
    Sim(Sim),
    Size(Size),
    Soak(Soak),
    Test(Test),
    View(View),
    Web(Web),
    /// Build every firmware of a board
    #[command(hide = true)]
    All {
        /// The board
        board: String,
    },
    /// List the boards, and which of them are emulated
    #[command(hide = true)]
    Boards,
    #[command(hide = true)]
    Check(Check),
    #[command(hide = true)]
    Replay(Replay),
    /// Build the firmware and test it over its serial line
    #[command(hide = true)]
    Serial {
        /// Only the tests whose names contain one of these
        only: Vec<String>,
    },
    #[command(hide = true)]
    SimOnTarget(SimOnTarget),
    #[command(hide = true)]
    ReleaseImage(ReleaseImage),
    #[command(hide = true)]
    Room(Room),
}

/// Reads the clock of a chip.
fn clock(text: &str) -> Result<u32, String> {
    let known = [cargo::USUAL_CLOCK_MHZ]
        .into_iter()
        .chain(cargo::OTHER_CLOCKS_MHZ);
    match text.parse() {
        Ok(mhz) if known.clone().any(|it| it == mhz) => Ok(mhz),
        _ => {
            let known: Vec<_> = known.map(|mhz| mhz.to_string()).collect();
            Err(format!("chips run at {} MHz", known.join(" or ")))
        }
    }
}

impl CommandLine {
    /// Reads a command line, and makes sure that what the command uses is there.
    ///
    /// # Errors
    ///
    /// What cannot be opened, or is not attached or installed. Options that do not exist, and help, end the program.
    pub fn checked(arguments: impl IntoIterator<Item = OsString>) -> Result<Self> {
        let matches = Self::command().get_matches_from(arguments);
        let line = Self::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
        if let Some(axes) = line.axes {
            cargo::ask_for_axes(axes);
        }
        if let Some(mhz) = line.clock {
            cargo::ask_for_clock(mhz);
        }
        line.verb.check(innermost(&matches))?;
        Ok(line)
    }
}

/// The options of the command itself.
fn innermost(matches: &ArgMatches) -> &ArgMatches {
    match matches.subcommand() {
        Some((_, own)) => innermost(own),
        None => matches,
    }
}

/// The command that this program was started for.
pub fn read() -> Verb {
    CommandLine::parse().verb
}

impl Verb {
    /// The tool that does it; none: the dispatcher.
    pub fn tool(&self) -> Option<Tool> {
        Some(match self {
            Self::Bench(_)
            | Self::BringUp(_)
            | Self::Calibrate(_)
            | Self::Check(_)
            | Self::Latency(_)
            | Self::Qemu(_)
            | Self::Replay(_)
            | Self::Run(_)
            | Self::SimOnTarget(_) => tools::TARGET,
            Self::Board(Board::Import(_)) => tools::IMPORT,
            Self::Rehearse(options) if options.faults.is_some() => tools::SOAK,
            Self::All { .. }
            | Self::Board(_)
            | Self::Boards
            | Self::Build(_)
            | Self::Rehearse(_)
            | Self::Release(_)
            | Self::ReleaseImage(_)
            | Self::Room(_)
            | Self::Serial { .. }
            | Self::Size(_) => tools::FIRMWARE,
            Self::Conformance(_) => tools::CONFORMANCE,
            Self::Docs(_) => tools::DOCS,
            Self::Flash(options) if options.dfu => tools::DFU,
            Self::Flash(options) if options.to.is_some() => tools::FIRMWARE,
            Self::Flash(_) => tools::PROBE,
            Self::Fuzz(_) | Self::Soak(_) => tools::SOAK,
            Self::Monitor(_) => tools::MONITOR,
            Self::Schedule(_) => tools::SCHEDULE,
            Self::Send(_) => tools::SEND,
            Self::Settings(_) => tools::SETTINGS,
            Self::Sim(_) => tools::SIM,
            Self::Test(options) if options.clients => tools::CLIENTS,
            Self::Test(options) if options.faults.is_some() => tools::SOAK,
            Self::Test(_) => return None,
            Self::View(_) => tools::VIEW,
            Self::Web(_) => tools::WEB,
        })
    }

    /// Says that another program does this command.
    ///
    /// # Errors
    ///
    /// Always.
    pub fn refuse(&self) -> Result<ExitCode> {
        let name = env::args().next().unwrap_or_default();
        bail!("{name} does not do that: `cargo xtask` starts what does")
    }

    /// Makes sure that what the command uses is there.
    fn check(&self, options: &ArgMatches) -> Result<()> {
        // It waits until its port is there.
        let waits = matches!(self, Self::Send(options) if options.wait);
        files::check(options, waits.then_some("port"))?;
        if self.needs_qemu() {
            ensure!(
                cargo::clock_mhz() == cargo::USUAL_CLOCK_MHZ,
                "the emulated board runs at {} MHz: `--clock` is for the virtual machine",
                cargo::USUAL_CLOCK_MHZ
            );
            cargo::need_qemu()?;
        }
        match self {
            Self::Flash(Flash { dfu: true, .. }) => {
                probe::announce_dfu();
                Ok(())
            }
            Self::Flash(Flash {
                probe, to: None, ..
            })
            | Self::Calibrate(Calibrate {
                probe, qemu: false, ..
            })
            | Self::Latency(Latency {
                probe,
                board: Some(_),
                ..
            }) => probe::need(probe.as_deref()),
            Self::BringUp(BringUp {
                probe,
                qemu: false,
                virtual_board: false,
                verify: None,
                ..
            }) => probe::need(probe.as_deref()).map_err(|error| error.context(probe::BRING_UP)),
            _ => Ok(()),
        }
    }

    fn needs_qemu(&self) -> bool {
        match self {
            Self::Bench(_) | Self::Qemu(_) | Self::Run(_) => true,
            Self::Latency(options) => options.board.is_none(),
            Self::BringUp(options) => options.qemu,
            Self::Calibrate(options) => options.qemu,
            Self::Schedule(options) => options.replay,
            Self::Sim(options) => options.on_target,
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn typed(line: &str) -> (Verb, ArgMatches) {
        let words = ["xtask"].into_iter().chain(line.split(' '));
        let matches = CommandLine::command().try_get_matches_from(words);
        let matches = matches.unwrap_or_else(|error| panic!("{line}: {error}"));
        let verb = CommandLine::from_arg_matches(&matches).unwrap().verb;
        (verb, innermost(&matches).clone())
    }

    /// What is wrong before anything is compiled.
    fn wrong(line: &str) -> String {
        let (verb, options) = typed(line);
        let waits = matches!(&verb, Verb::Send(options) if options.wait);
        let checked = files::check(&options, waits.then_some("port"));
        checked.map_or_else(|error| error.to_string(), |()| String::new())
    }

    #[test]
    fn the_command_line_is_consistent_and_takes_axes_and_clock_anywhere() {
        CommandLine::command().debug_assert();
        let read = |line: &str| CommandLine::try_parse_from(line.split(' '));
        for (line, axes, clock) in [
            ("xtask --axes 4 sim a.nc", Some(4), None),
            ("xtask sim a.nc --axes=6 --quality", Some(6), None),
            ("xtask sim --clock 96 a.nc", None, Some(96)),
            ("xtask run a.elf -- --axes 4", None, None),
        ] {
            let line = read(line).unwrap();
            assert_eq!((line.axes, line.clock), (axes, clock), "{line:?}");
        }
        for line in ["--axes", "--axes 2", "--axes=7", "--axes X", "--clock=100"] {
            assert!(read(&format!("xtask sim a.nc {line}")).is_err(), "{line}");
        }
        assert!(read("xtask mill").is_err());
    }

    #[test]
    fn what_a_command_uses_is_known_before_it_is_compiled() {
        for (line, qemu) in [
            ("qemu a.nc", true),
            ("sim a.nc", false),
            ("sim a.nc --on-target", true),
            ("latency", true),
            ("latency --board mill", false),
            ("flash --board mill", false),
            ("calibrate --board mill --qemu", true),
            ("bring-up --board mill --qemu", true),
            ("bring-up --verify a.json", false),
            ("schedule --replay", true),
            ("test", false),
        ] {
            assert_eq!(typed(line).0.needs_qemu(), qemu, "{line}");
        }
    }

    #[test]
    fn a_firmware_is_flashed_by_the_tool_that_has_what_it_takes() {
        for (line, tool) in [
            ("flash --board mill", tools::PROBE),
            ("flash --board mill --to card", tools::FIRMWARE),
            ("flash --board mill --dfu", tools::DFU),
            ("flash --from release --dfu", tools::DFU),
            ("flash --from release --to card", tools::FIRMWARE),
        ] {
            assert_eq!(typed(line).0.tool(), Some(tool), "{line}");
        }
        let read = |line: &str| CommandLine::try_parse_from(line.split(' '));
        for line in [
            "--dfu",
            "--board a --dfu --to b",
            "--board a --dfu --probe b",
            "--from a --unproven",
        ] {
            assert!(read(&format!("xtask flash {line}")).is_err(), "{line}");
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
            assert_eq!(
                wrong(&line),
                format!("{file} would be written over: it is what is read")
            );
        }
        for line in [
            format!("view {file} -o {file}.html"),
            "sim /dev/null --json /dev/null".into(),
        ] {
            assert_eq!(wrong(&line), "", "{line}");
        }
    }

    #[test]
    fn missing_files_and_ports_are_told_at_once() {
        for (line, missing) in [
            ("sim no.nc --plot a.svg", "no.nc"),
            ("sim --quality no.nc", "no.nc"),
            ("sim --set $0=1 no.nc", "no.nc"),
            ("sim - --settings=no.settings", "no.settings"),
            ("sim - --tool-table no.tbl", "no.tbl"),
            ("settings --port /dev/no --save a.settings", "/dev/no"),
            (
                "settings --tcp localhost:1 --load no.settings",
                "no.settings",
            ),
            ("qemu no.nc", "no.nc"),
            ("conformance no", "no"),
            ("monitor --sim no.nc --svg a.svg", "no.nc"),
            ("monitor --sim --program no.nc", "no.nc"),
            ("monitor --port /dev/no", "/dev/no"),
            ("view --no-open no.nc -o a.html", "no.nc"),
            ("send --resume no.nc --tcp localhost:1", "no.nc"),
            ("send /dev/null --port /dev/no", "/dev/no"),
            ("run no.elf", "no.elf"),
            ("bring-up --verify no.json", "no.json"),
            ("board import no.cfg", "no.cfg"),
            ("flash --from no --dfu", "no"),
        ] {
            assert_eq!(wrong(line), format!("cannot open {missing}"), "{line}");
        }
        for line in [
            "sim - --json a.json",
            "sim --pty a",
            "docs --check",
            "send /dev/null --port /dev/no --wait",
        ] {
            assert_eq!(wrong(line), "", "{line}");
        }
    }
}
