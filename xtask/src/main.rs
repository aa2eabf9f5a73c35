//! `cargo xtask`: starts the tools of Leadscrew, each of which is a program of its own.
//!
//! A tool is compiled when it is used for the first time, with what it needs and no more.

mod test;

use std::{env, process::ExitCode};

use common::{
    options::{CommandLine, Verb},
    tools,
};

fn main() -> ExitCode {
    common::main(|| {
        let line = CommandLine::checked(env::args_os())?;
        match (line.verb.tool(), line.verb) {
            (Some(tool), _) => tools::become_tool(tool, env::args_os().skip(1)),
            (None, Verb::Test(options)) => test::start(&options),
            (None, other) => other.refuse(),
        }
    })
}
