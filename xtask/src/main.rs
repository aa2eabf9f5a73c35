//! `cargo xtask`: starts the tools of Leadscrew, each of which is a program of its own.
//!
//! A tool is compiled when it is used for the first time, with what it needs and no more.

mod test;
mod verb;

use std::{
    ffi::{OsStr, OsString},
    process::ExitCode,
};

use anyhow::{Context, Result};
use clap::{Arg, Command, value_parser};
use common::{cargo, ui};

use verb::{VERBS, Verb};

/// The names of the options that every command has, and of the arguments of each.
const AXES: &str = "axes";
const CLOCK: &str = "clock";
const ARGUMENTS: &str = "arguments";

fn main() -> ExitCode {
    let matches = command().get_matches();
    common::main(|| {
        let (name, rest) = matches.subcommand().context("no command is given")?;
        let verb = Verb::named(name)?;
        let rest = rest.get_many(ARGUMENTS).into_iter().flatten().cloned();
        let (behind, rest) = without(AXES, axes, rest.collect())?;
        if let Some(axes) = behind.or(matches.get_one(AXES).copied()) {
            cargo::ask_for_axes(axes);
        }
        let (behind, arguments) = without(CLOCK, clock, rest)?;
        if let Some(mhz) = behind.or(matches.get_one(CLOCK).copied()) {
            cargo::ask_for_clock(mhz);
        }
        verb.start(arguments)
    })
}

/// What may be typed: the arguments of a command are its own matter.
fn command() -> Command {
    let verbs = VERBS.iter().map(|verb| {
        let arguments = Arg::new(ARGUMENTS)
            .num_args(0..)
            .trailing_var_arg(true)
            .allow_hyphen_values(true)
            .value_parser(value_parser!(OsString));
        Command::new(verb.name)
            .about(verb.about)
            .disable_help_flag(true)
            .arg(arguments)
    });
    let axes = Arg::new(AXES)
        .long(AXES)
        .value_name("N")
        .value_parser(axes)
        .help("Number of axes, 3 to 6, of the firmware and of the virtual machine; before a command or behind it");
    let clock = Arg::new(CLOCK)
        .long(CLOCK)
        .value_name("MHZ")
        .value_parser(clock)
        .help(
            "Clock of the chip that the virtual machine is, 168 or 96: a board's file says its own",
        );
    Command::new("xtask")
        .bin_name("cargo xtask")
        .about("Builds, simulates, tests and flashes Leadscrew")
        .long_about(
            "Builds, simulates, tests and flashes Leadscrew.\n\n\
             Start with `cargo xtask sim examples/…` to see a program run, and `cargo xtask test` to \
             see everything tested that needs no hardware. Each command tells more with --help.",
        )
        .version(env!("CARGO_PKG_VERSION"))
        .styles(ui::STYLES)
        .max_term_width(100)
        .disable_help_subcommand(true)
        .subcommand_required(true)
        .arg_required_else_help(true)
        .arg(axes)
        .arg(clock)
        .subcommands(verbs)
}

/// Reads a number of axes.
fn axes(text: &str) -> Result<u8, String> {
    match text.parse() {
        Ok(axes @ 3..=6) => Ok(axes),
        _ => Err("a machine has 3 to 6 axes".into()),
    }
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

/// Takes an option with a value out of the arguments of a command.
fn without<T>(
    option: &str,
    read: impl Fn(&str) -> Result<T, String>,
    arguments: Vec<OsString>,
) -> Result<(Option<T>, Vec<OsString>)> {
    let option = format!("--{option}");
    let mut found = None;
    let mut others = Vec::new();
    let mut arguments = arguments.into_iter();
    while let Some(argument) = arguments.next() {
        let text = argument.to_string_lossy();
        let value = match text.strip_prefix(&option) {
            _ if text == "--" => {
                drop(text);
                others.push(argument);
                others.extend(arguments);
                break;
            }
            Some("") => arguments.next().unwrap_or_default(),
            Some(value) if value.starts_with('=') => OsStr::new(&value[1..]).to_owned(),
            _ => {
                drop(text);
                others.push(argument);
                continue;
            }
        };
        let value = read(&value.to_string_lossy());
        found = Some(value.map_err(anyhow::Error::msg).context(option.clone())?);
    }
    Ok((found, others))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(line: &str) -> Result<(Option<u8>, String)> {
        let (axes, rest) = without(AXES, axes, line.split(' ').map(OsString::from).collect())?;
        let rest: Vec<_> = rest.iter().map(|text| text.to_string_lossy()).collect();
        Ok((axes, rest.join(" ")))
    }

    #[test]
    fn the_number_of_axes_is_taken_out_of_the_arguments() {
        for (line, axes, rest) in [
            ("a.nc --plot b.svg", None, "a.nc --plot b.svg"),
            ("--axes 4 a.nc", Some(4), "a.nc"),
            ("a.nc --axes=6 --quality", Some(6), "a.nc --quality"),
            ("a.elf -- --axes 4", None, "a.elf -- --axes 4"),
        ] {
            assert_eq!(taken(line).unwrap(), (axes, rest.to_owned()), "{line}");
        }
        for line in ["--axes", "--axes 2", "--axes=7", "--axes X"] {
            assert!(taken(line).is_err(), "{line}");
        }
    }

    #[test]
    fn the_clock_is_one_of_those_that_chips_have() {
        let line = ["a.nc", "--clock", "96", "--axes=4"].map(OsString::from);
        let (clock_mhz, rest) = without(CLOCK, clock, line.into()).unwrap();
        assert_eq!((clock_mhz, rest.len()), (Some(96), 2));
        let error = without(CLOCK, clock, vec!["--clock=100".into()]).unwrap_err();
        assert_eq!(format!("{error:#}"), "--clock: chips run at 168 or 96 MHz");
    }

    #[test]
    fn commands_are_told_apart_from_their_arguments() {
        command().debug_assert();
        let typed = ["xtask", "--axes", "4", "sim", "--help", "a.nc"];
        let matches = command().get_matches_from(typed);
        assert_eq!(matches.get_one(AXES), Some(&4_u8));
        let (name, rest) = matches.subcommand().unwrap();
        let rest = rest.get_many::<OsString>(ARGUMENTS).unwrap();
        assert_eq!(name, "sim");
        assert!(rest.eq(["--help", "a.nc"].iter()));
        assert!(command().try_get_matches_from(["xtask", "mill"]).is_err());
    }
}
